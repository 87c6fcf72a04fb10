//! Texture coordinates as textures are read: behind the transforms of their slots (`KHR_texture_transform`), in which a tile
//! is a unit square whatever range a file stores its coordinates in.

use glam::{DAffine2, DMat2, DVec2};
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, vec2};
use photofit_scene::{FlatScene, Material, Scene, TextureSlot};
use std::borrow::Cow;

/// What the textures of each material make of its two sets of coordinates; `None` where they are read as they stand.
#[derive(Debug)]
pub(super) struct TextureSpaces(Vec<[Option<DAffine2>; 2]>);

/// The transform of a slot; `None` where it does nothing, or there is no way back.
fn transform(slot: &TextureSlot) -> Option<DAffine2> {
    let [u, v] = slot.transform.map(|row| row.map(f64::from));
    let linear = DMat2::from_cols(DVec2::new(u[0], v[0]), DVec2::new(u[1], v[1]));
    let affine = DAffine2::from_mat2_translation(linear, DVec2::new(u[2], v[2]));
    (affine != DAffine2::IDENTITY && affine.inverse().is_finite()).then_some(affine)
}

/// That of a set: of the first slot that reads it, which colours come first in.
fn of_set(material: &Material, set: u32) -> Option<DAffine2> {
    material.texture_slots().find(|slot| slot.tex_coord == set).and_then(transform)
}

fn apply(affine: DAffine2, uv: &mut Vec2f) {
    let to = affine.transform_point2(DVec2::new(uv.x.into(), uv.y.into()));
    *uv = vec2(to.x as f32, to.y as f32);
}

impl TextureSpaces {
    /// Those of a scene's materials.
    pub(super) fn of(scene: &Scene) -> Self {
        Self(scene.materials.iter().map(|m| [0, 1].map(|set| of_set(m, set))).collect())
    }

    /// The mesh with its coordinates as they are read.
    pub(super) fn read<'a>(&self, flat: &'a FlatScene) -> Cow<'a, Mesh> {
        if self.0.as_flattened().iter().all(Option::is_none) {
            return Cow::Borrowed(&flat.mesh);
        }
        let mut mesh = flat.mesh.clone();
        // A vertex belongs to triangles of one material.
        let mut done = vec![false; mesh.positions.len()];
        for (t, material) in mesh.triangles.iter().zip(&flat.triangle_material) {
            for v in t.map(|v| v as usize) {
                if !std::mem::replace(&mut done[v], true) {
                    self.change(*material as usize, |a| a, [mesh.uvs.get_mut(v), mesh.uvs1.get_mut(v)]);
                }
            }
        }
        Cow::Owned(mesh)
    }

    /// Puts coordinates that are as they are read back into the range of a material's slots.
    pub(super) fn store(&self, material: usize, mesh: &mut Mesh) {
        mesh.uvs.iter_mut().for_each(|uv| self.change(material, |a| a.inverse(), [Some(uv), None]));
        mesh.uvs1.iter_mut().for_each(|uv| self.change(material, |a| a.inverse(), [None, Some(uv)]));
    }

    fn change(&self, material: usize, way: fn(DAffine2) -> DAffine2, sets: [Option<&mut Vec2f>; 2]) {
        for (affine, uv) in self.0[material].iter().zip(sets) {
            if let (Some(affine), Some(uv)) = (affine, uv) {
                apply(way(*affine), uv);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::prepare::decimated_only;
    use super::super::tests::tiled;
    use super::*;
    use crate::engine::Normalised;
    use photofit_geometry::decimate::{Options, Target};

    #[test]
    fn coordinates_in_another_range_are_decimated_as_they_are_read() {
        // As programs that quantise store them, and turned.
        let transform = [[0.0, -16.0, 3.0], [16.0, 0.0, 0.25]];
        let mut plain = tiled();
        plain.primitives[0].mesh.uvs.iter_mut().for_each(|uv| *uv *= 0.25);
        let mut packed = plain.clone();
        packed.materials[0].base_color_texture.as_mut().unwrap().transform = transform;
        let pack = |uv: &Vec2f| vec2((uv.y - 0.25) / 16.0, (uv.x - 3.0) / -16.0);
        let mesh = &mut packed.primitives[0].mesh;
        mesh.uvs = mesh.uvs.iter().map(pack).collect();
        mesh.uvs1 = vec![vec2(0.3, 0.7); mesh.uvs.len()];
        plain.primitives[0].mesh.uvs1 = mesh.uvs1.clone();
        let [a, b] = [&plain, &packed].map(|scene| {
            let n = Normalised::new(scene).unwrap();
            let how = Options { keep_uvs: true, ..Options::new(Target::Triangles(40)) };
            decimated_only("decimated", scene, &n, &[], &how).unwrap().scene.primitives.remove(0).mesh
        });
        assert!(a.triangles.len() == 40 && a.triangles == b.triangles);
        for (k, (a_uv, b_uv)) in a.uvs.iter().zip(&b.uvs).enumerate() {
            let b_uv = vec2(3.0 - 16.0 * b_uv.y, 0.25 + 16.0 * b_uv.x);
            assert!((*a_uv - b_uv).length() < 1e-5, "{k}: {a_uv:?} {b_uv:?}");
            assert!((a.positions[k] - b.positions[k]).length() < 1e-5, "{k}");
            assert!((b.uvs1[k] - vec2(0.3, 0.7)).length() < 1e-6, "the other set is read as it stands");
            // The texture lies in one tile, and what is read of it, too.
            assert!(
                (-1e-6..=1.0 + 1e-6).contains(&b_uv.x) && (-1e-6..=1.0 + 1e-6).contains(&b_uv.y),
                "{b_uv:?}"
            );
        }
    }

    #[test]
    fn a_transform_without_a_way_back_changes_nothing() {
        let mut scene = tiled();
        scene.materials[0].base_color_texture.as_mut().unwrap().transform =
            [[0.0, 0.0, 0.5], [0.0, 1.0, 0.0]];
        let flat = scene.flatten();
        assert!(matches!(TextureSpaces::of(&scene).read(&flat), Cow::Borrowed(_)));
    }
}
