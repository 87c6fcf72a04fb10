//! Quadric error forms in three dimensions (Garland and Heckbert 1997).

use glam::DVec3;

/// The form `x'Ax + 2 b'x + c` with the area it stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Quadric {
    /// `A`: xx, yy, zz, xy, xz, yz.
    pub(super) a: [f64; 6],
    pub(super) b: DVec3,
    pub(super) c: f64,
    /// Weight of the surface behind it; `eval / weight` is a mean squared distance.
    pub(super) weight: f64,
}

impl Quadric {
    /// `weight * (g.x + d)^2`.
    #[inline]
    pub(super) fn linear(g: DVec3, d: f64, weight: f64) -> Self {
        let w = g * weight;
        Self {
            a: [w.x * g.x, w.y * g.y, w.z * g.z, w.x * g.y, w.x * g.z, w.y * g.z],
            b: w * d,
            c: weight * d * d,
            weight: 0.0,
        }
    }

    /// `weight * |x - p|^2`.
    #[inline]
    pub(super) fn point(p: DVec3, weight: f64) -> Self {
        Self {
            a: [weight, weight, weight, 0.0, 0.0, 0.0],
            b: p * -weight,
            c: weight * p.length_squared(),
            weight: 0.0,
        }
    }

    #[inline]
    pub(super) fn add(&mut self, o: &Self) {
        for (a, b) in self.a.iter_mut().zip(o.a) {
            *a += b;
        }
        self.b += o.b;
        self.c += o.c;
        self.weight += o.weight;
    }

    #[inline]
    pub(super) fn sub(&mut self, o: &Self) {
        for (a, b) in self.a.iter_mut().zip(o.a) {
            *a -= b;
        }
        self.b -= o.b;
        self.c -= o.c;
        self.weight -= o.weight;
    }

    /// The form times a factor.
    #[inline]
    pub(super) fn scaled(&self, f: f64) -> Self {
        Self { a: self.a.map(|x| x * f), b: self.b * f, c: self.c * f, weight: self.weight * f }
    }

    #[inline]
    fn apply(&self, x: DVec3) -> DVec3 {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        DVec3::new(
            xx * x.x + xy * x.y + xz * x.z,
            xy * x.x + yy * x.y + yz * x.z,
            xz * x.x + yz * x.y + zz * x.z,
        )
    }

    /// Value at `x`, never below zero.
    #[inline]
    pub(super) fn eval(&self, x: DVec3) -> f64 {
        (x.dot(self.apply(x) + 2.0 * self.b) + self.c).max(0.0)
    }

    /// Minimiser of the form, held at `m` in the directions that it does not determine.
    ///
    /// A Tikhonov term of `1e-5` of the mean eigenvalue around `m` acts as a smooth pseudo-inverse. `None` where the
    /// form is zero or the solution is not finite.
    pub(super) fn minimise(&self, m: DVec3) -> Option<DVec3> {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        let trace = xx + yy + zz;
        let mu = trace * (1e-5 / 3.0);
        if mu <= 0.0 || mu.is_nan() {
            return None;
        }
        let r = -(self.apply(m) + self.b);
        // Cholesky of A + mu I.
        let l00 = (xx + mu).sqrt();
        let (l10, l20) = (xy / l00, xz / l00);
        let d1 = yy + mu - l10 * l10;
        if d1 <= 0.0 || d1.is_nan() {
            return None;
        }
        let l11 = d1.sqrt();
        let l21 = (yz - l20 * l10) / l11;
        let d2 = zz + mu - l20 * l20 - l21 * l21;
        if d2 <= 0.0 || d2.is_nan() {
            return None;
        }
        let l22 = d2.sqrt();
        let y0 = r.x / l00;
        let y1 = (r.y - l10 * y0) / l11;
        let y2 = (r.z - l20 * y0 - l21 * y1) / l22;
        let z = y2 / l22;
        let y = (y1 - l21 * z) / l11;
        let x = (y0 - l10 * y - l20 * z) / l00;
        let p = m + DVec3::new(x, y, z);
        p.is_finite().then_some(p)
    }

    /// Parameter in `[0, 1]` of the smallest value on the segment from `u` to `v`; `None` where it is constant.
    pub(super) fn minimise_on(&self, u: DVec3, v: DVec3) -> Option<f64> {
        let d = v - u;
        let curvature = d.dot(self.apply(d));
        let t = -d.dot(self.apply(u) + self.b) / curvature;
        (curvature > 0.0 && t.is_finite()).then(|| t.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minimum_of_three_planes_is_their_point() {
        let p = DVec3::new(0.3, -0.2, 0.9);
        let mut q = Quadric::default();
        for n in [DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::new(0.0, 0.6, -0.8)] {
            q.add(&Quadric::linear(n, -n.dot(p), 2.0));
        }
        let x = q.minimise(p + DVec3::splat(0.1)).expect("regular");
        assert!((x - p).length() < 1e-4, "{x}");
        assert!(q.eval(p) < 1e-15);
        assert!((q.eval(p + DVec3::X) - 2.0 * (1.0 + 0.36)).abs() < 1e-12);
    }

    #[test]
    fn undetermined_directions_stay_at_the_start() {
        let q = Quadric::linear(DVec3::Z, -1.0, 1.0);
        let x = q.minimise(DVec3::new(4.0, 5.0, 0.0)).expect("a plane");
        assert!((x - DVec3::new(4.0, 5.0, 1.0)).length() < 1e-4, "{x}");
        assert_eq!(Quadric::default().minimise(DVec3::ZERO), None);
    }

    #[test]
    fn segment_minimum_is_clamped() {
        let q = Quadric::point(DVec3::new(0.25, 1.0, 0.0), 1.0);
        assert_eq!(q.minimise_on(DVec3::ZERO, DVec3::X), Some(0.25));
        assert_eq!(q.minimise_on(DVec3::X, DVec3::X * 2.0), Some(0.0));
        assert_eq!(Quadric::default().minimise_on(DVec3::ZERO, DVec3::X), None);
    }
}
