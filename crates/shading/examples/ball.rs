//! A ball of metal or plastic under a lamp, drawn in characters, and what its roughness does to the highlight.
//!
//! `cargo run -p photofit-shading --example ball [ROUGHNESS]`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_scalar::{Vec3, vec3};
use photofit_shading::{Energy, Light, Surface, shade, shade_vjp, view_direction};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let roughness = std::env::args().nth(1).map_or(Ok(0.3), |word| word.parse())?;
    let surface = Surface { base_color: vec3(0.9_f32, 0.7, 0.3), roughness, metallic: 0.7, gamma: 0.0 };
    let eye = vec3(0.0, 0.0, 4.0);
    let lights = [
        Light::Point { position: vec3(2.0, 3.0, 3.0), intensity: Vec3::splat(30.0) },
        Light::Ambient { radiance: Vec3::splat(0.1) },
    ];
    let mut slope = 0.0;
    for row in 0..24 {
        let line: String = (0..48)
            .map(|column| {
                let (x, y) = ((column as f32 - 23.5) / 24.0, (11.5 - row as f32) / 12.0);
                let square = x * x + y * y;
                if square > 1.0 {
                    return ' ';
                }
                let normal = vec3(x, y, (1.0 - square).sqrt());
                let wo = view_direction(eye, normal);
                let brightness = shade(&surface, Energy::Single, normal, normal, wo, &lights).y;
                // The adjoint of the mean brightness: how it would change with the roughness.
                slope +=
                    shade_vjp(&surface, Energy::Single, normal, normal, wo, &lights, vec3(0.0, 1.0, 0.0))
                        .surface
                        .roughness;
                char::from(b" .:-=+*#%@"[(brightness.sqrt() * 7.0).clamp(1.0, 9.0) as usize])
            })
            .collect();
        println!("{line}");
    }
    println!("d brightness / d roughness, summed over the picture: {slope:.2}");
    Ok(())
}
