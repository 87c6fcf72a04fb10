//! The `photofit` program: simplify, render, compare and inspect 3D assets, surfaces from points, and a demo.
//!
//! Every command checks its options and where it will write before it starts work. Errors are one line on stderr and
//! exit status 1; a wrong command line is exit status 2; Ctrl-C before there was anything to keep is 130.

mod aov;
mod args;
mod compare;
mod demo;
mod demo_asset;
mod denoise;
mod inspect;
mod light;
mod memory;
mod mitsuba;
mod output;
mod path_render;
mod preflight;
mod progress;
mod recover;
mod render;
mod sequence;
mod simplify;
mod surface;
mod surface_camera;

use args::{Cli, Command};
use photofit_fit::FitError;
use std::io::Write;
use std::process::ExitCode;

/// Exit status of a run that Ctrl-C ended, as shells count.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let cli = Cli::checked();
    let result = match &cli.command {
        Command::Simplify(a) => simplify::run(a),
        Command::Render(a) => render::run(a),
        Command::Compare(a) => compare::run(a),
        Command::Inspect(a) => inspect::run(a),
        Command::Surface(a) => surface::run(a),
        Command::Denoise(a) => denoise::run(a),
        Command::Recover(a) => recover::run(a),
        Command::Demo(a) => demo::run(a),
    };
    let Err(error) = result else { return ExitCode::SUCCESS };
    // One line, whatever a message holds.
    let text = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    // Nobody is left to tell when stderr is gone.
    let _ = writeln!(std::io::stderr(), "error: {text}");
    match error.downcast_ref::<FitError>() {
        Some(FitError::Interrupted) => ExitCode::from(INTERRUPTED),
        _ => ExitCode::FAILURE,
    }
}
