//! [`StripSolver`](super::StripSolver) on a device, for systems without `c2`.

use super::Symbol;
use crate::gpu::{filled, room};
use photofit_fft::laplacian_eigenvalue;
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder};

/// Rows of a part of a column.
const PART: usize = 16;
/// Longest rows, by the workgroup memory that they need: two copies of a row.
const SHORT: usize = 1024;
const LONG: usize = 2048;
const STRIP: &str = include_str!("strip.wgsl");

pub(crate) const SHORT_ROWS: Kernel = Kernel {
    name: "strip: rows up to 1024",
    source: &[INDEX, "const WORK: u32 = 2048u;", STRIP],
    entry: "rows",
};
pub(crate) const LONG_ROWS: Kernel = Kernel {
    name: "strip: rows up to 2048",
    source: &[INDEX, "const WORK: u32 = 4096u;", STRIP],
    entry: "rows",
};
pub(crate) const PART_ENDS: Kernel = column("strip: ends of parts", "part_ends");
pub(crate) const SEPARATORS: Kernel = column("strip: rows between parts", "separators");
pub(crate) const PART_INSIDES: Kernel = column("strip: insides of parts", "part_insides");

const fn column(name: &'static str, entry: &'static str) -> Kernel {
    Kernel { name, source: &[INDEX, "const WORK: u32 = 1u;", STRIP], entry }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    width: u32,
    height: u32,
    pictures: u32,
    stages: u32,
    c0: f32,
    c1: f32,
    scale: f32,
    back: u32,
    radices: [u32; 12],
}

/// Solves `(c0 + c1 L) u = f`, periodic along rows and Neumann along columns, for packed pictures: two channels as the real
/// and the imaginary part of one, rows after each other.
///
/// The rows are transformed as on the CPU. Columns are cut into parts, which are eliminated side by side; the rows between
/// them have a tridiagonal system of their own (Wang 1981): exact as well.
#[derive(Debug)]
pub(crate) struct DeviceStrip {
    params: Params,
    rows: Kernel,
    roots: Buffer<[f32; 2]>,
    eigenvalues: Buffer<f32>,
    factors: Buffer<[f32; 4]>,
    ends: Buffer<[f32; 4]>,
}

impl DeviceStrip {
    /// The longest rows that a device transforms.
    pub(crate) fn longest(gpu: &Gpu) -> usize {
        if gpu.report().workgroup_memory as usize >= 2 * LONG * size_of::<[f32; 2]>() { LONG } else { SHORT }
    }

    /// For rows of `width` samples, at most [`Self::longest`], which only has the factors 2, 3 and 5; in the buffers of a
    /// former one, as far as they have the size.
    pub(crate) fn new(
        gpu: &Gpu,
        former: Option<&Self>,
        [width, height]: [usize; 2],
        pictures: usize,
        symbol: Symbol,
    ) -> Result<Self, GpuError> {
        symbol.check();
        assert!(symbol.c2 == 0.0, "a system without c2");
        assert!(width <= Self::longest(gpu), "rows of {width} samples");
        let radices = radices(width);
        let mut params = Params {
            width: width as u32,
            height: height as u32,
            pictures: pictures as u32,
            stages: radices.len() as u32,
            c0: symbol.c0 as f32,
            c1: symbol.c1 as f32,
            scale: 1.0,
            back: 0,
            radices: [0; 12],
        };
        params.radices[..radices.len()].copy_from_slice(&radices);
        let angle = |k: usize| std::f64::consts::TAU * k as f64 / width as f64;
        let roots: Vec<[f32; 2]> =
            (0..width).map(|k| [angle(k).cos() as f32, -angle(k).sin() as f32]).collect();
        let eigenvalues: Vec<f64> = (0..width).map(|k| laplacian_eigenvalue(angle(k))).collect();
        let single: Vec<f32> = eigenvalues.iter().map(|l| *l as f32).collect();
        let parts = height.div_ceil(PART);
        Ok(Self {
            params,
            rows: if width <= SHORT { SHORT_ROWS } else { LONG_ROWS },
            roots: filled(gpu, former.map(|f| &f.roots), "roots of unity", &roots)?,
            eigenvalues: filled(gpu, former.map(|f| &f.eigenvalues), "eigenvalues", &single)?,
            factors: filled(
                gpu,
                former.map(|f| &f.factors),
                "factors of rows between parts",
                &factors(&eigenvalues, height, symbol),
            )?,
            ends: room(gpu, former.map(|f| &f.ends), "ends of parts", pictures * parts * width)?,
        })
    }

    /// Puts the solution in place of the right-hand side.
    pub(crate) fn solve(&self, r: &mut Recorder, picture: &Buffer<[f32; 2]>) -> Result<(), GpuError> {
        let [width, height, pictures] =
            [self.params.width, self.params.height, self.params.pictures].map(|n| n as usize);
        let parts = height.div_ceil(PART);
        let forward = Params { scale: 1.0 / width as f32, ..self.params };
        let rows = [picture.bind(), self.roots.bind()];
        r.dispatch(&self.rows, &forward, &rows, 256 * height * pictures)?;
        let ends = [picture.bind(), self.eigenvalues.bind(), self.ends.bind()];
        if parts > 1 {
            r.dispatch(&PART_ENDS, &forward, &ends, pictures * parts * width)?;
            let between = [picture.bind(), self.ends.bind(), self.factors.bind()];
            r.dispatch(&SEPARATORS, &forward, &between, pictures * width)?;
        }
        r.dispatch(&PART_INSIDES, &forward, &ends[..2], pictures * parts * width)?;
        r.dispatch(&self.rows, &Params { back: 1, ..self.params }, &rows, 256 * height * pictures)?;
        Ok(())
    }
}

/// Factors of a length, fours first.
///
/// # Panics
/// If it has others than 2, 3 and 5.
fn radices(length: usize) -> Vec<u32> {
    let (mut rest, mut out) = (length, Vec::new());
    for radix in [4, 2, 3, 5] {
        while rest.is_multiple_of(radix) {
            out.push(radix as u32);
            rest /= radix;
        }
    }
    assert!(rest == 1, "a length of {length} has other factors than 2, 3 and 5");
    out
}

/// Of the inverse of what is inside of a part: first and last entry of the diagonal, and the one in the corner, times `c1^2`.
fn responses(eigenvalue: f64, part: usize, height: usize, symbol: Symbol) -> [f64; 3] {
    let (begin, end) = (part * PART, (part + 1) * PART);
    let rows = begin..if end >= height { height } else { end - 1 };
    let e = symbol.c1;
    let sides = |i: usize| f64::from(u8::from(i > 0)) + f64::from(u8::from(i + 1 < height));
    let pivot = |before: f64, i: usize| symbol.c0 + e * (eigenvalue + sides(i)) - before;
    let mut down = 0.0;
    let mut corner = e;
    for i in rows.clone() {
        let p = pivot(down, i);
        (down, corner) = (e * e / p, corner * e / p);
    }
    let up = rows.rev().fold(0.0, |up, i| e * e / pivot(up, i));
    [up, down, corner]
}

/// The factors of the rows between parts: for each row and frequency 1 / pivot, the factor of the row above, and of the one
/// below.
fn factors(eigenvalues: &[f64], height: usize, symbol: Symbol) -> Vec<[f32; 4]> {
    let (width, parts) = (eigenvalues.len(), height.div_ceil(PART));
    let mut out = vec![[0.0; 4]; (parts - 1) * width];
    for (k, l) in eigenvalues.iter().enumerate() {
        let mut below = 0.0;
        let mut own = responses(*l, 0, height, symbol);
        for part in 0..parts - 1 {
            // All parts but the first and the last are alike.
            let next = match part {
                0 => responses(*l, 1, height, symbol),
                _ if part + 2 == parts => responses(*l, part + 1, height, symbol),
                _ => own,
            };
            let diagonal = symbol.c0 + symbol.c1 * (l + 2.0) - own[1] - next[0];
            let above = if part == 0 { 0.0 } else { own[2] };
            let inverse = 1.0 / (diagonal - above * below);
            below = next[2] * inverse;
            out[part * width + k] = [inverse as f32, (above * inverse) as f32, below as f32, 0.0];
            own = next;
        }
    }
    out
}
