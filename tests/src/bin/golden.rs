//! Golden images from the command line: `cargo xtask golden report | accept NAME... | prune`.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command-line program reports on its streams"
)]

use std::fs;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use photofit_tests::cases::CASES;
use photofit_tests::{report, suite};

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("golden: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &[String]) -> Result<()> {
    let folder = suite::golden_folder();
    match args {
        [task] if task == "report" => {
            let outcomes = suite::run(CASES, &folder);
            for outcome in &outcomes {
                println!("{} {}", if outcome.passed() { "ok    " } else { "FAILED" }, outcome.summary());
            }
            let path = suite::report_path();
            report::write(&path, &outcomes)?;
            println!("{}", path.display());
            let failed = outcomes.iter().filter(|o| !o.passed()).count();
            if failed > 0 {
                bail!("{failed} of {} cases differ", outcomes.len());
            }
        }
        [task, names @ ..] if task == "accept" && !names.is_empty() => {
            for path in suite::accept(CASES, &folder, names)? {
                println!("wrote {}", path.display());
            }
        }
        [task] if task == "prune" => {
            for path in suite::orphans(CASES, &folder)? {
                fs::remove_file(&path).with_context(|| format!("{}: cannot delete", path.display()))?;
                println!("deleted {}", path.display());
            }
        }
        _ => bail!("expected report, accept NAME... or prune"),
    }
    Ok(())
}
