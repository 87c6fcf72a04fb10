//! Warps from the unit square to spheres, hemispheres, disks and triangles, each with its density.
//!
//! Directions are unit vectors with the pole at `+z`; densities are per solid angle (1/sr) or per area.

use photofit_scalar::{Real, Vec2, Vec3, vec2, vec3};

const PI: f64 = std::f64::consts::PI;

/// Uniform direction on the unit sphere from `u` in `[0, 1)^2`.
#[inline]
pub fn uniform_sphere<T: Real>(u: [T; 2]) -> Vec3<T> {
    let z = T::one() - T::of(2.0) * u[0];
    around_pole(z, u[1])
}

/// Density of [`uniform_sphere`]: `1 / (4 pi)`.
#[inline]
pub fn uniform_sphere_pdf<T: Real>() -> T {
    T::of(0.25 / PI)
}

/// Uniform direction with `z >= 0` from `u` in `[0, 1)^2`.
#[inline]
pub fn uniform_hemisphere<T: Real>(u: [T; 2]) -> Vec3<T> {
    around_pole(T::one() - u[0], u[1])
}

/// Density of [`uniform_hemisphere`] above the horizon: `1 / (2 pi)`.
#[inline]
pub fn uniform_hemisphere_pdf<T: Real>() -> T {
    T::of(0.5 / PI)
}

/// Direction with `z >= 0` and density proportional to `z`: a disk point lifted to the hemisphere (Malley).
#[inline]
pub fn cosine_hemisphere<T: Real>(u: [T; 2]) -> Vec3<T> {
    let d = concentric_disk(u);
    let z = (T::one() - d.x * d.x - d.y * d.y).relu().sqrt();
    vec3(d.x, d.y, z)
}

/// Density of [`cosine_hemisphere`]: `cos_theta / pi`, 0 below the horizon.
#[inline]
pub fn cosine_hemisphere_pdf<T: Real>(cos_theta: T) -> T {
    cos_theta.relu() * T::of(1.0 / PI)
}

/// Uniform point of the unit disk; squares around the centre become circles (Shirley and Chiu 1997).
#[inline]
pub fn concentric_disk<T: Real>(u: [T; 2]) -> Vec2<T> {
    let (a, b) = (T::of(2.0) * u[0] - T::one(), T::of(2.0) * u[1] - T::one());
    if a == T::zero() && b == T::zero() {
        return vec2(T::zero(), T::zero());
    }
    // The angle to the nearer axis, at most an eighth of a turn.
    let quarter = T::of(PI / 4.0);
    if a.abs() > b.abs() {
        let (sin, cos) = sin_cos_of_eighth(quarter * (b / a));
        vec2(a * cos, a * sin)
    } else {
        let (sin, cos) = sin_cos_of_eighth(quarter * (a / b));
        vec2(b * sin, b * cos)
    }
}

/// Sine and cosine of an angle in `[-pi / 4, pi / 4]`, by as many terms of their series as the type has digits: the same on
/// every platform.
#[inline(always)]
fn sin_cos_of_eighth<T: Real>(x: T) -> (T, T) {
    /// `(-1)^k / (2 k + 1)!` and `(-1)^k / (2 k)!`.
    const TERMS: [[f64; 2]; 9] = [
        [1.0, 1.0],
        [-1.0 / 6.0, -1.0 / 2.0],
        [1.0 / 120.0, 1.0 / 24.0],
        [-1.0 / 5_040.0, -1.0 / 720.0],
        [1.0 / 362_880.0, 1.0 / 40_320.0],
        [-1.0 / 39_916_800.0, -1.0 / 3_628_800.0],
        [1.0 / 6_227_020_800.0, 1.0 / 479_001_600.0],
        [-1.0 / 1_307_674_368_000.0, -1.0 / 87_178_291_200.0],
        [1.0 / 355_687_428_096_000.0, 1.0 / 20_922_789_888_000.0],
    ];
    let terms = if size_of::<T>() == 4 { &TERMS[..5] } else { &TERMS[..] };
    let square = x * x;
    let series =
        |which: usize| terms.iter().rev().fold(T::zero(), |sum, term| sum * square + T::of(term[which]));
    (x * series(0), series(1))
}

/// Density of [`concentric_disk`] per area: `1 / pi`.
#[inline]
pub fn concentric_disk_pdf<T: Real>() -> T {
    T::of(1.0 / PI)
}

/// Barycentric coordinates `[b0, b1, b2]` of a uniform point of a triangle, by a map of low distortion (Heitz 2019).
#[inline]
pub fn uniform_triangle<T: Real>(u: [T; 2]) -> [T; 3] {
    let half = T::of(0.5);
    let (b0, b1) = if u[0] < u[1] {
        let b0 = u[0] * half;
        (b0, u[1] - b0)
    } else {
        let b1 = u[1] * half;
        (u[0] - b1, b1)
    };
    [b0, b1, (T::one() - b0 - b1).relu()]
}

/// Density of [`uniform_triangle`] per area: `1 / area`; 0 for a triangle without area.
#[inline]
pub fn uniform_triangle_pdf<T: Real>(area: T) -> T {
    if area > T::zero() { T::one() / area } else { T::zero() }
}

/// Direction `i` of `n` that cover the sphere evenly: a spiral that turns by the golden angle (Fibonacci lattice,
/// Gonzalez 2010).
///
/// # Panics
/// If `i >= n`.
pub fn fibonacci_sphere<T: Real>(i: usize, n: usize) -> Vec3<T> {
    assert!(i < n, "direction {i} of {n}");
    let z = 1.0 - (2 * i + 1) as f64 / n as f64;
    // The turn in double precision: its fraction would lose its digits for large `i`.
    let turn = i as f64 * 0.618_033_988_749_894_8;
    around_pole(T::of(z), T::of(turn - turn.floor()))
}

/// The direction of height `z` after `turn` of a full turn from the x axis.
#[inline]
fn around_pole<T: Real>(z: T, turn: T) -> Vec3<T> {
    let r = (T::one() - z * z).relu().sqrt();
    let (sin, cos) = (T::of(2.0 * PI) * turn).sin_cos();
    vec3(r * cos, r * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;
    use crate::statistics::{chi_square, chi_square_uniform};

    /// Counts 200k warped points in cells that `cell` names.
    fn histogram(cells: usize, stream: u64, mut cell: impl FnMut([f64; 2]) -> usize) -> Vec<u64> {
        let mut rng = Rng::new(17, stream);
        let mut counts = vec![0; cells];
        for _ in 0..200_000 {
            counts[cell([rng.next_f64(), rng.next_f64()])] += 1;
        }
        counts
    }

    /// Cell of a direction on a grid of 10 heights in `[bottom, 1]` and 12 sectors.
    fn direction_cell(d: Vec3<f64>, bottom: f64) -> usize {
        let height = ((d.z - bottom) / (1.0 - bottom) * 10.0) as usize;
        let sector = ((d.y.atan2(d.x) / (2.0 * PI) + 0.5) * 12.0) as usize;
        height.min(9) * 12 + sector.min(11)
    }

    /// Integral of `pdf` over the cells of [`direction_cell`] by the midpoint rule.
    fn cell_probabilities(bottom: f64, pdf: impl Fn(f64) -> f64) -> Vec<f64> {
        let steps = 64;
        let height = (1.0 - bottom) / 10.0;
        let band = |i: usize| {
            let z = |k: usize| bottom + (i as f64 + (k as f64 + 0.5) / f64::from(steps as u32)) * height;
            (0..steps).map(|k| pdf(z(k))).sum::<f64>() * height / f64::from(steps as u32) * 2.0 * PI / 12.0
        };
        (0..120).map(|i| band(i / 12)).collect()
    }

    #[test]
    fn directions_follow_their_densities() {
        let sphere = histogram(120, 0, |u| direction_cell(uniform_sphere(u), -1.0));
        chi_square("sphere", &sphere, &cell_probabilities(-1.0, |_| uniform_sphere_pdf()));
        let hemisphere = histogram(120, 1, |u| direction_cell(uniform_hemisphere(u), 0.0));
        chi_square("hemisphere", &hemisphere, &cell_probabilities(0.0, |_| uniform_hemisphere_pdf()));
        let cosine = histogram(120, 2, |u| direction_cell(cosine_hemisphere(u), 0.0));
        chi_square("cosine hemisphere", &cosine, &cell_probabilities(0.0, cosine_hemisphere_pdf));
    }

    #[test]
    fn disk_points_are_uniform() {
        let counts = histogram(96, 3, |u| {
            let d = concentric_disk(u);
            let ring = ((d.x * d.x + d.y * d.y) * 8.0) as usize;
            let sector = ((d.y.atan2(d.x) / (2.0 * PI) + 0.5) * 12.0) as usize;
            ring.min(7) * 12 + sector.min(11)
        });
        chi_square_uniform("disk", &counts);
        assert!((concentric_disk_pdf::<f64>() * PI - 1.0).abs() < 1e-12);
    }

    #[test]
    fn triangle_points_are_uniform_and_inside() {
        // Four similar parts of the triangle, each cut in four again, have equal areas.
        let part = |b: [f64; 3]| match b.iter().position(|b| *b > 0.5) {
            Some(i) => (i, std::array::from_fn(|k| if k == i { 2.0 * b[k] - 1.0 } else { 2.0 * b[k] })),
            None => (3, std::array::from_fn(|k| 1.0 - 2.0 * b[k])),
        };
        let counts = histogram(16, 4, |u| {
            let b = uniform_triangle(u);
            assert!(b.iter().all(|b| *b >= 0.0) && (b.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let (first, inner) = part(b);
            first * 4 + part(inner).0
        });
        chi_square_uniform("triangle", &counts);
        assert_eq!((uniform_triangle_pdf(0.25), uniform_triangle_pdf(0.0)), (4.0, 0.0));
    }

    #[test]
    fn the_corners_of_the_square_stay_on_the_shapes() {
        let below_one = 1.0 - f32::EPSILON / 2.0;
        for u in [[0.0, 0.0], [0.0, below_one], [below_one, 0.0], [below_one; 2], [0.5, 0.5], [0.5, 0.0]] {
            for d in [uniform_sphere(u), uniform_hemisphere(u), cosine_hemisphere(u)] {
                assert!((d.length() - 1.0).abs() < 1e-6, "{u:?}");
            }
            assert!(uniform_hemisphere(u).z >= 0.0 && cosine_hemisphere(u).z >= 0.0);
            let d = concentric_disk(u);
            assert!(d.x * d.x + d.y * d.y <= 1.0 + 1e-6, "{u:?}");
            assert!(uniform_triangle(u).iter().all(|b| (0.0..=1.0).contains(b)), "{u:?}");
        }
    }

    #[test]
    fn sines_of_an_eighth_are_those_of_the_platform() {
        for i in -1000..=1000 {
            let x = f64::from(i) * (PI / 4.0 / 1000.0);
            let (sin, cos) = sin_cos_of_eighth(x);
            assert!((sin - x.sin()).abs() < 2e-16 && (cos - x.cos()).abs() < 3e-16, "{x}");
            let (sin, cos) = sin_cos_of_eighth(x as f32);
            let (s, c) = f64::from(x as f32).sin_cos();
            assert!((f64::from(sin) - s).abs() < 8e-8 && (f64::from(cos) - c).abs() < 1.2e-7, "{x}");
        }
    }

    #[test]
    fn fibonacci_directions_cover_the_sphere_evenly() {
        let n = 500;
        let directions: Vec<Vec3<f64>> = (0..n).map(|i| fibonacci_sphere(i, n)).collect();
        let mut mean = vec3(0.0, 0.0, 0.0);
        for (i, d) in directions.iter().enumerate() {
            assert!((d.length() - 1.0).abs() < 1e-12);
            mean += *d;
            let others = directions.iter().enumerate().filter(|(j, _)| *j != i);
            let nearest = others.map(|(_, o)| (*o - *d).length()).fold(f64::INFINITY, f64::min);
            // The best packing has 3.81 / sqrt(n) at most; this lattice keeps 3.09 but near the poles.
            assert!(nearest * (n as f64).sqrt() > 2.5, "direction {i} has a neighbour at {nearest}");
        }
        assert!(mean.length() / (n as f64) < 1e-3, "balanced");
        assert_eq!(fibonacci_sphere::<f32>(0, 1).z, 0.0);
    }
}
