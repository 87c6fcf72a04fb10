//! Time of a step's filters, beside Adam without filters and, with `--baseline`, beside a filter in Numba and cholespy.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;
use std::{env, fs};

use anyhow::{Context as _, Result, ensure};
use photofit_geometry::{adjacency::Edges, shapes, weld::Weld};
use photofit_optim::{
    Bilateral, Grid, GridBilateral, Guidance, LargeSteps, Optimizer, Placement, ScreenedPoisson,
    SpatialFilter, Taps, Temporal,
};

use crate::context::Context;
use crate::timing::Timing;

/// A grid to filter.
struct Case {
    name: &'static str,
    grid: Grid,
    channels: usize,
    levels: u32,
}

const CASES: [Case; 7] = [
    Case { name: "512^2 x 1", grid: Grid::plane(512, 512), channels: 1, levels: 5 },
    Case { name: "512^2 x 3", grid: Grid::plane(512, 512), channels: 3, levels: 5 },
    Case { name: "512^2 x 4", grid: Grid::plane(512, 512), channels: 4, levels: 5 },
    Case { name: "1024^2 x 4", grid: Grid::plane(1024, 1024), channels: 4, levels: 5 },
    Case { name: "2048^2 x 4", grid: Grid::plane(2048, 2048), channels: 4, levels: 5 },
    Case { name: "64^3 x 1", grid: Grid::volume(64, 64, 64), channels: 1, levels: 3 },
    Case { name: "64^3 x 4", grid: Grid::volume(64, 64, 64), channels: 4, levels: 3 },
];

/// The case that is compared with other implementations.
const COMPARED: usize = 2;

/// A number in [0, 1) from an index: the same in the script beside.
fn scrambled(i: usize) -> f32 {
    let mut x = (i as u32).wrapping_mul(0x9e37_79b1);
    x ^= x >> 15;
    x = x.wrapping_mul(0x85eb_ca77);
    x ^= x >> 13;
    (x >> 8) as f32 / (1 << 24) as f32
}

/// Parameters: steps of width 50 along both axes with a little noise.
fn parameters(grid: Grid, channels: usize) -> Vec<f32> {
    let [nx, _, _] = grid.shape();
    let value = |i: usize| {
        let site = i / channels;
        let block = (site % nx / 50) * 7 + (site / nx / 50) * 3 + i % channels;
        (block % 10) as f32 * 0.1 + 0.02 * scrambled(i)
    };
    (0..grid.sites() * channels).map(value).collect()
}

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for case in &CASES {
        let n = case.grid.sites() * case.channels;
        let params = parameters(case.grid, case.channels);
        let m: Vec<f32> = (0..n).map(|i| scrambled(i + 77) - 0.5).collect();
        let v: Vec<f32> = m.iter().map(|m| m * m).collect();
        for (name, taps) in [("postfilter, 3 taps", Taps::Three), ("postfilter, B3", Taps::B3)] {
            let config = Bilateral { levels: case.levels, taps, ..Bilateral::default() };
            let mut filter = GridBilateral::new("theta", case.grid, case.channels, config)?;
            let mut out = [vec![0.0_f32; n], vec![0.0; n]];
            ctx.measure(
                name,
                case.name,
                case.grid.sites(),
                || -> Result<()> {
                    let guidance =
                        Guidance { group: "theta", params: &params, grads: &m, rate: 0.01, guide: &[] };
                    filter.prepare(&guidance)?;
                    let [a, b] = &mut out;
                    filter.apply(&[&m, &v], &mut [a, b]);
                    Ok(())
                },
                |_| vec![],
            )?;
        }
        let mut poisson = ScreenedPoisson::new("theta", case.grid, 10.0)?;
        let mut out = vec![0.0_f32; n];
        ctx.measure(
            "screened Poisson of one field",
            case.name,
            case.grid.sites(),
            || poisson.apply(&[&m], &mut [&mut out]),
            |_| vec![],
        );
        let mut adam = Optimizer::new("theta", n, Temporal::adam())?;
        let mut x = params.clone();
        ctx.measure(
            "Adam, whole step",
            case.name,
            case.grid.sites(),
            || adam.step(&mut x, &m, 1e-6).is_ok(),
            |_| vec![],
        );
        let filter = GridBilateral::new(
            "theta",
            case.grid,
            case.channels,
            Bilateral { levels: case.levels, ..Bilateral::default() },
        )?;
        let mut bilateral =
            Optimizer::new("theta", n, Temporal::adam().paired(0.2))?.with_filter(Placement::POST, filter)?;
        ctx.measure(
            "bilateral, whole step",
            case.name,
            case.grid.sites(),
            || bilateral.step(&mut x, &m, 1e-6).is_ok(),
            |_| vec![],
        );
    }
    let python = env::var_os("PHOTOFIT_PYTHON").filter(|_| ctx.baseline());
    match &python {
        Some(python) => numba(ctx, python)?,
        None if ctx.baseline() => {
            ctx.note("No comparison with peers: `PHOTOFIT_PYTHON` names no Python interpreter.");
        }
        None => {}
    }
    large_steps(ctx, python.as_deref())
}

/// The numbers that a peer script prints, line by line.
fn printed(command: &mut Command) -> Result<Vec<Vec<f64>>> {
    let run = command.output().context("the peer script")?;
    ensure!(run.status.success(), "the peer script failed: {}", String::from_utf8_lossy(&run.stderr));
    let words = String::from_utf8_lossy(&run.stdout);
    Ok(words.lines().map(|l| l.split_whitespace().filter_map(|w| w.parse().ok()).collect()).collect())
}

/// The same filter in Numba, compared in value and time.
fn numba(ctx: &mut Context, python: &OsStr) -> Result<()> {
    let Case { name, grid, channels, levels } = CASES[COMPARED];
    let n = grid.sites() * channels;
    let params = parameters(grid, channels);
    let m: Vec<f32> = (0..n).map(|i| scrambled(i + 77) - 0.5).collect();
    let v: Vec<f32> = m.iter().map(|m| m * m).collect();
    for (taps, word) in [(Taps::Three, "three"), (Taps::B3, "b3")] {
        let sigma = photofit_optim::Sigma::Fixed(0.05);
        let config = Bilateral { levels, taps, sigma, ..Bilateral::default() };
        let mut filter = GridBilateral::new("theta", grid, channels, config)?;
        filter.prepare(&Guidance { group: "theta", params: &params, grads: &m, rate: 0.01, guide: &[] })?;
        let mut out = [vec![0.0_f32; n], vec![0.0; n]];
        let [a, b] = &mut out;
        filter.apply(&[&m, &v], &mut [a, b]);
        let path = Path::new("out/bench").join(format!("optim-bilateral-{word}.f32"));
        fs::create_dir_all("out/bench").context("out/bench: cannot create")?;
        let bytes: Vec<u8> = out.concat().iter().flat_map(|x| x.to_le_bytes()).collect();
        fs::write(&path, bytes).with_context(|| format!("{}: cannot write", path.display()))?;
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/bilateral_numba.py");
        let lines = printed(Command::new(python).arg(script).arg(word).arg(&path))?;
        ensure!(lines.len() == 1 && lines[0].len() > 1, "the peer script printed {lines:?}");
        let (difference, seconds) = (lines[0][0], lines[0][1..].to_vec());
        let method = if taps == Taps::Three { "Numba, 3 taps" } else { "Numba, B3" };
        ctx.record(method, name, grid.sites(), Timing::of(seconds), vec![("difference", difference)]);
    }
    ctx.note("`difference` is the largest one between our filtered moments and those of the script.");
    Ok(())
}

/// Factorisation and solve of Large Steps on the sphere with 100,000 vertices.
fn large_steps(ctx: &mut Context, python: Option<&OsStr>) -> Result<()> {
    const LAMBDA: f64 = 19.0;
    let mesh = shapes::displaced_sphere(100, 0.2, 4, 1);
    let edges = Edges::new(&mesh.triangles, &Weld::identity(mesh.positions.len())).vertices;
    let n = mesh.positions.len();
    let case = format!("{n} vertices");
    let x: Vec<f64> =
        mesh.positions.iter().flat_map(|p| [f64::from(p.x), f64::from(p.y), f64::from(p.z)]).collect();
    let path = ctx
        .measure("Large Steps, factor", &case, n, || LargeSteps::new(n, &edges, LAMBDA), |_| vec![])
        .context("the factorisation")?;
    let u = path.to_u(&x)?;
    ctx.measure(
        "Large Steps, solve",
        &case,
        n,
        || path.to_x(&u),
        |found| {
            let Ok(found) = found else { return vec![] };
            let off: f64 = found.iter().zip(&x).map(|(a, b)| (a - b).powi(2)).sum();
            vec![("error", (off / x.iter().map(|x| x * x).sum::<f64>()).sqrt())]
        },
    )?;
    let Some(python) = python else { return Ok(()) };
    let folder = Path::new("out/bench");
    let save = |name: &str, bytes: Vec<u8>| {
        let path = folder.join(name);
        fs::write(&path, bytes).with_context(|| format!("{}: cannot write", path.display()))?;
        Ok::<_, anyhow::Error>(path)
    };
    let pairs = save("optim-edges.u32", edges.iter().flatten().flat_map(|v| v.to_le_bytes()).collect())?;
    let positions = save("optim-positions.f64", x.iter().flat_map(|x| x.to_le_bytes()).collect())?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/large_steps_cholespy.py");
    let (repetitions, solves) = (5, 25);
    let mut command = Command::new(python);
    command.arg(script).arg(pairs).arg(n.to_string()).arg(LAMBDA.to_string()).arg(positions);
    let lines = printed(command.arg(repetitions.to_string()))?;
    let good = lines.len() == 2 && lines.iter().all(|l| l.len() == 1 + repetitions + solves);
    ensure!(good, "the peer script printed {lines:?}");
    for (scalar, line) in ["f64", "f32"].into_iter().zip(lines) {
        let (factor, solve) = line[1..].split_at(repetitions);
        ctx.record(&format!("cholespy {scalar}, factor"), &case, n, Timing::of(factor.to_vec()), vec![]);
        let error = vec![("error", line[0])];
        ctx.record(&format!("cholespy {scalar}, solve"), &case, n, Timing::of(solve.to_vec()), error);
    }
    Ok(())
}
