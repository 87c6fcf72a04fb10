//! Small vectors over [`Real`].

use crate::Real;
use std::ops::{Add, AddAssign, Div, Index, IndexMut, Mul, MulAssign, Neg, Sub, SubAssign};

macro_rules! vector {
    ($(#[$doc:meta])* $name:ident, $make:ident, $n:literal, $($f:ident $i:literal),+) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[repr(C)]
        pub struct $name<T> {
            $(#[doc = concat!("Component ", stringify!($f), ".")] pub $f: T,)+
        }

        #[doc = concat!("Makes a [`", stringify!($name), "`].")]
        #[inline(always)]
        pub const fn $make<T>($($f: T),+) -> $name<T> {
            $name { $($f),+ }
        }

        #[expect(unsafe_code, reason = "repr(C) struct of equal Pod fields has no padding")]
        // SAFETY: all-zero bytes are valid for T, and a struct of T fields is valid too.
        unsafe impl<T: Real> bytemuck::Zeroable for $name<T> {}
        #[expect(unsafe_code, reason = "repr(C) struct of equal Pod fields has no padding")]
        // SAFETY: repr(C), all fields of one Pod type, hence no padding and any bits are valid.
        unsafe impl<T: Real> bytemuck::Pod for $name<T> {}

        impl<T: Real> $name<T> {
            /// The zero vector.
            #[inline(always)]
            pub fn zero() -> Self {
                Self { $($f: T::zero()),+ }
            }
            /// All components equal to `x`.
            #[inline(always)]
            pub fn splat(x: T) -> Self {
                Self { $($f: x),+ }
            }
            /// Components as an array.
            #[inline(always)]
            pub fn to_array(self) -> [T; $n] {
                [$(self.$f),+]
            }
            /// From an array of components.
            #[inline(always)]
            pub fn from_array(a: [T; $n]) -> Self {
                Self { $($f: a[$i]),+ }
            }
            /// Converts the components to another scalar.
            #[inline(always)]
            pub fn cast<U: Real>(self) -> $name<U> {
                $name { $($f: U::of(self.$f.f64())),+ }
            }
            /// Applies `op` to each component.
            #[inline(always)]
            pub fn map(self, mut op: impl FnMut(T) -> T) -> Self {
                Self { $($f: op(self.$f)),+ }
            }
            /// Component-wise product.
            #[expect(clippy::should_implement_trait, reason = "`*` is left to scalars: a product of vectors has no one meaning")]
            #[inline(always)]
            pub fn mul(self, o: Self) -> Self {
                Self { $($f: self.$f * o.$f),+ }
            }
            /// Component-wise minimum.
            #[inline(always)]
            pub fn min(self, o: Self) -> Self {
                Self { $($f: self.$f.min(o.$f)),+ }
            }
            /// Component-wise maximum.
            #[inline(always)]
            pub fn max(self, o: Self) -> Self {
                Self { $($f: self.$f.max(o.$f)),+ }
            }
            /// Dot product.
            #[inline(always)]
            pub fn dot(self, o: Self) -> T {
                let mut s = T::zero();
                $(s += self.$f * o.$f;)+
                s
            }
            /// Squared Euclidean length.
            #[inline(always)]
            pub fn length_squared(self) -> T {
                self.dot(self)
            }
            /// Euclidean length.
            #[inline(always)]
            pub fn length(self) -> T {
                self.dot(self).sqrt()
            }
            /// Sum of the components.
            #[inline(always)]
            pub fn sum(self) -> T {
                let mut s = T::zero();
                $(s += self.$f;)+
                s
            }
            /// True when every component is finite.
            #[inline(always)]
            pub fn is_finite(self) -> bool {
                $(self.$f.is_finite())&&+
            }
            /// Unit vector of the same direction; the zero vector where the length is zero or not finite.
            #[inline(always)]
            pub fn normalize_or_zero(self) -> Self {
                let l = self.length();
                if l > T::min_positive_value() && l.is_finite() { self * (T::one() / l) } else { Self::zero() }
            }
            /// Adjoint of [`Self::normalize_or_zero`] at `self`: `(g - n (n.g)) / |self|`.
            #[inline(always)]
            pub fn normalize_vjp(self, g: Self) -> Self {
                let l = self.length();
                if !(l > T::min_positive_value() && l.is_finite()) {
                    return Self::zero();
                }
                let r = T::one() / l;
                let n = self * r;
                (g - n * n.dot(g)) * r
            }
        }

        impl<T: Real> Add for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn add(self, o: Self) -> Self {
                Self { $($f: self.$f + o.$f),+ }
            }
        }
        impl<T: Real> Sub for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, o: Self) -> Self {
                Self { $($f: self.$f - o.$f),+ }
            }
        }
        impl<T: Real> Neg for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self { $($f: -self.$f),+ }
            }
        }
        impl<T: Real> Mul<T> for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, s: T) -> Self {
                Self { $($f: self.$f * s),+ }
            }
        }
        impl<T: Real> Div<T> for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn div(self, s: T) -> Self {
                Self { $($f: self.$f / s),+ }
            }
        }
        impl<T: Real> AddAssign for $name<T> {
            #[inline(always)]
            fn add_assign(&mut self, o: Self) {
                $(self.$f += o.$f;)+
            }
        }
        impl<T: Real> SubAssign for $name<T> {
            #[inline(always)]
            fn sub_assign(&mut self, o: Self) {
                $(self.$f -= o.$f;)+
            }
        }
        impl<T: Real> MulAssign<T> for $name<T> {
            #[inline(always)]
            fn mul_assign(&mut self, s: T) {
                $(self.$f *= s;)+
            }
        }
        impl<T> Index<usize> for $name<T> {
            type Output = T;
            #[inline(always)]
            fn index(&self, i: usize) -> &T {
                [$(&self.$f),+][i]
            }
        }
        impl<T> IndexMut<usize> for $name<T> {
            #[inline(always)]
            fn index_mut(&mut self, i: usize) -> &mut T {
                let all: [&mut T; $n] = [$(&mut self.$f),+];
                all.into_iter().nth(i).expect("component index in range")
            }
        }
    };
}

vector!(
    /// Two components.
    Vec2, vec2, 2, x 0, y 1
);
vector!(
    /// Three components.
    Vec3, vec3, 3, x 0, y 1, z 2
);
vector!(
    /// Four components.
    Vec4, vec4, 4, x 0, y 1, z 2, w 3
);

impl<T: Real> Vec3<T> {
    /// Cross product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        vec3(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }
    /// Appends a fourth component.
    #[inline(always)]
    pub fn extend(self, w: T) -> Vec4<T> {
        vec4(self.x, self.y, self.z, w)
    }
    /// An orthonormal pair `(s, t)` with `s x t = self`, for a unit vector (Duff et al. 2017).
    #[inline(always)]
    pub fn orthonormal_pair(self) -> (Self, Self) {
        let sign = if self.z < T::zero() { -T::one() } else { T::one() };
        let a = -T::one() / (sign + self.z);
        let b = self.x * self.y * a;
        (
            vec3(T::one() + sign * self.x * self.x * a, sign * b, -sign * self.x),
            vec3(b, sign + self.y * self.y * a, -self.y),
        )
    }
}

impl<T: Real> Vec4<T> {
    /// The first three components.
    #[inline(always)]
    pub fn xyz(self) -> Vec3<T> {
        vec3(self.x, self.y, self.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalize_vjp_matches_central_differences() {
        let (v, g): (Vec3<f64>, _) = (vec3(0.3, -1.2, 0.7), vec3(0.5, 0.1, -0.9));
        let a = v.normalize_vjp(g);
        for k in 0..3 {
            let (mut p, mut m) = (v, v);
            p[k] += 1e-6;
            m[k] -= 1e-6;
            let d = (p.normalize_or_zero() - m.normalize_or_zero()).dot(g) / 2e-6;
            assert!((a[k] - d).abs() < 1e-8, "component {k}: {} against {d}", a[k]);
        }
    }

    #[test]
    fn orthonormal_pair_is_right_handed() {
        for n in [vec3(0.0, 0.0, 1.0_f64), vec3(0.0, 0.0, -1.0), vec3(0.6, -0.48, 0.64)] {
            let (s, t) = n.orthonormal_pair();
            assert!((s.cross(t) - n).length() < 1e-12, "{n:?}");
            assert!(s.dot(t).abs() < 1e-12, "{n:?}");
        }
    }

    #[test]
    fn zero_length_normalizes_to_zero() {
        assert_eq!(Vec3::<f32>::zero().normalize_or_zero(), Vec3::zero());
        assert_eq!(vec3(f32::NAN, 0.0, 0.0).normalize_or_zero(), Vec3::zero());
    }
}
