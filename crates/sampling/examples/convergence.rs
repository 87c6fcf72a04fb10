//! The error of an integral against the number of samples: random points, and scrambled Sobol points.
//!
//! `cargo run -p photofit-sampling --example convergence`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_sampling::{Rng, Sobol, cosine_hemisphere};
use photofit_scalar::vec3;

/// Light from a soft lamp at 45 degrees; the cosine belongs to the density of the directions.
fn lamp(u: [f32; 2]) -> f64 {
    let towards = vec3(0.5_f32.sqrt(), 0.0, 0.5_f32.sqrt());
    let cosine = cosine_hemisphere(u).dot(towards).max(0.0);
    f64::from(cosine.powi(8))
}

fn main() {
    let mean = |n: u32, point: &mut dyn FnMut(u32) -> [f32; 2]| {
        (0..n).map(|i| lamp(point(i))).sum::<f64>() / f64::from(n)
    };
    let truth = mean(1 << 22, &mut |i| Sobol::new(0, 0).sample_2d(i, 0));
    println!("{:>8}  {:>10}  {:>10}", "samples", "random", "Sobol");
    for n in [16, 64, 256, 1024, 4096, 16384] {
        // Root mean square of the relative error over 32 seeds.
        let rms = |estimate: &dyn Fn(u64) -> f64| {
            let square = |seed| (estimate(seed) / truth - 1.0).powi(2);
            ((0..32).map(square).sum::<f64>() / 32.0).sqrt()
        };
        let random = rms(&|seed| {
            let mut rng = Rng::new(seed, 0);
            mean(n, &mut |_| [rng.next_f32(), rng.next_f32()])
        });
        let sobol = rms(&|seed| {
            let points = Sobol::new(seed + 1, 0);
            mean(n, &mut |i| points.sample_2d(i, 0))
        });
        println!("{n:8}  {random:10.2e}  {sobol:10.2e}");
    }
}
