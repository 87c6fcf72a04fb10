//! Flat emitters: triangles and parallelograms, sampled by area with the density bent towards what the receiver gets.

use photofit_sampling::{Bilinear, uniform_triangle};
use photofit_scalar::Vec3f;

/// Who asks for light: a point, and how it weighs directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// The point.
    pub(crate) p: Vec3f,
    /// How light counts by its direction.
    pub(crate) facing: Facing,
}

/// How light counts at a receiver by the direction that it comes from. What counts as nothing is never sampled.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Facing {
    /// The same from everywhere.
    Around,
    /// By the cosine to this normal, nothing from behind.
    Front(Vec3f),
    /// By the cosine to this normal, on both sides.
    Both(Vec3f),
}

impl Receiver {
    /// A point that weighs all directions the same.
    pub(crate) fn point(p: Vec3f) -> Self {
        Self { p, facing: Facing::Around }
    }
}

/// A flat piece of a surface in the render frame: the image of the unit square, everywhere stretched the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    corner: Vec3f,
    edges: [Vec3f; 2],
    /// Unit normal of the front.
    pub(crate) ng: Vec3f,
    pub(crate) area: f32,
    /// Bound on the rounding of its points.
    pub(crate) rounding: f32,
    /// The half of the parallelogram next to the corner alone.
    pub(crate) triangle: bool,
}

impl Patch {
    /// A triangle, or the parallelogram that it is half of.
    pub(crate) fn new([a, b, c]: [Vec3f; 3], triangle: bool, ng: Vec3f, rounding: f32) -> Self {
        let edges = [b - a, c - a];
        let whole = edges.map(Vec3f::cast::<f64>);
        let area = whole[0].cross(whole[1]).length() * if triangle { 0.5 } else { 1.0 };
        Self { corner: a, edges, ng, area: area as f32, rounding, triangle }
    }

    /// Whether a point sees the back.
    #[inline(always)]
    pub(crate) fn is_behind(&self, p: Vec3f) -> bool {
        (p - self.corner).dot(self.ng) < -self.rounding
    }

    /// The point for a point of the unit square.
    #[inline(always)]
    pub(crate) fn point(&self, at: [f32; 2]) -> Vec3f {
        let [u, v] = if self.triangle {
            let [_, u, v] = uniform_triangle(at);
            [u, v]
        } else {
            at
        };
        self.corner + self.edges[0] * u + self.edges[1] * v
    }

    /// Inverse of [`Self::point`], for points of the patch.
    fn square(&self, p: Vec3f) -> [f32; 2] {
        // In double precision, which the fourth power of a length does not leave.
        let [e, f] = self.edges.map(Vec3f::cast::<f64>);
        let (v, n) = ((p - self.corner).cast::<f64>(), e.cross(f));
        let per = 1.0 / n.length_squared();
        let inside = |x: f64| (x * per).clamp(0.0, 1.0) as f32;
        let [u, v] = [inside(v.cross(f).dot(n)), inside(e.cross(v).dot(n))];
        if !self.triangle {
            return [u, v];
        }
        let rest = (1.0 - u - v).max(0.0);
        if rest < u { [2.0 * rest, rest + u] } else { [rest + u, (2.0 * u).min(1.0)] }
    }

    /// The density over the unit square for a receiver: bilinear between what it gets from the corners, which is the
    /// cosine at the receiver over the fourth power of the distance (one over the square, times the distance in the
    /// cosine at the light; the distance from the plane is the same for all). `None` where no light is received.
    #[inline(always)]
    fn density(&self, from: &Receiver) -> Option<Bilinear> {
        let v = self.corner - from.p;
        let [e, f] = self.edges;
        let corners =
            if self.triangle { [v + f, v, v + e, v + e * 0.5] } else { [v, v + e, v + f, v + e + f] };
        // By component, for vectors of four numbers.
        let each = |f: fn(Vec3f) -> f32| [f(corners[0]), f(corners[1]), f(corners[2]), f(corners[3])];
        let (x, y, z) = (each(|c| c.x), each(|c| c.y), each(|c| c.z));
        let mut square = [0.0; 4];
        for i in 0..4 {
            square[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
        }
        let mut weights = [0.0; 4];
        match from.facing {
            Facing::Around => {
                for i in 0..4 {
                    weights[i] = square[i].sqrt();
                }
            }
            Facing::Front(n) => {
                for i in 0..4 {
                    weights[i] = (x[i] * n.x + y[i] * n.y + z[i] * n.z).max(0.0);
                }
            }
            Facing::Both(n) => {
                for i in 0..4 {
                    weights[i] = (x[i] * n.x + y[i] * n.y + z[i] * n.z).abs();
                }
            }
        }
        // In proportion to a distance, so that powers stay in range.
        let near = square[0].min(square[3]);
        for i in 0..4 {
            let share = near / square[i];
            weights[i] *= share * share;
        }
        // The patch lies behind the receiver, or too near for these numbers.
        let behind = matches!(from.facing, Facing::Front(_)) && weights == [0.0; 4];
        if behind { None } else { Bilinear::new(weights).or_else(|| Bilinear::new([1.0; 4])) }
    }

    /// The point for `u` in `[0, 1)^2` and the density per area there.
    #[inline(always)]
    pub(crate) fn sample(&self, from: &Receiver, u: [f32; 2]) -> Option<(Vec3f, f32)> {
        let density = self.density(from)?;
        let at = density.sample(u);
        Some((self.point(at), density.pdf(at) / self.area))
    }

    /// Density per area with which [`Self::sample`] finds a point of the patch.
    pub(crate) fn pdf(&self, from: &Receiver, p: Vec3f) -> f32 {
        self.density(from).map_or(0.0, |density| density.pdf(self.square(p)) / self.area)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn points_are_found_again() {
        let corners = [vec3(0.5, 1.0, -2.0), vec3(1.5, 1.25, -2.0), vec3(0.25, 1.0, 1.0)];
        for triangle in [false, true] {
            let patch = Patch::new(corners, triangle, vec3(0.0, 1.0, 0.0), 1e-6);
            for i in 0..100 {
                let at = [(i % 10) as f32 / 9.0, (i / 10) as f32 / 9.0];
                let found = patch.square(patch.point(at));
                let off = (found[0] - at[0]).abs().max((found[1] - at[1]).abs());
                assert!(off < 2e-6, "{at:?} {found:?}");
            }
        }
    }

    #[test]
    fn densities_hold_at_any_scale() {
        for scale in [1e-15, 1e-8, 1.0, 1e8, 1e15] {
            let corners =
                [vec3(0.5, 1.0, -2.0), vec3(1.5, 1.25, -2.0), vec3(0.25, 1.0, 1.0)].map(|c| c * scale);
            let patch = Patch::new(corners, false, vec3(0.0, 1.0, 0.0), 0.0);
            for facing in [Facing::Around, Facing::Front(vec3(0.0, 1.0, 0.0))] {
                let from = Receiver { p: vec3(0.1, 0.2, 0.3) * scale, facing };
                let (at, density) = patch.sample(&from, [0.3, 0.6]).unwrap();
                let one = density * patch.area;
                assert!((0.2..5.0).contains(&one), "{scale}: {one}");
                let again = patch.pdf(&from, at) * patch.area;
                assert!((one - again).abs() < 1e-5 * one, "{scale}: {one} {again}");
                // At a corner all directions are as good as any.
                let touching = Receiver { p: corners[0], facing };
                assert!(patch.sample(&touching, [0.3, 0.6]).is_some_and(|(_, d)| d.is_finite()));
            }
        }
    }
}
