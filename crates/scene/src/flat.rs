//! The scene as one mesh in world space.

use crate::{AlphaMode, Material, Primitive, Scene};
use glam::Affine3A;
use photofit_geometry::skinning::Affine;
use photofit_geometry::tangents::{UvFrames, split_mirrored, vertex_tangents};
use photofit_geometry::weld::weld_rows;
use photofit_geometry::{Incidence, Mesh};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec4};
use std::borrow::Cow;
use std::collections::HashMap;

/// All instances of a scene as one world-space mesh; built by [`crate::Scene::flatten`].
///
/// Attributes are present for all vertices when any primitive has them (absent ones are filled: normals and tangents
/// computed, uv zero, colours white).
#[derive(Clone, Debug, Default)]
pub struct FlatScene {
    /// World-space geometry.
    pub mesh: Mesh,
    /// Index into [`crate::Scene::materials`] for each triangle.
    pub triangle_material: Vec<u32>,
}

impl Scene {
    /// All instances as one world-space mesh.
    ///
    /// Normals go by the inverse transpose; mirrored transforms turn the winding of the triangles and the handedness
    /// of tangents, so that front faces stay counter-clockwise. Tangents exist when some placed material has a normal
    /// map: the file's, else those of MikkTSpace on the map's own texture coordinates (which may split vertices);
    /// where no map needs them they are any unit vector across the normal. Vertex colours of opaque materials have alpha
    /// 1, since theirs means nothing.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]), or more than 2^32 - 1 vertices are placed.
    pub fn flatten(&self) -> FlatScene {
        let wants = Wants::of(self);
        let prepared: Vec<Option<Mesh>> = self.prepare(wants);
        let mut flat = FlatScene::default();
        let vertices =
            self.instances.iter().map(|i| self.mesh_of(&prepared, i.primitive).positions.len()).sum();
        assert!(u32::try_from(vertices).is_ok(), "at most 2^32 - 1 vertices");
        let triangles = self.triangle_count();
        flat.mesh.positions.reserve_exact(vertices);
        flat.mesh.normals.reserve_exact(vertices);
        flat.mesh.triangles.reserve_exact(triangles);
        flat.triangle_material.reserve_exact(triangles);
        for instance in &self.instances {
            let mesh = self.mesh_of(&prepared, instance.primitive);
            append(&mut flat.mesh, mesh, &instance.transform, wants);
            let material = self.primitives[instance.primitive].material;
            if self.materials[material].alpha_mode == AlphaMode::Opaque {
                let from = flat.mesh.colors.len().saturating_sub(mesh.positions.len());
                flat.mesh.colors[from..].iter_mut().for_each(|c| c.w = 1.0);
            }
            flat.triangle_material.extend(std::iter::repeat_n(material as u32, mesh.triangles.len()));
        }
        flat
    }

    /// The world-space positions, as [`Self::flatten`] has them, of the vertices whose attribute `name` (see
    /// [`Self::vertex_attributes`]; upper and lower case count alike) is above one half; `None` where no vertex has it.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]).
    pub fn positions_with(&self, name: &str) -> Option<Vec<Vec3f>> {
        let named = self.vertex_attributes.iter().filter(|a| a.name.eq_ignore_ascii_case(name));
        // Of names that differ in case a primitive may have several.
        let mut of: HashMap<usize, Vec<&[f32]>> = HashMap::new();
        named.for_each(|a| of.entry(a.primitive).or_default().push(&a.values));
        if of.is_empty() {
            return None;
        }
        let mut out = Vec::new();
        for instance in &self.instances {
            let positions = &self.primitives[instance.primitive].mesh.positions;
            let values = of.get(&instance.primitive).map_or(&[][..], Vec::as_slice);
            let transform = Affine::from(instance.transform);
            let is_marked = |v: &usize| values.iter().any(|values| values[*v] > 0.5);
            let marked = (0..positions.len()).filter(is_marked);
            out.extend(marked.map(|v| transform.point(positions[v])));
        }
        Some(out)
    }

    /// The mesh of a primitive in its own frame, with normals, and with tangents where its material needs them
    /// ([`Material::needs_tangents`]).
    ///
    /// # Panics
    /// If there is no such primitive, or the scene is not valid.
    pub fn complete_mesh(&self, primitive: usize) -> Cow<'_, Mesh> {
        let p = &self.primitives[primitive];
        let material = &self.materials[p.material];
        let tangents = p.mesh.tangents.is_empty() && material.needs_tangents();
        let normals = p.mesh.normals.is_empty() && !p.mesh.positions.is_empty();
        if normals || tangents { Cow::Owned(complete(p, material, tangents)) } else { Cow::Borrowed(&p.mesh) }
    }

    fn mesh_of<'a>(&'a self, prepared: &'a [Option<Mesh>], primitive: usize) -> &'a Mesh {
        prepared[primitive].as_ref().unwrap_or(&self.primitives[primitive].mesh)
    }

    /// The primitives that lack normals or needed tangents, completed in their own frame.
    fn prepare(&self, wants: Wants) -> Vec<Option<Mesh>> {
        self.primitives
            .iter()
            .map(|p| {
                let normals = p.mesh.normals.is_empty() && !p.mesh.positions.is_empty();
                let tangents = wants.tangents
                    && p.mesh.tangents.is_empty()
                    && self.materials[p.material].normal_texture.is_some();
                (normals || tangents).then(|| complete(p, &self.materials[p.material], tangents))
            })
            .collect()
    }
}

/// Optional attributes of the flat mesh.
#[derive(Clone, Copy, Debug)]
struct Wants {
    uvs: bool,
    uvs1: bool,
    colors: bool,
    tangents: bool,
}

impl Wants {
    fn of(scene: &Scene) -> Self {
        let placed = || scene.instances.iter().map(|i| &scene.primitives[i.primitive]);
        Self {
            uvs: placed().any(|p| !p.mesh.uvs.is_empty()),
            uvs1: placed().any(|p| !p.mesh.uvs1.is_empty()),
            colors: placed().any(|p| !p.mesh.colors.is_empty()),
            tangents: placed().any(|p| scene.materials[p.material].normal_texture.is_some()),
        }
    }
}

fn append(flat: &mut Mesh, mesh: &Mesh, transform: &Affine3A, wants: Wants) {
    let base = flat.positions.len() as u32;
    let n = mesh.positions.len();
    let transform = Affine::from(*transform);
    let normals = transform.normals();
    flat.positions.extend(mesh.positions.iter().map(|p| transform.point(*p)));
    flat.normals.extend(mesh.normals.iter().map(|&n| normals.apply(n)));
    if wants.uvs {
        fill(&mut flat.uvs, &mesh.uvs, n, vec2(0.0, 0.0));
    }
    if wants.uvs1 {
        fill(&mut flat.uvs1, &mesh.uvs1, n, vec2(0.0, 0.0));
    }
    if wants.colors {
        fill(&mut flat.colors, &mesh.colors, n, vec4(1.0, 1.0, 1.0, 1.0));
    }
    if wants.tangents {
        let from = flat.normals.len() - n;
        let unit = &flat.normals[from..];
        let tangents = (0..n).map(|v| match mesh.tangents.get(v) {
            Some(t) => moved_tangent(&transform, normals.mirrored, *t, unit[v]),
            None => unit[v].orthonormal_pair().0.extend(1.0),
        });
        flat.tangents.extend(tangents);
    }
    flat.triangles.extend(mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| i + base);
        if normals.mirrored { [a, c, b] } else { [a, b, c] }
    }));
}

fn fill<T: Copy>(out: &mut Vec<T>, from: &[T], n: usize, default: T) {
    if from.is_empty() {
        out.extend(std::iter::repeat_n(default, n));
    } else {
        out.extend_from_slice(from);
    }
}

/// A tangent moved by a transform, with the handedness of the moved frame; `normal` is the moved normal.
pub(crate) fn moved_tangent(transform: &Affine, mirrored: bool, t: Vec4f, normal: Vec3f) -> Vec4f {
    let unit = transform.direction(t.xyz()).normalize_or_zero();
    let unit = if unit == Vec3f::zero() { normal.orthonormal_pair().0 } else { unit };
    unit.extend(if mirrored { -t.w } else { t.w })
}

/// The mesh as a file holds it: with tangents where its material needs them.
pub(crate) fn for_file<'a>(primitive: &'a Primitive, material: &Material) -> Cow<'a, Mesh> {
    if material.needs_tangents() && primitive.mesh.tangents.is_empty() {
        return Cow::Owned(complete(primitive, material, true));
    }
    Cow::Borrowed(&primitive.mesh)
}

/// The same without tangents that its material has no use for.
pub(crate) fn lean_for_file<'a>(primitive: &'a Primitive, material: &Material) -> Cow<'a, Mesh> {
    if material.needs_tangents() || primitive.mesh.tangents.is_empty() {
        return for_file(primitive, material);
    }
    Cow::Owned(Mesh { tangents: Vec::new(), ..primitive.mesh.clone() })
}

/// The primitive's mesh with normals, and with tangents where asked.
fn complete(primitive: &Primitive, material: &Material, tangents: bool) -> Mesh {
    let mut mesh = primitive.mesh.clone();
    if mesh.normals.is_empty() {
        mesh.normals = crate::load::smooth_normals(&mesh.positions, &mesh.triangles);
    }
    if tangents {
        mesh = with_tangents(mesh, material);
    }
    mesh
}

/// Tangents of MikkTSpace on the coordinates that the normal map is read at.
fn with_tangents(mesh: Mesh, material: &Material) -> Mesh {
    let slot = material.normal_texture.as_ref();
    let uvs = match slot.map_or(0, |s| s.tex_coord) {
        1 => &mesh.uvs1,
        _ => &mesh.uvs,
    };
    if uvs.is_empty() {
        return mesh;
    }
    let t = slot.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], |s| s.transform);
    let apply = |uv: &Vec2f| {
        vec2(t[0][0] * uv.x + t[0][1] * uv.y + t[0][2], t[1][0] * uv.x + t[1][1] * uv.y + t[1][2])
    };
    let uvs: Vec<Vec2f> = uvs.iter().map(apply).collect();
    let split = split_mirrored(&mesh.triangles, &uvs);
    let uvs: Vec<Vec2f> = split.source.iter().map(|&v| uvs[v as usize]).collect();
    let mut mesh = split.apply(&mesh);
    // Vertices that agree in position, normal, coordinates and orientation share a tangent.
    let mut mirrored = vec![0.0_f32; uvs.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| uvs[v as usize]);
        let (s, t_) = (b - a, c - a);
        if s.x * t_.y - s.y * t_.x < 0.0 {
            t.iter().for_each(|&v| mirrored[v as usize] = 1.0);
        }
    }
    let rows: Vec<f32> = (0..uvs.len())
        .flat_map(|v| {
            let (p, n, uv) = (mesh.positions[v], mesh.normals[v], uvs[v]);
            [p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y, mirrored[v]]
        })
        .collect();
    let incidence = Incidence::new(&mesh.triangles, &weld_rows(&rows, 9));
    let frames = UvFrames::new(&incidence, &uvs);
    mesh.tangents = vertex_tangents(&incidence, &frames, &mesh.positions, &mesh.normals);
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, TextureSlot};
    use glam::{Mat3A, Quat, Vec3};
    use photofit_scalar::vec3;

    fn scene(transform: Affine3A) -> Scene {
        let mesh = Mesh {
            positions: vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.2), vec3(0.0, 1.0, 0.1)],
            normals: vec![vec3(-0.2, -0.1, 1.0).normalize_or_zero(); 3],
            tangents: vec![vec3(1.0, 0.0, 0.2).normalize_or_zero().extend(-1.0); 3],
            uvs: vec![vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0)],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let slot = TextureSlot {
            image: 0,
            sampler: crate::Sampler::default(),
            tex_coord: 0,
            transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        };
        Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            instances: vec![Instance { primitive: 0, transform }],
            materials: vec![Material { normal_texture: Some(slot), ..Material::default() }, Material::clay()],
            images: vec![crate::TextureImage {
                width: 1,
                height: 1,
                texels: vec![[0; 4]],
                ..crate::TextureImage::default()
            }],
            ..Scene::default()
        }
    }

    #[test]
    fn frames_go_with_any_transform() {
        let turned = Affine3A::from_scale_rotation_translation(
            Vec3::new(-2.0, 0.5, 1e-3),
            Quat::from_rotation_x(0.7),
            Vec3::ONE,
        );
        let shear = Affine3A::from_mat3(
            Mat3A::from_cols_array(&[1.0, 0.0, 0.3, 0.5, -1.0, 0.0, 0.0, 0.2, 1.0]).into(),
        );
        let tiny = Affine3A::from_scale(Vec3::splat(1e-20));
        for transform in [Affine3A::IDENTITY, turned, shear, tiny] {
            let flat = scene(transform).flatten().mesh;
            let [a, b, c] = flat.corners(0);
            let scale = 1.0 / (b - a).length().max((c - a).length());
            let face = ((b - a) * scale).cross((c - a) * scale).normalize_or_zero();
            let (n, t) = (flat.normals[0], flat.tangents[0]);
            assert!(face.dot(n) > 0.999, "winding and normal agree: {transform:?} {face:?} {n:?}");
            assert!(t.xyz().dot(n).abs() < 1e-3, "tangent lies in the surface: {transform:?}");
            // The moved bitangent: w cross(n, t) = -(n x t) in the mesh's own frame.
            let own = vec3(-0.2, -0.1, 1.0).cross(vec3(1.0, 0.0, 0.2)) * -1.0;
            let moved = transform.transform_vector3(Vec3::new(own.x, own.y, own.z));
            let bitangent = n.cross(t.xyz()) * t.w;
            assert!(bitangent.dot(vec3(moved.x, moved.y, moved.z)) > 0.0, "handedness: {transform:?}");
        }
    }

    #[test]
    fn flat_shapes_stay_finite() {
        let flat = scene(Affine3A::from_scale(Vec3::ZERO)).flatten().mesh;
        assert!(flat.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
        assert!(flat.tangents.iter().all(|t| (t.xyz().length() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn absent_attributes_are_filled() {
        let mut scene = scene(Affine3A::IDENTITY);
        let mut bare = scene.primitives[0].clone();
        bare.mesh.normals.clear();
        bare.mesh.tangents.clear();
        bare.mesh.uvs.clear();
        bare.mesh.colors = vec![vec4(0.5, 0.5, 0.5, 1.0); 3];
        bare.material = 1;
        scene.primitives.push(bare);
        scene.instances.push(Instance { primitive: 1, transform: Affine3A::from_translation(Vec3::X) });
        scene.instances.push(Instance { primitive: 1, transform: Affine3A::IDENTITY });
        let flat = scene.flatten();
        assert_eq!(flat.triangle_material, [0, 1, 1]);
        assert_eq!(flat.mesh.triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
        for (name, n) in [
            ("normals", flat.mesh.normals.len()),
            ("uvs", flat.mesh.uvs.len()),
            ("tangents", flat.mesh.tangents.len()),
            ("colors", flat.mesh.colors.len()),
        ] {
            assert_eq!(n, 9, "{name}");
        }
        assert!((flat.mesh.normals[3] - flat.mesh.normals[0]).length() < 1e-6, "computed");
        assert_eq!((flat.mesh.colors[0].x, flat.mesh.uvs[3]), (1.0, vec2(0.0, 0.0)));
        assert_eq!(scene.bounds(), flat.mesh.bounds());
        scene.materials[0].normal_texture = None;
        assert!(scene.flatten().mesh.tangents.is_empty(), "no normal map, no tangents");
    }
}
