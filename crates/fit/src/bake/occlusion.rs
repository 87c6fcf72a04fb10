//! Ambient occlusion of places of the reference, by rays.

use super::reference::{ReferenceSurface, SurfacePoint};
use photofit_rays::Ray;
use photofit_sampling::{Sobol, cosine_hemisphere};
use photofit_scene::AlphaMode;

/// Where the occlusion of a texel comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Occlusion {
    /// The reference's occlusion maps.
    #[default]
    Maps,
    /// Rays against the reference's surface.
    Rays(OcclusionRays),
    /// Nothing is occluded.
    None,
}

impl Occlusion {
    /// What users call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Maps => "keep",
            Self::Rays(_) => "bake",
            Self::None => "none",
        }
    }
}

/// Ambient occlusion by rays.
///
/// The share of indirect light that reaches a place is `1 - 1/pi int_H w(t(d)) cos(n, d) dd` over the hemisphere of its smooth
/// normal, where `t` is the distance to the first surface and `w(t) = max(0, 1 - t / reach)`: what is far away darkens less, so that
/// the inside of a room is not black. Directions have the density `cos / pi`. Both sides of a surface block rays, cut parts of alpha
/// masks and blended surfaces do not. The normal map is left out, as it would count twice in a renderer that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcclusionRays {
    /// Rays of a texel at least, shared out among its samples, 1 to 65536.
    pub rays: usize,
    /// Distance from which on surfaces occlude nothing, in diagonals of the reference's box.
    pub reach: f32,
}

impl Default for OcclusionRays {
    /// 64 rays, half of the diagonal.
    fn default() -> Self {
        Self { rays: 64, reach: 0.5 }
    }
}

impl OcclusionRays {
    /// Rays for each of so many samples of a texel.
    fn per_sample(&self, samples: usize) -> usize {
        self.rays.div_ceil(samples.max(1))
    }

    /// Share of indirect light that reaches a side of a place, in [0, 1]: the mean over the rays of sample `number` of `samples`
    /// of a texel with the points `sequence`.
    pub(super) fn open_share(
        &self,
        reference: &ReferenceSurface<'_>,
        place: &SurfacePoint,
        front: bool,
        sequence: &Sobol,
        (number, samples): (usize, usize),
    ) -> f32 {
        let [a, b, c] = reference.mesh().corners(place.triangle as usize);
        let face = (b - a).cross(c - a).normalize_or_zero();
        let side = if front { 1.0 } else { -1.0 };
        let (face, normal) = (face * side, reference.smooth_normal(place) * side);
        let (s, t) = normal.orthonormal_pair();
        let at = a + (b - a) * place.u + (c - a) * place.v;
        // Above the rounding of the point, and above surfaces that lie on this one.
        let size = at.to_array().into_iter().fold(0.0, |m: f32, x| m.max(x.abs()));
        let lift = (1e-5 * reference.diagonal()).max(4.0 * f32::EPSILON * size);
        let origin = at + face * lift;
        let reach = self.reach * reference.diagonal();
        let rays = self.per_sample(samples);
        let mut blocked = 0.0;
        for k in 0..rays {
            let d = cosine_hemisphere(sequence.point((number * rays + k) as u32, 0).pair());
            let d = s * d.x + t * d.y + normal * d.z;
            // Smooth normals lean away from their face: what would go into it leaves on the other side of it.
            let into = d.dot(face).min(0.0);
            let ray = Ray::new(origin, d - face * (2.0 * into)).within(0.0, reach);
            if let Some(hit) = first_surface(reference, place.triangle, &ray) {
                blocked += 1.0 - hit / reach;
            }
        }
        (1.0 - blocked / rays as f32).clamp(0.0, 1.0)
    }
}

/// Distance to the first surface that stops light.
fn first_surface(reference: &ReferenceSurface<'_>, from: u32, ray: &Ray) -> Option<f32> {
    let stops = |hit: &photofit_rays::Hit| {
        hit.triangle != from
            && match reference.material(hit.triangle).alpha_mode {
                AlphaMode::Opaque => true,
                AlphaMode::Mask { .. } => !reference.is_cut(&hit.into()),
                AlphaMode::Blend => false,
            }
    };
    reference.accel().closest_hit_where(ray, stops).map(|hit| hit.t)
}
