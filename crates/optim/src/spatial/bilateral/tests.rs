//! Tests of the grid bilateral filter: the definition, edges, bounds, spectrum, stress.

use super::*;
use photofit_gradcheck::Uniform;

fn guided<'a, T>(params: &'a [T], rate: T) -> Guidance<'a, T> {
    Guidance { group: "theta", params, grads: params, rate, guide: &[] }
}

fn run<T: Real>(filter: &mut GridBilateral<T>, params: &[T], field: &[T]) -> Vec<T> {
    filter.prepare(&guided(params, T::zero())).unwrap();
    let mut out = vec![T::zero(); field.len()];
    filter.apply(&[field], &mut [&mut out]);
    out
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |w, (a, b)| w.max((a - b).abs()))
}

/// The definition: scaled distances between sites, and who is cut from whom.
struct Naive<'a> {
    shape: [usize; 3],
    taps: Taps,
    distance: &'a dyn Fn(usize, usize) -> f64,
    apart: &'a dyn Fn(usize, usize) -> bool,
}

impl Naive<'_> {
    fn level(&self, stride: usize, field: &[f64], channels: usize) -> Vec<f64> {
        let [nx, ny, nz] = self.shape;
        let weights = self.taps.weights();
        let radius = (weights.len() / 2) as i64;
        let sites = nx * ny * nz;
        let mut out = vec![0.0; field.len()];
        for i in 0..sites {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let (mut total, mut sums) = (0.0, vec![0.0; channels]);
            for tap in 0..weights.len().pow(3) {
                let k =
                    [tap % weights.len(), tap / weights.len() % weights.len(), tap / weights.len().pow(2)];
                let to: Vec<i64> =
                    (0..3).map(|a| at[a] as i64 + (k[a] as i64 - radius) * stride as i64).collect();
                if (0..3).any(|a| to[a] < 0 || to[a] >= self.shape[a] as i64) {
                    continue;
                }
                let j = to[0] as usize + nx * (to[1] as usize + ny * to[2] as usize);
                if (self.apart)(i, j) {
                    continue;
                }
                let w = k.iter().map(|k| weights[*k]).product::<f64>() * (-(self.distance)(i, j)).exp();
                total += w;
                (0..channels).for_each(|c| sums[c] += w * field[j * channels + c]);
            }
            (0..channels).for_each(|c| out[i * channels + c] = sums[c] / total);
        }
        out
    }
}

/// Distance of sites in a field of `channels` samples.
fn distance(values: &[f64], channels: usize, sigma: f64) -> impl Fn(usize, usize) -> f64 + '_ {
    move |i, j| {
        let square: f64 =
            (0..channels).map(|c| (values[i * channels + c] - values[j * channels + c]).powi(2)).sum();
        square.sqrt() / sigma
    }
}

#[test]
fn equals_the_definition() {
    let shapes = [[1, 1, 1], [9, 1, 1], [70, 1, 1], [1, 13, 1], [11, 8, 1], [5, 4, 6], [1, 1, 5], [40, 3, 2]];
    for (case, shape) in shapes.into_iter().enumerate() {
        for taps in [Taps::Three, Taps::B3] {
            for (channels, coarse_to_fine) in [(1, false), (3, true), (4, false), (5, true)] {
                let mut rng = Uniform::new(case as u64);
                let n = shape.iter().product::<usize>();
                let params = rng.vec(n * channels, -1.0, 1.0);
                let [field, square] = [rng.vec(n * channels, -1.0, 1.0), rng.vec(n * channels, 0.0, 1.0)];
                let config = Bilateral {
                    levels: 4,
                    taps,
                    sigma: Sigma::Fixed(0.4),
                    coarse_to_fine,
                    ..Bilateral::default()
                };
                let grid = Grid::volume(shape[0], shape[1], shape[2]);
                let distance = distance(&params, channels, 0.4);
                let naive = Naive { shape, taps, distance: &distance, apart: &|_, _| false };
                let strides = if coarse_to_fine { [8, 4, 2, 1] } else { [1, 2, 4, 8] };
                let expected = [&field, &square]
                    .map(|f| strides.iter().fold(f.clone(), |f, s| naive.level(*s, &f, channels)));
                let mut filter = GridBilateral::new("theta", grid, channels, config).unwrap();
                filter.prepare(&guided(&params, 0.0)).unwrap();
                let mut out = [vec![0.0; n * channels], vec![0.0; n * channels]];
                let [a, b] = &mut out;
                filter.apply(&[&field, &square], &mut [a, b]);
                for k in 0..2 {
                    let error = worst(&out[k], &expected[k]);
                    assert!(error < 1e-12, "{shape:?} {taps:?} {channels} channels: {error:e}");
                }
                let single = |x: &[f64]| x.iter().map(|x| *x as f32).collect::<Vec<_>>();
                let mut filter = GridBilateral::new("theta", grid, channels, config).unwrap();
                let out = run(&mut filter, &single(&params), &single(&field));
                let error = worst(&out.iter().map(|x| f64::from(*x)).collect::<Vec<_>>(), &expected[0]);
                assert!(error < 3e-5, "{shape:?} {taps:?} {channels} channels in f32: {error:e}");
            }
        }
    }
}

#[test]
fn guides_labels_and_holes_are_the_definition_too() {
    let shape = [14, 9, 1];
    let n = 126;
    let mut rng = Uniform::new(2);
    let (params, field) = (rng.vec(n * 2, 0.1, 1.0), rng.vec(n * 2, -1.0, 1.0));
    let normals = rng.vec(n * 3, -1.0, 1.0);
    let labels: Vec<u32> = (0..n).map(|i| if i % 14 < 6 { 4_000_000_000 } else { 7 }).collect();
    let holes: Vec<bool> = (0..n).map(|_| rng.range(0.0, 1.0) < 0.2).collect();
    for (map, mapped) in [
        (GuideMap::Linear, params.clone()),
        (GuideMap::Log, params.iter().map(|x| (x + 1e-8).ln()).collect()),
        (GuideMap::Asinh(0.3), params.iter().map(|x| (x / 0.3).asinh()).collect()),
    ] {
        let (own, joint) = (distance(&mapped, 2, 0.4), distance(&normals, 3, 0.7));
        let both = |i: usize, j: usize| own(i, j).hypot(joint(i, j));
        let apart = |i: usize, j: usize| labels[i] != labels[j] || (holes[j] && i != j);
        let naive = Naive { shape, taps: Taps::Three, distance: &both, apart: &apart };
        let mut expected = [1, 2, 4].iter().fold(field.clone(), |f, s| naive.level(*s, &f, 2));
        for i in (0..n).filter(|i| holes[*i]) {
            expected[2 * i..2 * i + 2].copy_from_slice(&field[2 * i..2 * i + 2]);
        }
        let config = Bilateral { levels: 3, map, sigma: Sigma::Fixed(0.4), ..Bilateral::default() };
        let mut filter = GridBilateral::new("theta", Grid::plane(14, 9), 2, config)
            .unwrap()
            .with_guide(&vec![0.0; 3 * n], 3, 0.7)
            .unwrap()
            .with_holes(&holes)
            .unwrap()
            .with_labels(&labels)
            .unwrap();
        let guidance = Guidance { guide: &normals, ..guided(&params, 0.0) };
        filter.prepare(&guidance).unwrap();
        let mut out = vec![0.0; 2 * n];
        filter.apply(&[&field], &mut [&mut out]);
        assert!(worst(&out, &expected) < 1e-12, "{map:?}: {:e}", worst(&out, &expected));
        // The joint guide stays until the next one.
        assert_eq!(run(&mut filter, &params, &field), out);
    }
}

#[test]
fn nothing_leaks_across_labels_or_out_of_holes() {
    let n = 64 * 64;
    let labels: Vec<u32> = (0..n as u32).map(|i| (i % 64) / 20 + 100 * (i / 64 / 30)).collect();
    let holes: Vec<bool> = (0..n).map(|i| i % 7 == 0).collect();
    let mut filter = GridBilateral::new("theta", Grid::plane(64, 64), 1, Bilateral::low_pass(5))
        .unwrap()
        .with_labels(&labels)
        .unwrap()
        .with_holes(&holes)
        .unwrap();
    for at in [30 * 64 + 19, 29 * 64 + 20, 7] {
        let mut field = vec![0.0_f32; n];
        field[at] = 1e30;
        let out = run(&mut filter, &vec![0.5; n], &field);
        for i in 0..n {
            let same = labels[i] == labels[at] && !holes[i] && !holes[at];
            assert!(same || out[i] == field[i], "site {i} has {} from {at}", out[i]);
        }
        assert!(holes[at] || out[at] < 1e29, "spread within its own label");
    }
}

#[test]
fn the_width_is_the_stated_one() {
    for (taps, levels, stated) in
        [(Taps::B3, 3, 4.58), (Taps::B3, 4, 9.22), (Taps::B3, 5, 18.47), (Taps::Three, 5, 13.06)]
    {
        let mut field = vec![0.0_f64; 401];
        field[200] = 1.0;
        let config = Bilateral { taps, ..Bilateral::low_pass(levels) };
        let mut filter = GridBilateral::new("theta", Grid::line(401), 1, config).unwrap();
        let out = run(&mut filter, &field, &field);
        let variance: f64 = out.iter().enumerate().map(|(i, w)| w * (i as f64 - 200.0).powi(2)).sum();
        let k = if taps == Taps::B3 { 1.0 } else { 0.5 };
        let closed = (k * (4.0_f64.powi(levels as i32) - 1.0) / 3.0).sqrt();
        assert!((variance.sqrt() - closed).abs() < 1e-9 && (closed - stated).abs() < 0.01, "{closed}");
    }
}

/// Eigenvalues of a symmetric matrix by Jacobi rotations.
fn eigenvalues(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    for _ in 0..30 {
        for p in 0..n {
            for q in p + 1..n {
                if a[p][q].abs() < 1e-300 {
                    continue;
                }
                let t = 0.5 * (2.0 * a[p][q]).atan2(a[q][q] - a[p][p]);
                let (s, c) = t.sin_cos();
                for k in 0..n {
                    let (x, y) = (a[k][p], a[k][q]);
                    (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[p][k], a[q][k]);
                    (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    (0..n).map(|i| a[i][i]).collect()
}

fn matrix(config: Bilateral, grid: Grid, params: &[f64]) -> Vec<Vec<f64>> {
    let n = grid.sites();
    let mut filter = GridBilateral::new("theta", grid, 1, config).unwrap();
    let columns: Vec<Vec<f64>> = (0..n)
        .map(|j| {
            let mut unit = vec![0.0; n];
            unit[j] = 1.0;
            run(&mut filter, params, &unit)
        })
        .collect();
    (0..n).map(|i| (0..n).map(|j| columns[j][i]).collect()).collect()
}

#[test]
fn one_level_has_real_eigenvalues_from_zero_to_one_and_five_need_not_descend() {
    let mut negative = false;
    for seed in 0..6 {
        let params = Uniform::new(seed).vec(48, -1.0, 1.0);
        for taps in [Taps::Three, Taps::B3] {
            let config = Bilateral { levels: 1, taps, sigma: Sigma::Fixed(0.3), ..Bilateral::default() };
            let f = matrix(config, Grid::plane(8, 6), &params);
            // W = D F is symmetric with D_i / D_j = F_ji / F_ij: similar to S_ij = sqrt(F_ij F_ji).
            let s: Vec<Vec<f64>> =
                (0..48).map(|i| (0..48).map(|j| (f[i][j] * f[j][i]).sqrt()).collect()).collect();
            let values = eigenvalues(s);
            assert!(values.iter().all(|e| (-1e-12..=1.0 + 1e-12).contains(e)), "{taps:?}: {values:?}");
            let f = matrix(Bilateral { levels: 5, ..config }, Grid::plane(8, 6), &params);
            let half: Vec<Vec<f64>> =
                (0..48).map(|i| (0..48).map(|j| 0.5 * (f[i][j] + f[j][i])).collect()).collect();
            negative |= eigenvalues(half).iter().any(|e| *e < -1e-3);
        }
    }
    assert!(negative, "no direction g with g . F g < 0 was found");
}

#[test]
fn averages_are_bounded_by_jensen() {
    for b1 in [0.0, 0.2, 0.5, 0.9] {
        let bound = crate::Temporal::adam().paired(b1).bound();
        let b2 = 1.0 - (1.0 - b1) * (1.0 - b1);
        let mut rng = Uniform::new(12);
        let (mut m, mut v) = (vec![0.0; 300], vec![0.0; 300]);
        let mut largest = 0.0_f64;
        for _ in 0..30 {
            for i in 0..300 {
                let g: f64 = rng.range(-1.0, 1.5).powi(3);
                m[i] = b1 * m[i] + (1.0 - b1) * g;
                v[i] = b2 * v[i] + (1.0 - b2) * g * g;
            }
            let params = rng.vec(300, 0.0, 1.0);
            let config = Bilateral { sigma: Sigma::Fixed(0.1), ..Bilateral::default() };
            let mut filter = GridBilateral::new("theta", Grid::plane(20, 15), 1, config).unwrap();
            filter.prepare(&guided(&params, 0.0)).unwrap();
            let mut out = [vec![0.0; 300], vec![0.0; 300]];
            let [a, b] = &mut out;
            filter.apply(&[&m, &v], &mut [a, b]);
            largest = out[0].iter().zip(&out[1]).fold(largest, |l, (m, v)| l.max(m.abs() / v.sqrt()));
        }
        assert!(largest <= bound * (1.0 + 1e-9), "b1 {b1}: {largest} above {bound}");
    }
}

#[test]
fn automatic_widths_follow_the_parameters() {
    // Slope .25 along x and none along y, a jump in one column.
    let ramp: Vec<f64> = (0..600).map(|i| f64::from(i % 30) * 0.25 + f64::from(i % 30 / 29) * 9.0).collect();
    let auto = |k, map, rate| sigma::sigma(Sigma::Auto(k), map, Grid::line(600), &ramp, None, rate);
    assert!((auto(2.0, GuideMap::Linear, 0.0) - 0.5).abs() < 1e-12);
    assert!((auto(2.0, GuideMap::Linear, 10.0) - 2.0).abs() < 1e-12, "a fifth of the rate");
    let flat = vec![0.5; 600];
    let floor = |map| sigma::sigma(Sigma::Auto(3.0), map, Grid::plane(30, 20), &flat, None, 0.1);
    assert!((floor(GuideMap::Linear) - 0.02).abs() < 1e-12);
    assert!((floor(GuideMap::Log) - 0.04).abs() < 1e-7, "{}", floor(GuideMap::Log));
    assert!((floor(GuideMap::Asinh(1.2)) - 0.02 / 1.3).abs() < 1e-12);
    // Large grids are sampled: the estimate stays close.
    let mut rng = Uniform::new(1);
    let noise = rng.vec(300 * 300, 0.0, 1.0);
    let sampled = sigma::sigma(Sigma::Auto(1.0), GuideMap::Linear, Grid::plane(300, 300), &noise, None, 0.0);
    assert!((sampled - 0.293).abs() < 0.01, "{sampled}");
}

#[test]
fn extreme_widths_and_values() {
    let mut rng = Uniform::new(9);
    let params: Vec<f32> = rng.vec(400, -1.0, 1.0).iter().map(|x| *x as f32).collect();
    let field: Vec<f32> = rng.vec(400, -1.0, 1.0).iter().map(|x| *x as f32).collect();
    let filter = |sigma: f64| {
        let config = Bilateral { sigma: Sigma::Fixed(sigma), ..Bilateral::default() };
        GridBilateral::new("theta", Grid::plane(20, 20), 1, config).unwrap()
    };
    for sigma in [0.0, 1e-300, 1e-30, 1e-12] {
        assert_eq!(run(&mut filter(sigma), &params, &field), field, "sigma {sigma} keeps all sites apart");
    }
    let mut low = GridBilateral::new("theta", Grid::plane(20, 20), 1, Bilateral::low_pass(5)).unwrap();
    let smooth = run(&mut low, &params, &field);
    for (sigma, value) in [(0.0, 0.3), (1e-30, 0.0), (0.1, 3e38), (0.1, 1e-38)] {
        let same = run(&mut filter(sigma), &vec![value; 400], &field);
        assert_eq!(same, smooth, "equal parameters {value}: the low-pass filter");
    }
    assert_eq!(run(&mut filter(1e30), &params, &field), smooth);
    for scale in [1e-30_f32, 1e30] {
        let params: Vec<f32> = params.iter().map(|p| p * scale).collect();
        let a = run(&mut filter(0.3 * f64::from(scale)), &params, &field);
        assert!(a.iter().all(|x| x.is_finite() && x.abs() <= 1.0), "parameters times {scale}");
        assert!(a != field && a != smooth, "parameters times {scale}");
    }
    // Fields of any size, and sizes next to each other.
    for size in [1e-38_f32, 1e38] {
        let field: Vec<f32> = field.iter().map(|f| f * size).collect();
        let out = run(&mut filter(0.3), &params, &field);
        assert!(out.iter().all(|x| x.is_finite() && x.abs() <= 1.001 * size));
    }
}

#[test]
fn single_texels_and_empty_grids() {
    for taps in [Taps::Three, Taps::B3] {
        let config = Bilateral { taps, levels: 30, ..Bilateral::default() };
        let mut one = GridBilateral::new("theta", Grid::plane(1, 1), 4, config).unwrap();
        assert_eq!(
            run(&mut one, &[0.1_f32, 0.2, 0.3, 0.4], &[1.0, -2.0, 3.0, 1e-20]),
            [1.0, -2.0, 3.0, 1e-20]
        );
        let mut none = GridBilateral::new("theta", Grid::plane(0, 7), 4, config).unwrap();
        assert_eq!(run::<f32>(&mut none, &[], &[]), []);
    }
}

#[test]
fn bad_input_is_refused_by_name() {
    let new = || GridBilateral::<f32>::new("roughness", Grid::plane(4, 4), 1, Bilateral::default());
    let mut params = [0.5_f32; 16];
    params[11] = f32::NAN;
    let guidance = Guidance { group: "roughness", ..guided(&params, 0.1) };
    let error = new().unwrap().prepare(&guidance).unwrap_err();
    assert_eq!(error.to_string(), "parameter 11 of group `roughness` is NaN, and cannot guide a filter");
    assert!(new().unwrap().prepare(&guided(&params[..9], 0.1)).is_err());
    assert!(new().unwrap().with_labels(&[1; 15]).is_err());
    assert!(new().unwrap().with_holes(&[true; 17]).is_err());
    assert!(new().unwrap().with_guide(&[0.0; 15], 1, 0.1).is_err());
    assert!(new().unwrap().with_guide(&[f32::INFINITY; 16], 1, 0.1).is_err());
    assert!(new().unwrap().with_guide(&[0.0; 16], 1, 0.0).is_err());
    for bad in [
        Bilateral { levels: 31, ..Bilateral::default() },
        Bilateral { sigma: Sigma::Auto(-1.0), ..Bilateral::default() },
        Bilateral { sigma: Sigma::Fixed(f64::NAN), ..Bilateral::default() },
        Bilateral { map: GuideMap::Asinh(0.0), ..Bilateral::default() },
    ] {
        assert!(GridBilateral::<f32>::new("x", Grid::line(4), 1, bad).is_err(), "{bad:?}");
    }
    assert!(GridBilateral::<f32>::new("x", Grid::line(4), 0, Bilateral::default()).is_err());
    assert!(
        GridBilateral::<f32>::new("x", Grid::volume(1 << 30, 1 << 30, 9), 1, Bilateral::default()).is_err()
    );
}

#[test]
fn gradients_may_guide() {
    let mut rng = Uniform::new(5);
    let [params, grads, field] = [0; 3].map(|_| rng.vec(200, -1.0, 1.0));
    let config = Bilateral { sigma: Sigma::Fixed(0.3), ..Bilateral::default() };
    let new =
        |source| GridBilateral::new("theta", Grid::plane(20, 10), 1, Bilateral { source, ..config }).unwrap();
    let mut plain = new(Source::Gradients);
    plain.prepare(&Guidance { grads: &grads, ..guided(&params, 0.1) }).unwrap();
    let mut out = vec![0.0; 200];
    plain.apply(&[&field], &mut [&mut out]);
    assert_eq!(out, run(&mut new(Source::Parameters), &grads, &field));
}

#[test]
fn threads_do_not_change_a_bit() {
    let mut rng = Uniform::new(1);
    let [params, field] = [0; 2].map(|_| rng.vec(90 * 70 * 3, 0.0, 1.0));
    let [params, field] = [params, field].map(|x| x.iter().map(|x| *x as f32).collect::<Vec<_>>());
    let filtered = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let new = GridBilateral::new("theta", Grid::plane(90, 70), 3, Bilateral::default());
        pool.install(|| run(&mut new.unwrap(), &params, &field))
    };
    assert_eq!(filtered(1), filtered(3));
}

#[test]
#[ignore = "measurement"]
fn time_of_textures_and_volumes() {
    let three = Bilateral::default();
    let b3 = Bilateral { taps: Taps::B3, ..three };
    let volume = Bilateral { levels: 3, ..three };
    for (name, grid, channels, config) in [
        ("512^2 x 4, 3 taps", Grid::plane(512, 512), 4, three),
        ("512^2 x 4, B3", Grid::plane(512, 512), 4, b3),
        ("512^2 x 3, 3 taps", Grid::plane(512, 512), 3, three),
        ("512^2 x 1, 3 taps", Grid::plane(512, 512), 1, three),
        ("512^2 x 1, B3", Grid::plane(512, 512), 1, b3),
        ("64^3 x 1, 3 taps", Grid::volume(64, 64, 64), 1, volume),
        ("64^3 x 4, 3 taps", Grid::volume(64, 64, 64), 4, volume),
        ("64^3 x 1, B3", Grid::volume(64, 64, 64), 1, Bilateral { taps: Taps::B3, ..volume }),
        ("2048^2 x 4, 3 taps", Grid::plane(2048, 2048), 4, three),
    ] {
        let n = grid.sites() * channels;
        let mut rng = Uniform::new(1);
        let params: Vec<f32> = (0..n).map(|_| rng.range(0.0, 1.0) as f32).collect();
        let mut filter = GridBilateral::new("theta", grid, channels, config).unwrap();
        let mut out = [vec![0.0_f32; n], vec![0.0_f32; n]];
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..15 {
            let start = std::time::Instant::now();
            filter.prepare(&guided(&params, 0.1)).unwrap();
            times[0].push(start.elapsed().as_secs_f64());
            let [a, b] = &mut out;
            filter.apply(&[&params, &params], &mut [a, b]);
            times[1].push(start.elapsed().as_secs_f64());
        }
        times.iter_mut().for_each(|t| t.sort_by(f64::total_cmp));
        let [guide, all] = times.map(|t| [t[0] * 1e3, t[7] * 1e3]);
        println!("{name:20} guide {:.2} ms, all {:.2} ms best, {:.2} median", guide[0], all[0], all[1]);
    }
}
