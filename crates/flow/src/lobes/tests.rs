//! Lobes as a guide: densities, learning, threads, stress.

use super::*;
use photofit_sampling::{Rng, chi_square, uniform_sphere, uniform_sphere_pdf};
use photofit_scalar::vec3;
use std::f32::consts::TAU;

/// A bright spot in the direction of +x where x < 0.5, of -x elsewhere.
fn records(n: usize, seed: u64, brightness: f32) -> Vec<Record> {
    (0..n as u64)
        .map(|i| {
            let mut rng = Rng::new(seed, i);
            let mut next = || rng.next_f32();
            let position = vec3(next(), next(), next());
            let normal = vec3(0.0, 0.0, 1.0);
            let wi: Vec3f = uniform_sphere([next(), next()]);
            let towards = vec3(if position.x < 0.5 { 0.8 } else { -0.8 }, 0.0, 0.6);
            let incident = brightness * ((50.0 * (towards.dot(wi) - 1.0)).exp() + 0.01);
            let query = Query { position, normal, wo: normal, roughness: 1.0 };
            Record { query, wi, pdf: uniform_sphere_pdf(), value: incident * wi.z.max(0.0), incident }
        })
        .collect()
}

fn at(x: f32) -> Query {
    let normal = vec3(0.0, 0.0, 1.0);
    Query { position: vec3(x, 0.5, 0.5), normal, wo: vec3(0.6, 0.0, 0.8), roughness: 1.0 }
}

fn trained(data: &[Record]) -> LobeGuide {
    let mut guide = LobeGuide::new(LobeOptions::default());
    guide.learn(data).unwrap();
    guide
}

#[test]
fn mixtures_learn_where_light_comes_from() {
    let guide = trained(&records(40_000, 1, 1.0));
    assert!(guide.leaves() > 4, "{} leaves", guide.leaves());
    for (x, towards) in [(0.2, vec3(0.8, 0.0, 0.6)), (0.8, vec3(-0.8, 0.0, 0.6))] {
        let local = guide.local(&at(x));
        let elsewhere = vec3(-towards.x, 0.0, 0.6);
        let (right, wrong) = (guide.pdf(&local, towards), guide.pdf(&local, elsewhere));
        assert!(right > 10.0 * wrong, "{x}: {right} {wrong}");
        assert!(guide.share(&local) > 0.45, "{}", guide.share(&local));
    }
}

#[test]
fn samples_have_the_density_that_is_stated() {
    for guide in [LobeGuide::new(LobeOptions::default()), trained(&records(40_000, 1, 1.0))] {
        let local = guide.local(&at(0.3));
        let (rows, columns, n, fine) = (16, 16, 200_000, 60);
        let mut counts = vec![0_u64; rows * columns];
        let mut rng = Rng::new(9, 1);
        for _ in 0..n {
            let (wi, pdf) = guide.sample(&local, [rng.next_f32(), rng.next_f32()]).unwrap();
            assert!((guide.pdf(&local, wi) / pdf - 1.0).abs() < 1e-5);
            let row = ((0.5 - 0.5 * wi.z) * rows as f32) as usize;
            let column = ((0.5 + wi.y.atan2(wi.x) / TAU) * columns as f32) as usize;
            counts[row.min(rows - 1) * columns + column.min(columns - 1)] += 1;
        }
        let mut expected = vec![0.0_f64; rows * columns];
        for (cell, e) in expected.iter_mut().enumerate() {
            for k in 0..fine * fine {
                let row = (cell / columns) as f32 + ((k / fine) as f32 + 0.5) / fine as f32;
                let column = (cell % columns) as f32 + ((k % fine) as f32 + 0.5) / fine as f32;
                let z = 1.0 - 2.0 * row / rows as f32;
                let (s, c) = (TAU * (column / columns as f32 - 0.5)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                *e += f64::from(guide.pdf(&local, vec3(r * c, r * s, z)));
            }
            *e *= f64::from(2.0 * TAU) / (rows * columns * fine * fine) as f64;
        }
        let integral: f64 = expected.iter().sum();
        assert!((integral - 1.0).abs() < 1e-3, "{integral}");
        let z = chi_square::deviation(&counts, &expected);
        assert!(z < chi_square::bound(2), "chi-square lies {z:.1} deviations above its mean");
    }
}

#[test]
fn learning_is_the_same_for_any_number_of_threads() {
    let data = records(20_000, 3, 1.0);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let guide = pool.install(|| trained(&data));
        guide
            .leaves
            .iter()
            .flat_map(|l| (0..LOBES).map(|k| l.lobes.lobe(k).kappa.to_bits()))
            .collect::<Vec<u32>>()
    };
    assert!(bits(1) == bits(3), "other bits with other threads");
}

#[test]
fn extreme_records_leave_a_usable_guide() {
    let usable = |name: &str, guide: &LobeGuide| {
        let mut rng = Rng::new(8, 0);
        for x in [0.0, 0.3, 1e30, f32::NAN] {
            let local = guide.local(&at(x));
            let share = guide.share(&local);
            assert!((SHARE[0]..=SHARE[1]).contains(&share), "{name}: share {share}");
            for _ in 0..50 {
                let (wi, pdf) = guide.sample(&local, [rng.next_f32(), rng.next_f32()]).unwrap();
                assert!(wi.is_finite() && pdf > 0.0 && pdf.is_finite(), "{name}: {wi:?} {pdf}");
            }
        }
    };
    usable("untrained", &LobeGuide::new(LobeOptions::default()));
    usable("no light", &trained(&records(5000, 1, 0.0)));
    usable("radiance 1e6", &trained(&records(5000, 1, 1e6)));
    let mut one = records(5000, 1, 1e-3);
    (one[9].value, one[9].incident) = (1e6, 1e6);
    usable("one hot sample", &trained(&one));
    let mut point = records(20_000, 1, 1.0);
    point.iter_mut().for_each(|r| r.query.position = Vec3f::splat(0.25));
    let guide = trained(&point);
    assert_eq!(guide.leaves(), 1, "records at one point cannot be split");
    usable("one point", &guide);
    let mut narrow = records(5000, 1, 1.0);
    narrow.iter_mut().for_each(|r| r.wi = vec3(0.0, 0.6, 0.8));
    usable("one direction", &trained(&narrow));
}
