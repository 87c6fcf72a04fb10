//! Skins and morph targets as glTF defines them: where the vertices of a mesh stand in a pose, and the vector-Jacobian
//! product.
//!
//! `p_v = A_v (b_v + d_v)` and `n_v = unit(cof(A_v) (m_v + e_v))`, where `b` and `m` are the positions and unit normals of
//! the bind pose, `d` and `e` what the morph targets add ([`morph`]), `A_v` the mean of the joint matrices of the vertex
//! ([`blend`]; of a rigid node its own matrix) and `cof` the matrix of cofactors: the inverse transpose up to a positive
//! factor, which singular matrices have too. Every vertex is computed alone: the bits do not depend on threads. Matrices,
//! weights and targets are constants; a normal that a pose flattens passes no gradient.

use crate::angle::unit;
use photofit_scalar::{Real, Vec3, Vec3f};
use rayon::prelude::*;

/// Vertices handed to one thread at a time.
const GRAIN: usize = 1024;

/// An affine map `x -> axes x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine<T = f32> {
    /// Columns of the linear part: where the unit vectors go.
    pub axes: [Vec3<T>; 3],
    /// Where the origin goes.
    pub translation: Vec3<T>,
}

impl From<glam::Affine3A> for Affine {
    fn from(a: glam::Affine3A) -> Self {
        let column = |c: glam::Vec3A| Vec3::from_array(c.to_array());
        let m = a.matrix3;
        Self { axes: [m.x_axis, m.y_axis, m.z_axis].map(column), translation: column(a.translation) }
    }
}

impl<T: Real> Affine<T> {
    /// The map that moves nothing.
    pub fn identity() -> Self {
        let (l, o) = (T::one(), T::zero());
        let axes = [[l, o, o], [o, l, o], [o, o, l]].map(Vec3::from_array);
        Self { axes, translation: Vec3::zero() }
    }

    /// In another precision.
    #[must_use]
    pub fn cast<U: Real>(&self) -> Affine<U> {
        Affine { axes: self.axes.map(Vec3::cast), translation: self.translation.cast() }
    }

    /// Where a direction goes, with its length.
    #[inline(always)]
    pub fn direction(&self, d: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = self.axes;
        x * d.x + y * d.y + z * d.z
    }

    /// Where a point goes.
    #[inline(always)]
    pub fn point(&self, p: Vec3<T>) -> Vec3<T> {
        self.direction(p) + self.translation
    }

    /// The gradient of a point from that of where it goes: the transpose of [`Self::direction`].
    #[inline(always)]
    pub fn point_vjp(&self, g: Vec3<T>) -> Vec3<T> {
        Vec3::from_array(self.axes.map(|a| a.dot(g)))
    }

    /// First `self`, then `last`.
    #[must_use]
    pub fn then(&self, last: &Self) -> Self {
        Self { axes: self.axes.map(|a| last.direction(a)), translation: last.point(self.translation) }
    }

    /// The map that takes everything back, exact to rounding; `None` where the unit vectors span next to no volume
    /// (relative to their lengths), or are not finite.
    pub fn inverse(&self) -> Option<Self> {
        let [x, y, z] = self.axes;
        let volume = unit(x).cross(unit(y)).dot(unit(z));
        if !(volume.abs() > T::of(1e-4) && self.translation.is_finite()) {
            return None;
        }
        let rows = [y.cross(z), z.cross(x), x.cross(y)].map(|row| row / x.cross(y).dot(z));
        let axes: [Vec3<T>; 3] = std::array::from_fn(|k| Vec3::from_array(rows.map(|row| row[k])));
        let linear = Self { axes, translation: Vec3::zero() };
        let inverse = Self { translation: -linear.direction(self.translation), ..linear };
        (axes.iter().all(|a| a.is_finite()) && inverse.translation.is_finite()).then_some(inverse)
    }

    /// How normals go with it.
    #[inline(always)]
    pub fn normals(&self) -> NormalMap<T> {
        // Scaled to the order of one, so that products neither overflow nor vanish.
        let size = self.axes.iter().fold(T::zero(), |s, a| s.max(a.x.abs()).max(a.y.abs()).max(a.z.abs()));
        let s = if size > T::zero() && size.is_finite() { T::one() / size } else { T::one() };
        let [x, y, z] = self.axes.map(|a| a * s);
        let mirrored = x.cross(y).dot(z) < T::zero();
        let sign = if mirrored { -T::one() } else { T::one() };
        NormalMap { cofactors: [y.cross(z), z.cross(x), x.cross(y)].map(|c| c * sign), mirrored }
    }
}

/// How normals go with an [`Affine`]: by the inverse transpose, up to a positive factor.
#[derive(Clone, Copy, Debug)]
pub struct NormalMap<T = f32> {
    cofactors: [Vec3<T>; 3],
    /// The map turns handedness around.
    pub mirrored: bool,
}

impl<T: Real> NormalMap<T> {
    #[inline(always)]
    fn raw(&self, n: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = self.cofactors;
        x * n.x + y * n.y + z * n.z
    }

    /// The unit normal after the map; where it flattens everything that `n` is normal to, `n` itself, so that arithmetic
    /// stays finite.
    #[inline(always)]
    pub fn apply(&self, n: Vec3<T>) -> Vec3<T> {
        let unit = self.raw(n).normalize_or_zero();
        if unit == Vec3::zero() { n } else { unit }
    }

    /// The gradient of `n` from that of [`Self::apply`]; zero where the map flattens.
    #[inline(always)]
    pub fn apply_vjp(&self, n: Vec3<T>, g: Vec3<T>) -> Vec3<T> {
        let g = self.raw(n).normalize_vjp(g);
        Vec3::from_array(self.cofactors.map(|c| c.dot(g)))
    }
}

/// The mean of joint matrices, weighted by `influences`, pairs of joint and weight; a vertex without weights follows the
/// first joint, as in common viewers, and stays where it is where there is none.
///
/// # Panics
/// If a joint of a weight other than zero has no matrix.
pub fn blend(influences: impl Iterator<Item = (u32, f32)>, joints: &[Affine]) -> Affine {
    let nothing = Affine { axes: [Vec3::zero(); 3], translation: Vec3::zero() };
    let (mut sum, mut total) = (nothing, 0.0);
    for (j, w) in influences.filter(|(_, w)| *w != 0.0) {
        let joint = &joints[j as usize];
        sum.axes.iter_mut().zip(joint.axes).for_each(|(s, a)| *s += a * w);
        sum.translation += joint.translation * w;
        total += w;
    }
    if total == 0.0 {
        return joints.first().copied().unwrap_or_else(Affine::identity);
    }
    let scale = 1.0 / total;
    Affine { axes: sum.axes.map(|a| a * scale), translation: sum.translation * scale }
}

/// What morph targets add to each of `count` vertices, from the differences of each target (none: nothing) and its weight;
/// an empty list where nothing is added.
///
/// # Panics
/// If a target has another number of differences.
pub fn morph<'a>(count: usize, targets: impl Iterator<Item = (&'a [Vec3f], f32)>) -> Vec<Vec3f> {
    let mut sum = Vec::new();
    for (differences, weight) in targets.filter(|(d, w)| !d.is_empty() && *w != 0.0) {
        assert_eq!(differences.len(), count, "one difference per vertex");
        sum.resize(count, Vec3::zero());
        sum.iter_mut().zip(differences).for_each(|(s, d)| *s += *d * weight);
    }
    sum
}

/// A pose of a mesh: what happens to each of its vertices, one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deformation<T = f32> {
    /// Added to positions first, one per vertex; empty: nothing.
    pub positions: Vec<Vec3<T>>,
    /// Added to normals first, one per vertex; empty: nothing.
    pub normals: Vec<Vec3<T>>,
    /// Then the vertices move, one map per vertex; empty: they stay.
    pub moves: Vec<Affine<T>>,
}

impl<T: Real> Deformation<T> {
    /// Positions after it.
    ///
    /// # Panics
    /// If there is not one for each vertex.
    pub fn positions(&self, positions: &[Vec3<T>]) -> Vec<Vec3<T>> {
        self.check(positions.len());
        let of = |(v, p): (usize, &Vec3<T>)| {
            let p = self.positions.get(v).map_or(*p, |d| *p + *d);
            self.moves.get(v).map_or(p, |m| m.point(p))
        };
        positions.par_iter().enumerate().with_min_len(GRAIN).map(of).collect()
    }

    /// Adjoint of [`Self::positions`]: adds to `g` the gradient of `sum_v d[v] . positions[v]`.
    ///
    /// # Panics
    /// If there is not one for each vertex.
    pub fn positions_vjp(&self, d: &[Vec3<T>], g: &mut [Vec3<T>]) {
        assert_eq!(d.len(), g.len(), "one gradient per vertex");
        self.check(d.len());
        let of = |(v, (g, d)): (usize, (&mut Vec3<T>, &Vec3<T>))| {
            *g += self.moves.get(v).map_or(*d, |m| m.point_vjp(*d));
        };
        g.par_iter_mut().zip(d).enumerate().with_min_len(GRAIN).for_each(of);
    }

    /// Unit normals after it, from those before it; where it flattens one, that.
    ///
    /// # Panics
    /// If there is not one for each vertex.
    pub fn normals(&self, normals: &[Vec3<T>]) -> Vec<Vec3<T>> {
        self.check(normals.len());
        let of = |(v, before): (usize, &Vec3<T>)| {
            let n = self.normals.get(v).map_or(*before, |d| *before + *d);
            let n = self.moves.get(v).map_or(n, |m| m.normals().apply(n)).normalize_or_zero();
            if n == Vec3::zero() { *before } else { n }
        };
        normals.par_iter().enumerate().with_min_len(GRAIN).map(of).collect()
    }

    /// Adjoint of [`Self::normals`]: adds to `g` the gradient of `sum_v d[v] . normals[v]`, zero where one is flattened.
    ///
    /// # Panics
    /// If there is not one for each vertex.
    pub fn normals_vjp(&self, normals: &[Vec3<T>], d: &[Vec3<T>], g: &mut [Vec3<T>]) {
        assert!([d.len(), g.len()] == [normals.len(); 2], "one gradient per vertex");
        self.check(d.len());
        let of = |v: usize, g: &mut Vec3<T>, before: &Vec3<T>, d: &Vec3<T>| {
            let n = self.normals.get(v).map_or(*before, |e| *before + *e);
            *g += self.moves.get(v).map_or_else(|| n.normalize_vjp(*d), |m| m.normals().apply_vjp(n, *d));
        };
        let all = g.par_iter_mut().zip(normals.par_iter().zip(d)).enumerate().with_min_len(GRAIN);
        all.for_each(|(v, (g, (before, d)))| of(v, g, before, d));
    }

    fn check(&self, count: usize) {
        let fits = |n: usize| n == 0 || n == count;
        let lengths = [self.positions.len(), self.normals.len(), self.moves.len()];
        assert!(lengths.into_iter().all(fits), "one of each per vertex: {lengths:?} of {count}");
    }
}

#[cfg(test)]
mod tests;
