//! Total variation on a noisy disc: the error before and after, and how far the solver is from the optimum.
//!
//! `cargo run --release -p photofit-denoise --example disc`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_denoise::admm::{Admm, Stop};
use photofit_denoise::{DenoiseError, Shape, models};

fn main() -> Result<(), DenoiseError> {
    let shape = Shape::new(160, 120, 1);
    let pixel = |i: usize| ((i % shape.width) as f32, (i / shape.width) as f32);
    let disc = |(x, y): (f32, f32)| if (x - 70.0).hypot(y - 60.0) < 35.0 { 0.8 } else { 0.2 };
    let clean: Vec<f32> = (0..shape.len()).map(|i| disc(pixel(i))).collect();
    let noise = |i: usize| ((i * 7919 + i / 13 * 104_729) % 1000) as f32 / 1000.0 - 0.5;
    let noisy: Vec<f32> = (0..shape.len()).map(|i| clean[i] + 0.5 * noise(i)).collect();
    let error = |u: &[f32]| {
        let square: f32 = u.iter().zip(&clean).map(|(a, b)| (a - b).powi(2)).sum();
        (square / shape.len() as f32).sqrt()
    };
    println!("noisy: root mean square error {:.3}", error(&noisy));
    for lambda in [20.0, 8.0, 3.0, 1.0] {
        let mut admm = Admm::new(&models::rof(shape, &noisy, lambda))?;
        let report = admm.solve(Stop::Tolerance { tolerance: 1e-4, limit: 500 });
        println!("lambda {lambda:4}: {:.3} after {} iterations", error(&admm.solution()), report.iterations);
    }
    Ok(())
}
