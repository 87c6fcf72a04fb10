//! What an asset holds, and the same asset written as a binary glTF file.
//!
//! `cargo run -p photofit-scene --example contents ASSET [OUT.glb]`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_scene::{load, save_glb};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene = load(args.next().ok_or("the path of an asset is missing")?)?;
    println!("{}: {} bytes", scene.name, scene.source_bytes);
    for (i, primitive) in scene.primitives.iter().enumerate() {
        let mesh = &primitive.mesh;
        let placed = scene.instances.iter().filter(|instance| instance.primitive == i).count();
        println!(
            "  mesh {i}: {} triangles, {} vertices, material {}, placed {placed} times",
            mesh.triangles.len(),
            mesh.positions.len(),
            primitive.material
        );
    }
    for (i, material) in scene.materials.iter().enumerate() {
        println!("  material {i}: roughness {}, metallic {}", material.roughness, material.metallic);
    }
    for (i, image) in scene.images.iter().enumerate() {
        println!("  image {i}: {} x {}", image.width, image.height);
    }
    for warning in &scene.warnings {
        println!("  {warning}");
    }
    if let Some(out) = args.next() {
        save_glb(out, &scene)?;
    }
    Ok(())
}
