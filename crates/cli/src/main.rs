//! The `photofit` program: simplify, retexture, render, compare and inspect 3D assets, surfaces from points, and a demo.
//!
//! Every command checks its options and where it will write before it starts work. Errors are one line on stderr and
//! exit status 1; a wrong command line is exit status 2; `status` lists all.

mod animation;
mod aov;
mod args;
mod camera;
mod compare;
mod demo;
mod demo_asset;
mod denoise;
mod device;
mod fields;
mod gradient;
mod guided;
mod inspect;
mod interrupt;
mod light;
mod lod;
mod memory;
mod mitsuba;
mod output;
mod parameter_scene;
mod path_render;
mod preflight;
mod progress;
mod recover;
mod recover_material;
mod recover_mesh;
mod recover_scene;
mod recover_volume;
mod recovery;
mod render;
mod retexture;
mod sequence;
mod simplify;
mod status;
mod surface;
mod surface_camera;
mod threads;
mod traced_report;

use args::{Cli, Command};
use photofit_fit::FitError;
use status::{Ending, Misuse};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::checked();
    interrupt::listen();
    let result = match &cli.command {
        Command::Simplify(a) => simplify::run(a),
        Command::Retexture(a) => retexture::run(a),
        Command::Render(a) => render::run(a),
        Command::Compare(a) => compare::run(a).map(|()| Ending::Done),
        Command::Inspect(a) => inspect::run(a).map(|()| Ending::Done),
        Command::Surface(a) => surface::run(a).map(|()| Ending::Done),
        Command::Denoise(a) => denoise::run(a).map(|()| Ending::Done),
        Command::Recover(a) => recover::run(a),
        Command::Gradient(a) => gradient::run(a),
        Command::Demo(a) => demo::run(a),
    };
    let error = match result {
        Ok(Ending::Done) => return ExitCode::SUCCESS,
        Ok(Ending::Stopped) => return status::STOPPED.into(),
        Err(error) => error,
    };
    // One line, whatever a message holds.
    let text = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    // Nobody is left to tell when stderr is gone.
    let _ = writeln!(std::io::stderr(), "error: {text}");
    match error.downcast_ref::<FitError>() {
        Some(FitError::Interrupted) => status::INTERRUPTED.into(),
        _ if error.is::<Misuse>() => status::MISUSED.into(),
        _ => status::FAILED.into(),
    }
}
