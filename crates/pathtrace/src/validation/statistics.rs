//! Tests of hypotheses.

use photofit_image::Image;

/// Pixels along the side of a block whose means are compared.
const BLOCK: usize = 4;

/// Asserts that two renders with independent samples have the same expectation: a z-test of the means of blocks of
/// pixels, and a sharper one of the mean over the picture.
///
/// Blocks because single pixels with rare bright samples underestimate their variance; Sobol points make means less
/// noisy than the variance of their samples says, which errs to the side of passing.
pub(super) fn agree(name: &str, a: (&Image, &Image, u32), b: (&Image, &Image, u32)) {
    let (width, height) = (a.0.width, a.0.height);
    let (columns, rows) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
    let mut blocks = vec![(0.0, 0.0, 0.0); columns * rows * 3];
    for i in 0..a.0.pixels() {
        for c in 0..3 {
            let (ma, mb) = (f64::from(a.0.data[4 * i + c]), f64::from(b.0.data[4 * i + c]));
            let of = |v: &Image, n: u32| f64::from(v.data[3 * i + c]) / f64::from(n);
            let block = &mut blocks[(i / width / BLOCK * columns + i % width / BLOCK) * 3 + c];
            *block = (block.0 + ma - mb, block.1 + of(a.1, a.2) + of(b.1, b.2), block.2 + ma.max(mb));
        }
    }
    let (mut total, mut variance) = (0.0, 0.0);
    for (i, (d, v, size)) in blocks.iter().enumerate() {
        total += d;
        variance += v;
        let bound = 4.5 * v.sqrt() + 1e-4 * size + 1e-6;
        assert!(d.abs() <= bound, "{name}: block {i} differs by {d:.3e} of {size:.3e}, bound {bound:.3e}");
    }
    let z = total / variance.sqrt().max(1e-9);
    assert!(z.abs() < 4.0, "{name}: the mean differs by {total:.2e}, {z:.1} standard deviations");
}

/// Mean of a channel and its standard error.
pub(super) fn mean_of(picture: &Image, variance: &Image, spp: u32, c: usize) -> (f64, f64) {
    let n = picture.pixels() as f64;
    let mean = (0..picture.pixels()).map(|i| f64::from(picture.data[4 * i + c])).sum::<f64>() / n;
    let v = (0..picture.pixels()).map(|i| f64::from(variance.data[3 * i + c])).sum::<f64>() / n;
    (mean, (v / (n * f64::from(spp))).sqrt())
}

/// Asserts that counts come from probabilities (both over the same cells) at a significance of 0.01 over `tests` tests.
pub(super) fn chi_square(name: &str, counts: &[u64], probabilities: &[f64], tests: usize) {
    let z = photofit_sampling::chi_square::deviation(counts, probabilities);
    let bound = photofit_sampling::chi_square::bound(tests);
    assert!(z < bound, "{name}: chi-square lies {z:.2} standard deviations above its mean");
}

#[test]
fn the_comparators_notice_differences() {
    let picture = |v: f32| Image::from_fn(8, 8, 4, |_, _, _| v);
    let variance = Image::from_fn(8, 8, 3, |_, _, _| 0.01);
    let (a, b) = (picture(0.5), picture(0.53));
    agree("the same", (&a, &variance, 16), (&a, &variance, 16));
    let differ = |a: &Image, b: &Image| {
        std::panic::catch_unwind(|| agree("x", (a, &variance, 16), (b, &variance, 16))).is_err()
    };
    assert!(differ(&a, &b), "a difference of the mean");
    let mut spot = a.clone();
    for (x, v) in [(3, 1.4), (4, -0.4)] {
        spot.pixel_mut(x, 3)[..3].fill(v);
    }
    assert!(differ(&a, &spot), "blocks that differ");
    let wrong = std::panic::catch_unwind(|| chi_square("x", &[60, 40, 50], &[1.0 / 3.0; 3], 1));
    assert!(wrong.is_ok());
    let wrong = std::panic::catch_unwind(|| chi_square("x", &[600, 400, 500], &[1.0 / 3.0; 3], 1));
    assert!(wrong.is_err());
    let zero = std::panic::catch_unwind(|| chi_square("x", &[600, 1], &[1.0, 0.0], 1));
    assert!(zero.is_err());
}
