//! Sampling against density: Pearson's test on a grid that is as fine as the lobe.

use super::catalogue::{Case, all, gold, v};
use crate::bsdf::{
    Bsdf, BsdfSample, Distribution, Microfacet, Principled, PrincipledParameters, PrincipledThin,
    PrincipledThinParameters, RoughConductor, Scatter,
};
use photofit_sampling::{Rng, chi_square};
use photofit_scalar::{Real, Vec3, vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

const RINGS: usize = 16;
const SECTORS: usize = 12;
const CELLS: usize = RINGS * SECTORS;
/// Halvings of a cell by the quadrature: at most, and at least.
const DEPTH: u32 = 6;
const FORCED: u32 = 1;

/// Polar coordinates around a direction whose rings grow geometrically, `u = 1 - cos = scale (exp(rho) - 1)`, for the
/// directions on one side of the surface.
struct Chart {
    side: f64,
    pole: Vec3<f64>,
    s: Vec3<f64>,
    t: Vec3<f64>,
    scale: f64,
    rho_max: f64,
}

impl Chart {
    /// Centred at the densest of the pilot samples on a side, finer than the lobe there, but not than `finest`.
    fn new(side: f64, pilots: &[(Vec3<f64>, f64)], finest: f64) -> Option<Self> {
        let here = pilots.iter().filter(|p| p.0.z * side > 0.0);
        let &(pole, pdf) = here.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let scale = (0.1 / (2.0 * PI * pdf)).clamp(finest, 0.5);
        let (s, t) = pole.orthonormal_pair();
        Some(Self { side, pole, s, t, scale, rho_max: (2.0 / scale).ln_1p() })
    }

    fn cell(&self, d: Vec3<f64>) -> usize {
        let u = 0.5 * (d - self.pole).length_squared();
        let ring = ((u / self.scale).ln_1p() / self.rho_max * RINGS as f64) as usize;
        let sector = ((d.dot(self.t).atan2(d.dot(self.s)) / (2.0 * PI) + 0.5) * SECTORS as f64) as usize;
        ring.min(RINGS - 1) * SECTORS + sector.min(SECTORS - 1)
    }

    /// Density per unit of the coordinates `ring` in `[0, RINGS]` and `sector` in `[0, SECTORS]`.
    fn density(&self, ring: f64, sector: f64, pdf: &impl Fn(Vec3<f64>) -> f64) -> f64 {
        let step = self.rho_max / RINGS as f64;
        let grown = (ring * step).exp();
        let u = (self.scale * (ring * step).exp_m1()).min(2.0);
        let (sin, cos) = ((sector / SECTORS as f64 - 0.5) * 2.0 * PI).sin_cos();
        let r = (u * (2.0 - u)).max(0.0).sqrt();
        let d = self.pole * (1.0 - u) + (self.s * cos + self.t * sin) * r;
        if d.z * self.side <= 0.0 {
            return 0.0;
        }
        pdf(d) * self.scale * grown * step * 2.0 * PI / SECTORS as f64
    }

    /// Integral over a square of the coordinates that `whole` estimates, halved where finer estimates disagree.
    fn integrate(
        &self,
        at: [f64; 2],
        size: f64,
        whole: f64,
        depth: u32,
        pdf: &impl Fn(Vec3<f64>) -> f64,
    ) -> f64 {
        // Between these heights over the horizon; cells that it cuts are halved to the end.
        let (low, high) = self.heights(at, size);
        if high <= 0.0 {
            return 0.0;
        }
        // At the pole a lobe may end.
        let forced = if at[0] < 2.0 { FORCED + 2 } else { FORCED };
        let half = 0.5 * size;
        let corners = [[0.0, 0.0], [half, 0.0], [0.0, half], [half, half]];
        let parts = corners.map(|c| [at[0] + c[0], at[1] + c[1]]);
        let estimates = parts.map(|p| self.gauss(p, half, pdf));
        let sum: f64 = estimates.iter().sum();
        let settled = low > 0.0 && depth <= DEPTH - forced && (sum - whole).abs() < 1e-6 + 1e-3 * sum;
        if depth == 0 || settled {
            return sum;
        }
        parts.iter().zip(estimates).map(|(p, e)| self.integrate(*p, half, e, depth - 1, pdf)).sum()
    }

    /// Smallest and largest height over the horizon in a square, on the chart's side.
    fn heights(&self, at: [f64; 2], size: f64) -> (f64, f64) {
        let angle = |sector: f64| (sector / SECTORS as f64 - 0.5) * 2.0 * PI;
        let (from, to) = (angle(at[1]), angle(at[1] + size));
        let (a, turn) = (self.s.z.hypot(self.t.z), self.t.z.atan2(self.s.z));
        // Extremes of cos(phi - turn) on the interval: at its ends, or where it is 1 or -1.
        let ends = [(from - turn).cos(), (to - turn).cos()];
        let inside = |extreme: f64| {
            let first = extreme + 2.0 * PI * ((from - extreme) / (2.0 * PI)).ceil();
            first <= to
        };
        let most = if inside(turn) { 1.0 } else { ends[0].max(ends[1]) };
        let least = if inside(turn + PI) { -1.0 } else { ends[0].min(ends[1]) };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..=4 {
            let ring = at[0] + 0.25 * f64::from(i) * size;
            let u = (self.scale * (ring * self.rho_max / RINGS as f64).exp_m1()).min(2.0);
            let r = a * (u * (2.0 - u)).max(0.0).sqrt();
            for cosine in [least, most] {
                let z = (self.pole.z * (1.0 - u) + r * cosine) * self.side;
                (low, high) = (low.min(z), high.max(z));
            }
        }
        (low, high)
    }

    /// Probability of a cell.
    fn probability(&self, cell: usize, pdf: &impl Fn(Vec3<f64>) -> f64) -> f64 {
        let at = [(cell / SECTORS) as f64, (cell % SECTORS) as f64];
        self.integrate(at, 1.0, self.gauss(at, 1.0, pdf), DEPTH, pdf)
    }

    /// Gauss and Legendre's rule with three points along each axis.
    fn gauss(&self, at: [f64; 2], size: f64, pdf: &impl Fn(Vec3<f64>) -> f64) -> f64 {
        let offset = 0.5 * 0.6_f64.sqrt();
        let points = [(0.5 - offset, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + offset, 5.0 / 18.0)];
        let mut sum = 0.0;
        for (x, wx) in points {
            for (y, wy) in points {
                sum += wx * wy * self.density(at[0] + x * size, at[1] + y * size, pdf);
            }
        }
        sum * size * size
    }
}

/// The grids of both sides of the surface.
struct Grid(Vec<Chart>);

impl Grid {
    fn new(pilots: &[(Vec3<f64>, f64)], finest: f64) -> Self {
        Self([1.0, -1.0].into_iter().filter_map(|side| Chart::new(side, pilots, finest)).collect())
    }

    fn cells(&self) -> usize {
        self.0.len() * CELLS
    }

    /// `None` on a side where the pilots found nothing.
    fn cell(&self, d: Vec3<f64>) -> Option<usize> {
        let i = self.0.iter().position(|c| c.side * d.z > 0.0)?;
        Some(i * CELLS + self.0[i].cell(d))
    }

    /// Probabilities of the cells.
    fn probabilities(&self, pdf: &impl Fn(Vec3<f64>) -> f64) -> Vec<f64> {
        self.0.iter().flat_map(|c| (0..CELLS).map(move |i| c.probability(i, pdf))).collect()
    }
}

/// A scalar that BSDFs are sampled in.
trait Tested: Real {
    /// Smallest `1 - cos` that the grid resolves: rings of some thousand directions that the scalar can tell apart.
    const FINEST: f64;
    /// Relative error of value and density of a sample against those of its direction; `None` where directions are too
    /// coarse to say.
    const ROUNDING: Option<f64>;
}

impl Tested for f64 {
    const FINEST: Self = 1e-16;
    const ROUNDING: Option<Self> = Some(1e-6);
}

impl Tested for f32 {
    const FINEST: f64 = 1e-8;
    const ROUNDING: Option<f64> = None;
}

/// Compares `n` samples with the density of the same BSDF in f64; the message says what is wrong.
fn compare<T: Tested>(
    sampled: &Bsdf<T>,
    exact: &Bsdf<f64>,
    wo: Vec3<f64>,
    n: usize,
    limit: f64,
) -> Result<(), String> {
    let mut rng = Rng::new(31, 0);
    let wo_t: Vec3<T> = wo.cast();
    let mut draw = || {
        let u = [rng.next_f64(), rng.next_f64(), rng.next_f64()].map(T::of);
        sampled.sample(wo_t, u[0], [u[1], u[2]])
    };
    let first: Vec<_> = (0..2000).filter_map(|_| draw()).collect();
    let pilots: Vec<(Vec3<f64>, f64)> =
        first.iter().filter(|s| !s.delta).map(|s| (s.wi.cast(), s.pdf.f64())).collect();
    if pilots.is_empty() {
        return if first.len() > 1980 { Ok(()) } else { Err("hardly any sample".into()) };
    }
    let grid = Grid::new(&pilots, T::FINEST);
    let mut counts = vec![0; grid.cells()];
    let mut others = 0_u64;
    for _ in 0..n {
        let Some(s) = draw().filter(|s| !s.delta) else {
            others += 1;
            continue;
        };
        if let Some(bound) = T::ROUNDING {
            let (value, pdf) = sampled.eval_pdf(wo_t, s.wi);
            let (bound, tiny) = (T::of(bound), T::of(1e-12));
            if pdf <= T::zero()
                || (s.pdf - pdf).abs() > bound * pdf.abs().max(tiny)
                || (s.weight * pdf - value).length() > bound * value.length().max(tiny)
            {
                return Err(format!("{s:?} has density {pdf:?} and value {value:?}"));
            }
        } else if !(s.pdf > T::zero() && s.pdf.is_finite() && s.weight.is_finite()) {
            return Err(format!("{s:?} is not finite"));
        }
        match grid.cell(s.wi.cast()) {
            Some(i) => counts[i] += 1,
            None => others += 1,
        }
    }
    let mut expected = grid.probabilities(&|d| exact.pdf(wo, d));
    let total: f64 = expected.iter().sum();
    let share = others as f64 / n as f64;
    let noise = 4.0 * (share * (1.0 - share) / n as f64).sqrt();
    if (total + share - 1.0).abs() > 1e-3 + noise {
        return Err(format!("the density integrates to {total}, and {share} of the samples have none"));
    }
    for (i, (count, expected)) in counts.iter().zip(&mut expected).enumerate() {
        if *expected <= 1e-9 / n as f64 {
            if *count > 10 {
                return Err(format!("{count} samples in cell {i}, where the density is {expected}"));
            }
            // Slivers of cells at the horizon may slip through the quadrature.
            *expected = 1e-12;
        }
    }
    // Samples without density are one more cell.
    counts.push(others);
    expected.push((1.0 - total).max(1e-12));
    let z = chi_square::deviation(&counts, &expected);
    if z > limit { Err(format!("chi-square lies {z:.1} deviations above its mean")) } else { Ok(()) }
}

/// Whether the lobes are no thinner than the grid: those of anisotropic surfaces that are smooth along one axis are
/// lines. The same code runs for rougher ones.
fn is_resolved(case: &Case<f64>) -> bool {
    let lines = ["anisotropy r 0 ", "anisotropy r 0.02", "everything r 0 ", "everything r 0.02"];
    !lines.iter().any(|l| case.name.contains(l))
}

/// Directions towards the viewer: straight, oblique, grazing, and from below.
fn viewers(case: &Case<f64>) -> Vec<Vec3<f64>> {
    let mut out: Vec<Vec3<f64>> = [(1.0, 0.3), (0.7, 2.0), (0.3, -1.0), (0.05, 4.0)]
        .map(|(z, phi): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            vec3(r * phi.cos(), r * phi.sin(), z)
        })
        .to_vec();
    if case.both_sides {
        out.extend(out.clone().into_iter().map(|w| vec3(w.x, w.y, -w.z)));
    }
    out
}

/// The principled models with and without transmission, of both sides of their parameters' ranges.
fn principled<T: Real>() -> Vec<Case<T>> {
    let number = |x: f64| T::of(x);
    let mut out = Vec::new();
    for roughness in [0.05, 0.3, 0.8] {
        for spec_trans in [0.0, 0.6, 1.0] {
            for (eta, metallic, clearcoat) in [(1.5, 0.0, 0.0), (0.7, 0.3, 0.8), (1.0, 0.0, 0.0)] {
                let solid = PrincipledParameters {
                    base_color: v(0.9, 0.6, 0.3),
                    roughness: number(roughness),
                    anisotropic: number(0.4 * metallic),
                    metallic: number(metallic),
                    spec_trans: number(spec_trans),
                    spec_tint: number(0.2),
                    sheen: number(0.5),
                    sheen_tint: number(0.5),
                    flatness: number(0.3),
                    clearcoat: number(clearcoat),
                    clearcoat_gloss: number(0.4),
                    eta: number(eta),
                };
                let name = format!("principled r {roughness} t {spec_trans} eta {eta}");
                let bsdf = Bsdf::Principled(Principled::new(&solid));
                out.push(Case { name, bsdf, ior: None, both_sides: spec_trans > 0.0 });
            }
            let thin = PrincipledThinParameters {
                base_color: v(0.9, 0.6, 0.3),
                roughness: number(roughness),
                anisotropic: number(0.0),
                spec_trans: number(spec_trans),
                spec_tint: number(0.2),
                sheen: number(0.5),
                sheen_tint: number(0.5),
                flatness: number(0.3),
                diff_trans: number(0.8),
                eta: number(1.5),
            };
            let name = format!("thin principled r {roughness} t {spec_trans}");
            let bsdf = Bsdf::PrincipledThin(PrincipledThin::new(&thin));
            out.push(Case { name, bsdf, ior: None, both_sides: true });
        }
    }
    out
}

/// Tests the chosen cases as sampled in `T`.
fn run<T: Tested>(chosen: impl Fn(usize) -> bool, n: usize) {
    let with = |all: Vec<Case<T>>| all.into_iter().chain(principled::<T>());
    let exact = all::<f64>().into_iter().chain(principled::<f64>());
    let cases: Vec<_> = with(all::<T>()).zip(exact).filter(|(_, c)| is_resolved(c)).collect();
    let cases = cases.iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, c)| c);
    let tests: Vec<_> = cases.flat_map(|c| viewers(&c.1).into_iter().map(move |wo| (c, wo))).collect();
    let limit = chi_square::bound(tests.len());
    let mut failures: Vec<String> = tests
        .par_iter()
        .filter_map(|((sampled, exact), wo)| {
            let message = compare(&sampled.bsdf, &exact.bsdf, *wo, n, limit).err()?;
            Some(format!("{} from z {:.2}: {message}", exact.name, wo.z))
        })
        .collect();
    let count = failures.len();
    failures.truncate(20);
    assert!(count == 0, "{count} of {} fail:\n{}", tests.len(), failures.join("\n"));
}

#[test]
fn samples_follow_their_density() {
    // Every fifteenth, so that each kind of material meets several parameters.
    run::<f64>(|i| i % 15 == 3, 100_000);
}

#[test]
fn samples_of_the_principled_models_follow_their_density() {
    let count = all::<f64>().iter().filter(|c| is_resolved(c)).count();
    run::<f64>(|i| i >= count, 20_000);
    run::<f32>(|i| i >= count, 20_000);
}

#[test]
fn samples_in_single_precision_follow_their_density() {
    run::<f32>(|i| i % 15 == 7, 100_000);
}

#[test]
#[ignore = "slow: a million samples of every BSDF"]
fn samples_follow_their_density_everywhere() {
    run::<f64>(|_| true, 1_000_000);
}

#[test]
#[ignore = "slow: a million samples of every BSDF"]
fn samples_in_single_precision_follow_their_density_everywhere() {
    run::<f32>(|_| true, 1_000_000);
}

#[test]
fn a_wrong_density_is_noticed() {
    // Samples of one roughness against the density of another.
    let case = |alpha: f64| RoughConductor {
        metal: gold(),
        surface: Microfacet::isotropic(Distribution::Ggx, alpha),
    };
    let wo = vec3(0.6, 0.0, 0.8);
    let mut rng = Rng::new(1, 1);
    let (right, wrong) = (case(0.3), case(0.33));
    let samples: Vec<BsdfSample<f64>> = (0..30_000)
        .filter_map(|_| right.sample(wo, rng.next_f64(), [rng.next_f64(), rng.next_f64()]))
        .collect();
    let pilots: Vec<_> = samples.iter().take(2000).map(|s| (s.wi, s.pdf)).collect();
    let grid = Grid::new(&pilots, f64::FINEST);
    let mut counts = vec![0; grid.cells()];
    samples.iter().for_each(|s| counts[grid.cell(s.wi).unwrap()] += 1);
    let against = |b: &RoughConductor<f64>| {
        let expected = grid.probabilities(&|d| b.pdf(wo, d));
        // Of the samples that did not fall below the surface.
        let total: f64 = expected.iter().sum();
        let expected: Vec<f64> = expected.iter().map(|p| (p / total).max(1e-12)).collect();
        chi_square::deviation(&counts, &expected)
    };
    assert!(against(&right) < 4.0 && against(&wrong) > 5.0, "{} {}", against(&right), against(&wrong));
}
