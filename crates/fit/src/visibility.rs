//! How visible each triangle of an asset is from outside.
//!
//! Rays leave points of a triangle in cosine-weighted directions; the share that reaches the sky is the triangle's
//! accessibility (unoccluded form factor to a far surrounding sphere). Triangles that no ray leaves can be removed or
//! simplified freely, and are not a source for baking.

use crate::bake::ReferenceSurface;
use crate::bake::reference::SurfacePoint;
use photofit_rays::Ray;
use photofit_sampling::SplitMix64;
use photofit_scalar::Vec3f;
use photofit_scene::AlphaMode;
use photofit_shading::Sides;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Triangles between two reports.
const CHUNK: usize = 64;

/// How many rays [`visibility`] spends, and what occludes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilitySettings {
    /// Rays of the first pass over all triangles, shared out by area. The second pass, over triangles that the first
    /// found hidden, spends at most as many again.
    pub rays: usize,
    /// Least rays for each side of a triangle in the first pass (fewer where `rays` would be exceeded).
    pub min_rays: usize,
    /// Most rays for each side of a triangle in the first pass.
    pub max_rays: usize,
    /// Rays of the second pass for each hidden side; it ends at the first ray that gets out.
    pub retry_rays: usize,
    /// Single-sided triangles are not drawn from behind ([`Sides`]) and occlude nothing there.
    pub cull_back_faces: bool,
}

impl Default for VisibilitySettings {
    fn default() -> Self {
        Self { rays: 6_000_000, min_rays: 24, max_rays: 256, retry_rays: 192, cull_back_faces: true }
    }
}

/// Accessibility of the triangles of an asset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Share of the cosine-weighted sky over the counter-clockwise side that is not occluded, in [0, 1].
    pub front: Vec<f32>,
    /// The same for the other side; zero for single-sided materials where back faces are culled.
    pub back: Vec<f32>,
}

impl Visibility {
    /// Every side of `triangles` triangles is visible.
    pub fn everything(triangles: usize) -> Self {
        Self { front: vec![1.0; triangles], back: vec![1.0; triangles] }
    }

    /// Accessibility of the better side of a triangle, in [0, 1].
    pub fn importance(&self, triangle: usize) -> f32 {
        self.front[triangle].max(self.back[triangle])
    }

    /// True when some ray got out of either side.
    pub fn is_visible(&self, triangle: usize) -> bool {
        self.importance(triangle) > 0.0
    }

    /// True when some ray got out of the given side.
    #[inline]
    pub fn is_side_visible(&self, triangle: usize, front: bool) -> bool {
        (if front { self.front[triangle] } else { self.back[triangle] }) > 0.0
    }

    /// Number of triangles that no ray left.
    pub fn hidden(&self) -> usize {
        (0..self.front.len()).filter(|&t| !self.is_visible(t)).count()
    }
}

/// Measures the accessibility of all triangles of a reference.
///
/// Surfaces that an alpha mask cuts out occlude nothing and are not visible themselves; blended surfaces occlude
/// nothing. Degenerate triangles are not visible. Deterministic for any number of threads.
pub fn visibility(reference: &ReferenceSurface<'_>, settings: &VisibilitySettings) -> Visibility {
    visibility_reporting(reference, settings, &|_| ControlFlow::Continue(())).unwrap_or_default()
}

/// As [`visibility`]; `report` hears the finished share in `[0, 1]` from several threads, in no particular order, and
/// may end the work: then there is no result.
pub fn visibility_reporting(
    reference: &ReferenceSurface<'_>,
    settings: &VisibilitySettings,
    report: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Visibility> {
    let n = reference.mesh().triangles.len();
    let areas: Vec<f32> = (0..n as u32).into_par_iter().map(|t| reference.area_normal(t).length()).collect();
    let total: f64 = areas.iter().map(|&a| f64::from(a)).sum();
    let sides = |t: u32| if two_sided(reference, t, settings) { 2 } else { 1 };
    let all_sides: usize = (0..n as u32).map(sides).sum();
    let least = settings.min_rays.min(settings.rays / all_sides.max(1)).max(1);
    let most = settings.max_rays.max(least);
    let mut out = Visibility { front: vec![0.0; n], back: vec![0.0; n] };
    let (done, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let chunks = n.div_ceil(CHUNK).max(1) as f32;
    let pass = |out: &mut Visibility, rays: &(dyn Fn(usize) -> usize + Sync), stop: bool| {
        out.front.par_chunks_mut(CHUNK).zip(out.back.par_chunks_mut(CHUNK)).enumerate().for_each(
            |(c, (front, back))| {
                // The second pass is short where little is hidden.
                let share = done.fetch_add(1, Ordering::Relaxed) as f32 / chunks;
                if stopped.load(Ordering::Relaxed) || report(share.min(1.0)).is_break() {
                    stopped.store(true, Ordering::Relaxed);
                    return;
                }
                for (i, (f, b)) in front.iter_mut().zip(back).enumerate() {
                    let t = c * CHUNK + i;
                    if areas[t] <= 0.0 || !areas[t].is_finite() || (stop && f.max(*b) > 0.0) {
                        continue;
                    }
                    let probe = Probe { reference, settings, triangle: t as u32, rays: rays(t), stop };
                    *f = probe.side(true);
                    if sides(t as u32) == 2 {
                        *b = probe.side(false);
                    }
                }
            },
        );
    };
    let by_area = |t: usize| {
        let share = f64::from(areas[t]) / total * settings.rays as f64;
        (share as usize).clamp(least, most)
    };
    pass(&mut out, &by_area, false);
    let hidden = out.hidden();
    if hidden > 0 {
        let retry = settings.retry_rays.min(settings.rays / (2 * hidden));
        pass(&mut out, &|_| retry, true);
    }
    (!stopped.into_inner()).then_some(out)
}

/// True when the back of a triangle is drawn.
fn two_sided(reference: &ReferenceSurface<'_>, triangle: u32, settings: &VisibilitySettings) -> bool {
    !settings.cull_back_faces || Sides::of(reference.material(triangle).double_sided).shows(false)
}

/// The rays of one triangle.
struct Probe<'a> {
    reference: &'a ReferenceSurface<'a>,
    settings: &'a VisibilitySettings,
    triangle: u32,
    rays: usize,
    /// End at the first ray that gets out.
    stop: bool,
}

impl Probe<'_> {
    /// Share of rays that get out of one side.
    fn side(&self, front: bool) -> f32 {
        let reference = self.reference;
        let [a, b, c] = reference.mesh().corners(self.triangle as usize);
        let up = (b - a).cross(c - a).normalize_or_zero();
        let up = if front { up } else { -up };
        let (s, t) = up.orthonormal_pair();
        // Above the rounding of the point, and above surfaces that lie on this one.
        let size = a.to_array().into_iter().fold(0.0, |m: f32, x| m.max(x.abs()));
        let lift = (1e-5 * reference.diagonal()).max(4.0 * f32::EPSILON * size);
        let start = (u64::from(self.triangle) << 2) | (u64::from(front) << 1) | u64::from(self.stop);
        let mut random = SplitMix64::new(0, start);
        let offset = [(); 4].map(|()| random.next_f64());
        let mut free = 0;
        for i in 0..self.rays {
            let [x0, x1, x2, x3] = sequence(offset, i);
            // Square root warp to the triangle; Malley's method to the hemisphere.
            let r = x0.sqrt();
            let place = SurfacePoint { triangle: self.triangle, u: r * (1.0 - x1), v: r * x1 };
            let p = a + (b - a) * place.u + (c - a) * place.v;
            let (sin, cos) = (std::f32::consts::TAU * x2).sin_cos();
            let d = s * (x3.sqrt() * cos) + t * (x3.sqrt() * sin) + up * (1.0 - x3).sqrt();
            if !reference.is_cut(&place) && !self.occluded(p + up * lift, d) {
                free += 1;
                if self.stop {
                    break;
                }
            }
        }
        if self.rays == 0 { 0.0 } else { free as f32 / self.rays as f32 }
    }

    fn occluded(&self, origin: Vec3f, direction: Vec3f) -> bool {
        // A view from outside sees the other side of what the ray meets.
        let seen = |front: bool| !front;
        let cull = self.settings.cull_back_faces;
        is_occluded(self.reference, &Ray::new(origin, direction), |t| t == self.triangle, seen, cull)
    }
}

/// Whether something that is drawn lies on a ray, but for triangles that are `left_out`. `seen` says, from the side that the ray
/// meets, whether the viewer looks at a front; only fronts of single-sided surfaces are drawn where back faces are culled.
pub(crate) fn is_occluded(
    reference: &ReferenceSurface<'_>,
    ray: &Ray,
    left_out: impl Fn(u32) -> bool,
    seen: impl Fn(bool) -> bool,
    cull_back_faces: bool,
) -> bool {
    reference.accel().occluded_where(ray, |hit| {
        let material = reference.material(hit.triangle);
        let drawn = Sides::of(material.double_sided).shows(seen(hit.front)) || !cull_back_faces;
        drawn
            && !left_out(hit.triangle)
            && match material.alpha_mode {
                AlphaMode::Opaque => true,
                AlphaMode::Mask { .. } => !reference.is_cut(&hit.into()),
                AlphaMode::Blend => false,
            }
    })
}

/// Point `i` of the four-dimensional additive sequence with the generalised golden ratio, in [0, 1)^4.
pub(crate) fn sequence(start: [f64; 4], i: usize) -> [f32; 4] {
    // Powers of the inverse of the root of x^5 = x + 1.
    const STEP: [f64; 4] =
        [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_037_808_6, 0.538_597_257_223_61];
    std::array::from_fn(|k| {
        let x = start[k] + STEP[k] * (i + 1) as f64;
        // The largest single below one, should the conversion round up.
        ((x - x.floor()) as f32).min(1.0 - 0.5 * f32::EPSILON)
    })
}

#[cfg(test)]
mod tests {
    use super::{VisibilitySettings, visibility, visibility_reporting};
    use crate::bake::tests::{World, moved, quick, sheet};
    use photofit_geometry::shapes;
    use photofit_scalar::Vec3f;
    use photofit_scene::{AlphaMode, Material};
    use std::ops::ControlFlow;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn visibility_knows_inside_from_outside() {
        let sphere = shapes::icosphere(8);
        let cube = moved(&shapes::cube(), 0.2, Vec3f::zero());
        let n = sphere.triangles.len();
        let mut world = World::default();
        world.add(&sphere, Material::clay()).add(&cube, Material::clay());
        let seen = world.visibility();
        assert!(
            (0..n).all(|t| seen.front[t] > 0.98 && seen.back[t] == 0.0),
            "a convex shell sees all of the sky"
        );
        assert!((n..n + 12).all(|t| !seen.is_visible(t)), "the cube inside is hidden");
        assert_eq!(seen.hidden(), 12);

        // Holes, glass and back faces let light through.
        let clear = Material { base_color: [1.0, 1.0, 1.0, 0.1], ..Material::clay() };
        for (mode, visible) in [
            (AlphaMode::Opaque, false),
            (AlphaMode::Mask { cutoff: 0.5 }, true),
            (AlphaMode::Mask { cutoff: 0.05 }, false),
            (AlphaMode::Blend, true),
        ] {
            let mut world = World::default();
            world.add(&sphere, Material { alpha_mode: mode, ..clear.clone() }).add(&cube, Material::clay());
            let seen = world.visibility();
            assert!((n..n + 12).all(|t| seen.is_visible(t) == visible), "{mode:?}");
            // What is wholly cut out cannot be seen itself.
            assert_eq!(seen.is_visible(0), mode != AlphaMode::Mask { cutoff: 0.5 }, "{mode:?}");
        }
        let mut inward = sphere.clone();
        inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let mut room = World::default();
        room.add(&inward, Material::clay()).add(&cube, Material::clay());
        assert!(
            (n..n + 12).all(|t| room.visibility().is_visible(t)),
            "a room without back faces shows its inside"
        );
        let all = VisibilitySettings { cull_back_faces: false, ..quick() };
        assert!(room.with(|r| visibility(r, &all)).front[n..].iter().all(|&x| x == 0.0));
    }

    #[test]
    fn reports_rise_to_the_end_and_can_stop_the_work() {
        let mut world = World::default();
        world.add(&shapes::icosphere(8), Material::clay());
        let seen = Mutex::new(Vec::new());
        let all = world.with(|r| {
            visibility_reporting(r, &quick(), &|share| {
                seen.lock().unwrap().push(share);
                ControlFlow::Continue(())
            })
        });
        assert_eq!(all, Some(world.visibility()));
        let seen = seen.into_inner().unwrap();
        assert!(seen.len() > 10 && seen.iter().all(|s| (0.0..=1.0).contains(s)) && seen.contains(&0.0));
        let asked = AtomicUsize::new(0);
        let stopped = world.with(|r| {
            visibility_reporting(r, &quick(), &|_| {
                asked.fetch_add(1, Ordering::Relaxed);
                ControlFlow::Break(())
            })
        });
        assert!(stopped.is_none() && asked.into_inner() < seen.len());
    }

    #[test]
    fn accessibility_has_its_closed_form() {
        // The floor under the middle of a square ceiling of side 2 at height 1: form factor 0.5541 (Howell, C-11, 4 quarters).
        let mut floor = moved(&sheet(1), 1e-3, Vec3f::zero());
        floor.triangles.truncate(1);
        let mut ceiling = sheet(1);
        ceiling.positions.iter_mut().for_each(|p| p.z = 1.0);
        let mut world = World::default();
        world.add(&floor, Material::clay()).add(&ceiling, Material::clay());
        let s = VisibilitySettings { min_rays: 20_000, max_rays: 20_000, rays: 1_000_000, ..quick() };
        let seen = world.with(|r| visibility(r, &s));
        let quarter = 1.0 / 2.0_f64.sqrt() * (1.0 / 2.0_f64.sqrt()).atan() / std::f64::consts::PI;
        let expected = 1.0 - 4.0 * quarter;
        assert!((f64::from(seen.front[0]) - expected).abs() < 0.005, "{} against {expected}", seen.front[0]);
        assert!(seen.front[1] > 0.99 && seen.back[1] == 0.0);
    }
}
