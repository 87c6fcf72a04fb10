//! Grids of directions that are as fine as the lobes of a BSDF, and the probabilities of their cells.

use photofit_scalar::{Vec3, vec3};
use std::f64::consts::PI;

/// Cells along the first coordinate of a chart, and along the second.
const RINGS: usize = 16;
/// See [`RINGS`].
const SECTORS: usize = 12;
const CELLS: usize = RINGS * SECTORS;
/// Most halvings of a cell by the quadrature, where the domain ends in it (all of it is halved along the end) and elsewhere.
const DEPTH: [u32; 2] = [6, 14];
/// Least halvings of a cell, and of one at the pole, where a lobe may end.
const FORCED: [u32; 2] = [1, 3];

/// Lobes that are lines: those of anisotropic surfaces which are all but smooth along one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lines {
    /// Cosine and sine of the angle of the axes.
    pub(super) turn: [f64; 2],
    /// Index of refraction of the inside.
    pub(super) ior: f64,
}

/// Coordinates of the directions on one side of the surface, cut into cells.
#[derive(Debug)]
enum Chart {
    Rings(Rings),
    Halves(Halves),
}

impl Chart {
    fn side(&self) -> f64 {
        match self {
            Self::Rings(c) => c.side,
            Self::Halves(c) => c.side,
        }
    }

    /// `None` for directions that the chart does not show.
    fn cell(&self, d: Vec3<f64>) -> Option<usize> {
        match self {
            Self::Rings(c) => Some(c.cell(d)),
            Self::Halves(c) => c.cell(d),
        }
    }

    /// How many of the first cells are one.
    fn joined(&self) -> usize {
        match self {
            Self::Rings(c) => c.joined,
            Self::Halves(_) => 0,
        }
    }

    /// Probability of a cell.
    fn probability(&self, cell: usize, pdf: &impl Fn(Vec3<f64>) -> f64) -> f64 {
        let at = [(cell / SECTORS) as f64, (cell % SECTORS) as f64];
        match self {
            Self::Rings(c) => integrate(at, &|a, b| c.density(a, b, pdf), &|at, size| c.cut(at, size)),
            Self::Halves(c) => integrate(at, &|a, b| c.density(a, b, pdf), &|at, size| c.cut(at, size)),
        }
    }
}

/// How a square of coordinates is integrated over.
enum Cut {
    /// Nothing is in it.
    Empty,
    /// The domain ends in it: it is halved to the end.
    Ends,
    /// Halved at least this often.
    Whole(u32),
}

/// Integral of a density over a cell, halved where finer estimates disagree.
fn integrate(at: [f64; 2], density: &impl Fn(f64, f64) -> f64, cut: &impl Fn([f64; 2], f64) -> Cut) -> f64 {
    refine(at, 0, gauss(at, 1.0, density), density, cut)
}

/// The same for a square that is `depth` halvings smaller than a cell, whose integral is about `whole`.
fn refine(
    at: [f64; 2],
    depth: u32,
    whole: f64,
    density: &impl Fn(f64, f64) -> f64,
    cut: &impl Fn([f64; 2], f64) -> Cut,
) -> f64 {
    let size = 0.5_f64.powi(depth as i32);
    let (least, most) = match cut(at, size) {
        Cut::Empty => return 0.0,
        Cut::Ends => (DEPTH[0], DEPTH[0]),
        Cut::Whole(forced) => (forced, DEPTH[1]),
    };
    let half = 0.5 * size;
    let parts = [[0.0, 0.0], [half, 0.0], [0.0, half], [half, half]].map(|c| [at[0] + c[0], at[1] + c[1]]);
    let estimates = parts.map(|p| gauss(p, half, density));
    let sum: f64 = estimates.iter().sum();
    if depth >= most || (depth >= least && (sum - whole).abs() < 1e-7 + 1e-3 * sum) {
        return sum;
    }
    parts.iter().zip(estimates).map(|(p, e)| refine(*p, depth + 1, e, density, cut)).sum()
}

/// Gauss and Legendre's rule with three points along each axis.
fn gauss(at: [f64; 2], size: f64, density: &impl Fn(f64, f64) -> f64) -> f64 {
    let offset = 0.5 * 0.6_f64.sqrt();
    let points = [(0.5 - offset, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + offset, 5.0 / 18.0)];
    let mut sum = 0.0;
    for (x, wx) in points {
        for (y, wy) in points {
            sum += wx * wy * density(at[0] + x * size, at[1] + y * size);
        }
    }
    sum * size * size
}

/// Polar coordinates around a direction whose rings grow geometrically, `u = 1 - cos = scale (exp(rho) - 1)`, for the
/// directions on one side of the surface.
#[derive(Debug)]
struct Rings {
    side: f64,
    pole: Vec3<f64>,
    s: Vec3<f64>,
    t: Vec3<f64>,
    scale: f64,
    rho_max: f64,
    /// The first cells that are one, all of the innermost rings.
    joined: usize,
}

impl Rings {
    /// Centred at the densest of the pilot samples on a side, finer than the lobe there.
    fn new(side: f64, pilots: &[(Vec3<f64>, f64)], blur: f64) -> Option<Self> {
        let here = pilots.iter().filter(|p| p.0.z * side > 0.0);
        let &(pole, pdf) = here.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let scale = (0.1 / (2.0 * PI * pdf)).clamp(1e-16, 0.5);
        let (s, t) = pole.orthonormal_pair();
        let rho_max = (2.0 / scale).ln_1p();
        let joined = ((blur / scale).ln_1p() / rho_max * RINGS as f64) as usize * SECTORS;
        Some(Self { side, pole, s, t, scale, rho_max, joined })
    }

    fn cell(&self, d: Vec3<f64>) -> usize {
        let u = 0.5 * (d - self.pole).length_squared();
        let ring = ((u / self.scale).ln_1p() / self.rho_max * RINGS as f64) as usize;
        let sector = ((d.dot(self.t).atan2(d.dot(self.s)) / (2.0 * PI) + 0.5) * SECTORS as f64) as usize;
        let cell = ring.min(RINGS - 1) * SECTORS + sector.min(SECTORS - 1);
        if cell < self.joined { 0 } else { cell }
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

    /// Squares between these heights over the horizon.
    fn cut(&self, at: [f64; 2], size: f64) -> Cut {
        let (low, high) = self.heights(at, size);
        match (low > 0.0, high > 0.0) {
            (_, false) => Cut::Empty,
            (false, true) => Cut::Ends,
            _ => Cut::Whole(FORCED[usize::from(at[0] < 2.0)]),
        }
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
        let polar = |ring: f64| {
            let u = (self.scale * (ring * self.rho_max / RINGS as f64).exp_m1()).min(2.0);
            2.0 * (0.5 * u).sqrt().asin()
        };
        let rings = [polar(at[0]), polar(at[0] + size)];
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for cosine in [least, most] {
            // The height is `r cos(theta - top)`: extreme at the ends, at the top or opposite to it.
            let (x, y) = (self.pole.z * self.side, a * cosine * self.side);
            let (r, top) = (x.hypot(y), y.atan2(x));
            let mut height = |theta: f64| {
                let z = r * (theta - top).cos();
                (low, high) = (low.min(z), high.max(z));
            };
            rings.into_iter().for_each(&mut height);
            for theta in [top, top + PI, top - PI] {
                if theta > rings[0] && theta < rings[1] {
                    height(theta);
                }
            }
        }
        (low, high)
    }
}

/// Half vectors in cylindrical coordinates around the second axis of the surface, their angle to the normal and their height
/// along the axis, of which solid angle is the product; each grows geometrically, `x = scale sinh(asinh(END / scale) a)` with
/// `a` in `[-1, 1]`.
#[derive(Debug)]
struct Halves {
    side: f64,
    wo: Vec3<f64>,
    /// Index of refraction on the other side of the surface over that of the viewer's, where directions are on the other side.
    eta: Option<f64>,
    turn: [f64; 2],
    scales: [f64; 2],
}

/// Largest angle and height.
const END: [f64; 2] = [0.5 * PI, 1.0];

impl Halves {
    /// As fine as the half vectors of the pilot samples on a side are dense, but not finer than `blur`.
    fn new(side: f64, pilots: &[(Vec3<f64>, f64)], wo: Vec3<f64>, lines: Lines, blur: f64) -> Option<Self> {
        let ior = if wo.z > 0.0 { lines.ior } else { 1.0 / lines.ior };
        let eta = (side * wo.z < 0.0).then_some(ior);
        let mut chart = Self { side, wo, eta, turn: lines.turn, scales: [1.0; 2] };
        let halves = pilots.iter().filter(|p| p.0.z * side > 0.0).filter_map(|p| chart.half(p.0));
        let [mut x, mut y]: [Vec<f64>; 2] =
            halves.map(|h| (h.x.atan2(h.z).abs(), h.y.abs())).unzip::<f64, f64, Vec<_>, Vec<_>>().into();
        for (scale, values) in chart.scales.iter_mut().zip([&mut x, &mut y]) {
            let quarter = values.len() / 4;
            *scale = values.select_nth_unstable_by(quarter, f64::total_cmp).1.clamp(blur.sqrt(), 0.5);
        }
        Some(chart)
    }

    /// The half vector of a direction, above the surface, along its axes. `None` where a smooth facet would not turn the
    /// viewer's direction into it.
    fn half(&self, wi: Vec3<f64>) -> Option<Vec3<f64>> {
        let h = match self.eta {
            None => self.wo + wi,
            Some(eta) => self.wo + wi * eta,
        };
        let h = h * (1.0 / h.length()) * if h.z < 0.0 { -1.0 } else { 1.0 };
        let possible = match self.eta {
            None => true,
            Some(_) => self.wo.dot(h) * wi.dot(h) < 0.0,
        };
        let [c, s] = self.turn;
        possible.then(|| vec3(c * h.x + s * h.y, c * h.y - s * h.x, h.z))
    }

    /// The direction of a half vector along the axes, and the change of solid angle with it.
    fn direction(&self, h: Vec3<f64>) -> Option<(Vec3<f64>, f64)> {
        let [c, s] = self.turn;
        let h = vec3(c * h.x - s * h.y, s * h.x + c * h.y, h.z);
        let m = if self.wo.dot(h) < 0.0 { h * -1.0 } else { h };
        let cos = self.wo.dot(m);
        match self.eta {
            None => Some((m * (2.0 * cos) - self.wo, 4.0 * cos)),
            Some(eta) => {
                let squared = 1.0 - (1.0 - cos * cos) / (eta * eta);
                if squared <= 0.0 {
                    return None;
                }
                let inner = squared.sqrt();
                let wi = m * (cos / eta - inner) - self.wo * (1.0 / eta);
                let root = cos - eta * inner;
                Some((wi, root * root / (eta * eta * inner)))
            }
        }
    }

    fn cell(&self, d: Vec3<f64>) -> Option<usize> {
        let h = self.half(d)?;
        let along = |x: f64, k: usize, cells: usize| {
            let a = (x / self.scales[k]).asinh() / (END[k] / self.scales[k]).asinh();
            ((0.5 * (a + 1.0) * cells as f64) as usize).min(cells - 1)
        };
        Some(along(h.x.atan2(h.z), 0, RINGS) * SECTORS + along(h.y, 1, SECTORS))
    }

    /// The half vector at coordinates, with the solid angle per unit of them.
    fn place(&self, a: f64, b: f64) -> (Vec3<f64>, f64) {
        let along = |a: f64, k: usize, cells: usize| {
            let range = (END[k] / self.scales[k]).asinh();
            let t = (2.0 * a / cells as f64 - 1.0) * range;
            (self.scales[k] * t.sinh(), self.scales[k] * t.cosh() * range * 2.0 / cells as f64)
        };
        let ((angle, along_angle), (y, along_y)) = (along(a, 0, RINGS), along(b, 1, SECTORS));
        let r = (1.0 - y * y).max(0.0).sqrt();
        (vec3(r * angle.sin(), y, r * angle.cos()), along_angle * along_y)
    }

    /// Whether there is a direction at coordinates.
    fn shows(&self, a: f64, b: f64) -> bool {
        let (h, _) = self.place(a, b);
        self.direction(h).is_some_and(|(d, _)| d.z * self.side > 0.0)
    }

    fn density(&self, a: f64, b: f64, pdf: &impl Fn(Vec3<f64>) -> f64) -> f64 {
        let (h, solid_angle) = self.place(a, b);
        match self.direction(h) {
            Some((d, change)) if d.z * self.side > 0.0 => pdf(d) * change * solid_angle,
            _ => 0.0,
        }
    }

    fn cut(&self, at: [f64; 2], size: f64) -> Cut {
        let shown = (0..16).filter(|k| {
            let [x, y] = [k % 4, k / 4].map(|i| f64::from(i) / 3.0 * size);
            self.shows(at[0] + x, at[1] + y)
        });
        match shown.count() {
            // Large squares may hide a corner of the domain.
            0 if size < 0.3 => Cut::Empty,
            16 => Cut::Whole(FORCED[0]),
            _ => Cut::Ends,
        }
    }
}

/// The grids of both sides of the surface.
#[derive(Debug)]
pub(super) struct Grid(Vec<Chart>);

impl Grid {
    /// As fine as the lobes that pilot samples with their densities show. Directions whose distance has `1 - cos` below
    /// `blur` are not told apart.
    pub(super) fn new(pilots: &[(Vec3<f64>, f64)], wo: Vec3<f64>, lines: Option<Lines>, blur: f64) -> Self {
        let chart = |side: f64| {
            pilots.iter().any(|p| p.0.z * side > 0.0).then_some(())?;
            match lines {
                None => Rings::new(side, pilots, blur).map(Chart::Rings),
                Some(lines) => Halves::new(side, pilots, wo, lines, blur).map(Chart::Halves),
            }
        };
        Self([1.0, -1.0].into_iter().filter_map(chart).collect())
    }

    pub(super) fn cells(&self) -> usize {
        self.0.len() * CELLS
    }

    /// `None` for directions that no chart shows.
    pub(super) fn cell(&self, d: Vec3<f64>) -> Option<usize> {
        let i = self.0.iter().position(|c| c.side() * d.z > 0.0)?;
        Some(i * CELLS + self.0[i].cell(d)?)
    }

    /// Probabilities of the cells.
    pub(super) fn probabilities(&self, pdf: &impl Fn(Vec3<f64>) -> f64) -> Vec<f64> {
        let of = |chart: &Chart| {
            let mut all: Vec<f64> = (0..CELLS).map(|i| chart.probability(i, pdf)).collect();
            // Cells that are one.
            for i in 0..chart.joined() {
                all[0] += if i > 0 { std::mem::take(&mut all[i]) } else { 0.0 };
            }
            all
        };
        self.0.iter().flat_map(of).collect()
    }
}
