//! Sampling against density: Pearson's test on a grid that is as fine as the lobe.

use super::catalogue::{Case, all, case, extended, gold, v};
use super::charts::{Grid, Lines};
use crate::bsdf::{
    Bsdf, BsdfSample, Distribution, Microfacet, Principled, PrincipledParameters, PrincipledThin,
    PrincipledThinParameters, RoughConductor, Scatter,
};
use photofit_sampling::{Rng, chi_square};
use photofit_scalar::{Real, Vec3, vec3};
use rayon::prelude::*;

/// The quick tests take one of so many cases: without a common divisor with the thirty of each roughness, so that they meet kinds of
/// all sorts.
const STRIDE: usize = 13;
/// Cells that expect fewer samples count together.
const FEW: f64 = 20.0;

/// A scalar that BSDFs are sampled in.
trait Tested: Real {
    /// `1 - cos` of directions that the grid does not tell apart: those of some thousand that the scalar can.
    const BLUR: f64;
    /// Relative error of value and density of a sample against those of its direction; `None` where directions are too
    /// coarse to say of each one.
    const ROUNDING: Option<f64>;
    /// The same of the median sample, against value and density in f64.
    const MEDIAN: f64;
}

impl Tested for f64 {
    const BLUR: Self = 1e-16;
    const ROUNDING: Option<Self> = Some(1e-6);
    const MEDIAN: Self = 1e-6;
}

impl Tested for f32 {
    const BLUR: f64 = 1e-8;
    const ROUNDING: Option<f64> = None;
    const MEDIAN: f64 = 0.02;
}

/// Compares `n` samples with the density of the same BSDF in f64; the message says what is wrong.
fn compare<T: Tested>(
    sampled: &Bsdf<T>,
    exact: &Case<f64>,
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
    // What bends light by less than a thousandth has lobes that directions in single precision do not resolve.
    let too_narrow = lines(exact).is_some() || exact.ior.is_some_and(|ior| (ior - 1.0).abs() < 1e-3);
    let off = if too_narrow { 0.0 } else { median_error(&first, exact, wo) };
    if off.is_nan() || off > T::MEDIAN {
        return Err(format!("the median sample has a density or value that is off by {off:.3}"));
    }
    let grid = Grid::new(&pilots, wo, lines(exact), T::BLUR);
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
    let mut expected = grid.probabilities(&|d| exact.bsdf.pdf(wo, d));
    let total: f64 = expected.iter().sum();
    let share = others as f64 / n as f64;
    let noise = 4.0 * (share * (1.0 - share) / n as f64).sqrt();
    if (total + share - 1.0).abs() > 1e-3 + noise {
        return Err(format!("the density integrates to {total}, and {share} of the samples have none"));
    }
    // Samples without density are one more cell, which takes those that expect few: what slips through the quadrature,
    // slivers of cells at sharp ends of a lobe, is missing in the sum of the others.
    let mut kept = 0.0;
    for (count, expected) in counts.iter_mut().zip(&mut expected) {
        if *expected * (n as f64) < FEW {
            others += std::mem::take(count);
            *expected = 0.0;
        }
        kept += *expected;
    }
    counts.push(others);
    expected.push((1.0 - kept).max(1e-12));
    let z = chi_square::deviation(&counts, &expected);
    if z > limit { Err(format!("chi-square lies {z:.1} deviations above its mean")) } else { Ok(()) }
}

/// Relative error of density and weight of the median sample, the sum of both, against those of the same BSDF in f64.
fn median_error<T: Real>(samples: &[BsdfSample<T>], exact: &Case<f64>, wo: Vec3<f64>) -> f64 {
    let errors = samples.iter().filter(|s| !s.delta).map(|s| {
        let (value, pdf) = exact.bsdf.eval_pdf(wo, s.wi.cast());
        let weight: Vec3<f64> = s.weight.cast();
        let of_value = (weight * s.pdf.f64() - value).length() / value.length().max(1e-12);
        (s.pdf.f64() - pdf).abs() / pdf.max(1e-12) + of_value
    });
    let mut errors: Vec<f64> = errors.collect();
    let middle = errors.len() / 2;
    *errors.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The lines that a case's lobes are, if they are.
fn lines(case: &Case<f64>) -> Option<Lines> {
    let thin =
        |kind: &str| ["0", "0.02"].iter().any(|r| case.name.starts_with(&format!("glTF {kind} r {r} ")));
    let turn = if thin("anisotropy") {
        [0.6, 0.8]
    } else if thin("everything") {
        [1.0, 0.0]
    } else {
        return None;
    };
    Some(Lines { turn, ior: case.ior.unwrap_or(1.0) })
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
                out.push(Case { both_sides: spec_trans > 0.0, ..case(name, bsdf) });
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
            out.push(Case { both_sides: true, ..case(name, bsdf) });
        }
    }
    out
}

/// Tests the chosen cases as sampled in `T`.
fn run<T: Tested>(chosen: impl Fn(usize) -> bool, n: usize) {
    let with = |all: Vec<Case<T>>| all.into_iter().chain(principled::<T>());
    let exact = all::<f64>().into_iter().chain(principled::<f64>());
    let cases: Vec<_> = with(all::<T>()).zip(exact).collect();
    let cases = cases.iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, c)| c);
    let tests: Vec<_> = cases.flat_map(|c| viewers(&c.1).into_iter().map(move |wo| (c, wo))).collect();
    let limit = chi_square::bound(tests.len());
    let mut failures: Vec<String> = tests
        .par_iter()
        .filter_map(|((sampled, exact), wo)| {
            let message = compare(&sampled.bsdf, exact, *wo, n, limit).err()?;
            Some(format!("{} from z {:.2}: {message}", exact.name, wo.z))
        })
        .collect();
    let count = failures.len();
    failures.truncate(20);
    assert!(count == 0, "{count} of {} fail:\n{}", tests.len(), failures.join("\n"));
}

#[test]
fn samples_follow_their_density() {
    run::<f64>(|i| i % STRIDE == 3, 100_000);
}

#[test]
fn samples_of_the_principled_models_follow_their_density() {
    let count = all::<f64>().len();
    run::<f64>(|i| i >= count, 20_000);
    run::<f32>(|i| i >= count, 20_000);
}

#[test]
fn samples_in_single_precision_follow_their_density() {
    run::<f32>(|i| i % STRIDE == 7, 100_000);
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
    let grid = Grid::new(&pilots, wo, None, f64::BLUR);
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

#[test]
fn a_wrong_density_of_a_line_is_noticed() {
    let case = |roughness: f64| {
        case(format!("glTF anisotropy r {roughness} "), extended("anisotropy", roughness).bsdf())
    };
    // Alphas have a least value, which roughness .02 is below and .034 above.
    let (right, wrong) = (case(0.02), case(0.034));
    let wo = viewers(&right)[1];
    let against = |other: &Bsdf<f64>| {
        let named = Case { name: right.name.clone(), bsdf: *other, ..case(0.02) };
        // Density and value of a sample are those of what is sampled; they are not looked at in single precision.
        compare::<f32>(&extended("anisotropy", 0.02).bsdf(), &named, wo, 50_000, chi_square::bound(1))
    };
    assert_eq!(against(&right.bsdf), Ok(()));
    assert!(against(&wrong.bsdf).is_err(), "a sixth of the width");
}
