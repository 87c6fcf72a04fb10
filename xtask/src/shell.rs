//! Running the programs that a task consists of.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail};

/// The workspace's root folder.
pub(crate) fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_path_buf()
}

/// The cargo that runs this program, or the one on the path.
fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// Runs cargo with the streams shown; an exit status other than zero is an error.
pub(crate) fn run_cargo(args: &[&str]) -> Result<()> {
    run_cargo_with(args, &[])
}

/// [`run_cargo`] with environment variables added.
pub(crate) fn run_cargo_with(args: &[&str], env: &[(&str, &str)]) -> Result<()> {
    let line = format!("cargo {}", args.join(" "));
    println!("$ {line}");
    let start = Instant::now();
    let mut command = cargo();
    command.args(args).envs(env.iter().copied());
    let status = command.status().with_context(|| format!("{line}: cannot start"))?;
    if !status.success() {
        bail!("{line}: {status}");
    }
    println!("  {:.1} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// The standard output of a cargo command.
pub(crate) fn cargo_output(args: &[&str]) -> Result<String> {
    let line = format!("cargo {}", args.join(" "));
    let output = cargo()
        .args(args)
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("{line}: cannot start"))?;
    if !output.status.success() {
        bail!("{line}: {}", output.status);
    }
    String::from_utf8(output.stdout).with_context(|| format!("{line}: output is not UTF-8"))
}

/// Whether a program answers `--version`.
pub(crate) fn is_installed(program: &str, args: &[&str]) -> bool {
    let mut command = Command::new(program);
    command.args(args).arg("--version").stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
