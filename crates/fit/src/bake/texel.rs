//! One texel: where its samples lie, what they find, and their average.

use super::reference::ReferenceSurface;
use super::select::{Choice, Found, Pick, Selector};
use super::target::{Frame, point};
use super::{BakeClass, BakeSettings, BakeStatistics, Occlusion};
use photofit_geometry::{Mesh, atlas::Coverage};
use photofit_raster::{CHANNELS, channel};
use photofit_sampling::Sobol;
use photofit_scalar::{Vec2f, Vec3f, vec2};
use photofit_scene::AlphaMode;

/// Seed of the rays of ambient occlusion: they are the same in every bake.
const OCCLUSION_SEED: u64 = 0;

/// Everything a row needs.
#[derive(Debug)]
pub(super) struct Job<'a> {
    pub(super) selector: Selector<'a>,
    pub(super) target: &'a Mesh,
    /// Where to look, one per vertex.
    pub(super) directions: &'a [Vec3f],
    pub(super) classes: Option<&'a [BakeClass]>,
    pub(super) settings: &'a BakeSettings,
    pub(super) coverage: &'a Coverage,
    /// Distance to look at each vertex.
    pub(super) cage: &'a [f32],
}

/// Sums over the samples of a texel.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// Samples with a surface or a hole.
    count: f32,
    /// Sum of the alphas: the weight of everything but alpha.
    weight: f32,
    /// Samples with a surface.
    surfaces: f32,
    base_color: Vec3f,
    emissive: Vec3f,
    /// Unit world-space normals.
    normal: Vec3f,
    roughness: f32,
    metallic: f32,
    gamma: f32,
    occlusion: f32,
}

impl Job<'_> {
    /// Bakes row `y`.
    pub(super) fn row(
        &self,
        y: usize,
        texels: &mut [[f32; CHANNELS]],
        valid: &mut [bool],
        cut: &mut [bool],
    ) -> BakeStatistics {
        let mut statistics = BakeStatistics::default();
        for x in 0..self.settings.width {
            let at = y * self.settings.width + x;
            let triangle = self.coverage.triangle[at];
            if triangle == u32::MAX {
                continue;
            }
            statistics.covered_texels += 1;
            let sum = self.texel(x, y, triangle as usize, &mut statistics);
            if sum.surfaces > 0.0 {
                let frame = Frame::new(self.target, triangle as usize, self.coverage.barycentric[at]);
                texels[x] = sum.average(&frame, self.settings);
                valid[x] = true;
                statistics.valid_texels += 1;
            } else if sum.count > 0.0 {
                texels[x][channel::ALPHA] = 0.0;
                cut[x] = true;
            }
        }
        statistics
    }

    fn texel(&self, x: usize, y: usize, owner: usize, statistics: &mut BakeStatistics) -> Sum {
        let s = self.settings;
        let n = s.samples_per_side;
        let mut sum = Sum::default();
        let sequence = Sobol::new(OCCLUSION_SEED, (y * s.width + x) as u64);
        for k in 0..n * n {
            let place = |k: usize| (((k as f32 + 0.5) / n as f32) - 0.5) * s.filter_width + 0.5;
            let (dx, dy) = (place(k % n), place(k / n));
            let (triangle, w) = self.locate(x, y, owner, vec2(x as f32 + dx, y as f32 + dy));
            statistics.samples += 1;
            let Some(point) = point(self.target, self.directions, triangle, w, s.face_normal) else {
                statistics.missed += 1;
                continue;
            };
            let t = self.target.triangles[triangle].map(|i| i as usize);
            let cage = self.cage[t[0]] * w[0] + self.cage[t[1]] * w[1] + self.cage[t[2]] * w[2];
            match self.selector.choose(&point, cage, self.classes.map(|c| c[triangle])) {
                Choice::Nothing => statistics.missed += 1,
                Choice::Cut => {
                    statistics.cut += 1;
                    sum.count += 1.0;
                }
                Choice::Surface(pick) => {
                    match pick.found {
                        Found::Ray => statistics.by_ray += 1,
                        Found::FarRay => statistics.by_far_ray += 1,
                        Found::ClosestPoint => statistics.by_closest_point += 1,
                        Found::Hidden => statistics.hidden += 1,
                    }
                    statistics.mean_distance += f64::from(pick.distance);
                    statistics.max_distance = statistics.max_distance.max(pick.distance);
                    let width = self.texel_width(triangle) * s.filter_width / n as f32;
                    let occlusion = self.occlusion(&pick, &sequence, k);
                    sum.add(self.selector.reference, &pick, width, occlusion, s.unlit_as_emission);
                }
            }
        }
        sum
    }

    /// Share of indirect light that reaches sample `k` of a texel with its random sequence; `None`: what the reference's
    /// maps say.
    fn occlusion(&self, pick: &Pick, sequence: &Sobol, k: usize) -> Option<f32> {
        match self.settings.occlusion {
            Occlusion::Maps => None,
            Occlusion::None => Some(1.0),
            Occlusion::Rays(rays) => {
                let samples = self.settings.samples_per_side * self.settings.samples_per_side;
                let reference = self.selector.reference;
                Some(rays.open_share(reference, &pick.place, pick.front, sequence, (k, samples)))
            }
        }
    }

    /// Triangle and weights for a point of the atlas (in texels) inside the texel `(x, y)`.
    ///
    /// Outside of the texel's owner it may lie in the triangle of a texel nearby whose normals are on the same side; else it
    /// is moved onto the owner.
    fn locate(&self, x: usize, y: usize, owner: usize, p: Vec2f) -> (usize, [f32; 3]) {
        let w = self.weights(owner, p);
        let Some(w) = w else {
            return (owner, self.coverage.barycentric[y * self.settings.width + x]);
        };
        // Rounding at the edges is no reason to look elsewhere.
        if least(w) >= -1e-4 {
            return (owner, clamped(w));
        }
        for ny in y.saturating_sub(1)..(y + 2).min(self.settings.height) {
            for nx in x.saturating_sub(1)..(x + 2).min(self.settings.width) {
                let other = self.coverage.triangle[ny * self.settings.width + nx];
                let foreign = |c: &[BakeClass]| c[other as usize].opposed != c[owner].opposed;
                if other == u32::MAX || other as usize == owner || self.classes.is_some_and(foreign) {
                    continue;
                }
                if let Some(w) = self.weights(other as usize, p).filter(|&w| least(w) >= 0.0) {
                    return (other as usize, w);
                }
            }
        }
        // A convex mix of the nearest point of the texel's centre (inside) and the point (outside) ends on the edge.
        let inside = self.coverage.barycentric[y * self.settings.width + x];
        let mut share = 1.0_f32;
        for k in 0..3 {
            if w[k] < 0.0 {
                share = share.min(inside[k] / (inside[k] - w[k]));
            }
        }
        (owner, clamped(std::array::from_fn(|k| inside[k] + (w[k] - inside[k]) * share)))
    }

    /// Barycentric weights of a point of the atlas, in texels; `None` for triangles without area there.
    fn weights(&self, triangle: usize, p: Vec2f) -> Option<[f32; 3]> {
        let size = vec2(self.settings.width as f32, self.settings.height as f32);
        let [a, b, c] = self.target.triangles[triangle].map(|i| self.target.uvs[i as usize].mul(size));
        let cross = |o: Vec2f, p: Vec2f, q: Vec2f| (p.x - o.x) * (q.y - o.y) - (p.y - o.y) * (q.x - o.x);
        let area = cross(a, b, c);
        // Relative to the texel: thinner ones give weights without digits.
        if area.abs() < 1e-6 {
            return None;
        }
        let (v, w) = (cross(a, p, c) / area, cross(a, b, p) / area);
        Some([1.0 - v - w, v, w])
    }

    /// Side of the patch of surface behind a texel of a triangle, in the asset's units.
    fn texel_width(&self, triangle: usize) -> f32 {
        let size = vec2(self.settings.width as f32, self.settings.height as f32);
        let t = self.target.triangles[triangle];
        let [a, b, c] = t.map(|i| self.target.uvs[i as usize].mul(size));
        let texels = ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)).abs();
        let [a, b, c] = self.target.corners(triangle);
        let area = (b - a).cross(c - a).length();
        if texels > 0.0 { (area / texels).sqrt() } else { 0.0 }
    }
}

fn least(w: [f32; 3]) -> f32 {
    w[0].min(w[1]).min(w[2])
}

/// Weights without negative ones, of sum one.
fn clamped(w: [f32; 3]) -> [f32; 3] {
    let w = w.map(|x| x.max(0.0));
    let sum = w[0] + w[1] + w[2];
    if sum > 0.0 { w.map(|x| x / sum) } else { [1.0, 0.0, 0.0] }
}

impl Sum {
    fn add(
        &mut self,
        reference: &ReferenceSurface<'_>,
        pick: &Pick,
        width: f32,
        occlusion: Option<f32>,
        unlit_as_emission: bool,
    ) {
        let shaded = reference.shade(&pick.place, width);
        let s = &shaded.surface;
        let alpha = match reference.material(pick.place.triangle).alpha_mode {
            AlphaMode::Blend => s.alpha.clamp(0.0, 1.0),
            AlphaMode::Opaque | AlphaMode::Mask { .. } => 1.0,
        };
        // Fully transparent samples still say what lies there when a texel has no other.
        let weight = alpha.max(1e-6);
        self.count += 1.0;
        self.surfaces += 1.0;
        self.weight += weight;
        if s.unlit && unlit_as_emission {
            self.emissive += s.base_color * weight;
            self.gamma += weight;
        } else {
            self.base_color += s.base_color * weight;
            self.emissive += s.emissive * weight;
        }
        self.roughness += s.roughness * weight;
        self.metallic += s.metallic * weight;
        self.occlusion += occlusion.unwrap_or(shaded.occlusion) * weight;
        self.normal += (if pick.front { shaded.normal } else { -shaded.normal }) * weight;
    }

    fn average(&self, frame: &Frame, settings: &BakeSettings) -> [f32; CHANNELS] {
        let r = 1.0 / self.weight;
        let mut texel = [0.0; CHANNELS];
        let three = |texel: &mut [f32; CHANNELS], at: usize, v: Vec3f| {
            texel[at..at + 3].copy_from_slice(&v.to_array());
        };
        three(&mut texel, channel::BASE_COLOR, self.base_color * r);
        three(&mut texel, channel::EMISSIVE, self.emissive * r);
        let normal = frame.express(self.normal.normalize_or_zero());
        three(&mut texel, channel::NORMAL, normal);
        let mean_alpha = self.weight / self.count;
        texel[channel::ALPHA] = if mean_alpha > 1.5e-6 { mean_alpha.min(1.0) } else { 0.0 };
        texel[channel::SPECULAR_SUPPRESSION] = self.gamma * r;
        texel[channel::METALLIC] = self.metallic * r;
        texel[channel::OCCLUSION] = self.occlusion * r;
        let roughness = self.roughness * r;
        texel[channel::ROUGHNESS] =
            if settings.widen_roughness { widened(roughness, (self.normal * r).length()) } else { roughness };
        texel
    }
}

/// Roughness of a patch whose unit normals average to a vector of the given length.
///
/// A von Mises-Fisher lobe of that mean length has concentration `k = l (3 - l^2) / (1 - l^2)` (Banerjee et al. 2005);
/// as a microfacet distribution it adds `2 / k` to the squared GGX alpha (Toksvig 2005; Han et al. 2007).
fn widened(roughness: f32, length: f32) -> f32 {
    let l = length.clamp(0.0, 1.0);
    let alpha = roughness * roughness;
    let spread = 2.0 * (1.0 - l * l) / (l * (3.0 - l * l)).max(1e-6);
    alpha.mul_add(alpha, spread).min(1.0).sqrt().sqrt()
}
