//! Size and slenderness of connected components.

use super::clean::Soup;
use super::components::components;
use glam::DVec3;
use nalgebra::{Matrix3, Vector3};

/// What a component weighs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Part {
    /// Live triangles.
    pub(super) live: usize,
    /// Weighted area of the input.
    pub(super) area: f64,
    /// Twice the second largest variance of its surface: the squared distance to its axis.
    pub(super) extent2: f64,
    /// Whether its removal is in the queue.
    pub(super) queued: bool,
    /// Whether it has a vertex that stays, and must not be removed.
    pub(super) held: bool,
}

/// Triangles of each component, in compressed rows.
#[derive(Debug, Default)]
pub(super) struct Members {
    start: Vec<u32>,
    triangles: Vec<u32>,
}

impl Members {
    pub(super) fn new(part: &[u32], count: usize) -> Self {
        let mut start = vec![0_u32; count + 1];
        for &c in part {
            start[c as usize + 1] += 1;
        }
        for c in 0..count {
            start[c + 1] += start[c];
        }
        let mut fill = start.clone();
        let mut triangles = vec![0; part.len()];
        for (t, &c) in part.iter().enumerate() {
            triangles[fill[c as usize] as usize] = t as u32;
            fill[c as usize] += 1;
        }
        Self { start, triangles }
    }

    pub(super) fn of(&self, c: u32) -> &[u32] {
        &self.triangles[self.start[c as usize] as usize..self.start[c as usize + 1] as usize]
    }
}

fn points(soup: &Soup, t: usize) -> [DVec3; 3] {
    soup.triangles[t].map(|i| soup.positions[i as usize])
}

fn cross(p: [DVec3; 3]) -> DVec3 {
    (p[1] - p[0]).cross(p[2] - p[0])
}

/// Component of each triangle and the components; multiplies the weights of slender ones.
///
/// A component of surface `A` and integrated mean curvature `M` (signed, an open border counts as a half turn) is as
/// thick as `A / (2 M)`: the radius of a tube however it is bent. The length of the silhouette per area goes with the
/// inverse of it. `edges` are those of [`super::topology::Topology::edges`].
pub(super) fn parts(
    soup: &Soup,
    edges: &[(u64, u32)],
    weight: &mut [f64],
    thin_power: f64,
) -> (Vec<u32>, Vec<Part>) {
    let (label, count) = components(&soup.triangles, soup.positions.len());
    let mut parts = vec![Part::default(); count];
    let mut area = vec![0.0; count];
    let mut mean = vec![DVec3::ZERO; count];
    for k in 0..soup.triangles.len() {
        let p = points(soup, k);
        let (a, c) = (0.5 * cross(p).length(), label[k] as usize);
        area[c] += a;
        mean[c] += (p[0] + p[1] + p[2]) * (a / 3.0);
        parts[c].live += 1;
    }
    for (m, a) in mean.iter_mut().zip(&area) {
        *m /= a.max(f64::MIN_POSITIVE);
    }
    let mut moments = vec![Matrix3::<f64>::zeros(); count];
    for k in 0..soup.triangles.len() {
        let p = points(soup, k);
        let c = label[k] as usize;
        // Exact second moment of a triangle: area / 12 (sum of v v' + 9 m m') with m the centroid.
        let d = p.map(|x| x - mean[c]);
        let w = 0.5 * cross(p).length() / 12.0;
        for x in [d[0], d[1], d[2], d[0] + d[1] + d[2]] {
            let x = Vector3::new(x.x, x.y, x.z);
            moments[c] += x * x.transpose() * w;
        }
    }
    let bend = curvature(soup, edges, &label, count);
    let mut thickness = vec![0.0; count];
    for c in 0..count {
        let m = moments[c] / area[c].max(f64::MIN_POSITIVE);
        let mut e = m.symmetric_eigenvalues().as_slice().to_vec();
        e.sort_by(f64::total_cmp);
        parts[c].extent2 = (2.0 * e[1]).max(0.0);
        thickness[c] = parts[c].extent2.sqrt().min(area[c] / (2.0 * bend[c].abs()).max(f64::MIN_POSITIVE));
    }
    let thick = thickness.iter().fold(0.0, |a: f64, t| a.max(*t));
    for k in 0..soup.triangles.len() {
        let c = label[k] as usize;
        if thick > 0.0 {
            // A factor above 1000 would only drown everything else.
            weight[k] *= (thick / thickness[c].max(1e-3 * thick)).powf(thin_power).min(1e3);
        }
        parts[c].area += 0.5 * cross(points(soup, k)).length() * weight[k];
    }
    (label, parts)
}

/// Integrated mean curvature of each component: half the sum of edge length times turning angle.
fn curvature(soup: &Soup, edges: &[(u64, u32)], label: &[u32], count: usize) -> Vec<f64> {
    let mut bend = vec![0.0; count];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let (u, v) = ((run[0].0 >> 32) as u32, run[0].0 as u32);
        let length = soup.positions[u as usize].distance(soup.positions[v as usize]);
        let s = run[0].1 as usize;
        let turn = match run {
            [_] => std::f64::consts::PI,
            [_, (_, t)] => {
                let t = *t as usize;
                let (n, m) = (cross(points(soup, s)), cross(points(soup, t)));
                let far = soup.triangles[t].iter().find(|&&x| x != u && x != v).map_or(u, |&x| x);
                let rise = (soup.positions[far as usize] - soup.positions[u as usize]).dot(n);
                n.cross(m).length().atan2(n.dot(m)) * -rise.signum()
            }
            _ => 0.0,
        };
        bend[label[s] as usize] += 0.5 * length * turn;
    }
    bend
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decimate::topology::Topology;

    /// A soup of straight or bent square tubes as `(centre line, radius)`.
    fn soup(lines: &[(Vec<DVec3>, f64)]) -> Soup {
        let mut soup = Soup {
            centre: DVec3::ZERO,
            diagonal: 1.0,
            positions: Vec::new(),
            origin: Vec::new(),
            locked: Vec::new(),
            triangles: Vec::new(),
            source: Vec::new(),
            cleaned: 0,
        };
        for (line, radius) in lines {
            let base = soup.positions.len() as u32;
            for (k, p) in line.iter().enumerate() {
                let ahead = line[(k + 1).min(line.len() - 1)] - line[k.saturating_sub(1)];
                let side = ahead.cross(DVec3::Z).normalize();
                let offsets = [side, DVec3::Z, -side, -DVec3::Z];
                soup.positions.extend(offsets.map(|o| *p + o * *radius));
            }
            for k in 0..line.len() as u32 - 1 {
                for s in 0..4 {
                    let (a, b) = (base + 4 * k + s, base + 4 * k + (s + 1) % 4);
                    soup.triangles.extend([[a, a + 4, b + 4], [a, b + 4, b]]);
                }
            }
        }
        soup.source = (0..soup.triangles.len() as u32).collect();
        soup
    }

    #[test]
    fn bent_and_straight_tubes_are_equally_thick() {
        let straight: Vec<DVec3> = (0..=64).map(|k| DVec3::X * (f64::from(k) / 64.0 * 3.0)).collect();
        let bent: Vec<DVec3> =
            (0..=64).map(|k| f64::from(k) / 64.0 * 3.0).map(|a| DVec3::new(a.cos(), a.sin(), 5.0)).collect();
        let fat: Vec<DVec3> = straight.iter().map(|p| *p + DVec3::Y * 9.0).collect();
        let soup = soup(&[(straight, 0.01), (bent, 0.01), (fat, 0.5)]);
        let edges = Topology::new(soup.triangles.clone(), soup.positions.len()).edges();
        let mut weight = vec![1.0; soup.triangles.len()];
        let (label, parts) = parts(&soup, &edges, &mut weight, 1.0);
        assert_eq!(parts.len(), 3);
        let of = |c: u32| weight[label.iter().position(|l| *l == c).expect("has triangles")];
        assert!((of(0) / of(1) - 1.0).abs() < 0.1, "{} against {}", of(0), of(1));
        assert!(of(0) > 20.0 * of(2), "{} against {}", of(0), of(2));
        assert!((of(2) - 1.0).abs() < 1e-9, "the thickest counts once");
    }
}
