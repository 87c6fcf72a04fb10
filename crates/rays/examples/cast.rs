//! Casts rays at a square and prints what they meet: `cargo run -p photofit-rays --example cast`.

#![expect(clippy::print_stdout, reason = "an example shows its results")]

use photofit_rays::{Accel, AccelError, Ray};
use photofit_scalar::vec3;

fn main() -> Result<(), AccelError> {
    let corners = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(1.0, 1.0, 0.0), vec3(0.0, 1.0, 0.0)];
    let accel = Accel::build(&corners, &[[0, 1, 2], [0, 2, 3]])?;
    for row in 0..6 {
        let line: String = (0..12)
            .map(|column| {
                let origin = vec3(column as f32 / 8.0 - 0.2, row as f32 / 4.0 - 0.1, 2.0);
                match accel.closest_hit(&Ray::new(origin, vec3(0.0, 0.0, -1.0))) {
                    Some(hit) => ['a', 'b'][hit.triangle as usize],
                    None => '.',
                }
            })
            .collect();
        println!("{line}");
    }
    let nearest = accel.closest_point(vec3(0.5, 2.0, 0.0), f32::INFINITY);
    println!("closest to (0.5, 2, 0): {:?}", nearest.map(|found| found.distance));
    Ok(())
}
