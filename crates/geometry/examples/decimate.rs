//! Decimates a rock step by step: triangles that remain, and how far the surface moved.
//!
//! `cargo run --release -p photofit-geometry --example decimate`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_geometry::decimate::{Options, Target, decimate};
use photofit_geometry::shapes::displaced_sphere;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rock = displaced_sphere(40, 0.25, 4, 7);
    println!("{} triangles", rock.triangles.len());
    // One group of triangles (one material), no vertex more important than another.
    let (group, importance) = (vec![0; rock.triangles.len()], Vec::new());
    for count in [8000, 2000, 500, 125] {
        let options = Options::new(Target::Triangles(count));
        let light = decimate(&rock, &group, &importance, &options)?;
        let moved = 100.0 * light.relative_error;
        println!("{:5} triangles, moved by at most {moved:.3}% of the diagonal", light.mesh.triangles.len());
    }
    Ok(())
}
