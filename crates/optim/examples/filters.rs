//! A noisy gradient, with and without a filter along edges: the piecewise constant signal that a fit recovers.
//!
//! `cargo run --release -p photofit-optim --example filters`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_optim::{Bilateral, Grid, GridBilateral, OptimError, Optimizer, Placement, Temporal};

const SITES: usize = 256;

/// A deterministic hash of step and site, in [-1, 1).
fn noise(step: usize, site: usize) -> f32 {
    let mixed = (step * SITES + site + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 23) as f32 - 1.0
}

fn main() -> Result<(), OptimError> {
    let target: Vec<f32> = (0..SITES).map(|i| [0.2, 0.8, 0.5, 0.9][i / 64]).collect();
    let filter = GridBilateral::new("signal", Grid::line(SITES), 1, Bilateral::default())?;
    let plain = Optimizer::new("signal", SITES, Temporal::adam())?;
    let filtered = Optimizer::new("signal", SITES, Temporal::adam().paired(0.5))?
        .with_filter(Placement::POST, filter)?;
    for (name, mut optimizer) in [("Adam", plain), ("Adam with a bilateral filter", filtered)] {
        let mut signal = vec![0.0; SITES];
        for step in 0..400 {
            let gradient: Vec<f32> =
                (0..SITES).map(|i| signal[i] - target[i] + 0.5 * noise(step, i)).collect();
            let rate = 0.05 * (1.0 - step as f32 / 400.0);
            optimizer.step(&mut signal, &gradient, rate)?;
        }
        let square: f32 = signal.iter().zip(&target).map(|(a, b)| (a - b).powi(2)).sum();
        println!("{name}: root mean square error {:.4}", (square / SITES as f32).sqrt());
    }
    Ok(())
}
