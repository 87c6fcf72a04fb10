//! An animated asset for tests: a tube that two joints bend, and a smaller tube that a node moves.

use glam::{Affine3A, Quat, Vec3};
use photofit_geometry::Mesh;
use photofit_scalar::{vec2, vec3};
use photofit_scene::{
    Animation, Bind, Channel, Curve, Hierarchy, Influences, Instance, Interpolation, Material, Node,
    NodeMesh, NodePrimitive, NodeTransform, Placement, Primitive, Property, Scene, Skin, TextureImage,
    TextureSlot,
};
use std::sync::Arc;

/// Texels of the picture on both tubes.
const TEXELS: usize = 32;

/// A tube about +y from 0 to 2, its picture in a column of the unit square.
fn tube(rings: usize, around: usize, radius: f32, columns: [f32; 2]) -> Mesh {
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for k in 0..=around {
            let (y, u) = (ring as f32 / rings as f32, k as f32 / around as f32);
            let (s, c) = (u * std::f32::consts::TAU).sin_cos();
            mesh.positions.push(vec3(radius * s, 2.0 * y, radius * c));
            mesh.normals.push(vec3(s, 0.0, c));
            mesh.uvs.push(vec2(columns[0] + (columns[1] - columns[0]) * u, 0.02 + 0.96 * y));
        }
    }
    let row = around as u32 + 1;
    for ring in 0..rings as u32 {
        for k in 0..around as u32 {
            let a = ring * row + k;
            mesh.triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
        }
    }
    mesh
}

/// The arm: animation 0, "bend", turns the upper joint by 90 degrees about z and lifts the small tube by 1, both within a
/// second; 1 is "still".
pub(crate) fn arm(rings: usize, around: usize) -> Scene {
    let upper = tube(rings, around, 0.35, [0.02, 0.48]);
    let small = tube(2, around, 0.15, [0.52, 0.98]);
    let weights = |y: f32| {
        let t = ((y - 0.6) / 0.8).clamp(0.0, 1.0);
        [1.0 - t, t, 0.0, 0.0]
    };
    let influences = Influences {
        joints: vec![[0, 1, 0, 0]; upper.positions.len()],
        weights: upper.positions.iter().map(|p| weights(p.y)).collect(),
    };
    let at = |x: f32, y: f32| NodeTransform::Parts {
        translation: Vec3::new(x, y, 0.0),
        rotation: Quat::IDENTITY,
        scale: Vec3::ONE,
    };
    let node = |children: Vec<usize>, transform| Node { children, transform, ..Node::default() };
    let half = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2).to_array();
    let curve =
        |values: Vec<f32>| Curve { times: vec![0.0, 1.0], values, interpolation: Interpolation::Linear };
    let hierarchy = Hierarchy {
        nodes: vec![
            node(vec![1, 2, 4], at(0.0, 0.0)),
            Node { mesh: Some(0), skin: Some(0), ..node(Vec::new(), at(0.0, 0.0)) },
            node(vec![3], at(0.0, 0.0)),
            node(Vec::new(), at(0.0, 1.0)),
            Node { mesh: Some(1), ..node(Vec::new(), at(1.0, -0.5)) },
        ],
        roots: vec![0],
        meshes: vec![
            NodeMesh {
                primitives: vec![NodePrimitive {
                    primitive: 0,
                    bind: Some(Bind {
                        mesh: upper.clone(),
                        influences: vec![influences],
                        targets: Vec::new(),
                    }),
                    extras: None,
                }],
                ..NodeMesh::default()
            },
            NodeMesh {
                primitives: vec![NodePrimitive { primitive: 1, bind: None, extras: None }],
                ..NodeMesh::default()
            },
        ],
        skins: vec![Skin {
            joints: vec![2, 3],
            inverse_binds: vec![Affine3A::IDENTITY, Affine3A::from_translation(Vec3::new(0.0, -1.0, 0.0))],
            ..Skin::default()
        }],
        animations: vec![
            Animation {
                name: "bend".into(),
                channels: vec![
                    Channel { node: 3, property: Property::Rotation, curve: 0 },
                    Channel { node: 4, property: Property::Translation, curve: 1 },
                ],
                curves: vec![
                    curve([Quat::IDENTITY.to_array(), half].concat()),
                    curve(vec![1.0, -0.5, 0.0, 1.0, 0.5, 0.0]),
                ],
                ..Animation::default()
            },
            Animation { name: "still".into(), ..Animation::default() },
        ],
        placements: vec![Placement { node: 1, part: 0 }, Placement { node: 4, part: 0 }],
        ..Hierarchy::default()
    };
    let texel = |i: usize| {
        let (x, y) = (i % TEXELS, i / TEXELS);
        let stripe = if (x / 4 + y / 4).is_multiple_of(2) { 230 } else { 60 };
        [stripe, (40 + 6 * y) as u8, (230 - 6 * x) as u8, 255]
    };
    let slot = TextureSlot::new(0);
    Scene {
        name: "arm".into(),
        primitives: [upper, small].map(|mesh| Primitive { mesh, material: 0 }).into(),
        instances: vec![
            Instance { primitive: 0, transform: Affine3A::IDENTITY },
            Instance { primitive: 1, transform: Affine3A::from_translation(Vec3::new(1.0, -0.5, 0.0)) },
        ],
        materials: vec![Material {
            base_color: [1.0; 4],
            base_color_texture: Some(slot),
            metallic: 0.0,
            roughness: 0.7,
            double_sided: true,
            ..Material::default()
        }],
        images: vec![TextureImage {
            name: "checker".into(),
            width: TEXELS,
            height: TEXELS,
            texels: (0..TEXELS * TEXELS).map(texel).collect(),
            ..TextureImage::default()
        }],
        hierarchy: Some(Arc::new(hierarchy)),
        ..Scene::default()
    }
}
