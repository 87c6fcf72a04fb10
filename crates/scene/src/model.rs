//! The scene: primitives, their placements, materials and images.

use crate::error::{Fault, fault};
use crate::nodes::{AssetInfo, Hierarchy};
use crate::skin::Bind;
use crate::{Camera, LightKind, Material, PunctualLight, SceneError, TextureSlot};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;
use photofit_texture::MipLayout;
use std::path::PathBuf;
use std::sync::Arc;

/// An image of a texture, RGBA, row 0 at the top; its encoding follows from the slot that uses it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TextureImage {
    /// Name in the file.
    pub name: String,
    /// Application data of the file.
    pub extras: Option<serde_json::Value>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` texels.
    pub texels: Vec<[u8; 4]>,
    /// The same in 16 bits a channel, rounded to `texels`, where a file has more than 8 and materials read data from it; they are
    /// read from these, colours from `texels`, and a PNG is written with them. Empty: `texels` are all. Who changes texels empties
    /// it.
    pub texels16: Vec<[u16; 4]>,
    /// Mip levels of its own beside `texels`, each halved and rounded down, where there are some: those of a file that holds
    /// them (KTX 2.0), or to be written into one. Empty: they follow from `texels`. Who changes texels empties it.
    pub mips: Vec<Vec<[u8; 4]>>,
    /// How it is written; what is loaded says [`TextureEncoding::Png`] whatever it came from.
    pub encoding: TextureEncoding,
    /// The file (PNG, JPEG, WebP or KTX 2.0) that it was read from, where [`crate::Limits::keep_encoded`] asked for it: it is written in place
    /// of `texels`, which must be what it decodes to.
    pub encoded: Option<Arc<[u8]>>,
}

impl TextureImage {
    /// The texels, 0 to 1, as materials read data from them: not decoded, in all the bits that there are.
    pub fn data(&self) -> Vec<[f32; 4]> {
        if self.texels16.is_empty() {
            return self.texels.iter().map(|t| t.map(|v| f32::from(v) / 255.0)).collect();
        }
        self.texels16.iter().map(|t| t.map(|v| f32::from(v) / 65535.0)).collect()
    }
}

/// How an image is stored in a written file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureEncoding {
    /// Exact.
    #[default]
    Png,
    /// Lossy, a fraction of the bytes, all channels at full resolution; images with alpha are stored as PNG.
    Jpeg {
        /// 1 to 100.
        quality: u8,
    },
    /// Exact, for readers that know `EXT_texture_webp`.
    WebP,
    /// Lossy, about a third of the bytes of a JPEG, chroma at half resolution, alpha exact; for readers that know
    /// `EXT_texture_webp`.
    LossyWebP {
        /// 1 to 100.
        quality: u8,
    },
    /// Blocks of UASTC in KTX 2.0, which graphics processors keep compressed, with mip levels of their own; for readers that
    /// know `KHR_texture_basisu`. Images whose sides are no multiples of 4, or that are colour and data at once, are stored
    /// as PNG.
    Ktx2 {
        /// 1 to 100: below 100 blocks are chosen that compress better.
        quality: u8,
    },
}

/// A mesh with one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Primitive {
    /// Geometry in its own frame.
    pub mesh: Mesh,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// One number per vertex of a primitive that glTF has no meaning for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexAttribute {
    /// Its name, without the `_` that glTF puts before it.
    pub name: String,
    /// Index into [`Scene::primitives`].
    pub primitive: usize,
    /// Finite values, one per vertex.
    pub values: Vec<f32>,
}

/// A placed primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::primitives`].
    pub primitive: usize,
    /// Own frame to world.
    pub transform: glam::Affine3A,
}

/// An asset in memory.
///
/// Invariant: every index is in range (loaders check it; [`Scene::validate`] checks scenes made by hand).
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name, usually the file's stem.
    pub name: String,
    /// Meshes with one material each.
    pub primitives: Vec<Primitive>,
    /// Placements; the same primitive may appear many times.
    pub instances: Vec<Instance>,
    /// Primitives whose normals are computed, since the file has none for them, in order.
    pub computed_normals: Vec<usize>,
    /// The attribute of vertices that was asked for ([`crate::Limits::vertex_attribute`]), in the order of the primitives.
    pub vertex_attributes: Vec<VertexAttribute>,
    /// Names of attributes of vertices and morph targets that are not read, sorted: those of glTF that a scene has no place
    /// for, and `_NAME`s that were not asked for.
    pub ignored_attributes: Vec<String>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Texture images.
    pub images: Vec<TextureImage>,
    /// Cameras of the file, in world space.
    pub cameras: Vec<Camera>,
    /// Lights of the file, in world space.
    pub lights: Vec<PunctualLight>,
    /// Bytes of the files that it was loaded from: the asset itself, its buffers, textures and materials.
    pub source_bytes: u64,
    /// The files beside the asset's own that were read: buffers, textures, material libraries; links followed.
    pub files: Vec<PathBuf>,
    /// What the loader ignored or repaired, one line each.
    pub warnings: Vec<String>,
    /// The nodes that place all this, with skins, morph targets and animations; `None` for formats without and for scenes
    /// made by hand.
    pub hierarchy: Option<Arc<Hierarchy>>,
    /// What the file says about itself.
    pub about: AssetInfo,
    /// Names of the extensions that the file uses and the loader does not read.
    pub ignored_extensions: Vec<String>,
    /// Objects of the file whose application data is not kept.
    pub ignored_extras: usize,
}

/// Bytes that a scene takes; see [`Scene::memory`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Vertices and triangles as stored, with bind poses, joints and morph targets, bytes.
    pub geometry: usize,
    /// Texels as stored, bytes.
    pub images: usize,
    /// Vertices and triangles that [`Scene::flatten`] makes at most, bytes.
    pub flattened: usize,
    /// Texels with the mip chains of a [`crate::surface::SurfaceLibrary`] at most, bytes.
    pub surfaces: usize,
}

/// Largest number of vertices or triangles that [`Scene::flatten`] makes.
pub const MAX_FLAT: usize = 100_000_000;

impl Scene {
    /// Triangles as they are placed: a primitive that appears twice counts twice.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.primitives[i.primitive].mesh.triangles.len()).sum()
    }

    /// Vertices as they are placed: a primitive that appears twice counts twice.
    pub fn vertex_count(&self) -> usize {
        self.instances.iter().map(|i| self.primitives[i.primitive].mesh.positions.len()).sum()
    }

    /// World-space box around all placed vertices, `(min, max)`; `None` without vertices.
    pub fn bounds(&self) -> Option<(Vec3f, Vec3f)> {
        let mut all: Option<(Vec3f, Vec3f)> = None;
        for instance in &self.instances {
            for p in &self.primitives[instance.primitive].mesh.positions {
                let p = instance.transform.transform_point3a(glam::vec3a(p.x, p.y, p.z));
                let p = photofit_scalar::vec3(p.x, p.y, p.z);
                all = Some(all.map_or((p, p), |(lo, hi)| (lo.min(p), hi.max(p))));
            }
        }
        all
    }

    /// Centre of the bounds and radius of the sphere around it that holds all placed vertices; `None` without
    /// vertices.
    pub fn bounding_sphere(&self) -> Option<(glam::Vec3, f32)> {
        let (lo, hi) = self.bounds()?;
        let center = glam::vec3a(lo.x + hi.x, lo.y + hi.y, lo.z + hi.z) * 0.5;
        let mut radius = 0.0_f32;
        for instance in &self.instances {
            for p in &self.primitives[instance.primitive].mesh.positions {
                let p = instance.transform.transform_point3a(glam::vec3a(p.x, p.y, p.z));
                radius = radius.max(p.distance_squared(center));
            }
        }
        Some((center.into(), radius.sqrt()))
    }

    /// World-space area of all triangles, in squared units, summed in f64.
    pub fn area(&self) -> f64 {
        let mut sum = 0.0;
        for instance in &self.instances {
            let mesh = &self.primitives[instance.primitive].mesh;
            let m = instance.transform.matrix3;
            for t in 0..mesh.triangles.len() {
                let p = mesh.corners(t);
                let edge = |k: usize| {
                    let e = p[k] - p[0];
                    (m * glam::vec3a(e.x, e.y, e.z)).as_dvec3()
                };
                sum += 0.5 * edge(1).cross(edge(2)).length();
            }
        }
        sum
    }

    /// Bytes in memory.
    pub fn memory(&self) -> Memory {
        fn bytes<T>(v: &[T]) -> usize {
            size_of_val(v)
        }
        let of_mesh = |m: &Mesh| {
            bytes(&m.positions)
                + bytes(&m.normals)
                + bytes(&m.uvs)
                + bytes(&m.uvs1)
                + bytes(&m.tangents)
                + bytes(&m.colors)
                + bytes(&m.triangles)
        };
        let levels = |i: &TextureImage| i.mips.iter().map(|l| bytes(l)).sum::<usize>();
        let images: usize =
            self.images.iter().map(|i| bytes(&i.texels) + bytes(&i.texels16) + levels(i)).sum();
        let of_bind = |b: &Bind| {
            let sets = b.influences.iter().map(|s| bytes(&s.joints) + bytes(&s.weights));
            let targets = b.targets.iter();
            let targets = targets.map(|t| bytes(&t.positions) + bytes(&t.normals) + bytes(&t.tangents));
            of_mesh(&b.mesh) + sets.sum::<usize>() + targets.sum::<usize>()
        };
        let parts = self.hierarchy.iter().flat_map(|h| &h.meshes).flat_map(|m| &m.primitives);
        let binds: usize = parts.filter_map(|p| p.bind.as_ref()).map(of_bind).sum();
        let meshes: usize = self.primitives.iter().map(|p| of_mesh(&p.mesh)).sum();
        Memory {
            geometry: meshes + binds,
            images,
            flattened: self.vertex_count() * 72 + self.triangle_count() * 16,
            surfaces: images / 3 * 4,
        }
    }

    /// Checks the invariants of a scene made by hand.
    ///
    /// # Errors
    /// If an index is out of range, an attribute has another length than the positions, an image or a mip level of it has
    /// another number of texels than its size says, or a projector has no picture.
    pub fn validate(&self) -> Result<(), SceneError> {
        self.check().map_err(Fault::in_scene)
    }

    pub(crate) fn check(&self) -> Result<(), Fault> {
        for (p, primitive) in self.primitives.iter().enumerate() {
            check_mesh(&primitive.mesh).map_err(|rule| fault(format!("primitive {p}"), rule))?;
            if primitive.material >= self.materials.len() {
                let rule = format!(
                    "names material {}; there are {} materials",
                    primitive.material,
                    self.materials.len()
                );
                return Err(fault(format!("primitive {p}"), rule));
            }
        }
        for a in &self.vertex_attributes {
            let vertices = self.primitives.get(a.primitive).map_or(0, |p| p.mesh.positions.len());
            if a.values.len() != vertices || !a.values.iter().all(|x| x.is_finite()) {
                let rule = format!(
                    "must have {vertices} finite values, one for each vertex of primitive {}",
                    a.primitive
                );
                return Err(fault(format!("vertex attribute {}", a.name), rule));
            }
        }
        for (i, instance) in self.instances.iter().enumerate() {
            if instance.primitive >= self.primitives.len() {
                let rule = format!(
                    "names primitive {}; there are {} primitives",
                    instance.primitive,
                    self.primitives.len()
                );
                return Err(fault(format!("instance {i}"), rule));
            }
        }
        for (m, material) in self.materials.iter().enumerate() {
            if let Some(slot) = material.texture_slots().find(|s| s.image >= self.images.len()) {
                let rule = format!("names image {}; there are {} images", slot.image, self.images.len());
                return Err(fault(format!("material {m}"), rule));
            }
        }
        for (i, image) in self.images.iter().enumerate() {
            if image.width == 0
                || image.height == 0
                || image.width.checked_mul(image.height) != Some(image.texels.len())
            {
                let rule = format!(
                    "has {} texels; its size {} x {} asks for as many",
                    image.texels.len(),
                    image.width,
                    image.height
                );
                return Err(fault(format!("image {i}"), rule));
            }
            if ![0, image.texels.len()].contains(&image.texels16.len()) {
                let (found, wanted) = (image.texels16.len(), image.texels.len());
                let rule = format!("has {found} texels of 16 bits; it must have none or {wanted}");
                return Err(fault(format!("image {i}"), rule));
            }
            // Rounded, with a step for arithmetic in floating point.
            let same = |(deep, texel): (&u16, &u8)| deep.abs_diff(u16::from(*texel) * 257) <= 129;
            if !image.texels16.as_flattened().iter().zip(image.texels.as_flattened()).all(same) {
                let rule =
                    "has texels of 16 bits that are not its texels of 8; who changes these empties those";
                return Err(fault(format!("image {i}"), rule.to_string()));
            }
            if !image.texels16.is_empty() && !image.mips.is_empty() {
                let rule =
                    "has texels of 16 bits and mip levels of its own; it must have one of them at most";
                return Err(fault(format!("image {i}"), rule.to_string()));
            }
            let sizes = MipLayout::full(image.width, image.height);
            let wanted = sizes.levels()[1..].iter().map(|l| l.width as usize * l.height as usize);
            let wanted: Vec<usize> = wanted.take(image.mips.len()).collect();
            let found: Vec<usize> = image.mips.iter().map(Vec::len).collect();
            if found != wanted {
                let rule = format!("has mip levels of {found:?} texels; they must be {wanted:?}");
                return Err(fault(format!("image {i}"), rule));
            }
        }
        if let Some(i) =
            self.lights.iter().position(|l| l.kind == LightKind::Projector && l.picture.is_none())
        {
            return Err(fault(format!("light {i}"), "is a projector without a picture; it must have one"));
        }
        match &self.hierarchy {
            Some(hierarchy) => hierarchy.check(self),
            None => Ok(()),
        }
    }

    /// Checks that the scene can be the input of a fit: it has triangles, a surface, and a size that can be
    /// flattened.
    ///
    /// # Errors
    /// If there are no triangles (a point cloud included), the whole area is zero, or more than [`MAX_FLAT`] vertices
    /// or triangles are placed.
    pub fn validate_for_fit(&self) -> Result<(), SceneError> {
        self.validate()?;
        let fail = |rule: String| Err(fault("the asset", rule).in_scene());
        let (vertices, triangles) = (self.vertex_count(), self.triangle_count());
        if triangles == 0 {
            return fail(match vertices {
                0 => "has no geometry".into(),
                n => format!("has {n} points only; it must have triangles"),
            });
        }
        if vertices.max(triangles) > MAX_FLAT {
            return fail(format!(
                "places {vertices} vertices and {triangles} triangles; it may place {MAX_FLAT} of each"
            ));
        }
        let area = self.area();
        if !(area > 0.0 && area.is_finite()) {
            return fail(format!("has an area of {area}; it must have a surface of positive finite area"));
        }
        Ok(())
    }
}

impl Material {
    /// The texture slots in use, those of extensions after those of the core.
    pub fn texture_slots(&self) -> impl Iterator<Item = &TextureSlot> {
        self.textures().map(|(_, slot)| slot)
    }

    /// The same with what each is for, in words.
    pub fn textures(&self) -> impl Iterator<Item = (&'static str, &TextureSlot)> {
        let core = [
            ("base colour", &self.base_color_texture),
            ("roughness and metalness", &self.metallic_roughness_texture),
            ("normal", &self.normal_texture),
            ("occlusion", &self.occlusion_texture),
            ("emission", &self.emissive_texture),
        ];
        let core = core.into_iter().filter_map(|(name, slot)| slot.as_ref().map(|slot| (name, slot)));
        core.chain(self.extensions.iter().flat_map(|e| e.textures()))
    }

    /// Images that it reads data from: what is not decoded from sRGB.
    pub(crate) fn data(&self) -> impl Iterator<Item = usize> + '_ {
        let core = [&self.metallic_roughness_texture, &self.normal_texture, &self.occlusion_texture];
        let more = self.extensions.iter().flat_map(|e| e.textures());
        let more = more.filter(|(name, _)| !name.ends_with("colour")).map(|(_, slot)| slot);
        core.into_iter().flatten().chain(more).map(|slot| slot.image)
    }

    /// The same, to be changed.
    pub fn texture_slots_mut(&mut self) -> impl Iterator<Item = &mut TextureSlot> {
        let core = [
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.normal_texture,
            &mut self.occlusion_texture,
            &mut self.emissive_texture,
        ];
        core.into_iter().flatten().chain(self.extensions.iter_mut().flat_map(|e| e.slots_mut()))
    }
}

pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), String> {
    let n = mesh.positions.len();
    if u32::try_from(n).is_err() {
        return Err(format!("has {n} vertices; it may have at most {}", u32::MAX));
    }
    if let Some((name, length)) = mesh.misfit() {
        return Err(format!(
            "has {length} {name} for {n} vertices; it must have none or one of {name} per vertex"
        ));
    }
    match mesh.triangles.iter().flatten().find(|&&i| i as usize >= n) {
        Some(i) => Err(format!("names index {i}; it must be below the {n} vertices")),
        None => Ok(()),
    }
}
