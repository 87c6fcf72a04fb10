//! Known answers of baking, and the small worlds they are baked from.

mod alpha;
mod occlusion;
mod robustness;
mod surface;

use super::{BakeSettings, Baked, ReferenceSurface, Target, bake};
use crate::visibility::{Visibility, VisibilitySettings, visibility};
use photofit_geometry::{Mesh, opposed, shapes};
use photofit_raster::channel;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{
    Filter, FlatScene, Material, Sampler, Scene, SurfaceLibrary, TextureImage, TextureSlot, Wrap,
};
use std::ops::ControlFlow;

/// A reference in the making.
#[derive(Default)]
pub(crate) struct World {
    flat: FlatScene,
    scene: Scene,
}

impl World {
    pub(crate) fn add(&mut self, mesh: &Mesh, material: Material) -> &mut Self {
        let base = self.flat.mesh.positions.len() as u32;
        let m = &mut self.flat.mesh;
        m.positions.extend(&mesh.positions);
        m.normals.extend(&mesh.normals);
        let uvs =
            if mesh.uvs.is_empty() { vec![vec2(0.0, 0.0); mesh.positions.len()] } else { mesh.uvs.clone() };
        m.uvs.extend(uvs);
        m.tangents.extend(if mesh.tangents.is_empty() {
            mesh.normals.iter().map(|n| n.orthonormal_pair().0.extend(1.0)).collect()
        } else {
            mesh.tangents.clone()
        });
        m.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
        let material_index = self.scene.materials.len() as u32;
        self.flat.triangle_material.extend(mesh.triangles.iter().map(|_| material_index));
        self.scene.materials.push(material);
        self
    }

    pub(crate) fn image(&mut self, width: usize, texels: Vec<[u8; 4]>) -> Option<TextureSlot> {
        let height = texels.len() / width;
        self.scene.images.push(TextureImage {
            name: "image".into(),
            width,
            height,
            texels,
            ..TextureImage::default()
        });
        let sampler =
            Sampler { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::ClampToEdge, filter: Filter::Bilinear };
        Some(TextureSlot { sampler, ..TextureSlot::new(self.scene.images.len() - 1) })
    }

    pub(crate) fn with<R>(&self, ask: impl FnOnce(&ReferenceSurface<'_>) -> R) -> R {
        let (library, opposed) = (SurfaceLibrary::new(&self.scene), opposed(&self.flat.mesh));
        ask(&ReferenceSurface::new(&self.flat, &self.scene.materials, &library, &opposed).unwrap())
    }

    pub(crate) fn visibility(&self) -> Visibility {
        self.with(|r| visibility(r, &quick()))
    }

    pub(crate) fn bake(&self, seen: &Visibility, target: &Mesh, settings: &BakeSettings) -> Baked {
        self.with(|r| bake(r, seen, &Target::new(target), settings, &go_on)).unwrap()
    }
}

pub(crate) fn quick() -> VisibilitySettings {
    VisibilitySettings { rays: 200_000, ..VisibilitySettings::default() }
}

pub(crate) fn go_on(_: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

pub(crate) fn size(side: usize) -> BakeSettings {
    BakeSettings { width: side, height: side, ..BakeSettings::default() }
}

pub(crate) fn painted(color: [f32; 3]) -> Material {
    Material { base_color: [color[0], color[1], color[2], 1.0], ..Material::clay() }
}

/// Each triangle on its own patch of the atlas; vertices split, normals kept, tangents along the patch.
pub(crate) fn patches(mesh: &Mesh) -> Mesh {
    let side = (mesh.triangles.len() as f32).sqrt().ceil();
    let mut out = Mesh::default();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let cell = vec2((t as f32 % side).floor(), (t as f32 / side).floor());
        let [a, b, c] = mesh.corners(t);
        // Solves uv derivatives for this patch: u along b - a, v along c - a.
        let (e1, e2) = (b - a, c - a);
        for (k, &i) in corners.iter().enumerate() {
            let local = [vec2(0.1, 0.1), vec2(0.8, 0.1), vec2(0.1, 0.8)][k];
            out.positions.push(mesh.positions[i as usize]);
            let n = mesh.normals[i as usize];
            out.normals.push(n);
            out.uvs.push((cell + local) / side);
            let tangent = (e1 - n * n.dot(e1)).normalize_or_zero();
            let w = if n.cross(tangent).dot(e2) < 0.0 { -1.0 } else { 1.0 };
            out.tangents.push(tangent.extend(w));
        }
        let base = 3 * t as u32;
        out.triangles.push([base, base + 1, base + 2]);
    }
    out
}

pub(crate) fn moved(mesh: &Mesh, scale: f32, shift: Vec3f) -> Mesh {
    let mut out = mesh.clone();
    out.positions.iter_mut().for_each(|p| *p = *p * scale + shift);
    out
}

pub(crate) fn color_of(texel: &[f32; 16]) -> [f32; 3] {
    [texel[0], texel[1], texel[2]]
}

/// World-space normal that shading makes of a baked texel, and the point of the target there.
pub(crate) fn shaded(target: &Mesh, baked: &Baked) -> Vec<(usize, Vec3f, Vec3f)> {
    let (w, h) = (baked.maps.width, baked.maps.height);
    let cover = photofit_geometry::atlas::mesh_coverage(&target.uvs, &target.triangles, w, h, true);
    (0..w * h)
        .filter(|&i| baked.valid[i])
        .map(|i| {
            let b = cover.barycentric[i];
            let t = target.triangles[cover.triangle[i] as usize].map(|i| i as usize);
            let mix = |a: &[Vec3f]| a[t[0]] * b[0] + a[t[1]] * b[1] + a[t[2]] * b[2];
            let tangents: Vec<Vec3f> = target.tangents.iter().map(|t| t.xyz()).collect();
            let texel = &baked.maps.texels[i];
            let map = vec3(texel[channel::NORMAL], texel[channel::NORMAL + 1], texel[channel::NORMAL + 2]);
            let n =
                photofit_shading::perturb(mix(&target.normals), mix(&tangents), target.tangents[t[0]].w, map);
            (i, n, mix(&target.positions))
        })
        .collect()
}

pub(crate) fn degrees(a: Vec3f, b: Vec3f) -> f32 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// A deterministic byte.
pub(crate) fn noise(i: usize) -> u8 {
    ((i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u8
}

/// A square sheet with tangents.
pub(crate) fn sheet(cells: u32) -> Mesh {
    let mut mesh = shapes::quad_grid(cells, cells);
    // v grows downwards, against +y: the bitangent of glTF (towards v = 0 in texture space, green up) is +y.
    mesh.tangents = mesh.normals.iter().map(|_| vec3(1.0, 0.0, 0.0).extend(1.0)).collect();
    mesh
}
