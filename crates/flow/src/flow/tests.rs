//! The flow as a guide: densities, training, ablations, stress.

use super::*;
use crate::{Grid, Tensor};
use photofit_sampling::{chi_square, cosine_hemisphere, cosine_hemisphere_pdf};
use photofit_scalar::vec3;
use std::f32::consts::{PI, TAU};

const DOMAINS: [Domain; 4] = [Domain::Hemisphere, Domain::Sphere, Domain::HalfVector, Domain::Visible];

fn guide(options: FlowOptions) -> FlowGuide {
    FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), options).unwrap()
}

fn query(p: Vec3f, theta: f32) -> Query {
    let normal = vec3(0.36, -0.48, 0.8);
    let (s, _) = normal.orthonormal_pair();
    Query { position: p, normal, wo: normal * theta.cos() + s * theta.sin(), roughness: 0.7 }
}

#[test]
fn densities_of_random_weights_integrate_to_one() {
    for domain in DOMAINS {
        for family in [Family::Quadratic, Family::Rational] {
            let mut guide = guide(FlowOptions { domain, ..FlowOptions::of(family) });
            guide.randomize(0.25, 5);
            let local = guide.local(&query(vec3(0.2, 0.7, 0.4), 0.6));
            let n = 600;
            let mut sum = 0.0_f64;
            for i in 0..n {
                let z = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
                let r = (1.0 - z * z).sqrt();
                for j in 0..n {
                    let (s, c) = (TAU * (j as f32 + 0.5) / n as f32).sin_cos();
                    sum += f64::from(guide.pdf(&local, vec3(r * c, r * s, z)));
                }
            }
            let integral = sum * f64::from(4.0 * PI) / f64::from(n * n);
            // Points of half vectors that face away have no direction: their mass is missing.
            let lost = (0..200 * 200).filter(|i| {
                let u = [((i % 200) as f32 + 0.5) / 200.0, ((i / 200) as f32 + 0.5) / 200.0];
                guide.sample(&local, u).is_none()
            });
            let lost = lost.count() as f64 / 40_000.0;
            let allowed = if domain == Domain::HalfVector { 5e-3 } else { 1e-3 };
            assert!((integral + lost - 1.0).abs() < allowed, "{domain:?} {family:?}: {integral} + {lost}");
        }
    }
}

#[test]
fn samples_have_the_density_that_is_stated() {
    for domain in DOMAINS {
        let mut guide = guide(FlowOptions { domain, ..FlowOptions::default() });
        guide.randomize(0.2, 7);
        let local = guide.local(&query(vec3(0.2, 0.7, 0.4), 0.6));
        let (rows, columns, n) = (12, 16, 200_000);
        let mut counts = vec![0_u64; rows * columns + 1];
        let mut rng = Rng::new(9, 1);
        for _ in 0..n {
            let Some((wi, pdf)) = guide.sample(&local, [rng.next_f32(), rng.next_f32()]) else {
                counts[rows * columns] += 1;
                continue;
            };
            let again = guide.pdf(&local, wi);
            // Half vectors have a pole at the normal: there the rounding of wi moves the density.
            let allowed = 5e-3 + 1e-5 * pdf;
            assert!((again / pdf - 1.0).abs() < allowed, "{domain:?}: {pdf} {again}");
            let row = ((0.5 - 0.5 * wi.z) * rows as f32) as usize;
            let column = ((0.5 + wi.y.atan2(wi.x) / TAU) * columns as f32) as usize;
            counts[row.min(rows - 1) * columns + column.min(columns - 1)] += 1;
        }
        let fine = 100;
        let mut expected = vec![0.0_f64; rows * columns + 1];
        for (cell, e) in expected.iter_mut().enumerate().take(rows * columns) {
            for k in 0..fine * fine {
                let row = (cell / columns) as f32 + ((k / fine) as f32 + 0.5) / fine as f32;
                let column = (cell % columns) as f32 + ((k % fine) as f32 + 0.5) / fine as f32;
                let z = 1.0 - 2.0 * row / rows as f32;
                let (s, c) = (TAU * (column / columns as f32 - 0.5)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                *e += f64::from(guide.pdf(&local, vec3(r * c, r * s, z)));
            }
            *e *= f64::from(4.0 * PI) / (rows * columns * fine * fine) as f64;
        }
        expected[rows * columns] = (1.0 - expected.iter().sum::<f64>()).max(0.0);
        let z = chi_square::deviation(&counts, &expected);
        assert!(z < chi_square::bound(4), "{domain:?}: chi-square lies {z:.1} deviations above its mean");
    }
}

/// Light that turns with the position, on a glossy surface that is seen from many sides.
pub(super) fn records(n: usize, seed: u64) -> Vec<Record> {
    (0..n as u64)
        .map(|i| {
            let mut rng = Rng::new(seed, i);
            let mut next = || rng.next_f32();
            let position = vec3(next(), next(), next());
            let normal = vec3(0.0, 0.0, 1.0);
            let wo = cosine_hemisphere([next(), next()]);
            let wi = cosine_hemisphere([next(), next()]);
            let turn = TAU * position.x;
            let towards = vec3(0.8 * turn.cos(), 0.8 * turn.sin(), 0.6);
            let light = (30.0 * (towards.dot(wi) - 1.0)).exp();
            let half = (wo + wi).normalize_or_zero();
            let gloss = (60.0 * (half.z - 1.0)).exp();
            let value = (0.3 * light + gloss * (0.2 + light)) * wi.z;
            let query = Query { position, normal, wo, roughness: 0.4 };
            Record { query, wi, pdf: cosine_hemisphere_pdf(wi.z), value, incident: light }
        })
        .collect()
}

pub(super) fn trained(options: FlowOptions, data: &[Record]) -> FlowGuide {
    let mut guide = guide(options);
    guide.learn(data).unwrap();
    guide
}

#[test]
fn training_lowers_the_cross_entropy_and_every_condition_helps() {
    let (data, held_out) = (records(150_000, 1), records(20_000, 2));
    let options = FlowOptions { passes: 2, ..FlowOptions::default() };
    let untrained = guide(options).cross_entropy(&held_out);
    let full = trained(options, &data).cross_entropy(&held_out);
    assert!(full < untrained - 0.95, "{untrained} -> {full}");
    let spatial = trained(FlowOptions { spatial: false, ..options }, &data).cross_entropy(&held_out);
    let directional = trained(FlowOptions { directional: false, ..options }, &data).cross_entropy(&held_out);
    assert!(spatial > full + 0.1, "without positions {spatial}, with {full}");
    assert!(directional > full + 0.1, "without directions {directional}, with {full}");
    let hashed = FlowOptions { encoding: Encoding::Hash(Grid::default()), ..options };
    let hashed = trained(hashed, &data).cross_entropy(&held_out);
    assert!(hashed < spatial - 0.1, "hash grid: {hashed}, without positions {spatial}");
    let rational = FlowOptions { passes: 2, ..FlowOptions::of(Family::Rational) };
    let rational = trained(rational, &data).cross_entropy(&held_out);
    assert!(rational < untrained - 0.8, "rational quadratic: {rational}");
}

#[test]
fn half_vectors_beat_directions_on_gloss() {
    // A narrow lobe around the mirrored viewer under even light.
    let gloss = |n: usize, seed: u64| -> Vec<Record> {
        let sharp = |r: &mut Record| {
            let half = (r.query.wo + r.wi).normalize_or_zero();
            r.value = (400.0 * (half.z - 1.0)).exp() * r.wi.z;
        };
        let mut data = records(n, seed);
        data.iter_mut().for_each(sharp);
        data
    };
    let (data, held_out) = (gloss(150_000, 1), gloss(20_000, 2));
    let entropy =
        |domain| trained(FlowOptions { domain, ..FlowOptions::default() }, &data).cross_entropy(&held_out);
    let (half, direct) = (entropy(Domain::HalfVector), entropy(Domain::Hemisphere));
    assert!(half < direct - 0.1, "half vector {half}, direct {direct}");
}

#[test]
fn training_is_the_same_for_any_number_of_threads() {
    let data = records(5000, 3);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let guide = pool.install(|| trained(FlowOptions::default(), &data));
        let local = guide.local(&query(vec3(0.2, 0.7, 0.4), 0.6));
        (guide.frozen.network, guide.frozen.table, local.share.to_bits())
    };
    assert!(bits(1) == bits(3), "other bits with other threads");
}

#[test]
fn shares_follow_what_pays() {
    // Light in one corner of the sky: the guide earns its share. A narrow lobe around the mirrored viewer, which the
    // scattering function follows exactly: the guide cannot do as well.
    let mut bright = records(60_000, 4);
    for r in &mut bright {
        r.value = (60.0 * (vec3(0.0, 0.8, 0.6).dot(r.wi) - 1.0)).exp() * r.wi.z;
    }
    let mut mirror = records(60_000, 5);
    for (i, r) in mirror.iter_mut().enumerate() {
        let mut rng = Rng::new(6, i as u64);
        let (wo, radius) = (r.query.wo, 0.02);
        let offset = vec3(rng.uniform(-radius, radius), rng.uniform(-radius, radius), 0.0);
        r.wi = (vec3(-wo.x, -wo.y, wo.z) + offset).normalize_or_zero();
        r.pdf = wo.z / (4.0 * radius * radius);
        r.value = r.pdf;
    }
    // The mean over places: at a single one it depends on the seed.
    let share = |data: &[Record]| {
        let guide = trained(FlowOptions { passes: 3, ..FlowOptions::default() }, data);
        let place = |k: i32| {
            query(vec3(k as f32 % 3.0, (k / 3) as f32 % 3.0, (k / 9) as f32) * 0.4 + Vec3f::splat(0.1), 0.3)
        };
        (0..27).map(|k| guide.share(&guide.local(&place(k)))).sum::<f32>() / 27.0
    };
    let (bright, mirror) = (share(&bright), share(&mirror));
    assert!(bright > 0.43, "{bright}");
    assert!(mirror < 0.1, "{mirror}");
}

#[test]
fn a_first_call_without_light_counts_as_the_first() {
    let mut guide = guide(FlowOptions::default());
    let record = records(1, 1)[0];
    assert_eq!(guide.example(&record).other, record.pdf, "no guide had a part in the first records");
    guide.learn(&[Record { value: 0.0, ..record }]).unwrap();
    let local = guide.local(&record.query);
    let (share, part) = (guide.share(&local), guide.pdf(&local, record.wi));
    let expected = (record.pdf - share * part).max(0.0) / (1.0 - share);
    assert!((guide.example(&record).other - expected).abs() <= 1e-6 * record.pdf && part > 0.0);
}

#[test]
fn extreme_records_leave_a_usable_guide() {
    let usable = |name: &str, guide: &FlowGuide| {
        let mut rng = Rng::new(8, 0);
        for i in 0..200 {
            let at = match i % 4 {
                0 => query(Vec3f::splat(f32::NAN), 0.3),
                1 => Query { normal: Vec3f::zero(), ..query(Vec3f::splat(2.0), 0.3) },
                2 => Query { wo: -query(Vec3f::zero(), 0.5).wo, roughness: 0.0, ..query(Vec3f::zero(), 0.5) },
                _ => query(vec3(rng.next_f32(), rng.next_f32(), rng.next_f32()), 1.57),
            };
            let local = guide.local(&at);
            let share = guide.share(&local);
            assert!((SHARE[0]..=SHARE[1]).contains(&share), "{name}: share {share}");
            if let Some((wi, pdf)) = guide.sample(&local, [rng.next_f32(), rng.next_f32()]) {
                assert!(wi.is_finite() && pdf > 0.0 && pdf.is_finite(), "{name}: {wi:?} {pdf}");
                assert!(guide.pdf(&local, wi).is_finite(), "{name}");
            }
        }
    };
    type Change = fn(usize, &mut Record);
    let cases: [(&str, Change); 6] = [
        ("no light", |_, r| r.value = 0.0),
        ("one hot sample", |i, r| r.value = if i == 77 { 1e6 } else { 1e-6 }),
        ("radiance 1e6", |_, r| r.value *= 1e6),
        ("faulty values", |i, r| r.value = [f32::NAN, f32::INFINITY, -1.0, 1.0][i % 4]),
        ("degenerate vertices", |i, r| {
            r.query.normal = if i % 2 == 0 { Vec3f::zero() } else { Vec3f::splat(f32::NAN) };
        }),
        ("densities near zero", |i, r| r.pdf = if i % 2 == 0 { 1e-30 } else { 0.0 }),
    ];
    for domain in DOMAINS {
        let options = FlowOptions { domain, ..FlowOptions::default() };
        usable("untrained", &guide(options));
        for (name, change) in cases {
            let mut data = records(4000, 6);
            data.iter_mut().enumerate().for_each(|(i, r)| change(i, r));
            usable(name, &trained(options, &data));
        }
    }
    // A scene without extent.
    let mut flat = FlowGuide::new(Vec3f::zero(), Vec3f::zero(), FlowOptions::default()).unwrap();
    flat.learn(&records(2000, 6)).unwrap();
    usable("no extent", &flat);
}

#[test]
fn weights_that_are_not_numbers_show() {
    let at = query(Vec3f::splat(0.5), 0.4);
    for family in [Family::Quadratic, Family::Rational] {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut guide = guide(FlowOptions::of(family));
            guide.learn(&records(1000, 3)).unwrap();
            let before = guide.pdf(&guide.local(&at), at.normal);
            guide.mean.network.fill(bad);
            // They are kept from answering ...
            assert!(matches!(guide.refresh(), Err(FlowError::Diverged { .. })));
            let after = guide.pdf(&guide.local(&at), at.normal);
            assert!(after.to_bits() == before.to_bits() && after > 0.0);
            // ... and would give no density and no share that pass for true ones.
            guide.frozen = guide.mean.clone();
            let local = guide.local(&at);
            assert!(guide.pdf(&local, at.normal).is_nan(), "{family:?}, {bad}");
            let sample = guide.sample(&local, [0.3, 0.6]);
            assert!(sample.is_none_or(|(_, pdf)| pdf.is_nan()), "{family:?}, {bad}: {sample:?}");
            assert!(bad.is_infinite() || guide.share(&local).is_nan());
        }
    }
}

#[test]
fn training_that_diverges_is_an_error_and_the_copy_before_answers() {
    let at = query(Vec3f::splat(0.5), 0.4);
    let [mut guide, untrained] =
        [(); 2].map(|()| guide(FlowOptions { rates: [f32::MAX, f32::MAX], ..FlowOptions::default() }));
    let error = guide.learn(&records(4000, 3)).unwrap_err();
    assert!(matches!(error, FlowError::Diverged { .. }), "{error}");
    let pdf = |guide: &FlowGuide| guide.pdf(&guide.local(&at), at.normal).to_bits();
    assert_eq!(pdf(&guide), pdf(&untrained));
}

#[test]
fn settings_outside_their_ranges_are_refused() {
    let grid = Grid::default();
    for options in [
        FlowOptions { bins: 0, ..FlowOptions::default() },
        FlowOptions { bins: 32, ..FlowOptions::default() },
        FlowOptions { layers: 5, ..FlowOptions::default() },
        FlowOptions { encoding: Encoding::Hash(Grid { entries: 1000, ..grid }), ..FlowOptions::default() },
        FlowOptions { encoding: Encoding::Hash(Grid { levels: 20, ..grid }), ..FlowOptions::default() },
        FlowOptions { encoding: Encoding::Tensor(Tensor { nodes: 1 }), ..FlowOptions::default() },
        FlowOptions { batch: 0, ..FlowOptions::default() },
        FlowOptions { rates: [-1.0, 0.1], ..FlowOptions::default() },
        FlowOptions { rates: [0.1, f32::NAN], ..FlowOptions::default() },
    ] {
        let error = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), options).unwrap_err();
        assert!(
            matches!(error, FlowError::Setting { .. }) && error.to_string().contains("must be"),
            "{error}"
        );
    }
}
