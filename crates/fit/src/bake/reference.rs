//! The reference as rays see it: geometry, materials, and what lies where a triangle is met.

use super::{BakeClass, BakeError};
use crate::engine::classes::transmits;
use photofit_geometry::Mesh;
use photofit_rays::{Accel, Hit};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec4};
use photofit_scene::{AlphaMode, FlatScene, Material, SurfaceLibrary, SurfaceSample, UvDerivatives};

/// The reference asset, prepared for rays.
#[derive(Debug)]
pub struct ReferenceSurface<'a> {
    scene: &'a FlatScene,
    materials: &'a [Material],
    surfaces: &'a SurfaceLibrary,
    opposed: &'a [bool],
    accel: Accel,
    diagonal: f32,
}

/// What lies at a point of the reference.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shaded {
    pub(crate) surface: SurfaceSample,
    /// Unit shading normal in world space, on the counter-clockwise side of the triangle.
    pub(crate) normal: Vec3f,
    /// Share of indirect light that reaches it.
    pub(crate) occlusion: f32,
}

/// A place on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SurfacePoint {
    pub(crate) triangle: u32,
    /// Barycentric weights of the second and third vertex.
    pub(crate) u: f32,
    pub(crate) v: f32,
}

/// What the surface library asks for at a place.
struct Attributes {
    material: usize,
    uv: [Vec2f; 2],
    color: Vec4f,
}

impl SurfacePoint {
    /// A corner of a triangle.
    pub(crate) fn corner(triangle: u32, k: usize) -> Self {
        let [u, v] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k];
        Self { triangle, u, v }
    }

    fn weights(&self) -> [f32; 3] {
        [1.0 - self.u - self.v, self.u, self.v]
    }
}

impl From<&Hit> for SurfacePoint {
    fn from(hit: &Hit) -> Self {
        Self { triangle: hit.triangle, u: hit.u, v: hit.v }
    }
}

impl<'a> ReferenceSurface<'a> {
    /// Checks the scene and builds its acceleration structure. `opposed` says of each triangle whether its vertex normals point
    /// to its back; empty: those of none do ([`photofit_geometry::opposed`]).
    ///
    /// # Errors
    /// An empty scene, an attribute of the wrong length, a material index out of range, or geometry that
    /// [`Accel::build`] refuses.
    pub fn new(
        scene: &'a FlatScene,
        materials: &'a [Material],
        surfaces: &'a SurfaceLibrary,
        opposed: &'a [bool],
    ) -> Result<Self, BakeError> {
        let mesh = &scene.mesh;
        if mesh.triangles.is_empty() {
            return Err(BakeError::Empty { what: "reference" });
        }
        let n = mesh.positions.len();
        attribute("reference", "normals", mesh.normals.len(), n, true)?;
        attribute("reference", "uvs", mesh.uvs.len(), n, false)?;
        attribute("reference", "uvs1", mesh.uvs1.len(), n, false)?;
        attribute("reference", "tangents", mesh.tangents.len(), n, false)?;
        attribute("reference", "colors", mesh.colors.len(), n, false)?;
        attribute("reference", "opposed flags", opposed.len(), mesh.triangles.len(), false)?;
        if scene.triangle_material.len() != mesh.triangles.len() {
            return Err(BakeError::Length {
                mesh: "reference",
                what: "triangle materials",
                found: scene.triangle_material.len(),
                expected: mesh.triangles.len(),
            });
        }
        for (triangle, &material) in scene.triangle_material.iter().enumerate() {
            if material as usize >= materials.len() {
                return Err(BakeError::Material { triangle, material, materials: materials.len() });
            }
        }
        let accel = Accel::build(&mesh.positions, &mesh.triangles)
            .map_err(|source| BakeError::Geometry { mesh: "reference", source })?;
        let diagonal = diagonal(mesh);
        Ok(Self { scene, materials, surfaces, opposed, accel, diagonal })
    }

    /// World-space geometry.
    pub fn mesh(&self) -> &Mesh {
        &self.scene.mesh
    }

    /// The acceleration structure over [`Self::mesh`].
    pub fn accel(&self) -> &Accel {
        &self.accel
    }

    /// Diagonal of the box around the triangles, in the asset's units.
    pub fn diagonal(&self) -> f32 {
        self.diagonal
    }

    /// Material of a triangle.
    #[inline]
    pub fn material(&self, triangle: u32) -> &Material {
        &self.materials[self.scene.triangle_material[triangle as usize] as usize]
    }

    /// Which surfaces a triangle belongs to.
    #[inline]
    pub(crate) fn class(&self, triangle: u32) -> BakeClass {
        let opposed = self.opposed.get(triangle as usize).is_some_and(|o| *o);
        let material = self.material(triangle);
        BakeClass { alpha: material.alpha_mode.into(), opposed, see_through: transmits(material) }
    }

    /// Normal of a triangle times twice its area.
    #[inline]
    pub(crate) fn area_normal(&self, triangle: u32) -> Vec3f {
        let [a, b, c] = self.scene.mesh.corners(triangle as usize);
        (b - a).cross(c - a)
    }

    /// Unit interpolated normal at a place, without its normal map.
    pub(crate) fn smooth_normal(&self, place: &SurfacePoint) -> Vec3f {
        let mesh = &self.scene.mesh;
        let t = mesh.triangles[place.triangle as usize].map(|i| i as usize);
        let w = place.weights();
        let n = mesh.normals[t[0]] * w[0] + mesh.normals[t[1]] * w[1] + mesh.normals[t[2]] * w[2];
        let n = n.normalize_or_zero();
        if n == Vec3f::zero() { self.area_normal(place.triangle).normalize_or_zero() } else { n }
    }

    /// True where an alpha mask removes the surface.
    #[inline]
    pub(crate) fn is_cut(&self, place: &SurfacePoint) -> bool {
        if !matches!(self.material(place.triangle).alpha_mode, AlphaMode::Mask { .. }) {
            return false;
        }
        let at = self.attributes(place);
        self.surfaces.alpha(at.material, at.uv[0], at.uv[1], at.color.w) < 0.5
    }

    fn attributes(&self, place: &SurfacePoint) -> Attributes {
        let mesh = &self.scene.mesh;
        let t = mesh.triangles[place.triangle as usize].map(|i| i as usize);
        let w = place.weights();
        let uv = |set: &[Vec2f]| {
            if set.is_empty() {
                Vec2f::zero()
            } else {
                set[t[0]] * w[0] + set[t[1]] * w[1] + set[t[2]] * w[2]
            }
        };
        let colors = &mesh.colors;
        let color = if colors.is_empty() {
            vec4(1.0, 1.0, 1.0, 1.0)
        } else {
            colors[t[0]] * w[0] + colors[t[1]] * w[1] + colors[t[2]] * w[2]
        };
        let material = self.scene.triangle_material[place.triangle as usize] as usize;
        Attributes { material, uv: [uv(&mesh.uvs), uv(&mesh.uvs1)], color }
    }

    /// Surface and shading normal at a place, filtered over about `width` of the asset's units.
    pub(crate) fn shade(&self, place: &SurfacePoint, width: f32) -> Shaded {
        let mesh = &self.scene.mesh;
        let t = mesh.triangles[place.triangle as usize].map(|i| i as usize);
        let w = place.weights();
        let at = self.attributes(place);
        // Alpha masks are sampled, not filtered: a coarse level mixes in the colours of what is cut.
        let masked = matches!(self.material(place.triangle).alpha_mode, AlphaMode::Mask { .. });
        let filtered = width > 0.0 && !masked && !self.surfaces.is_constant(at.material);
        let footprint = filtered.then(|| {
            let [d0, d1] = self.uv_densities(t).map(|d| d * width);
            UvDerivatives { dx: [vec2(d0, 0.0), vec2(d1, 0.0)], dy: [vec2(0.0, d0), vec2(0.0, d1)] }
        });
        let surface = self.surfaces.lookup(at.material, at.uv[0], at.uv[1], at.color, footprint.as_ref());
        let occlusion = self.surfaces.occlusion(at.material, at.uv, footprint.as_ref());
        let n = mesh.normals[t[0]] * w[0] + mesh.normals[t[1]] * w[1] + mesh.normals[t[2]] * w[2];
        let normal = if mesh.tangents.is_empty() {
            self.smooth_normal(place)
        } else {
            let tangent = mesh.tangents[t[0]].xyz() * w[0]
                + mesh.tangents[t[1]].xyz() * w[1]
                + mesh.tangents[t[2]].xyz() * w[2];
            photofit_shading::perturb(n, tangent, mesh.tangents[t[0]].w, surface.normal)
        };
        let normal = if normal == Vec3f::zero() {
            self.area_normal(place.triangle).normalize_or_zero()
        } else {
            normal
        };
        Shaded { surface, normal, occlusion }
    }

    /// Change of both sets of texture coordinates per length on a triangle (square roots of the ratios of areas).
    fn uv_densities(&self, t: [usize; 3]) -> [f32; 2] {
        let mesh = &self.scene.mesh;
        let [a, b, c] = t.map(|i| mesh.positions[i]);
        let area = (b - a).cross(c - a).length();
        [&mesh.uvs, &mesh.uvs1].map(|set| {
            if set.is_empty() || area <= 0.0 {
                return 0.0;
            }
            let [a, b, c] = t.map(|i| set[i]);
            let uv = ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)).abs();
            (uv / area).sqrt().min(f32::MAX)
        })
    }
}

/// Checks the length of an attribute array; an absent one passes unless `needed`.
pub(crate) fn attribute(
    mesh: &'static str,
    what: &'static str,
    found: usize,
    expected: usize,
    needed: bool,
) -> Result<(), BakeError> {
    if found == expected || (found == 0 && !needed) {
        Ok(())
    } else {
        Err(BakeError::Length { mesh, what, found, expected })
    }
}

/// Diagonal of the box around the vertices that triangles name.
fn diagonal(mesh: &Mesh) -> f32 {
    let first = mesh.corners(0)[0];
    let (lo, hi) = (0..mesh.triangles.len())
        .flat_map(|t| mesh.corners(t))
        .fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
    (hi.cast::<f64>() - lo.cast::<f64>()).length() as f32
}
