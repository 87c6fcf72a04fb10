//! ROF against scikit-image's Chambolle iteration, at equal primal-dual gap.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use photofit_denoise::Shape;
use photofit_denoise::admm::{Admm, Stop};
use photofit_denoise::models;
use photofit_denoise::primal_dual::{ChambollePock, rof_gap};

use super::denoise::{picture, single};
use crate::context::Context;
use crate::timing::{Timing, time};

const HEIGHT: usize = 720;
const WIDTH: usize = 1280;
const LAMBDA: f32 = 8.0;
/// Relative gaps at which times are compared.
const GAPS: [f64; 2] = [1e-2, 1e-3];
const PEER_ITERATIONS: [usize; 8] = [5, 10, 20, 40, 80, 160, 320, 640];

/// A method's gaps and seconds, by growing effort.
type Curve = Vec<(f64, f64)>;

/// Times both and notes the ratios. `python` runs the script of the peer.
pub(super) fn run(ctx: &mut Context, python: &OsStr) -> Result<()> {
    let target = single(&picture(WIDTH, HEIGHT, 1));
    let shape = Shape::new(WIDTH, HEIGHT, 1);
    let problem = models::rof(shape, &target, LAMBDA);
    let case = |k: usize| format!("{WIDTH} x {HEIGHT}, {k} iterations");
    let [mut admm, mut pock] = [Curve::new(), Curve::new()];
    for iterations in [5, 10, 20, 40, 80, 160] {
        let (timing, solver) = time(|| {
            let mut solver = Admm::new(&problem).expect("a good problem");
            solver.solve(Stop::Iterations(iterations));
            solver
        });
        let dual = solver.gradient_dual().context("the dual of a solved problem")?;
        let gap = rof_gap(&problem, &solver.solution(), &dual).relative();
        admm.push((gap, timing.median));
        ctx.record("ROF, ADMM", &case(iterations), shape.len(), timing, vec![("certified", gap)]);
        let (timing, solver) = time(|| {
            let mut solver = ChambollePock::new(&problem).expect("a good problem");
            (0..iterations).for_each(|_| solver.step());
            solver
        });
        let gap = solver.gap().relative();
        pock.push((gap, timing.median));
        ctx.record("ROF, Chambolle-Pock", &case(iterations), shape.len(), timing, vec![("certified", gap)]);
    }
    let peer = peer(python, &target)?;
    for (iterations, (gap, seconds)) in PEER_ITERATIONS.iter().zip(&peer) {
        let timing = Timing::of(vec![*seconds]);
        let figures = vec![("certified", *gap)];
        ctx.record("scikit-image Chambolle", &case(*iterations), shape.len(), timing, figures);
    }
    for gap in GAPS {
        let [a, b, c] = [&admm, &pock, &peer].map(|curve| seconds_at(curve, gap));
        let Some(theirs) = c else { continue };
        let word = |ours: Option<f64>| match ours {
            Some(s) => format!("{:.0} ms ({:.3} of the peer)", 1e3 * s, s / theirs),
            None => "not reached".to_owned(),
        };
        ctx.note(format!(
            "ROF of {WIDTH} x {HEIGHT} to a gap of {gap:.0e}: ADMM {}, Chambolle-Pock {}, scikit-image {:.0} ms on one thread.",
            word(a),
            word(b),
            1e3 * theirs
        ));
    }
    Ok(())
}

/// The script's gaps and median seconds.
fn peer(python: &OsStr, target: &[f32]) -> Result<Curve> {
    let folder = Path::new("out/bench");
    fs::create_dir_all(folder).context("out/bench: cannot create")?;
    let path = folder.join("denoise-rof.f32");
    let bytes: Vec<u8> = target.iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(&path, bytes).with_context(|| format!("{}: cannot write", path.display()))?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/tv_chambolle.py");
    let mut command = Command::new(python);
    command.arg(script).arg(&path).args([HEIGHT, WIDTH].map(|n| n.to_string()));
    command.args([LAMBDA.to_string(), "3".to_owned()]).args(PEER_ITERATIONS.map(|n| n.to_string()));
    let run = command.output().context("the peer script")?;
    ensure!(run.status.success(), "the peer script failed: {}", String::from_utf8_lossy(&run.stderr));
    let text = String::from_utf8_lossy(&run.stdout).into_owned();
    let numbers = |l: &str| l.split_whitespace().filter_map(|w| w.parse().ok()).collect::<Vec<f64>>();
    let lines: Vec<Vec<f64>> = text.lines().map(numbers).collect();
    let good = lines.len() == PEER_ITERATIONS.len() && lines.iter().all(|l| l.len() > 1);
    ensure!(good, "the peer script printed {text}");
    Ok(lines.iter().map(|l| (l[0], Timing::of(l[1..].to_vec()).median)).collect())
}

/// Seconds at a gap, between two points in proportion to the logarithms; `None` if the curve does not reach it.
fn seconds_at(curve: &[(f64, f64)], gap: f64) -> Option<f64> {
    let k = curve.iter().position(|(g, _)| *g <= gap)?;
    let (g1, s1) = curve[k];
    let Some((g0, s0)) = k.checked_sub(1).map(|k| curve[k]) else { return Some(s1) };
    let share = ((gap / g0).ln() / (g1 / g0).ln()).clamp(0.0, 1.0);
    Some((s0.ln() + share * (s1 / s0).ln()).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_at_a_gap_are_interpolated() {
        let curve = [(1e-1, 1.0), (1e-3, 100.0)];
        assert!((seconds_at(&curve, 1e-2).expect("reached") - 10.0).abs() < 1e-9);
        assert_eq!((seconds_at(&curve, 0.5), seconds_at(&curve, 1e-4)), (Some(1.0), None));
    }
}
