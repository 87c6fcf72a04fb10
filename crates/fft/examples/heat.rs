//! Heat in a rod with closed ends: each wave of the cosine transform fades by itself, by the eigenvalue of the Laplacian.
//!
//! `cargo run --release -p photofit-fft --example heat`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_fft::{Cosine, laplacian_eigenvalue};

fn main() {
    let cells = 60;
    let cosine = Cosine::<f64>::new(cells);
    let mut buffers = cosine.buffers();
    // The left third is hot.
    let start: Vec<f64> = (0..cells).map(|k| if k < cells / 3 { 1.0 } else { 0.0 }).collect();
    for time in [0.0, 10.0, 100.0, 1000.0] {
        let mut rod = start.clone();
        cosine.forward(&mut rod, &mut buffers);
        for (k, wave) in rod.iter_mut().enumerate() {
            let angle = std::f64::consts::PI * k as f64 / cells as f64;
            *wave *= (-time * laplacian_eigenvalue(angle)).exp() / cells as f64;
        }
        cosine.inverse(&mut rod, &mut buffers);
        let bar: String =
            rod.iter().map(|t| b" .:-=+*#%@"[(9.999 * t.clamp(0.0, 1.0)) as usize] as char).collect();
        println!("{time:5} |{bar}| heat {:.6}", rod.iter().sum::<f64>());
    }
}
