//! The error of central differences against the step: truncation on one side, rounding on the other.
//!
//! `cargo run -p photofit-gradcheck --example steps`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_gradcheck::{Uniform, check, max_relative_error};

/// A weighted sum of `sin(x_i x_(i+1))`, with weights that no two terms share.
fn value(x: &[f64], weights: &[f64]) -> f64 {
    weights.iter().zip(x.windows(2)).map(|(w, pair)| w * (pair[0] * pair[1]).sin()).sum()
}

fn main() {
    let mut random = Uniform::new(1);
    let (x, weights) = (random.vec(8, -1.0, 1.0), random.vec(7, -1.0, 1.0));
    let mut gradient = vec![0.0; x.len()];
    for (i, w) in weights.iter().enumerate() {
        let cosine = (x[i] * x[i + 1]).cos();
        gradient[i] += w * cosine * x[i + 1];
        gradient[i + 1] += w * cosine * x[i];
    }
    for h in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10] {
        println!("{h:6.0e}: {:.1e}", max_relative_error(&x, &gradient, h, |x| value(x, &weights)));
    }
    // What a test writes: it panics, with the error, where the gradient is wrong.
    check("sum of sines", &x, &gradient, 1e-5, 1e-8, |x| value(x, &weights));
}
