//! Round trips, densities and gradients of both families.

use super::{Family, Spline};
use photofit_gradcheck::{Uniform, check};

const FAMILIES: [Family; 2] = [Family::Quadratic, Family::Rational];

fn logits(family: Family, bins: usize, spread: f64, random: &mut Uniform) -> Vec<f64> {
    random.vec(family.logits(bins), -spread, spread)
}

#[test]
fn warps_and_their_inverses_are_round_trips() {
    let mut random = Uniform::new(3);
    for family in FAMILIES {
        for (bins, spread) in [(1, 1.0), (10, 2.0), (15, 4.0), (31, 3.0)] {
            for _ in 0..50 {
                let wide = logits(family, bins, spread, &mut random);
                let narrow: Vec<f32> = wide.iter().map(|l| *l as f32).collect();
                let (exact, single) = (Spline::new(family, bins, &wide), Spline::new(family, bins, &narrow));
                for _ in 0..50 {
                    let u = random.range(0.0, 1.0);
                    let (x, density) = exact.inverse(u);
                    let (back, forward) = exact.forward(x);
                    assert!((back - u).abs() < 1e-12, "{family:?} {bins}: {u} {back}");
                    assert!((density / forward - 1.0).abs() < 1e-8, "{family:?}: {density} {forward}");
                    let u = u as f32;
                    let (x, density) = single.inverse(u);
                    let (back, forward) = single.forward(x);
                    // Where the density is high, rounding x alone moves u by its density times half a unit.
                    let allowed = 1e-5_f32.max(2e-7 * density);
                    assert!((back - u).abs() < allowed, "{family:?} {bins}: {u} {back} at {density}");
                    assert!((density / forward - 1.0).abs() < 2e-3, "{family:?}: {density} {forward}");
                }
            }
        }
    }
}

#[test]
fn densities_are_derivatives_and_ends_are_kept() {
    let mut random = Uniform::new(4);
    for family in FAMILIES {
        for _ in 0..100 {
            let spline = Spline::new(family, 15, &logits(family, 15, 2.0, &mut random));
            assert!(spline.forward(0.0).0.abs() < 1e-12 && (spline.forward(1.0).0 - 1.0).abs() < 1e-12);
            assert!(spline.inverse(0.0).0.abs() < 1e-12 && (spline.inverse(1.0).0 - 1.0).abs() < 1e-12);
            let (x, h) = (random.range(0.01, 0.99), 1e-6);
            let slope = (spline.forward(x + h).0 - spline.forward(x - h).0) / (2.0 * h);
            let density = spline.forward(x).1;
            // A knot between the two points leaves an error of first order.
            assert!((slope / density - 1.0).abs() < 1e-3, "{family:?}: {slope} {density}");
        }
        let flat = Spline::new(family, 15, &vec![0.0; family.logits(15)]);
        for x in [0.1, 0.5, 0.77_f64] {
            let (u, density) = flat.forward(x);
            assert!((u - x).abs() < 1e-5 && (density - 1.0_f64).abs() < 1e-5, "{family:?}: identity at zero");
        }
    }
}

#[test]
fn gradients_agree_with_differences() {
    let mut random = Uniform::new(5);
    for family in FAMILIES {
        for bins in [1, 4, 15] {
            for _ in 0..20 {
                let n = family.logits(bins);
                let mut at = logits(family, bins, 1.5, &mut random);
                at.push(random.range(0.02, 0.98));
                let g = [random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
                let value = |v: &[f64]| {
                    let (u, density) = Spline::new(family, bins, &v[..n]).forward(v[n]);
                    g[0] * u + g[1] * density.ln()
                };
                let mut gradient = vec![0.0; n + 1];
                let spline = Spline::new(family, bins, &at[..n]);
                gradient[n] = spline.forward_vjp(at[n], g, &mut gradient[..n]);
                check(&format!("{family:?} {bins}"), &at, &gradient, 1e-6, 1e-5, value);
            }
        }
    }
}

#[test]
fn the_textbook_root_loses_digits_that_the_stable_one_keeps() {
    // Bins whose density hardly changes: (root - B) / A cancels.
    let (mut stable, mut textbook) = (0.0_f32, 0.0_f32);
    let mut random = Uniform::new(6);
    for _ in 0..200 {
        let logits: Vec<f32> = random.vec(31, -1e-4, 1e-4).iter().map(|l| *l as f32).collect();
        let spline = super::Quadratic::new(15, &logits);
        let u = random.range(0.0, 1.0) as f32;
        stable = stable.max((spline.forward(spline.inverse(u).0).0 - u).abs());
        let heights = [1.0 + logits[0], 1.0 + logits[1]];
        let (linear, square, y) = (heights[0], heights[1] - heights[0], u);
        let a = ((linear * linear + 2.0 * square * y).sqrt() - linear) / square;
        textbook = textbook.max((linear * a + 0.5 * square * a * a - u).abs());
    }
    assert!(stable < 1e-6, "{stable}");
    assert!(textbook > 1e-4, "the negative control must lose digits: {textbook}");
}
