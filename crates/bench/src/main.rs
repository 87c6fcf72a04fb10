//! Error-against-time suites: `cargo xtask bench [SUITE...] [--baseline]`.
//!
//! A suite is one file in `suites/` with `pub fn run(ctx: &mut Context) -> Result<()>` and one line in
//! [`suites::SUITES`]. What it records lands in `out/bench` as JSON, SVG plots and a Markdown table; with
//! `--baseline` it also times its reference method, in the same run, because times of different runs do not compare.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command-line program reports on its streams"
)]

mod context;
mod plot;
mod points;
mod suites;
mod timing;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};

use context::Context;
use suites::SUITES;

fn main() -> ExitCode {
    match run(std::env::args().skip(1)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: impl Iterator<Item = String>) -> Result<()> {
    let mut baseline = false;
    let mut names = Vec::new();
    for arg in args {
        match arg.as_str() {
            "--baseline" => baseline = true,
            "--list" => {
                for suite in SUITES {
                    println!("{:10} {}", suite.name, suite.about);
                }
                return Ok(());
            }
            name if SUITES.iter().any(|suite| suite.name == name) => names.push(arg),
            other => bail!("no suite or option `{other}`; suites: {}", list()),
        }
    }
    for suite in SUITES.iter().filter(|suite| names.is_empty() || names.iter().any(|n| n == suite.name)) {
        println!("\n# {}: {}", suite.name, suite.about);
        let mut context = Context::new(suite.name, suite.about, baseline);
        (suite.run)(&mut context)?;
        let folder = Path::new("out/bench");
        context.write(folder)?;
        print!("\n{}", context.markdown());
        println!("\nwrote {}", folder.join(suite.name).display());
    }
    Ok(())
}

fn list() -> String {
    SUITES.iter().map(|suite| suite.name).collect::<Vec<_>>().join(", ")
}
