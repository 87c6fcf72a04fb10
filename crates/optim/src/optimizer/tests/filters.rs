//! Filters in a step: bounds, memory, scale, traps.

use crate::{
    Bilateral, Grid, GridBilateral, GuideMap, OptimError, Optimizer, Placement, ScreenedPoisson,
    SecondMoment, Sigma, Temporal,
};
use photofit_gradcheck::Uniform;
use photofit_scalar::Real;

const GRID: Grid = Grid::plane(24, 18);
const N: usize = 24 * 18;

fn fixed(sigma: f64) -> Bilateral {
    Bilateral { levels: 4, sigma: Sigma::Fixed(sigma), ..Bilateral::default() }
}

fn with_bilateral<T: Real>(temporal: Temporal, placement: Placement, channels: usize) -> Optimizer<T> {
    let filter = GridBilateral::new("theta", GRID, channels, fixed(0.2)).unwrap();
    Optimizer::new("theta", N * channels, temporal).unwrap().with_filter(placement, filter).unwrap()
}

fn exact() -> Temporal {
    Temporal { relative_epsilon: 0.0, bias_correction: false, ..Temporal::adam() }
}

fn single(x: &[f64]) -> Vec<f32> {
    x.iter().map(|x| *x as f32).collect()
}

#[test]
fn a_lone_gradient_on_a_zero_history_moves_by_the_rate() {
    for b1 in [0.0, 0.2, 0.5, 0.9] {
        for placement in [Placement::PRE, Placement::POST, Placement::BOTH] {
            let mut optimizer = with_bilateral::<f64>(exact().paired(b1), placement, 1);
            let mut x = Uniform::new(1).vec(N, 0.0, 1.0);
            let before = x.clone();
            optimizer.step(&mut x, &[0.0; N], 0.1).unwrap();
            assert_eq!(x, before);
            optimizer.step(&mut x, &[-3.0; N], 0.125).unwrap();
            let off = x.iter().zip(&before).fold(0.0_f64, |w, (x, y)| w.max((x - y - 0.125).abs()));
            assert!(off < 1e-12, "b1 {b1} {placement:?}: {off:e}");
        }
    }
}

/// Longest step of 40 at rate one under gradients of very different sizes.
fn longest(mut optimizer: Optimizer<f64>, channels: usize) -> f64 {
    let mut rng = Uniform::new(12);
    let mut x = rng.vec(N * channels, 0.0, 1.0);
    let mut longest = 0.0_f64;
    for t in 0..40 {
        let g: Vec<f64> =
            (0..x.len()).map(|i| rng.range(-1.0, 1.3).powi(1 + ((i / 5 + t) % 30) as i32)).collect();
        let before = x.clone();
        optimizer.step(&mut x, &g, 1.0).unwrap();
        longest = x.iter().zip(&before).fold(longest, |l, (x, y)| l.max((x - y).abs()));
        x.iter_mut().for_each(|x| *x = x.rem_euclid(1.0));
    }
    longest
}

#[test]
fn steps_are_bounded_when_both_moments_are_filtered_and_not_when_one_is() {
    for b1 in [0.0, 0.2, 0.5, 0.9] {
        let bound = exact().paired(b1).bound();
        for second in [SecondMoment::PerEntry, SecondMoment::PerVector(2), SecondMoment::GlobalMax] {
            let temporal = Temporal { second, ..exact() }.paired(b1);
            for placement in [Placement::PRE, Placement::POST, Placement::BOTH] {
                let step = longest(with_bilateral(temporal, placement, 2), 2);
                assert!(
                    step <= bound * (1.0 + 1e-9),
                    "b1 {b1} {second:?} {placement:?}: {step} above {bound}"
                );
            }
            let poisson = ScreenedPoisson::new("theta", GRID, 4.0).unwrap();
            let optimizer = Optimizer::new("theta", 2 * N, temporal).unwrap();
            let step = longest(optimizer.with_filter(Placement::POST, poisson).unwrap(), 2);
            assert!(step <= bound * (1.0 + 1e-9), "b1 {b1} {second:?} Poisson: {step} above {bound}");
        }
        let global = Temporal { second: SecondMoment::GlobalMax, ..exact() }.paired(b1);
        assert!(longest(with_bilateral(global, Placement::FIRST, 2), 2) <= bound * (1.0 + 1e-9));
        // Negative control: m alone against a v of its own size.
        let step = longest(with_bilateral(exact().paired(b1), Placement::FIRST, 2), 2);
        assert!(step > 700.0, "b1 {b1}: only {step} with the first moment alone filtered");
    }
}

#[test]
fn without_memory_the_step_is_mean_over_rms() {
    let mut optimizer = with_bilateral::<f64>(Temporal::memoryless(), Placement::POST, 1);
    assert!(optimizer.state().m.is_empty() && optimizer.state().v.is_empty());
    let mut rng = Uniform::new(3);
    let mut x = rng.vec(N, 0.0, 1.0);
    let g = rng.vec(N, -1.0, 2.0);
    let square: Vec<f64> = g.iter().map(|g| g * g).collect();
    let mut filter = GridBilateral::new("theta", GRID, 1, fixed(0.2)).unwrap();
    let guidance = crate::Guidance { group: "theta", params: &x, grads: &g, rate: 0.1, guide: &[] };
    crate::SpatialFilter::prepare(&mut filter, &guidance).unwrap();
    let mut out = [vec![0.0; N], vec![0.0; N]];
    let [mean, of_squares] = &mut out;
    crate::SpatialFilter::apply(&mut filter, &[&g, &square], &mut [mean, of_squares]);
    let before = x.clone();
    optimizer.step(&mut x, &g, 0.1).unwrap();
    for i in 0..N {
        let expected = 0.1 * out[0][i] / out[1][i].sqrt();
        assert!((before[i] - x[i] - expected).abs() < 1e-6, "{i}: {} against {expected}", before[i] - x[i]);
    }
    assert!(optimizer.state().m.is_empty() && optimizer.state().step == 1);
}

#[test]
fn filters_work_on_copies_of_the_moments() {
    let temporal = Temporal::adam().paired(0.5);
    let mut filtered = with_bilateral::<f32>(temporal, Placement::POST, 1);
    let mut plain = Optimizer::new("theta", N, temporal).unwrap();
    let mut rng = Uniform::new(6);
    let (mut x, mut y) = (single(&rng.vec(N, 0.0, 1.0)), vec![0.0_f32; N]);
    for _ in 0..5 {
        let g = single(&rng.vec(N, -1.0, 1.0));
        filtered.step(&mut x, &g, 0.01).unwrap();
        plain.step(&mut y, &g, 0.01).unwrap();
    }
    assert_eq!(filtered.state(), plain.state());
    assert_ne!(x, y);
}

#[test]
fn gradients_times_a_power_of_two_give_the_same_bits() {
    for placement in [Placement::PRE, Placement::POST, Placement::BOTH] {
        for second in [SecondMoment::PerEntry, SecondMoment::GlobalMax, SecondMoment::PerVector(3)] {
            let mut first: Option<Vec<f32>> = None;
            for scale in [0.0_f32, -66.0, 66.0].map(f32::exp2) {
                let temporal = Temporal { second, ..Temporal::adam() };
                let mut optimizer = with_bilateral::<f32>(temporal, placement, 3);
                let mut rng = Uniform::new(2);
                let mut x = single(&rng.vec(3 * N, 0.0, 1.0));
                for _ in 0..5 {
                    let g: Vec<f32> = single(&rng.vec(3 * N, -1.0, 1.0)).iter().map(|g| g * scale).collect();
                    optimizer.step(&mut x, &g, 0.01).unwrap();
                }
                assert_eq!(first.get_or_insert(x.clone()), &x, "{placement:?} {second:?} scale {scale}");
            }
        }
    }
}

#[test]
fn extreme_gradients_move_by_the_rate() {
    for size in [1e-20_f32, 1e20, 1e-38, 3e38] {
        for placement in [Placement::PRE, Placement::POST] {
            let mut optimizer = with_bilateral::<f32>(Temporal::adam(), placement, 1);
            let mut x = vec![0.5_f32; N];
            for t in 1..=5 {
                optimizer.step(&mut x, &[size; N], 0.5).unwrap();
                let expected = 0.5 - 0.5 * t as f32;
                assert!(x.iter().all(|x| (x - expected).abs() < 1e-4), "{size} {placement:?}: {}", x[0]);
            }
        }
    }
}

#[test]
fn a_restored_state_continues_to_the_same_bits() {
    let new = || {
        let config = Bilateral { map: GuideMap::Log, ..Bilateral::default() };
        let filter = GridBilateral::new("theta", GRID, 1, config).unwrap();
        let poisson = ScreenedPoisson::new("theta", GRID, 0.3).unwrap();
        Optimizer::<f32>::new("theta", N, Temporal::adam().paired(0.2))
            .unwrap()
            .with_filter(Placement::PRE, poisson)
            .unwrap()
            .with_filter(Placement::POST, filter)
            .unwrap()
    };
    let mut rng = Uniform::new(8);
    let mut a = (single(&rng.vec(N, 0.1, 1.0)), new());
    let gradients: Vec<Vec<f32>> = (0..12).map(|_| single(&rng.vec(N, -1.0, 1.0))).collect();
    gradients[..6].iter().for_each(|g| a.1.step(&mut a.0, g, 0.01).unwrap());
    let mut b = (a.0.clone(), new());
    b.1.restore(a.1.state().clone()).unwrap();
    for g in &gradients[6..] {
        a.1.step(&mut a.0, g, 0.01).unwrap();
        b.1.step(&mut b.0, g, 0.01).unwrap();
    }
    assert_eq!((&a.0, a.1.state()), (&b.0, b.1.state()));
}

#[test]
fn refused_steps_change_nothing() {
    let mut optimizer = with_bilateral::<f32>(Temporal::adam(), Placement::POST, 1);
    let mut x = vec![0.5_f32; N];
    let mut g = vec![1.0_f32; N];
    optimizer.step(&mut x, &g, 0.1).unwrap();
    let (before, state) = (x.clone(), optimizer.state().clone());
    g[100] = f32::NAN;
    let error = optimizer.step(&mut x, &g, 0.1).unwrap_err();
    assert_eq!(error.to_string(), "gradient 100 of parameter group `theta` is NaN");
    g[100] = 1.0;
    x[33] = f32::INFINITY;
    let error = optimizer.step(&mut x, &g, 0.1).unwrap_err();
    assert!(matches!(error, OptimError::NonFiniteParameter { index: 33, .. }), "{error}");
    x[33] = before[33];
    assert!(optimizer.step_guided(&mut x, &g, 0.1, &[1.0]).is_err(), "a guide that nobody expects");
    assert_eq!((&x, optimizer.state()), (&before, &state));
    optimizer.step(&mut x, &g, 0.1).unwrap();
}

#[test]
fn combinations_without_meaning_are_refused() {
    let poisson = || ScreenedPoisson::new("theta", GRID, 1.0).unwrap();
    let new = |len| Optimizer::<f32>::new("theta", len, Temporal::adam()).unwrap();
    assert!(new(N + 1).with_filter(Placement::POST, poisson()).is_err());
    let variable = new(N).with_filter(Placement::PRE, poisson()).unwrap();
    let error = variable.with_filter(Placement::VARIABLE, poisson()).unwrap_err();
    assert_eq!(error.to_string(), "a change of variables of `theta` cannot be combined with another filter");
    let mut variable = new(N).with_filter(Placement::VARIABLE, poisson()).unwrap();
    let (mut x, g) = (vec![0.0; N], vec![1.0; N]);
    let error = variable.step(&mut x, &g, 0.1).unwrap_err();
    assert!(matches!(error, OptimError::Combination { .. }), "{error}");
    assert_eq!((x, variable.state().step), (vec![0.0; N], 0));
    // Vectors across sites have no second moment per site.
    let vectors = Optimizer::<f32>::new("theta", N, Temporal::vector_adam(2)).unwrap();
    assert!(vectors.with_filter(Placement::POST, poisson()).is_err());
}

#[test]
fn constant_parameters_stay_constant() {
    for placement in [Placement::PRE, Placement::POST, Placement::BOTH] {
        let mut optimizer = with_bilateral::<f32>(Temporal::adam().paired(0.5), placement, 1);
        let mut x = vec![0.25_f32; N];
        // Without gradients nothing moves; with one for all, all move together, for a width of zero between neighbours.
        optimizer.step(&mut x, &[0.0; N], 0.1).unwrap();
        assert_eq!(x, [0.25; N], "{placement:?}");
        for _ in 0..5 {
            optimizer.step(&mut x, &[1e-20; N], 0.1).unwrap();
            let spread = x.iter().fold(0.0_f32, |s, v| s.max((v - x[0]).abs()));
            assert!(spread < 1e-6 && x[0].is_finite(), "{placement:?}: {spread}");
        }
        assert!(x[0] < 0.2, "{placement:?}: {}", x[0]);
    }
}
