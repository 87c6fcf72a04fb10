//! A rock of 5,120 triangles becomes one of 400 that looks like it, all through the facade.
//!
//! `cargo run --release -p photofit --example light_rock [OUT.glb]`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit::fit::Silent;
use photofit::fit::simplify::{SimplifyOptions, simplify};
use photofit::geometry::{decimate::Target, shapes};
use photofit::scene::{Instance, Material, Primitive, Scene};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rock = Scene {
        primitives: vec![Primitive { mesh: shapes::displaced_sphere(16, 0.2, 3, 1), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: Default::default() }],
        materials: vec![Material::clay()],
        ..Scene::default()
    };
    let options = SimplifyOptions {
        target: Target::Triangles(400),
        resolution: 128,
        texture_size: 128,
        steps: 60,
        ..SimplifyOptions::default()
    };
    let output = std::env::args().nth(1).unwrap_or_else(|| "light_rock.glb".into());
    let outcome = simplify(&rock, output.as_ref(), &options, &Silent)?;
    println!("{} -> {} triangles", outcome.triangles_in, outcome.triangles_out);
    for stage in &outcome.stages {
        let quality = &stage.quality;
        println!("  {:<14} {:>6} dB, FLIP {:.3}", stage.name, quality.decibels(2), quality.flip);
    }
    println!("wrote {output}");
    Ok(())
}
