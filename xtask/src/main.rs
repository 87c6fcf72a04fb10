//! Workspace tasks: `cargo xtask <task>`; without a task it lists them.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command-line program reports on its streams"
)]

mod ci;
mod dist;
mod judge;
mod lint;
mod shaders;
mod shell;
mod tasks;
mod tidy;
mod web;

use std::process::ExitCode;

use anyhow::{Result, bail};

const USAGE: &str = "\
cargo xtask <task>

  ci [--no-test]            everything CI runs, in order: tidy, lint, shaders, web, test
  tidy                      formatting, layers, module docs, file length, ARCHITECTURE.md, one glam
  lint                      clippy and rustdoc without warnings, cargo-deny
  features                  clippy on each library with none of its features and with each of them alone, some minutes
  shaders                   the kernels of all crates, parsed and validated without a device
  web [--browser]           compile the crates that work on arrays, with and without their kernels, for browsers, where
                            that target is installed; --browser runs twins in headless Chromium
  test [--gpu] [--slow]     cargo test --workspace; --slow adds the ignored suites and `features`, --gpu requires an adapter
  golden report             compare all golden images, write target/golden/report.html
  golden accept NAME...     write the golden images named, by the CPU path
  golden prune              delete golden files that no case names
  bench [SUITE...] [--baseline]
                            error-against-time suites into out/bench; --baseline times the reference too
  bench peers [NAME...]     tables against other programs into out/bench/peers
  judge FILE...             glTF files by the validator and the asset auditor of Khronos, where node is installed
  demo [ARGS...]            cargo run --release -p photofit-cli -- demo
  dist                      release program, readme and licences as an archive in out/dist
";

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &[String]) -> Result<()> {
    let (task, rest) = match args.split_first() {
        Some((task, rest)) => (task.as_str(), rest),
        None => ("help", args),
    };
    let here = std::env::current_dir()?;
    std::env::set_current_dir(shell::root())?;
    match task {
        "ci" => ci::run(flag(rest, &["--no-test"])?.contains(&"--no-test")),
        "tidy" => no_args(rest).and_then(|()| tidy::run()),
        "lint" => no_args(rest).and_then(|()| lint::run()),
        "features" => no_args(rest).and_then(|()| lint::features_one_by_one()),
        "shaders" => no_args(rest).and_then(|()| shaders::run()),
        "web" => web::run(flag(rest, &["--browser"])?.contains(&"--browser")),
        "test" => {
            let flags = flag(rest, &["--gpu", "--slow"])?;
            tasks::test(flags.contains(&"--gpu"), flags.contains(&"--slow"))
        }
        "golden" => tasks::golden(rest),
        "bench" => tasks::bench(rest),
        "judge" => judge::run(rest, &here),
        "demo" => tasks::demo(rest),
        "dist" => no_args(rest).and_then(|()| dist::run()),
        "help" | "--help" | "-h" => {
            print!("{USAGE}");
            Ok(())
        }
        other => bail!("no task `{other}`\n\n{USAGE}"),
    }
}

/// The flags given, each of which must be one of `known`.
fn flag<'a>(args: &'a [String], known: &[&str]) -> Result<Vec<&'a str>> {
    for arg in args {
        if !known.contains(&arg.as_str()) {
            bail!("unknown argument `{arg}`, expected {}", known.join(" or "));
        }
    }
    Ok(args.iter().map(String::as_str).collect())
}

fn no_args(args: &[String]) -> Result<()> {
    match args {
        [] => Ok(()),
        [arg, ..] => bail!("unexpected argument `{arg}`"),
    }
}
