//! References at moments against scenes that are posed by hand.

use super::*;
use crate::engine::reference::{MaterialFeatures, PathTraced, Rasterized, Reference, ReferencePicture};
use crate::engine::views::{Lighting, Orbit, OverMoments, Sampling, Set, Setup, Shot, Views};
use glam::{Affine3A, Vec3};
use photofit_geometry::shapes;
use photofit_scene::{
    Animation, Bind, Channel, Curve, Hierarchy, Instance, Interpolation, Material, MorphTarget, Node,
    NodeMesh, NodePrimitive, Placement, Primitive, Property,
};

/// A ball that moves to the right for two seconds, beside one that grows on its upper side.
fn moving() -> Scene {
    let mut ball = shapes::icosphere(6);
    ball.normals = ball.positions.clone();
    let lift = ball.positions.iter().map(|p| photofit_scalar::vec3(0.0, 0.8 * p.y.max(0.0), 0.0)).collect();
    let bind = Bind {
        mesh: ball.clone(),
        influences: Vec::new(),
        targets: vec![MorphTarget { positions: lift, ..MorphTarget::default() }],
    };
    let at = |x: f32| Affine3A::from_translation(Vec3::new(x, 0.0, 0.0));
    let node = |mesh: usize, x: f32| Node {
        mesh: Some(mesh),
        transform: photofit_scene::NodeTransform::Parts {
            translation: Vec3::new(x, 0.0, 0.0),
            rotation: glam::Quat::IDENTITY,
            scale: Vec3::ONE,
        },
        ..Node::default()
    };
    let mesh = |primitive: usize, bind: Option<Bind>| NodeMesh {
        primitives: vec![NodePrimitive { primitive, bind, extras: None }],
        ..NodeMesh::default()
    };
    let curve = |values: &[f32]| Curve {
        times: vec![0.0, 2.0],
        values: values.to_vec(),
        interpolation: Interpolation::Linear,
    };
    let animation = Animation {
        name: "go".into(),
        channels: vec![
            Channel { node: 0, property: Property::Translation, curve: 0 },
            Channel { node: 1, property: Property::Weights, curve: 1 },
        ],
        curves: vec![curve(&[0.0, 0.0, 0.0, 2.0, 0.5, 0.0]), curve(&[0.0, 1.0])],
        ..Animation::default()
    };
    Scene {
        primitives: vec![
            Primitive { mesh: ball.clone(), material: 0 },
            Primitive { mesh: ball, material: 1 },
        ],
        materials: vec![
            Material { base_color: [0.8, 0.3, 0.2, 1.0], ..Material::clay() },
            Material { base_color: [0.2, 0.3, 0.8, 1.0], ..Material::clay() },
        ],
        instances: vec![
            Instance { primitive: 0, transform: at(0.0) },
            Instance { primitive: 1, transform: at(-2.5) },
        ],
        hierarchy: Some(Arc::new(Hierarchy {
            nodes: vec![node(0, 0.0), node(1, -2.5)],
            roots: vec![0, 1],
            meshes: vec![mesh(0, None), mesh(1, Some(bind))],
            animations: vec![animation],
            placements: vec![Placement { node: 0, part: 0 }, Placement { node: 1, part: 0 }],
            ..Hierarchy::default()
        })),
        ..Scene::default()
    }
}

/// The scene as it is at a moment, without animations.
fn by_hand(moment: Moment) -> Scene {
    let mut scene = moving();
    scene.set_pose(scene.pose(moment.animation, moment.time));
    Scene { hierarchy: None, ..scene }
}

fn setup(moment: Moment) -> Setup {
    Setup { moment, ..Orbit::new(3, &Lighting::Point, 48).setup(Set::HeldOut, 1, 4) }
}

/// Largest difference of two pictures.
fn difference(a: &ReferencePicture, b: &ReferencePicture) -> f32 {
    a.image.data.iter().zip(&b.image.data).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

#[test]
fn references_show_the_asset_at_any_moment() {
    let scene = moving();
    scene.validate_for_fit().unwrap();
    let n = Normalised::new(&scene).unwrap();
    let animated = Animated::new(&scene, &n);
    let raster = Rasterized::new(&n.flat, &n.library).animated(&animated);
    let path = PathTraced::new(&scene, &n, MaterialFeatures::Core, 7).unwrap().sampled(8).animated(&animated);
    let moments = animated.moments(0, 3);
    assert_eq!(moments[1], Moment { animation: Some(0), time: 1.0 });
    let mut before: Option<ReferencePicture> = None;
    // Back to the start, too: nothing of a moment may stay.
    for moment in [moments[1], moments[2], Moment::default(), moments[1]] {
        let posed = by_hand(moment);
        let mut flat = posed.flatten();
        flat.mesh.positions.iter_mut().for_each(|p| *p = n.frame().to_frame(*p));
        let wanted = Rasterized::new(&flat, &n.library).picture(&setup(Moment::default())).unwrap();
        let found = raster.picture(&setup(moment)).unwrap();
        assert!(difference(&found, &wanted) < 1e-6, "rasterized, {moment:?}");
        let fresh = PathTraced::new(&posed, &n, MaterialFeatures::Core, 7).unwrap().sampled(8);
        let wanted = fresh.picture(&setup(Moment::default())).unwrap();
        let traced = path.picture(&setup(moment)).unwrap();
        assert!(difference(&traced, &wanted) < 1e-6, "path traced, {moment:?}");
        let changed = before.as_ref().is_none_or(|b| difference(b, &found) > 0.1);
        assert!(changed, "{moment:?} is another picture");
        before = Some(found);
    }
    // Where it is: the ball that moves leaves the frame of the asset as it stands.
    let [start, end] = [moments[0], moments[2]].map(|m| raster.bounds(m));
    assert!((start.radius - 1.0).abs() < 0.01 && end.radius > 1.3, "{start:?} {end:?}");
}

#[test]
fn views_and_shots_carry_the_moment() {
    let scene = moving();
    let n = Normalised::new(&scene).unwrap();
    let animated = Animated::new(&scene, &n);
    let raster = Rasterized::new(&n.flat, &n.library).animated(&animated);
    let orbit = Orbit::new(0, &Lighting::Mixed, 16);
    let views = OverMoments { views: orbit, moments: animated.moments(0, 3) };
    let mut seen = Vec::new();
    for index in 0..12 {
        let s = views.setup(Set::Train, index, 0);
        let shot = Shot::new(&s, raster.picture(&s).unwrap().image, Sampling::SUPERSAMPLED, 0, index);
        assert_eq!(shot.moment, s.moment);
        // Each moment under both kinds of light.
        seen.push((s.moment.time as u32, index % 2));
    }
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 6);
}

#[test]
fn moments_that_are_not_there_are_errors() {
    let scene = moving();
    let n = Normalised::new(&scene).unwrap();
    let animated = Animated::new(&scene, &n);
    let still = Rasterized::new(&n.flat, &n.library);
    let [first, never, unknown] =
        [(0, 0.5), (0, f32::NAN), (3, 0.0)].map(|(a, time)| Moment { animation: Some(a), time });
    let told = |r: &dyn Reference, m| r.picture(&setup(m)).unwrap_err().to_string();
    assert!(told(&still, first).contains("stands still"));
    let moving = still.animated(&animated);
    assert!(told(&moving, never).contains("finite") && told(&moving, unknown).contains("the asset has 1"));
    let still = Scene { hierarchy: None, ..scene.clone() };
    let still = Animated::new(&still, &n);
    assert!(still.flat(first).unwrap_err().to_string().contains("the asset has 0"));
    assert_eq!(still.flat(Moment::default()).unwrap().mesh.positions, n.flat.mesh.positions);
}

/// That vertices which stand as an asset does at rest are taken to where it is at these moments, by way of its bind pose.
fn check_way_to_bind(mut scene: Scene, moments: &[Moment]) {
    scene.set_pose(scene.pose(None, 0.0));
    let n = Normalised::new(&scene).unwrap();
    let animated = Animated::new(&scene, &n);
    let to_bind = animated.to_bind().unwrap();
    let rest = animated.flat(Moment::default()).unwrap();
    let (positions, normals) = (to_bind.positions(&rest.mesh.positions), to_bind.normals(&rest.mesh.normals));
    for moment in moments.iter().copied().chain([Moment::default()]) {
        let (flat, pose) = (animated.flat(moment).unwrap(), animated.deformation(moment).unwrap());
        let farthest = |a: &[photofit_scalar::Vec3f], b: &[photofit_scalar::Vec3f]| {
            assert_eq!(a.len(), b.len());
            a.iter().zip(b).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max)
        };
        let off = [
            farthest(&pose.positions(&positions), &flat.mesh.positions),
            farthest(&pose.normals(&normals), &flat.mesh.normals),
        ];
        assert!(off.iter().all(|o| *o < 1e-4), "{moment:?}: {off:?}");
    }
}

#[test]
fn the_way_to_the_bind_pose_is_that_of_the_pose_at_rest() {
    let at = |times: [f32; 3]| times.map(|time| Moment { animation: Some(0), time });
    let parts = |x: f32, y: f32, rotation, scale| photofit_scene::NodeTransform::Parts {
        translation: Vec3::new(x, y, 0.0),
        rotation,
        scale,
    };
    // Two joints that are bent at rest.
    let mut bent = arm::arm(8, 10);
    let turn = glam::Quat::from_rotation_z(1.0);
    Arc::make_mut(bent.hierarchy.as_mut().unwrap()).nodes[3].transform = parts(0.0, 1.0, turn, Vec3::ONE);
    check_way_to_bind(bent, &at([0.0, 0.4, 1.0]));
    // A node that mirrors.
    let mut mirrored = arm::arm(8, 10);
    let scale = Vec3::new(-1.0, 1.0, 2.0);
    Arc::make_mut(mirrored.hierarchy.as_mut().unwrap()).nodes[4].transform =
        parts(1.0, -0.5, glam::Quat::IDENTITY, scale);
    check_way_to_bind(mirrored, &at([0.0, 0.4, 1.0]));
    // Morph targets that are there at rest.
    let mut morphed = moving();
    Arc::make_mut(morphed.hierarchy.as_mut().unwrap()).meshes[1].weights = vec![0.5];
    check_way_to_bind(morphed, &at([0.0, 0.7, 2.0]));
}

#[test]
fn shapes_that_cannot_be_fitted_are_refused() {
    let told = |scene: &Scene, moment: Moment| {
        let n = Normalised::new(scene).unwrap();
        let animated = Animated::new(scene, &n);
        let done = animated.to_bind().and_then(|_| animated.deformation(moment).map(drop));
        done.map_err(|e| e.to_string())
    };
    let end = Moment { animation: Some(0), time: 2.0 };
    let mut scene = moving();
    let hierarchy = Arc::make_mut(scene.hierarchy.as_mut().unwrap());
    let bind = hierarchy.meshes[1].primitives[0].bind.as_mut().unwrap();
    bind.targets[0].normals = vec![photofit_scalar::vec3(0.1, 0.0, 0.2); bind.mesh.positions.len()];
    assert_eq!(told(&scene, end), Ok(()), "no weight at rest");
    Arc::make_mut(scene.hierarchy.as_mut().unwrap()).meshes[1].weights = vec![0.5];
    scene.set_pose(scene.pose(None, 0.0));
    let normals = "light_asset has morph targets that change its normals where it stands at rest; its shape cannot be fitted";
    assert_eq!(told(&scene, end).unwrap_err(), normals);
    let mut turning = moving();
    let animation = &mut Arc::make_mut(turning.hierarchy.as_mut().unwrap()).animations[0];
    animation.channels.push(Channel { node: 0, property: Property::Scale, curve: 2 });
    let values = vec![1.0, 1.0, 1.0, -1.0, 1.0, 1.0];
    animation.curves.push(Curve { values, ..animation.curves[0].clone() });
    assert_eq!(told(&turning, Moment { time: 0.5, ..end }), Ok(()));
    let inside_out = "light_asset primitive 0 is turned inside out at 2 s; its shape cannot be fitted";
    assert_eq!(told(&turning, end).unwrap_err(), inside_out);
}
