//! Plane maps of charts: as-rigid-as-possible, then symmetric Dirichlet relaxation where the bound asks for it.
//!
//! Liu et al., "A local/global approach to mesh parameterization" (2008); Smith and Schaefer, "Bijective
//! parameterization with free boundaries" (2015) for the energy; Garanzha et al., "Foldover-free maps in 50 lines of
//! code" (2021) for the regularised determinant that repairs flips.

use super::chart::{Chart, singular};
use super::linear::{Factor, Symmetric};
use super::overlap::is_injective;
use super::topology::{Topology, frame, positive};
use photofit_scalar::{Vec2, Vec3, vec2};

/// Projects the chart along its mean normal.
pub(super) fn project(chart: &mut Chart, topo: &Topology) {
    let mean = chart.triangles.iter().fold(Vec3::zero(), |s, &t| s + topo.normal[t as usize] * topo.area(t));
    let (x, y) = frame(mean);
    for i in 0..chart.triangles.len() {
        for k in 0..3 {
            let p = topo.corner(chart.triangles[i], k);
            chart.uv[chart.corners[i][k] as usize] = vec2(p.dot(x), p.dot(y));
        }
    }
}

/// Improves the plane map that the chart brings along until it is injective and within `bound`; false when it
/// cannot be.
pub(super) fn flatten(chart: &mut Chart, topo: &Topology, bound: f64, rounds: usize) -> bool {
    if chart.border.is_empty() {
        return false;
    }
    chart.rescale();
    if chart.worst_stretch(topo) > 1.02 {
        if arap(chart, topo, rounds).is_none() {
            return false;
        }
        chart.rescale();
        let flips = chart.flips();
        if flips > 2 + chart.triangles.len() / 10 {
            return false;
        }
        if flips > 0 {
            untangle(chart, topo);
            chart.rescale();
            if chart.flips() > 0 {
                return false;
            }
        }
        let worst = chart.worst_stretch(topo);
        if worst > bound {
            if worst > 4.0 * bound {
                return false;
            }
            for power in [2, 4, 6] {
                relax(chart, topo, 4, power, 0.0);
                chart.rescale();
                if chart.worst_stretch(topo) <= bound {
                    break;
                }
            }
        }
    }
    chart.uv.iter().all(|p| p.is_finite()) && chart.worst_stretch(topo) <= bound && is_injective(chart)
}

/// Lowers the distortion of an accepted chart further; keeps the old map where the new one breaks a rule.
pub(super) fn polish(chart: &mut Chart, topo: &Topology, bound: f64) {
    if chart.worst_stretch(topo) <= 1.02 {
        return;
    }
    let before = (chart.uv.clone(), energy(chart, topo));
    let done = arap(chart, topo, 12).is_some();
    if done && chart.flips() == 0 {
        relax(chart, topo, 6, 1, 0.0);
        relax(chart, topo, 4, 3, 0.0);
    } else {
        chart.uv.clone_from(&before.0);
        relax(chart, topo, 10, 1, 0.0);
    }
    chart.rescale();
    let fine = chart.worst_stretch(topo) <= bound && energy(chart, topo) <= before.1 && is_injective(chart);
    if !fine {
        chart.uv = before.0;
    }
}

/// Area-weighted symmetric Dirichlet energy, 1 for an isometry.
fn energy(chart: &Chart, topo: &Topology) -> f64 {
    let mut sum = 0.0;
    for (i, &t) in chart.triangles.iter().enumerate() {
        let (s1, s2) = singular(chart.jacobian(topo, i));
        sum += topo.area(t) * 0.25 * (s1 * s1 + s2 * s2 + 1.0 / (s1 * s1) + 1.0 / (s2 * s2));
    }
    sum / chart.area
}

/// Local/global iterations of the as-rigid-as-possible energy `sum area |J - R|^2`.
fn arap(chart: &mut Chart, topo: &Topology, rounds: usize) -> Option<()> {
    let n = chart.uv.len();
    let mut diagonal = vec![0.0; n];
    let mut lower = Vec::with_capacity(chart.corners.len() * 3);
    for (c, &t) in chart.corners.iter().zip(&chart.triangles) {
        let (g, area) = (topo.rest[t as usize].gradients(), topo.area(t));
        for k in 0..3 {
            let (i, j) = (c[k], c[(k + 1) % 3]);
            diagonal[i as usize] += area * g[k].length_squared();
            lower.push((i.max(j), i.min(j), area * g[k].dot(g[(k + 1) % 3])));
        }
    }
    // A small shift fixes the free translation; the right-hand sides sum to zero, so it does not bend the map.
    let shift = 1e-8 * diagonal.iter().sum::<f64>() / n as f64;
    diagonal.iter_mut().for_each(|d| *d += shift);
    let factor = Factor::new(&Symmetric::new(diagonal, lower), &chart.uv)?;
    let mut work = Vec::new();
    let mut rhs = vec![Vec2::zero(); n];
    let mut last = f64::INFINITY;
    for _ in 0..rounds {
        rhs.fill(Vec2::zero());
        let mut sum = 0.0;
        for i in 0..chart.triangles.len() {
            let t = chart.triangles[i];
            let (g, area) = (topo.rest[t as usize].gradients(), topo.area(t));
            let (a, b) = chart.jacobian(topo, i);
            let r = vec2(a.x + b.y, a.y - b.x).normalize_or_zero();
            sum += area * ((a - r).length_squared() + (b - vec2(-r.y, r.x)).length_squared());
            for k in 0..3 {
                let v = &mut rhs[chart.corners[i][k] as usize];
                *v += (r * g[k].x + vec2(-r.y, r.x) * g[k].y) * area;
            }
        }
        if sum >= last * 0.98 || sum <= 1e-8 * chart.area {
            break;
        }
        last = sum;
        factor.solve(&mut rhs, &mut work);
        chart.uv.copy_from_slice(&rhs);
    }
    Some(())
}

/// Drives flipped triangles positive with the regularised energy, epsilon halving towards zero.
fn untangle(chart: &mut Chart, topo: &Topology) {
    let mut eps = 0.3;
    for _ in 0..12 {
        relax(chart, topo, 2, 1, eps);
        if chart.flips() == 0 {
            break;
        }
        eps *= 0.6;
    }
}

/// Gauss-Seidel Newton sweeps over the vertices on `sum area D^power`, `D` the symmetric Dirichlet energy over 4.
///
/// With `eps = 0` the energy is infinite for flipped triangles, so that a map without flips stays so; with
/// `eps > 0` the determinant `d` is replaced by `(d + sqrt(d^2 + eps^2)) / 2`.
fn relax(chart: &mut Chart, topo: &Topology, sweeps: usize, power: i32, eps: f64) {
    let n = chart.uv.len();
    let mut start = vec![0_u32; n + 1];
    for c in chart.corners.iter().flatten() {
        start[*c as usize + 1] += 1;
    }
    for i in 0..n {
        start[i + 1] += start[i];
    }
    let mut fill = start.clone();
    let mut incident = vec![(0_u32, 0_u32); chart.corners.len() * 3];
    for (i, c) in chart.corners.iter().enumerate() {
        for k in 0..3 {
            incident[fill[c[k] as usize] as usize] = (i as u32, k as u32);
            fill[c[k] as usize] += 1;
        }
    }
    for _ in 0..sweeps {
        for v in 0..n {
            let around = &incident[start[v] as usize..start[v + 1] as usize];
            relax_vertex(chart, topo, v, around, power, eps);
        }
    }
}

fn relax_vertex(chart: &mut Chart, topo: &Topology, v: usize, around: &[(u32, u32)], power: i32, eps: f64) {
    let old = chart.uv[v];
    let (mut e0, mut g) = (0.0, Vec2::<f64>::zero());
    let mut h = [0.0; 3];
    for &(i, k) in around {
        let t = chart.triangles[i as usize];
        let area = topo.area(t);
        let hat = topo.rest[t as usize].gradients()[k as usize];
        let (a, b) = chart.jacobian(topo, i as usize);
        let f = a.length_squared() + b.length_squared();
        let d = a.x * b.y - a.y * b.x;
        let root = (d * d + eps * eps).sqrt();
        let (x, dx) = if eps > 0.0 { (0.5 * (d + root), 0.5 * (1.0 + d / root)) } else { (d, 1.0) };
        if !positive(x) {
            return;
        }
        let df = (a * hat.x + b * hat.y) * 2.0;
        let dd = vec2(b.y * hat.x - a.y * hat.y, a.x * hat.y - b.x * hat.x) * dx;
        let (q, q2) = (1.0 / x, 1.0 / (x * x));
        let energy = 0.25 * f * (1.0 + q2);
        let gd = (df * (1.0 + q2) - dd * (2.0 * f * q2 * q)) * 0.25;
        let outer = area * f64::from(power) * energy.powi(power - 1);
        let second = if power > 1 { outer * f64::from(power - 1) / energy } else { 0.0 };
        e0 += area * energy.powi(power);
        g += gd * outer;
        let iso = 0.5 * (1.0 + q2) * hat.length_squared() * outer;
        let (cross, quad) = (-0.5 * q2 * q * outer, 1.5 * f * q2 * q2 * outer);
        h[0] += iso + 2.0 * cross * df.x * dd.x + quad * dd.x * dd.x + second * gd.x * gd.x;
        h[1] += cross * (df.x * dd.y + df.y * dd.x) + quad * dd.x * dd.y + second * gd.x * gd.y;
        h[2] += iso + 2.0 * cross * df.y * dd.y + quad * dd.y * dd.y + second * gd.y * gd.y;
    }
    let step = newton_step(h, g);
    if !step.is_finite() || step == Vec2::zero() {
        return;
    }
    let mut factor = 1.0;
    for _ in 0..6 {
        chart.uv[v] = old + step * factor;
        if ring_energy(chart, topo, around, power, eps) < e0 {
            return;
        }
        factor *= 0.5;
    }
    chart.uv[v] = old;
}

/// `-H^-1 g` with the eigenvalues of `H = [[h0, h1], [h1, h2]]` made positive.
fn newton_step(h: [f64; 3], g: Vec2<f64>) -> Vec2<f64> {
    let (mean, half) = (0.5 * (h[0] + h[2]), 0.5 * (h[0] - h[2]));
    let radius = half.hypot(h[1]);
    let least = mean - radius;
    let floor = 1e-3 * (mean.abs() + radius);
    let lift = if least < floor { floor - least } else { 0.0 };
    let (a, c) = (h[0] + lift, h[2] + lift);
    let det = a * c - h[1] * h[1];
    vec2(-(c * g.x - h[1] * g.y) / det, -(a * g.y - h[1] * g.x) / det)
}

fn ring_energy(chart: &Chart, topo: &Topology, around: &[(u32, u32)], power: i32, eps: f64) -> f64 {
    let mut sum = 0.0;
    for &(i, _) in around {
        let (a, b) = chart.jacobian(topo, i as usize);
        let f = a.length_squared() + b.length_squared();
        let d = a.x * b.y - a.y * b.x;
        let x = if eps > 0.0 { 0.5 * (d + (d * d + eps * eps).sqrt()) } else { d };
        if !positive(x) {
            return f64::INFINITY;
        }
        sum += topo.area(chart.triangles[i as usize]) * (0.25 * f * (1.0 + 1.0 / (x * x))).powi(power);
    }
    sum
}
