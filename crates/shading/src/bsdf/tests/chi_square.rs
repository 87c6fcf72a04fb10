//! Sampling against density: Pearson's test on cells that hold equal shares of pilot samples.

use super::catalogue::{Case, all, gold};
use crate::bsdf::{Bsdf, Distribution, Microfacet, RoughConductor};
use photofit_sampling::{Rng, chi_square};
use photofit_scalar::{Real, Vec3, vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, SQRT_2};

/// Pilot samples in a box of the quadrature whose estimates are trusted, at most.
const PILOTS_TRUSTED: usize = 2;
/// Pilot samples in a box that is cut at their median, more than this.
const PILOTS_CUT: usize = 16;
/// Quarterings of such a box, at most.
const DEPTH: u32 = 16;

/// How much is drawn.
#[derive(Clone, Copy)]
struct Effort {
    samples: usize,
    pilots: usize,
    cells: usize,
}

/// Coordinates of the directions on one side of the surface: radius of Lambert's equal-area disk, from 0 at the pole to
/// the square root of 2 at the horizon, and azimuth from `turn`. The solid angle is `radius dradius dazimuth`.
#[derive(Clone, Copy)]
struct Chart {
    side: f64,
    turn: f64,
}

impl Chart {
    fn place(&self, d: Vec3<f64>) -> [f64; 2] {
        let c = d.z.abs();
        // The digits of directions near the pole lie in x and y, of those near the horizon in z.
        let square = if c < 0.5 { 2.0 * (1.0 - c) } else { 2.0 * (d.x * d.x + d.y * d.y) / (1.0 + c) };
        let azimuth = d.y.atan2(d.x) - self.turn;
        [square.sqrt().min(SQRT_2), azimuth - 2.0 * PI * (azimuth / (2.0 * PI)).round()]
    }

    fn direction(&self, [r, azimuth]: [f64; 2]) -> Vec3<f64> {
        let (sin, cos) = (azimuth + self.turn).sin_cos();
        let sine = r * (1.0 - 0.25 * r * r).max(0.0).sqrt();
        vec3(sine * cos, sine * sin, self.side * (1.0 - 0.5 * r * r).max(0.0))
    }
}

/// A rectangle of the coordinates.
#[derive(Clone, Copy)]
struct Rectangle {
    low: [f64; 2],
    high: [f64; 2],
}

impl Rectangle {
    const ALL: Self = Self { low: [0.0, -PI], high: [SQRT_2, PI] };

    fn halves(self, axis: usize, at: f64) -> [Self; 2] {
        let (mut first, mut second) = (self, self);
        first.high[axis] = at;
        second.low[axis] = at;
        [first, second]
    }

    /// Splits the points at their median along the axis on which they spread more.
    fn split(self, points: &mut [[f64; 2]]) -> (usize, f64, usize) {
        let n = points.len() as f64;
        let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
        let means = [mean(0), mean(1)];
        let spread = |k: usize| points.iter().map(|p| (p[k] - means[k]).abs()).sum::<f64>();
        let axis = usize::from(spread(1) * means[0] > spread(0));
        let middle = points.len() / 2;
        points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
        (axis, points[middle][axis], middle)
    }
}

/// A cell, or a cut into two parts.
enum Tree {
    Cell(usize),
    Cut { axis: usize, at: f64, parts: Box<[Self; 2]> },
}

impl Tree {
    /// Cells of equal shares of the points; appends the probability of each.
    fn new(
        rectangle: Rectangle,
        points: &mut [[f64; 2]],
        per_cell: usize,
        pdf: &impl Fn([f64; 2]) -> f64,
        probabilities: &mut Vec<f64>,
    ) -> Self {
        if points.len() < 2 * per_cell {
            probabilities.push(probability(rectangle, points, pdf));
            return Self::Cell(probabilities.len() - 1);
        }
        let (axis, at, middle) = rectangle.split(points);
        let (a, b) = points.split_at_mut(middle);
        let [first, second] = rectangle.halves(axis, at);
        let parts = [
            Self::new(first, a, per_cell, pdf, probabilities),
            Self::new(second, b, per_cell, pdf, probabilities),
        ];
        Self::Cut { axis, at, parts: Box::new(parts) }
    }

    fn find(&self, at: [f64; 2]) -> usize {
        match self {
            Self::Cell(i) => *i,
            Self::Cut { axis, at: cut, parts } => parts[usize::from(at[*axis] >= *cut)].find(at),
        }
    }
}

/// Integral of the density over a rectangle, cut until each box holds few of the points: lobes of any shape are
/// resolved where they are.
fn probability(rectangle: Rectangle, points: &mut [[f64; 2]], pdf: &impl Fn([f64; 2]) -> f64) -> f64 {
    if points.len() <= PILOTS_CUT {
        return integrate(rectangle, points, gauss(rectangle, pdf), DEPTH, pdf);
    }
    let (axis, at, middle) = rectangle.split(points);
    let (a, b) = points.split_at_mut(middle);
    let [first, second] = rectangle.halves(axis, at);
    probability(first, a, pdf) + probability(second, b, pdf)
}

/// Integral that `whole` estimates, over quarters where finer estimates disagree or points lie.
fn integrate(
    rectangle: Rectangle,
    points: &[[f64; 2]],
    whole: f64,
    depth: u32,
    pdf: &impl Fn([f64; 2]) -> f64,
) -> f64 {
    let middle = [0, 1].map(|k| 0.5 * (rectangle.low[k] + rectangle.high[k]));
    let [left, right] = rectangle.halves(0, middle[0]);
    let ([a, b], [c, d]) = (left.halves(1, middle[1]), right.halves(1, middle[1]));
    let quarters = [a, b, c, d].map(|q| (q, gauss(q, pdf)));
    let sum: f64 = quarters.iter().map(|q| q.1).sum();
    let settled = points.len() <= PILOTS_TRUSTED && (sum - whole).abs() < 2e-8 + 1e-3 * sum;
    if depth == 0 || settled {
        return sum;
    }
    let quarter = |i: usize| {
        let (q, estimate) = &quarters[i];
        let here = |p: &&[f64; 2]| (0..2).all(|k| (p[k] >= middle[k]) == (q.low[k] >= middle[k]));
        let inside: Vec<[f64; 2]> = points.iter().filter(here).copied().collect();
        integrate(*q, &inside, *estimate, depth - 1, pdf)
    };
    (0..4).map(quarter).sum()
}

/// Gauss and Legendre's rule with three points along each axis.
fn gauss(rectangle: Rectangle, pdf: &impl Fn([f64; 2]) -> f64) -> f64 {
    let offset = 0.5 * 0.6_f64.sqrt();
    let points = [(0.5 - offset, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + offset, 5.0 / 18.0)];
    let size = [0, 1].map(|k| rectangle.high[k] - rectangle.low[k]);
    let mut sum = 0.0;
    for (x, wx) in points {
        for (y, wy) in points {
            let at = [rectangle.low[0] + x * size[0], rectangle.low[1] + y * size[1]];
            sum += wx * wy * at[0] * pdf(at);
        }
    }
    sum * size[0] * size[1]
}

/// The cells of both sides of the surface; a side that the pilots do not find has none.
struct Cells {
    sides: Vec<(Chart, Tree)>,
    probabilities: Vec<f64>,
}

impl Cells {
    fn new(wo: Vec3<f64>, pilots: &[Vec3<f64>], cells: usize, pdf: impl Fn(Vec3<f64>) -> f64) -> Self {
        let per_cell = (pilots.len() / cells).max(1);
        let (mut sides, mut probabilities) = (Vec::new(), Vec::new());
        for side in [1.0, -1.0] {
            let chart = Chart { side, turn: (-wo.y).atan2(-wo.x) };
            let here = pilots.iter().filter(|d| d.z * side > 0.0);
            let mut places: Vec<_> = here.map(|d| chart.place(*d)).collect();
            if !places.is_empty() {
                let density = |at: [f64; 2]| pdf(chart.direction(at));
                let tree = Tree::new(Rectangle::ALL, &mut places, per_cell, &density, &mut probabilities);
                sides.push((chart, tree));
            }
        }
        Self { sides, probabilities }
    }

    fn find(&self, d: Vec3<f64>) -> Option<usize> {
        let (chart, tree) = self.sides.iter().find(|(c, _)| c.side * d.z > 0.0)?;
        Some(tree.find(chart.place(d)))
    }
}

/// Compares samples with the density; the message says what is wrong.
fn compare<T: Real>(bsdf: &Bsdf<T>, wo: Vec3<T>, effort: Effort, limit: f64) -> Result<(), String> {
    let mut rng = Rng::new(31, 0);
    let mut number = || T::of(f64::from(rng.next_f32()));
    let mut draw = || bsdf.sample(wo, number(), [number(), number()]);
    let first: Vec<_> = (0..effort.pilots).filter_map(|_| draw()).collect();
    let pilots: Vec<Vec3<f64>> = first.iter().filter(|s| !s.delta).map(|s| s.wi.cast()).collect();
    if pilots.is_empty() {
        let enough = first.len() as f64 > 0.99 * effort.pilots as f64;
        return if enough { Ok(()) } else { Err("hardly any sample".into()) };
    }
    let pdf = |d: Vec3<f64>| bsdf.pdf(wo, d.cast()).f64();
    let Cells { sides, mut probabilities } = Cells::new(wo.cast(), &pilots, effort.cells, pdf);
    let cells = Cells { sides, probabilities: Vec::new() };
    let mut counts = vec![0; probabilities.len()];
    let mut others = 0_u32;
    for _ in 0..effort.samples {
        match draw().filter(|s| !s.delta).and_then(|s| cells.find(s.wi.cast())) {
            Some(i) => counts[i] += 1,
            None => others += 1,
        }
    }
    let total: f64 = probabilities.iter().sum();
    let n = effort.samples as f64;
    let share = f64::from(others) / n;
    let noise = 4.0 * (share * (1.0 - share) / n).sqrt();
    if (total + share - 1.0).abs() > 1e-3 + noise {
        return Err(format!("the density integrates to {total}, and {share} of the samples have none"));
    }
    // Samples without density are one more cell; what the quadrature errs by is no matter of it.
    counts.push(u64::from(others));
    probabilities.push((1.0 - total).max(1e-12));
    let sum: f64 = probabilities.iter().sum();
    probabilities.iter_mut().for_each(|p| *p /= sum);
    let z = chi_square::deviation(&counts, &probabilities);
    if z < limit { Ok(()) } else { Err(format!("chi-square lies {z:.1} deviations above its mean")) }
}

/// Directions towards the viewer: straight, oblique, grazing, and from below.
fn viewers<T: Real>(case: &Case<T>) -> Vec<Vec3<T>> {
    let mut out: Vec<Vec3<T>> = [(1.0, 0.3), (0.7, 2.0), (0.3, -1.0), (0.05, 4.0)]
        .map(|(z, phi): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            vec3(T::of(r * phi.cos()), T::of(r * phi.sin()), T::of(z))
        })
        .to_vec();
    if case.both_sides {
        out.extend(out.clone().into_iter().map(|w| vec3(w.x, w.y, -w.z)));
    }
    out
}

fn run<T: Real>(tests: &[(&Case<T>, Vec3<T>)], effort: Effort) {
    let limit = chi_square::bound(tests.len());
    let mut failures: Vec<String> = tests
        .par_iter()
        .filter_map(|(c, wo)| {
            let message = compare(&c.bsdf, *wo, effort, limit).err()?;
            Some(format!("{} from z {:.2}: {message}", c.name, wo.z.f64()))
        })
        .collect();
    let count = failures.len();
    failures.truncate(20);
    assert!(count == 0, "{count} of {} fail:\n{}", tests.len(), failures.join("\n"));
}

#[test]
fn samples_follow_their_density() {
    // Every case as it ships, each from one of the viewers.
    let cases = all::<f32>();
    let tests: Vec<_> = cases
        .iter()
        .enumerate()
        .map(|(i, c)| {
            let viewers = viewers(c);
            (c, viewers[i % viewers.len()])
        })
        .collect();
    run(&tests, Effort { samples: 20_000, pilots: 8_000, cells: 64 });
}

#[test]
#[ignore = "slow: a million samples of every BSDF from every viewer"]
fn samples_follow_their_density_everywhere() {
    let cases = all::<f32>();
    let tests: Vec<_> = cases.iter().flat_map(|c| viewers(c).into_iter().map(move |wo| (c, wo))).collect();
    run(&tests, Effort { samples: 1_000_000, pilots: 60_000, cells: 256 });
}

#[test]
fn samples_carry_the_density_and_the_value_of_their_direction() {
    for case in all::<f64>() {
        let mut rng = Rng::new(17, 0);
        for wo in viewers(&case) {
            for _ in 0..200 {
                let s = case.bsdf.sample(wo, rng.next_f64(), [rng.next_f64(), rng.next_f64()]);
                let Some(s) = s.filter(|s| !s.delta) else { continue };
                let (value, pdf) = case.bsdf.eval_pdf(wo, s.wi);
                let near = (s.pdf - pdf).abs() <= 1e-6 * pdf;
                let weighted = (s.weight * pdf - value).length() <= 1e-6 * value.length().max(1e-12);
                assert!(near && weighted && pdf > 0.0, "{}: {s:?} {pdf} {value:?}", case.name);
            }
        }
    }
}

#[test]
fn a_wrong_density_is_noticed() {
    // Samples of one roughness against the density of another.
    let case = |alpha: f32| {
        let surface = Microfacet::isotropic(Distribution::Ggx, alpha);
        Bsdf::RoughConductor(RoughConductor { metal: gold(), surface })
    };
    let wo = vec3(0.6_f32, 0.0, 0.8);
    let (right, wrong) = (case(0.3), case(0.33));
    let against = |density: &Bsdf<f32>| {
        let mut rng = Rng::new(1, 1);
        let mut draw = || right.sample(wo, rng.next_f32(), [rng.next_f32(), rng.next_f32()]);
        let drawn: Vec<Vec3<f64>> = (0..40_000).filter_map(|_| draw()).map(|s| s.wi.cast()).collect();
        let cells = Cells::new(wo.cast(), &drawn[..8000], 64, |d| f64::from(density.pdf(wo, d.cast())));
        let mut counts = vec![0; cells.probabilities.len()];
        drawn[8000..].iter().for_each(|d| counts[cells.find(*d).unwrap()] += 1);
        let total: f64 = cells.probabilities.iter().sum();
        let probabilities: Vec<f64> = cells.probabilities.iter().map(|p| p / total).collect();
        chi_square::deviation(&counts, &probabilities)
    };
    let bound = chi_square::bound(1);
    assert!(
        against(&right) < bound && against(&wrong) > 2.0 * bound,
        "{} {}",
        against(&right),
        against(&wrong)
    );
}
