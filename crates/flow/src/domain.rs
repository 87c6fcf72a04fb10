//! Maps between the unit square, on which flows live, and directions.
//!
//! Directions are those of a frame whose z is the normal on the viewer's side. A map has a density per solid angle of its
//! own, that of uniform points; the density of a flow through it is the product of both.

use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};
use std::f32::consts::{PI, TAU};

/// Which quantity the square stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Domain {
    /// Directions above the surface; uniform points follow the cosine.
    #[default]
    Hemisphere,
    /// All directions; uniform points are uniform.
    Sphere,
    /// Half vectors by their angles, `phi_h = 2 pi x_0` and `theta_h = (pi / 2) x_1`. Those that face away from the
    /// viewer have no direction, and directions below the surface are possible.
    HalfVector,
    /// The primary-sample space of visible GGX normals (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
    /// Spherical Caps"): uniform points are that distribution itself.
    Visible,
}

/// The smallest width of GGX that [`Domain::Visible`] works with.
const ALPHA_MIN: f32 = 1e-3;

/// The normal around which frames of other normals turn: that of ceilings, where y is up.
const SINGULAR: Vec3f = vec3(0.0, -1.0, 0.0);
/// An axis across it.
const ACROSS: Vec3f = vec3(1.0, 0.0, 0.0);
/// 1 less the cosine to the singular normal, below which frames do not turn around it: 11 degrees, within which normal maps
/// bend ceilings.
const CAP: f32 = 0.02;

/// The frame of a vertex and what maps need of it.
#[derive(Clone, Copy, Debug)]
pub struct Chart {
    domain: Domain,
    axes: [Vec3f; 3],
    /// Towards the viewer, in the frame.
    wo: Vec3f,
    alpha: f32,
}

impl Chart {
    /// The chart of a vertex; `alpha` is the width of GGX.
    ///
    /// The frame turns with the normal alone for [`Domain::Hemisphere`], not at all for [`Domain::Sphere`], and has the
    /// viewer in its xz plane for the others: densities then change continuously with the normal, but for the hemisphere across
    /// a ring of 11 degrees around straight down and for the others where the viewer looks along the normal.
    #[inline]
    pub fn new(domain: Domain, normal: Vec3f, wo: Vec3f, alpha: f32) -> Self {
        let facing = if normal.dot(wo) < 0.0 { -normal } else { normal };
        // Fallback for zero normals.
        let n = if facing.length_squared() > 0.5 { facing } else { vec3(0.0, 0.0, 1.0) };
        let axes = match domain {
            Domain::Sphere => [vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0)],
            Domain::Hemisphere => with_pair(n),
            Domain::HalfVector | Domain::Visible => {
                let s = wo - n * n.dot(wo);
                if s.length_squared() > 1e-8 {
                    let s = s.normalize_or_zero();
                    [s, n.cross(s), n]
                } else {
                    with_pair(n)
                }
            }
        };
        let wo = vec3(axes[0].dot(wo), axes[1].dot(wo), axes[2].dot(wo)).normalize_or_zero();
        Self { domain, axes, wo, alpha: alpha.max(ALPHA_MIN) }
    }

    /// Towards the viewer, in the frame.
    pub fn wo(&self) -> Vec3f {
        self.wo
    }

    /// A direction of the frame in that of the world.
    #[inline]
    fn to_world(self, v: Vec3f) -> Vec3f {
        (self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z).normalize_or_zero()
    }

    /// The direction of a point of the square and the density of uniform points there, 1/sr.
    #[inline]
    pub fn direction(&self, x: [f32; 2]) -> Option<(Vec3f, f32)> {
        let (s, c) = (TAU * x[0]).sin_cos();
        let ring = |r: f32, z: f32| vec3(r * c, r * s, z);
        let (wi, density) = match self.domain {
            Domain::Hemisphere => {
                let z = (1.0 - x[1]).max(0.0).sqrt();
                (ring(x[1].max(0.0).sqrt(), z), z / PI)
            }
            Domain::Sphere => {
                let z = 1.0 - 2.0 * x[1];
                (ring((1.0 - z * z).max(0.0).sqrt(), z), 0.5 / TAU)
            }
            Domain::HalfVector => {
                let (sin, cos) = (0.5 * PI * x[1]).sin_cos();
                let half = ring(sin, cos);
                (self.reflect(half)?, half_vector_density(self.wo.dot(half), sin))
            }
            Domain::Visible => {
                let v = self.stretched();
                let z = (1.0 - x[1]) * (1.0 + v.z) - v.z;
                let h = ring((1.0 - z * z).max(0.0).sqrt(), z) + v;
                let half = vec3(self.alpha * h.x, self.alpha * h.y, h.z).normalize_or_zero();
                (self.reflect(half)?, self.visible_density(half))
            }
        };
        (density > 0.0 && density.is_finite()).then(|| (self.to_world(wi), density))
    }

    /// The point of the square of a direction and the density of uniform points there; `None` for directions that
    /// [`Self::direction`] does not make.
    #[inline]
    pub fn point(&self, wi: Vec3f) -> Option<([f32; 2], f32)> {
        let wi = vec3(self.axes[0].dot(wi), self.axes[1].dot(wi), self.axes[2].dot(wi));
        let (around, height, density) = match self.domain {
            Domain::Hemisphere if wi.z <= 0.0 => return None,
            Domain::Hemisphere => (vec2(wi.x, wi.y), wi.x * wi.x + wi.y * wi.y, wi.z / PI),
            Domain::Sphere => (vec2(wi.x, wi.y), 0.5 - 0.5 * wi.z, 0.5 / TAU),
            Domain::HalfVector | Domain::Visible => self.half_point(wi + self.wo)?,
        };
        let turn = around.y.atan2(around.x) / TAU;
        let x = [if turn < 0.0 { turn + 1.0 } else { turn }, height];
        (density > 0.0 && density.is_finite()).then(|| (x.map(|v| v.clamp(0.0, 1.0)), density))
    }

    /// The angles or the cap of a half vector from the sum of both directions, which is `2 (V.H) H`: its length keeps the
    /// digits of a small `V.H` that a scalar product loses.
    #[inline]
    fn half_point(&self, sum: Vec3f) -> Option<(Vec2f, f32, f32)> {
        let cosine = 0.5 * sum.length();
        if sum.z < 0.0 || cosine <= 1e-7 {
            return None;
        }
        let half = sum * (0.5 / cosine);
        if self.domain == Domain::HalfVector {
            let sin = (half.x * half.x + half.y * half.y).sqrt();
            let theta = sin.atan2(half.z);
            return Some((vec2(half.x, half.y), theta / (0.5 * PI), half_vector_density(cosine, sin)));
        }
        let v = self.stretched();
        let h = vec3(half.x / self.alpha, half.y / self.alpha, half.z).normalize_or_zero();
        let c = h * (2.0 * v.dot(h)) - v;
        Some((vec2(c.x, c.y), 1.0 - (c.z + v.z) / (1.0 + v.z), self.visible_density(half)))
    }

    /// The direction that a half vector mirrors the viewer into, if it faces the viewer.
    #[inline]
    fn reflect(&self, half: Vec3f) -> Option<Vec3f> {
        let cosine = self.wo.dot(half);
        (cosine > 0.0).then(|| half * (2.0 * cosine) - self.wo)
    }

    /// The viewer where the surface is a unit sphere.
    #[inline]
    fn stretched(&self) -> Vec3f {
        vec3(self.alpha * self.wo.x, self.alpha * self.wo.y, self.wo.z.max(0.0)).normalize_or_zero()
    }

    /// `G_1 D / (4 cos theta_o)`.
    #[inline]
    fn visible_density(&self, half: Vec3f) -> f32 {
        let (a2, cosine) = (self.alpha * self.alpha, self.wo.z);
        let slope = (half.x * half.x + half.y * half.y) / a2 + half.z * half.z;
        let d = 1.0 / (PI * a2 * slope * slope);
        let root = (cosine * cosine + a2 * (1.0 - cosine * cosine)).sqrt();
        // G_1 = 2 cos / (cos + root).
        d / (2.0 * (cosine.max(0.0) + root))
    }
}

/// `1 / (4 (V.H))` of the reflection, over `(pi / 2) 2 pi sin theta_h` of the angles.
#[inline]
fn half_vector_density(cosine: f32, sin: f32) -> f32 {
    1.0 / (4.0 * PI * PI * cosine * sin.max(1e-7))
}

/// A frame for a normal: those of neighbouring normals are near each other, but across a ring around [`SINGULAR`]. (A frame whose
/// sign depends on that of a coordinate turns over within walls.)
fn with_pair(n: Vec3f) -> [Vec3f; 3] {
    let sum = n - SINGULAR;
    // 1 less the cosine to the singular normal, without cancellation.
    let below = 0.5 * sum.length_squared();
    // The axis of the opposite direction, turned along the great circle to the normal.
    let s = if below < CAP { ACROSS } else { ACROSS - sum * (ACROSS.dot(n) / below) };
    let s = (s - n * s.dot(n)).normalize_or_zero();
    [s, n.cross(s), n]
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    const DOMAINS: [Domain; 4] = [Domain::Hemisphere, Domain::Sphere, Domain::HalfVector, Domain::Visible];

    fn charts(domain: Domain) -> impl Iterator<Item = Chart> {
        [(0.05, 0.4), (0.7, 0.1), (1.2, 0.7), (1.5, 0.3)].into_iter().map(
            move |(theta, alpha): (f32, f32)| {
                let n = vec3(0.36, -0.48, 0.8);
                let (s, _) = n.orthonormal_pair();
                Chart::new(domain, n, n * theta.cos() + s * theta.sin(), alpha)
            },
        )
    }

    #[test]
    fn frames_change_continuously_with_the_normal() {
        let mut rng = Rng::new(4, 0);
        for domain in DOMAINS {
            let mut reached = [0; 4];
            for i in 0..4000 {
                let mut unit = || photofit_sampling::uniform_sphere([rng.next_f32(), rng.next_f32()]);
                // Among others normals around walls along axes, floors and ceilings.
                let n: Vec3f = match i % 4 {
                    0 => vec3(1.0, 0.0, 0.0),
                    1 => vec3(0.0, 0.0, -1.0),
                    2 => vec3(0.0, 1.0, 0.0),
                    _ => unit(),
                };
                let (turned, wo): (Vec3f, Vec3f) = ((n + unit() * 1e-3).normalize_or_zero(), unit());
                let on_ring = (n.dot(SINGULAR).abs() - (1.0 - CAP)).abs() < 0.005;
                if n.dot(wo).abs() < 0.1 || n.cross(wo).length() < 0.1 || on_ring {
                    continue;
                }
                reached[i % 4] += 1;
                let [a, b] = [n, turned].map(|n| Chart::new(domain, n, wo, 0.5).axes);
                for k in 0..3 {
                    assert!((a[k] - b[k]).length() < 0.05, "{domain:?}, {n:?}: {a:?} and {b:?}");
                }
                assert!((a[0].cross(a[1]) - a[2]).length() < 1e-5, "{domain:?}, {n:?}: {a:?}");
            }
            assert!(reached.iter().all(|n| *n > 500), "{reached:?}");
        }
    }

    #[test]
    fn frames_around_the_singular_normal_are_orthonormal() {
        for angle in [0.0, 1e-6, 1e-3, 0.1, 0.19, 0.2, 0.201, 0.21, 0.4] {
            for turn in 0..8 {
                let (s, c) = (TAU * turn as f32 / 8.0).sin_cos();
                let sine = f32::sin(angle);
                let n = vec3(sine * c, -f32::cos(angle), sine * s).normalize_or_zero();
                let [s, t, _] = with_pair(n);
                assert!((s.cross(t) - n).length() < 1e-5 && s.dot(t).abs() < 1e-5, "{angle}: {s:?} {t:?}");
                assert!(
                    angle > 0.2 || (s - ACROSS).length() < 0.21,
                    "within the cap it hardly turns: {angle}, {s:?}"
                );
                assert!(s.dot(n).abs() < 1e-5 && t.dot(n).abs() < 1e-5, "{angle}: {s:?} {t:?}");
            }
        }
    }

    #[test]
    fn points_and_directions_are_round_trips() {
        for domain in DOMAINS {
            for chart in charts(domain) {
                let mut rng = Rng::new(1, 0);
                for _ in 0..2000 {
                    let x = [rng.uniform(0.01, 0.99), rng.uniform(0.01, 0.99)];
                    let Some((wi, density)) = chart.direction(x) else { continue };
                    assert!((wi.length() - 1.0).abs() < 1e-5);
                    let Some((back, again)) = chart.point(wi) else { panic!("{domain:?}: {x:?} is lost") };
                    // Near grazing half vectors and poles digits of x are lost, not those of wi.
                    let (there, _) = chart.direction(back).unwrap();
                    assert!((there - wi).length() < 2e-3, "{domain:?}: {wi:?} {there:?}");
                    assert!((again / density - 1.0).abs() < 2e-2, "{domain:?}: {density} {again}");
                }
            }
        }
    }

    /// Integral of the density over the sphere by a fine grid of directions, and the share of points without one.
    fn mass(chart: &Chart, factor: f32) -> (f64, f64) {
        let (rows, columns) = (1200, 1200);
        let mut sum = 0.0;
        for i in 0..rows {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / rows as f32;
            let r = (1.0 - z * z).sqrt();
            for j in 0..columns {
                let (s, c) = (TAU * (j as f32 + 0.5) / columns as f32).sin_cos();
                sum += f64::from(chart.point(vec3(r * c, r * s, z)).map_or(0.0, |p| p.1 * factor));
            }
        }
        let n = 1000;
        let lost = (0..n * n).filter(|i| {
            let x = [((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32];
            chart.direction(x).is_none()
        });
        (sum * f64::from(2.0 * TAU) / f64::from(rows * columns), lost.count() as f64 / f64::from(n * n))
    }

    #[test]
    fn densities_integrate_to_one_and_without_half_pi_they_do_not() {
        for domain in DOMAINS {
            for chart in charts(domain).take(3) {
                let (sum, lost) = mass(&chart, 1.0);
                // The density of half vectors has a pole, which a grid integrates less well.
                let allowed = if domain == Domain::HalfVector { 5e-3 } else { 2e-3 };
                assert!((sum + lost - 1.0).abs() < allowed, "{domain:?}: {sum} + {lost}");
                if domain == Domain::HalfVector {
                    // The defect: theta_h = (pi / 2) x without its factor in the density.
                    let (wrong, _) = mass(&chart, 0.5 * PI);
                    assert!((wrong + lost - 1.0).abs() > 0.1, "the negative control passes: {wrong}");
                }
            }
        }
    }

    #[test]
    fn half_vectors_that_face_away_have_no_direction() {
        let n = vec3(0.0, 0.0, 1.0);
        let chart = Chart::new(Domain::HalfVector, n, vec3(1.2_f32.sin(), 0.0, 1.2_f32.cos()), 0.5);
        assert!(chart.direction([0.5, 0.9]).is_none(), "V.H is negative");
        assert!(chart.direction([0.0, 0.5]).is_some());
    }
}
