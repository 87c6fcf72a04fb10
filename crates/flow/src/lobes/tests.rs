//! Lobes as a guide: densities, learning, threads, stress.

use super::mixture::LOBES;
use super::*;
use crate::guide::SHARE;
use photofit_sampling::{
    Rng, chi_square, cosine_hemisphere, cosine_hemisphere_pdf, uniform_sphere, uniform_sphere_pdf,
};
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

/// Above the unit cube of the records.
const PLACE: Vec3f = vec3(0.3, 0.6, 2.0);

/// A bright spot at a place, as seen from all over the unit cube.
fn lit_by_a_place(n: usize, seed: u64, place: Vec3f) -> Vec<Record> {
    let mut all = records(n, seed, 1.0);
    for r in &mut all {
        let towards = (place - r.query.position).normalize_or_zero();
        r.incident = (100.0 * (towards.dot(r.wi) - 1.0)).exp() + 1e-3;
        r.value = r.incident;
    }
    all
}

fn one_leaf(data: &[Record]) -> LobeGuide {
    let mut guide = LobeGuide::new(LobeOptions { leaf_records: usize::MAX, ..LobeOptions::default() });
    guide.learn(data).unwrap();
    guide
}

#[test]
fn lobes_follow_near_light_and_leave_far_light_where_it_is() {
    let middle = Vec3f::splat(0.5);
    for factor in [1.0, 3.0, 1e4] {
        // From the middle of the cube always in the same direction.
        let place = middle + (PLACE - middle) * factor;
        let expected = 1.0 / (place - middle).length();
        let guide = one_leaf(&lit_by_a_place(40_000, 5, place));
        let leaf = &guide.leaves[0];
        let most = (0..LOBES).max_by(|a, b| {
            let worth = |k: usize| leaf.lobes.lobe(k).weight * leaf.lobes.lobe(k).kappa;
            worth(*a).total_cmp(&worth(*b))
        });
        let found = leaf.parallax.inverse[most.unwrap()];
        assert!((found - expected).abs() < 0.1 * expected + 0.02, "{factor}: {found}, expected {expected}");
        let density = |position: Vec3f| {
            let local = guide.local(&Query { position, ..at(0.5) });
            guide.pdf(&local, (place - position).normalize_or_zero())
        };
        for position in [vec3(0.1, 0.9, 0.1), vec3(0.9, 0.1, 0.9), vec3(0.9, 0.9, 0.5)] {
            let share = density(position) / density(middle);
            assert!(share > 0.4, "{factor}, {position:?}: {share} of the density in the middle");
        }
    }
}

#[test]
fn leaves_that_split_go_on_to_follow_near_light() {
    let mut guide = LobeGuide::new(LobeOptions::default());
    let (mut leaves, mut least) = (1, 0.0);
    for round in 0..5 {
        let mut data = lit_by_a_place(6000 << round, 30 + round, PLACE);
        for (i, r) in data.iter_mut().enumerate().filter(|_| round > 0) {
            // Half of the directions from the guide.
            let mut rng = Rng::new(40 + round, i as u64);
            let local = guide.local(&r.query);
            let towards = (PLACE - r.query.position).normalize_or_zero();
            if rng.next_f32() < guide.share(&local) {
                r.wi = guide.sample(&local, [rng.next_f32(), rng.next_f32()]).unwrap().0;
            }
            let share = guide.share(&local);
            r.pdf = (1.0 - share) * uniform_sphere_pdf::<f32>() + share * guide.pdf(&local, r.wi);
            r.incident = (100.0 * (towards.dot(r.wi) - 1.0)).exp() + 1e-3;
            r.value = r.incident;
        }
        guide.learn(&data).unwrap();
        assert!(guide.leaves() > leaves, "round {round}: {} leaves", guide.leaves());
        leaves = guide.leaves();
        // Towards the place, all over the cube; a lobe of this light has 100 / 2 pi = 15.9 around its mean.
        let mut rng = Rng::new(50, 0);
        least = f32::INFINITY;
        for _ in 0..200 {
            let position = vec3(rng.next_f32(), rng.next_f32(), rng.next_f32());
            let local = guide.local(&Query { position, ..at(0.5) });
            least = guide.pdf(&local, (PLACE - position).normalize_or_zero()).min(least);
        }
        let looks = guide.leaves.iter().map(|l| {
            let most = (0..LOBES).max_by(|a, b| l.lobes.weight[*a].total_cmp(&l.lobes.weight[*b]));
            let k = most.unwrap();
            let place = l.parallax.pivot + l.lobes.mean(k) * (1.0 / l.parallax.inverse[k].max(1e-3));
            (place - PLACE).length()
        });
        let mut looks: Vec<f32> = looks.collect();
        looks.sort_by(f32::total_cmp);
        let middle = looks[looks.len() / 2];
        // Of a leaf's first records two or three are bright.
        let most = if round == 0 { 1.0 } else { 0.2 };
        assert!(middle < most, "round {round}: half of the leaves look {middle} beside the place");
    }
    assert!(least > 5.0, "least density towards the place {least}");
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
    let near = one_leaf(&lit_by_a_place(20_000, 7, PLACE));
    for guide in [LobeGuide::new(LobeOptions::default()), trained(&records(40_000, 1, 1.0)), near] {
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
    let data = lit_by_a_place(20_000, 3, PLACE);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let guide = pool.install(|| trained(&data));
        // Text of numbers is exact.
        format!("{:?} {:?}", guide.nodes, guide.leaves)
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

/// Records of a surface that scatters like the cosine, along directions of its mixture with the guide; `unguided` without.
fn on_matte(
    guide: &LobeGuide,
    n: usize,
    seed: u64,
    unguided: bool,
    light: impl Fn(Vec3f) -> f32,
) -> Vec<Record> {
    (0..n as u64)
        .map(|i| {
            let mut rng = Rng::new(seed, i);
            let mut next = || rng.next_f32();
            let query = Query { position: vec3(next(), next(), next()), ..at(0.0) };
            let local = guide.local(&query);
            let share = if unguided { 0.0 } else { guide.share(&local) };
            let wi = if next() < share {
                guide.sample(&local, [next(), next()]).unwrap().0
            } else {
                cosine_hemisphere([next(), next()])
            };
            let own = cosine_hemisphere_pdf(wi.z);
            let pdf = (1.0 - share) * own + share * guide.pdf(&local, wi);
            let incident = light(wi);
            Record { query, wi, pdf, value: incident * own, incident }
        })
        .collect()
}

/// A narrow light in the direction of this unit vector.
fn spot(towards: Vec3f) -> impl Fn(Vec3f) -> f32 {
    move |wi| (200.0 * (towards.dot(wi) - 1.0)).exp() + 1e-3
}

fn mean_share(guide: &LobeGuide) -> f32 {
    guide.leaves.iter().map(|l| l.share).sum::<f32>() / guide.leaves() as f32
}

#[test]
fn what_lobes_learn_by_heart_does_not_raise_their_share() {
    // Even light on a matte surface: nothing is better than its own directions.
    let mut guide = LobeGuide::new(LobeOptions::default());
    for round in 0..3 {
        let data = on_matte(&guide, 16_000 << round, 20 + round, round == 0, |_| 1.0);
        guide.learn(&data).unwrap();
        let share = mean_share(&guide);
        assert!(guide.leaves() > 30 && share < 0.2, "round {round}: share {share}");
    }
}

#[test]
fn shares_rise_and_fall_with_what_the_lobes_are_worth() {
    let options = LobeOptions { leaf_records: 1000, ..LobeOptions::default() };
    let mut guide = LobeGuide::new(options);
    let towards = spot(vec3(0.8, 0.0, 0.6));
    guide.learn(&on_matte(&guide, 4000, 1, true, &towards)).unwrap();
    guide.learn(&on_matte(&guide, 4000, 2, false, &towards)).unwrap();
    let high = mean_share(&guide);
    assert!(high > 0.49, "a narrow light: {high}");
    // The light goes, an even one comes: what the lobes know is worth nothing.
    for round in 0..3 {
        guide.learn(&on_matte(&guide, 4000, 3 + round, false, |_| 1.0)).unwrap();
    }
    let low = mean_share(&guide);
    assert!(low < 0.1, "an even light: {low}");
    // A guide that stays with one leaf and a small share has learned all the same.
    let mut one = LobeGuide::new(LobeOptions { leaf_records: usize::MAX, ..options });
    one.learn(&on_matte(&one, 4000, 1, true, |_| 1.0)).unwrap();
    assert!(one.leaves() == 1 && one.began && mean_share(&one) < 0.1, "{}", mean_share(&one));
}

#[test]
fn shares_have_no_better_neighbours() {
    let mut guide = LobeGuide::new(LobeOptions { leaf_records: usize::MAX, ..LobeOptions::default() });
    let data = on_matte(&guide, 4000, 1, true, |wi| 1.0 + 3.0 * wi.x.max(0.0));
    guide.learn(&data).unwrap();
    let next = on_matte(&guide, 40_000, 2, false, |wi| 1.0 + 3.0 * wi.x.max(0.0));
    let before = guide.clone();
    guide.learn(&next).unwrap();
    let likelihood = |s: f32| {
        let terms = next.iter().map(|r| {
            let local = before.local(&r.query);
            let mixture = s * before.pdf(&local, r.wi) + (1.0 - s) * cosine_hemisphere_pdf(r.wi.z);
            f64::from(r.value / r.pdf) * f64::from(mixture).ln()
        });
        terms.sum::<f64>()
    };
    let share = mean_share(&guide);
    for other in [share - 0.05, share + 0.05] {
        assert!(likelihood(share) >= likelihood(other.clamp(SHARE[0], SHARE[1])), "{share} {other}");
    }
}

#[test]
fn earlier_rounds_are_remembered_by_half_of_what_they_gathered() {
    let options = LobeOptions { leaf_records: usize::MAX, ..LobeOptions::default() };
    let seen = |guide: &LobeGuide| guide.leaves[0].seen;
    let (here, there) = (vec3(0.8, 0.0, 0.6), vec3(-0.8, 0.0, 0.6));
    let mut guide = LobeGuide::new(options);
    guide.learn(&on_matte(&guide, 4000, 1, true, spot(here))).unwrap();
    let first = seen(&guide);
    guide.learn(&on_matte(&guide, 40, 2, false, spot(there))).unwrap();
    let second = seen(&guide);
    assert!((0.5 * first..0.5 * first + 40.5).contains(&second), "{first} {second}");
    // Forty records do not undo four thousand, as many do.
    let pdf = |guide: &LobeGuide, wi| guide.pdf(&guide.local(&at(0.5)), wi);
    assert!(pdf(&guide, here) > 5.0 * pdf(&guide, there));
    for round in 0..3 {
        guide.learn(&on_matte(&guide, 4000, 3 + round, false, spot(there))).unwrap();
    }
    assert!(pdf(&guide, there) > 5.0 * pdf(&guide, here));
    // A record that is cut does not count for those that it drowns.
    let mut hot = on_matte(&LobeGuide::new(options), 1000, 1, true, |_| 1e-6);
    (hot[9].value, hot[9].incident) = (1e3, 1e3);
    let mut guide = LobeGuide::new(options);
    guide.learn(&hot).unwrap();
    assert!(seen(&guide) < 21.0, "{}", seen(&guide));
}

#[test]
fn leaves_are_split_where_both_sides_can_learn() {
    let options = LobeOptions::default();
    let count = |guide: &LobeGuide, data: &[Record]| {
        let mut counts = vec![0; guide.leaves()];
        data.iter().for_each(|r| counts[guide.leaf(r.query.position)] += 1);
        counts
    };
    // A crowd in a corner, and few far away that pull the mean out of it.
    let mut data: Vec<Record> = records(2000, 1, 1.0).into_iter().filter(Record::is_useful).collect();
    for r in &mut data {
        r.query.position *= 1e-2;
    }
    data[..5].iter_mut().for_each(|r| r.query.position.x += 1e3);
    let guide = trained(&data);
    let counts = count(&guide, &data);
    assert!(counts.iter().all(|n| *n >= options.least_records), "{counts:?}");
    assert!(counts.iter().all(|n| *n <= options.leaf_records), "the crowd is split all the same: {counts:?}");
    // Too many at one place leave nowhere to split.
    let mut place = data.clone();
    place[20..].iter_mut().for_each(|r| r.query.position = Vec3f::splat(0.5));
    assert_eq!(trained(&place).leaves(), 1);
}
