//! The tasks that hand over to one cargo command.

use anyhow::{Context, Result, bail};

use crate::lint;
use crate::shell::{run_cargo, run_cargo_with};

/// `cargo test --workspace`, the test command of the README.
///
/// `slow` runs the ignored suites afterwards, those on a device among them, which need an adapter, and checks the features
/// of each crate; `gpu` makes a missing
/// adapter an error. Without one, the tests on a device stay ignored, and each crate tells how many.
pub(crate) fn test(gpu: bool, slow: bool) -> Result<()> {
    let env: &[(&str, &str)] = if gpu { &[("PHOTOFIT_REQUIRE_GPU", "1")] } else { &[] };
    run_cargo_with(&["test", "--workspace"], env)?;
    if slow {
        run_cargo_with(&["test", "--workspace", "--", "--ignored"], env)?;
        lint::features_one_by_one()?;
    }
    Ok(())
}

/// `golden report | accept NAME... | prune`.
pub(crate) fn golden(args: &[String]) -> Result<()> {
    match args.first().map(String::as_str) {
        Some("report" | "prune") if args.len() == 1 => {}
        Some("accept") if args.len() > 1 => {}
        _ => bail!("expected `golden report`, `golden accept NAME...` or `golden prune`"),
    }
    // The same profile as the tests, so that an accepted image is the one that the tests will render.
    pass_on(&["run", "--quiet", "-p", "photofit-tests", "--bin", "golden", "--"], args)
}

/// Error-against-time suites; `peers [NAME...]` are the tables against other programs.
pub(crate) fn bench(args: &[String]) -> Result<()> {
    if let Some((first, names)) = args.split_first()
        && first == "peers"
    {
        return peers(names);
    }
    pass_on(&["run", "--release", "-p", "photofit-bench", "--"], args)
}

/// The drivers in crates/bench/peers, by the interpreter that `PHOTOFIT_PYTHON` names, or `python3`.
fn peers(names: &[String]) -> Result<()> {
    let python = std::env::var_os("PHOTOFIT_PYTHON").unwrap_or_else(|| "python3".into());
    let status = std::process::Command::new(&python).arg("crates/bench/peers/run.py").args(names).status();
    let status = status.with_context(|| {
        format!(
            "{}: cannot start; `apt-get install python3`, or name one by PHOTOFIT_PYTHON",
            python.display()
        )
    })?;
    if !status.success() {
        bail!("bench peers: {status}");
    }
    Ok(())
}

/// The main job on a generated asset.
pub(crate) fn demo(args: &[String]) -> Result<()> {
    pass_on(&["run", "--release", "-p", "photofit-cli", "--", "demo"], args)
}

fn pass_on(command: &[&str], args: &[String]) -> Result<()> {
    let all: Vec<&str> = command.iter().copied().chain(args.iter().map(String::as_str)).collect();
    run_cargo(&all)
}
