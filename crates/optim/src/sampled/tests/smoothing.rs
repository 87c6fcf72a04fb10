//! Loss or image smoothed, and black boxes behind white ones.

use super::*;
use crate::sampled::{
    Batch, GreyBox, ImageLoss, RenderedLoss, Renderer, SampledError, Smoothing, SquaredError, WhiteBox,
};

const PIXELS: usize = 8;

/// A bar that ends at `x`: pixel p is 1 where `x > p / 8`.
struct Bar;

impl Renderer for Bar {
    type Error = Infallible;

    fn image_len(&self) -> usize {
        PIXELS
    }

    fn render(&mut self, batch: &Batch<'_>, images: &mut [f64]) -> Result<(), Infallible> {
        for (i, image) in images.chunks_exact_mut(PIXELS).enumerate() {
            for (p, pixel) in image.iter_mut().enumerate() {
                *pixel = step(&[batch.point(i)[0] - p as f64 / 8.0]);
            }
        }
        Ok(())
    }
}

fn target() -> SquaredError {
    SquaredError { target: (0..PIXELS).map(|p| if p < 5 { 0.9 } else { 0.2 }).collect() }
}

/// Distribution function of the standard normal by integration from the middle.
fn phi(t: f64) -> f64 {
    let steps = 400;
    let h = t / f64::from(steps);
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    0.5 + (0..steps).map(|i| h * density((f64::from(i) + 0.5) * h)).sum::<f64>()
}

/// Value, gradient and second derivative of both objectives at `x`.
fn exact(x: f64, sigma: f64, smoothing: Smoothing) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (p, goal) in target().target.iter().enumerate() {
        let at = x - p as f64 / 8.0;
        let (first, second) = smoothed_step(at, sigma);
        let mean = phi(at / sigma);
        let terms = match smoothing {
            // The pixel is 0 or 1: its square is itself.
            Smoothing::Loss => {
                let factor = 1.0 - 2.0 * goal;
                [mean * factor + goal * goal, factor * first, factor * second]
            }
            Smoothing::Image { .. } => {
                let off = mean - goal;
                [off * off, 2.0 * off * first, 2.0 * (first * first + off * second)]
            }
        };
        (0..3).for_each(|k| sums[k] += terms[k] / PIXELS as f64);
    }
    sums
}

/// Mean and its standard error over seeds.
fn average(runs: u64, mut estimate: impl FnMut(u64) -> f64) -> (f64, f64) {
    let all: Vec<f64> = (0..runs).map(&mut estimate).collect();
    let mean = all.iter().sum::<f64>() / runs as f64;
    let square = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / runs as f64;
    (mean, (square / runs as f64).sqrt())
}

#[test]
fn losses_and_images_are_smoothed_as_asked() {
    let (x, sigma) = (0.42, 0.2);
    let estimator = estimator(4, Stencil::FourPoint, Kernel::Coordinates);
    let mut values = Vec::new();
    for smoothing in [Smoothing::Loss, Smoothing::Image { image_samples: 16 }] {
        let mut objective = RenderedLoss::new(Bar, target(), vec![1.0], smoothing).expect("an objective");
        let [value_exact, first, second] = exact(x, sigma, smoothing);
        let at = |seed| SamplePoint { theta: &[0.42], sigma, seed };
        let many = objective.loss(at(1), 100_000).expect("a loss");
        assert!((many - value_exact).abs() < 1e-3, "{smoothing:?}: {many} for {value_exact}");
        values.push(value_exact);
        let (mean, error) =
            average(4000, |seed| objective.gradient(at(seed), estimator).expect("a gradient").value[0]);
        assert!((mean - first).abs() < 4.0 * error, "{smoothing:?} gradient: {mean} for {first}, {error}");
        let (mean, error) =
            average(4000, |seed| objective.curvature(at(seed), &[1.0], estimator).expect("one").value[0]);
        assert!((mean - second).abs() < 4.0 * error, "{smoothing:?} curvature: {mean} for {second}, {error}");
        let (mean, error) =
            average(4000, |seed| objective.hessian(at(seed), estimator).expect("one").value[0]);
        assert!((mean - second).abs() < 4.0 * error, "{smoothing:?} Hessian: {mean} for {second}, {error}");
        let fine = Estimator { samples: 64, ..estimator };
        let (mean, error) = average(300, |seed| {
            objective.hessian_product_difference(at(seed), &[1.0], 0.1, fine).expect("one").value[0]
        });
        assert!(
            (mean - second).abs() < 4.0 * error + 0.02 * second.abs(),
            "{smoothing:?} product: {mean} for {second}"
        );
    }
    assert!((values[0] - values[1]).abs() > 0.02, "two objectives: {values:?}");
}

#[test]
fn every_picture_is_counted() {
    let smoothing = Smoothing::Image { image_samples: 10 };
    let mut objective = RenderedLoss::new(Bar, target(), vec![1.0], smoothing).expect("an objective");
    let at = SamplePoint { theta: &[0.4], sigma: 0.2, seed: 1 };
    let e =
        objective.gradient(at, estimator(3, Stencil::Antithetic, Kernel::Coordinates)).expect("a gradient");
    assert_eq!((e.evaluations, objective.evaluations()), (16, 16));
    let e = objective
        .curvature(at, &[1.0], estimator(3, Stencil::FourPoint, Kernel::Coordinates))
        .expect("a curvature");
    assert_eq!((e.evaluations, objective.evaluations()), (10 + 12 + 2 * 6, 50));
}

#[test]
fn squared_error_knows_its_derivatives() {
    let loss = target();
    let image: Vec<f64> = (0..PIXELS).map(|p| 0.1 * p as f64).collect();
    let direction: Vec<f64> = (0..PIXELS).map(|p| (1.7 * p as f64).sin()).collect();
    let at = |h: f64| -> Vec<f64> { image.iter().zip(&direction).map(|(i, d)| i + h * d).collect() };
    let mut gradient = vec![0.0; PIXELS];
    loss.gradient(&image, &mut gradient);
    let slope: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
    let (plus, middle, minus) = (loss.value(&at(1e-3)), loss.value(&image), loss.value(&at(-1e-3)));
    assert!((slope - (plus - minus) / 2e-3).abs() < 1e-9);
    assert!(
        (loss.second(&image, &direction, &direction) - (plus - 2.0 * middle + minus) / 1e-6).abs() < 1e-6
    );
}

/// y = (x0^2 + x1, x0 x1, sin x1).
struct Curved;

impl WhiteBox for Curved {
    fn inputs(&self) -> usize {
        2
    }
    fn outputs(&self) -> usize {
        3
    }
    fn value(&self, x: &[f64], y: &mut [f64]) {
        y.copy_from_slice(&[x[0] * x[0] + x[1], x[0] * x[1], x[1].sin()]);
    }
    fn jvp(&self, x: &[f64], v: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[2.0 * x[0] * v[0] + v[1], x[1] * v[0] + x[0] * v[1], x[1].cos() * v[1]]);
    }
    fn vjp(&self, x: &[f64], w: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[2.0 * x[0] * w[0] + x[1] * w[1], w[0] + x[0] * w[1] + x[1].cos() * w[2]]);
    }
    fn second(&self, x: &[f64], w: &[f64], v: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&[2.0 * w[0] * v[0] + w[1] * v[1], w[1] * v[0] - x[1].sin() * w[2] * v[1]]);
    }
}

/// A quadratic of y: smoothing changes its value, not its derivatives.
fn outer(y: &[f64]) -> f64 {
    y[0] * y[0] + 0.5 * y[0] * y[1] - 5.0 * y[1] + 2.0 * y[2] * y[2] - 12.0 * y[2]
}

fn grey() -> GreyBox<SmoothedLoss<impl BlackBox<Error = Infallible>>, Curved> {
    GreyBox::new(smooth(3, outer), Curved, vec![1.0, 1.0]).expect("sizes fit")
}

#[test]
fn grey_boxes_have_exact_second_order_and_need_the_curvature_of_the_inner_function() {
    let x = [0.7, -0.4];
    let whole = |x: &[f64]| {
        let mut y = [0.0; 3];
        Curved.value(x, &mut y);
        outer(&y)
    };
    let h = 1e-4;
    let shifted = |a: f64, b: f64| whole(&[x[0] + a * h, x[1] + b * h]);
    let gradient = [
        (shifted(1.0, 0.0) - shifted(-1.0, 0.0)) / (2.0 * h),
        (shifted(0.0, 1.0) - shifted(0.0, -1.0)) / (2.0 * h),
    ];
    let mixed =
        (shifted(1.0, 1.0) - shifted(1.0, -1.0) - shifted(-1.0, 1.0) + shifted(-1.0, -1.0)) / (4.0 * h * h);
    let pure = |a: f64, b: f64| (shifted(a, b) - 2.0 * whole(&x) + shifted(-a, -b)) / (h * h);
    let hessian = [pure(1.0, 0.0), mixed, mixed, pure(0.0, 1.0)];

    let estimator =
        Estimator { stratified: true, ..estimator(20_000, Stencil::FourPoint, Kernel::Coordinates) };
    let at = SamplePoint { theta: &x, sigma: 0.1, seed: 5 };
    let close = |name: &str, got: &[f64], expected: &[f64]| {
        for (g, e) in got.iter().zip(expected) {
            assert!((g - e).abs() < 0.05, "{name}: {got:?} for {expected:?}");
        }
    };
    close("gradient", &value(grey().gradient(at, estimator)).value, &gradient);
    close("Hessian", &value(grey().hessian(at, estimator)).value, &hessian);
    let v = [0.6, -0.8];
    let product = [hessian[0] * v[0] + hessian[1] * v[1], hessian[2] * v[0] + hessian[3] * v[1]];
    let big = Estimator { samples: 100_000, ..estimator };
    close("product", &value(grey().hessian_product(at, &v, big)).value, &product);
    let along = [product[0] * v[0] + product[1] * v[1]];
    close("curvature", &value(grey().curvature(at, &v, estimator)).value, &along);

    // As published, without the sum over the second derivatives of g: wrong by twice its own size.
    let y_gradient =
        value(smooth(3, outer).gradient(SamplePoint { theta: &[0.09, -0.28, x[1].sin()], ..at }, estimator))
            .value;
    let mut bent = [[0.0; 2]; 2];
    Curved.second(&x, &y_gradient, &[1.0, 0.0], &mut bent[0]);
    Curved.second(&x, &y_gradient, &[0.0, 1.0], &mut bent[1]);
    let missing = bent.iter().flatten().map(|b| b * b).sum::<f64>().sqrt();
    let size = hessian.iter().map(|b| b * b).sum::<f64>().sqrt();
    assert!(missing > 1.5 * size, "{missing} of {size}");
}

#[test]
fn sizes_that_do_not_fit_are_errors() {
    assert!(matches!(GreyBox::new(smooth(2, outer), Curved, vec![1.0; 2]), Err(SampledError::Setting(_))));
    assert!(matches!(GreyBox::new(smooth(3, outer), Curved, vec![1.0; 3]), Err(SampledError::Setting(_))));
    assert!(RenderedLoss::new(Bar, target(), vec![], Smoothing::Loss).is_err());
    assert!(RenderedLoss::new(Bar, target(), vec![1.0], Smoothing::Image { image_samples: 0 }).is_err());
}
