//! The main job: a light asset that looks like a heavy one, here a rock of 11,520 triangles.
//!
//! `cargo run --release -p photofit-fit --example simplify [OUT.glb]`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_fit::Silent;
use photofit_fit::simplify::{SimplifyOptions, StageQuality, simplify};
use photofit_geometry::{decimate::Target, shapes};
use photofit_scene::{Instance, Material, Primitive, Scene};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // An asset from a file would be `photofit_scene::load("rock.glb")?`.
    let rock = Scene {
        primitives: vec![Primitive { mesh: shapes::displaced_sphere(24, 0.2, 4, 1), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: Default::default() }],
        materials: vec![Material::clay()],
        ..Scene::default()
    };
    let out = std::env::args()
        .nth(1)
        .map_or_else(|| std::env::temp_dir().join("photofit-light.glb"), PathBuf::from);
    let options = SimplifyOptions {
        target: Target::Triangles(600),
        resolution: 128,
        texture_size: 128,
        steps: 100,
        ..SimplifyOptions::default()
    };
    let outcome = simplify(&rock, &out, &options, &Silent)?;
    println!("{} triangles instead of {}: {}", outcome.triangles_out, outcome.triangles_in, out.display());
    for StageQuality { name, triangles, quality } in &outcome.stages {
        println!("{name:>14}, {triangles} triangles: PSNR {:.2} dB, FLIP {:.3}", quality.psnr, quality.flip);
    }
    println!("{:.1} s", outcome.seconds);
    Ok(())
}
