//! Losses on a device against the CPU's.

use super::*;
use crate::gpu::tolerances::{LOSS, LOSS_GRADIENT, SIMILARITY, SIMILARITY_GRADIENT};
use crate::loss::PictureLayout;
use photofit_gpu::{assert_twin, test_device};
use photofit_gradcheck::Uniform;

const POINTWISE: [Loss; 5] = [Loss::LogSrgbL1, Loss::LogSrgbL2, Loss::Mse, Loss::Smape, Loss::RelativeL2];

type Image = Vec<[f32; 4]>;

/// Radiance over several orders of magnitude, some of it negative, infinite or equal to the other's.
fn images(n: usize, seed: u64) -> (Image, Image) {
    let mut rng = Uniform::new(seed);
    let mut sample = |y: f32| {
        let kind = rng.range(0.0, 1.0);
        let x = (10f64.powf(rng.range(-6.0, 4.0)) * if kind < 0.1 { -1.0 } else { 1.0 }) as f32;
        match kind {
            k if k > 0.999 => f32::INFINITY,
            k if k > 0.95 => y,
            _ => x,
        }
    };
    let y: Image = (0..n).map(|_| std::array::from_fn(|_| sample(0.0))).collect();
    let x = y.iter().map(|y| y.map(&mut sample)).collect();
    (x, y)
}

struct Setup<'a> {
    part: Part,
    term: Term,
    weights: &'a [f32],
    before: &'a Image,
}

/// Value and gradient by the device; the recording is for twice as many pixels.
fn on_device(gpu: &Gpu, (x, y): (&Image, &Image), setup: &Setup<'_>) -> (f32, Image) {
    let n = x.len();
    let room = 2 * n;
    let buffers = LossBuffers::new(gpu, room, !setup.weights.is_empty(), 3).expect("made");
    let buffers = buffers.serving(gpu, setup.term.loss, room).expect("made");
    let (candidate, gradient) =
        (gpu.zeros("candidate", room).expect("made"), gpu.zeros("gradient", room).expect("made"));
    gpu.write(&candidate, x).expect("written");
    gpu.write(&buffers.reference, y).expect("written");
    gpu.write(&buffers.weights, setup.weights).expect("written");
    gpu.write(&gradient, setup.before).expect("written");
    gpu.write(&buffers.values, &[5.0, 0.25, 5.0]).expect("written");
    let mut r = gpu.record("loss");
    let recorded =
        value_and_gradient(&mut r, &setup.term, room, &candidate, &buffers, &gradient, 1).expect("recorded");
    let mut recording = r.finish().expect("recorded");
    recorded.set(&mut recording, &setup.term, &setup.part);
    recording.run().expect("runs");
    let values = gpu.read(&buffers.values).expect("read");
    assert_eq!([values[0], values[2]], [5.0; 2], "other places are not touched");
    let mut g = gpu.read(&gradient).expect("read");
    assert!(g[n..].iter().flatten().all(|g| *g == 0.0), "nor other pixels");
    g.truncate(n);
    (values[1], g)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn values_and_gradients_are_those_of_the_cpu() {
    let gpu = test_device();
    for (n, read) in [(1, 0..1), (7 * 9, 0..3), (256, 1..4), (150_001, 0..3), (1000, 3..4)] {
        let (x, y) = images(n, n as u64);
        let mut rng = Uniform::new(3);
        let weights: Vec<f32> =
            (0..n).map(|i| if i % 5 == 1 { 0.0 } else { rng.range(0.1, 2.0) as f32 }).collect();
        let before: Image = (0..n).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect();
        for loss in POINTWISE {
            for (weights, accumulates) in [(&[][..], false), (&weights[..], true)] {
                let setup = Setup {
                    part: Part::whole([n, 1]),
                    term: Term { loss, read: read.clone(), factor: 0.7 * n as f64, accumulates },
                    weights,
                    before: &before,
                };
                let (value, g) = on_device(gpu, (&x, &y), &setup);
                let layout = PictureLayout::new(n, 1, 4).only(read.clone());
                let layout = if weights.is_empty() { layout } else { layout.weighted(weights) };
                let mut expected = if accumulates { before.clone() } else { vec![[0.0; 4]; n] };
                let own = loss.value_and_gradient(
                    x.as_flattened(),
                    y.as_flattened(),
                    &layout,
                    setup.term.factor,
                    expected.as_flattened_mut(),
                );
                let size = own + if accumulates { 0.25 } else { 0.0 };
                let error = (f64::from(value) - size).abs() / size.abs().max(1e-12);
                // Relative to the gradient, a share of the largest, or what it is added to. Gradients of the rational losses
                // are differences of larger numbers, those of the logarithmic ones span more sizes.
                let share = if matches!(loss, Loss::Smape | Loss::RelativeL2) { 0.1 } else { 1e-3 };
                let largest = expected.as_flattened().iter().fold(0.0_f32, |m, g| m.max(g.abs()));
                let floor = if accumulates { 1.0 } else { share * largest.max(1e-9) };
                let pairs = g.as_flattened().iter().zip(expected.as_flattened());
                let off = pairs.fold(0.0_f32, |m, (a, b)| m.max((a - b).abs() / b.abs().max(floor)));
                assert_twin("LOSS", format!("{loss:?} of {n}: {value} {size}"), error, LOSS);
                assert_twin("LOSS_GRADIENT", format!("{loss:?} of {n}"), off.into(), LOSS_GRADIENT.into());
            }
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn runs_agree_and_changes_are_noticed() {
    let gpu = test_device();
    let (mut x, mut y) = images(40_000, 8);
    // A single sample counts.
    x.iter_mut().chain(&mut y).flatten().for_each(|x| *x = x.clamp(-1.0, 1.0));
    let before = vec![[0.0; 4]; x.len()];
    for loss in POINTWISE.into_iter().chain([Loss::Ssim]) {
        let setup = Setup {
            part: Part::whole([200, 200]),
            term: Term { loss, read: 0..4, factor: 1.0, accumulates: false },
            weights: &[],
            before: &before,
        };
        let first = on_device(gpu, (&x, &y), &setup);
        assert!(on_device(gpu, (&x, &y), &setup) == first, "{loss:?}: the same bits");
        x[777] = [0.5, 0.1, 0.7, 2.0];
        let other = on_device(gpu, (&x, &y), &setup);
        assert!(other.0 != first.0 && other.1 != first.1, "{loss:?}");
        // Not a number is not hidden.
        x[777][3] = f32::NAN;
        assert!(on_device(gpu, (&x, &y), &setup).0.is_nan(), "{loss:?} hides NaN");
        x[777] = [0.2; 4];
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn similarity_is_that_of_the_cpu() {
    let gpu = test_device();
    for (size, read) in [([1, 1], 0..1), ([7, 9], 0..3), ([3, 40], 1..4), ([130, 67], 0..3), ([64, 64], 3..4)]
    {
        let [width, height] = size;
        let n = width * height;
        let (x, y) = pictures(n, n as u64);
        let mut rng = Uniform::new(3);
        let weights: Vec<f32> =
            (0..n).map(|i| if i % 5 == 1 { 0.0 } else { rng.range(0.1, 2.0) as f32 }).collect();
        let before: Image = (0..n).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect();
        for (weights, accumulates) in [(&[][..], false), (&weights[..], true)] {
            let factor = 0.7 * n as f64;
            let term = Term { loss: Loss::Ssim, read: read.clone(), factor, accumulates };
            let part = Part::whole(size);
            let (value, g) = on_device(gpu, (&x, &y), &Setup { part, term, weights, before: &before });
            // In f64: of both sides in f32 none is the truth, for variances are differences of larger numbers.
            let wide = |image: &Image| image.as_flattened().iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
            let weights: Vec<f64> = weights.iter().map(|w| f64::from(*w)).collect();
            let layout = PictureLayout::new(width, height, 4).only(read.clone());
            let layout = if weights.is_empty() { layout } else { layout.weighted(&weights) };
            let mut expected = if accumulates { wide(&before) } else { vec![0.0; 4 * n] };
            let own = Loss::Ssim.value_and_gradient(&wide(&x), &wide(&y), &layout, factor, &mut expected);
            let whole = own + if accumulates { 0.25 } else { 0.0 };
            // Under a window of one pixel variances are rounding alone, and the loss with them.
            let floor = if n == 1 { 100.0 } else { 0.01 };
            let error = (f64::from(value) - whole).abs() / whole.abs().max(floor * factor);
            let largest = expected.iter().fold(floor, |m, g| m.max(g.abs()));
            let pairs = g.as_flattened().iter().zip(&expected);
            let off = pairs.fold(0.0_f64, |m, (a, b)| m.max((f64::from(*a) - b).abs() / largest));
            assert_twin("SIMILARITY", format!("{width} x {height}: {value} {whole}"), error, SIMILARITY);
            assert_twin("SIMILARITY_GRADIENT", format!("{width} x {height}"), off, SIMILARITY_GRADIENT);
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn parts_of_a_picture_add_up_to_it() {
    let gpu = test_device();
    let ([width, height], read) = ([23, 40], 0..3);
    let n = width * height;
    let (x, y) = pictures(n, 5);
    let mut rng = Uniform::new(4);
    let weights: Vec<f32> = (0..n).map(|_| rng.range(0.1, 2.0) as f32).collect();
    let before = vec![[0.0; 4]; n];
    for loss in POINTWISE.into_iter().chain([Loss::Ssim]) {
        let term = Term { loss, read: read.clone(), factor: 3.0, accumulates: false };
        let of = |part: Part, rows: Range<usize>| {
            let pixels = rows.start * width..rows.end * width;
            let part_of = |image: &Image| image[pixels.clone()].to_vec();
            let setup = Setup {
                part,
                term: term.clone(),
                weights: &weights[pixels.clone()],
                before: &part_of(&before),
            };
            on_device(gpu, (&part_of(&x), &part_of(&y)), &setup)
        };
        let (value, g) = of(Part::whole([width, height]), 0..height);
        // With rows around those that count, and without some of them.
        let added = |reach: usize| {
            let (mut sum, mut gradient) = (0.0, vec![[0.0; 4]; n]);
            for counted in [0..3_usize, 3..17, 17..18, 18..18, 18..40] {
                let drawn = counted.start.saturating_sub(reach)..(counted.end + reach).min(height);
                let inside = counted.start - drawn.start..counted.end - drawn.start;
                let part = Part { size: [width, drawn.len()], counted: inside, rows: height };
                let (value, g) = of(part, drawn.clone());
                sum += value;
                let rows = gradient[drawn.start * width..].iter_mut().zip(&g);
                rows.for_each(|(sum, g)| (0..4).for_each(|c| sum[c] += g[c]));
            }
            let largest = g.as_flattened().iter().fold(0.0_f32, |m, g| m.max(g.abs()));
            let pairs = g.as_flattened().iter().zip(gradient.as_flattened());
            let off = pairs.fold(0.0_f32, |m, (a, b)| m.max((a - b).abs() / largest));
            [(sum / value - 1.0).abs(), off]
        };
        let [error, off] = added(Part::REACH);
        println!("{loss:?}: values differ by {error:.1e}, gradients by {off:.1e}");
        assert!(f64::from(error) < LOSS && off < LOSS_GRADIENT, "{loss:?}: {error:e}, {off:e}");
        if loss == Loss::Ssim {
            assert!(added(Part::REACH - 1)[1] > LOSS_GRADIENT, "a row less is noticed");
        }
    }
}

/// Smooth radiance of some contrast, and another that differs a little.
fn pictures(n: usize, seed: u64) -> (Image, Image) {
    let mut rng = Uniform::new(seed);
    let y: Image = (0..n).map(|_| std::array::from_fn(|_| rng.range(0.0, 1.5) as f32)).collect();
    let x = y.iter().map(|y| y.map(|y| (f64::from(y) + rng.range(-0.2, 0.2)) as f32)).collect();
    (x, y)
}
