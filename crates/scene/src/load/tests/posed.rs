//! Skins, morph targets and animations: known poses, round trips, broken files.

use super::gltf::{Builder, push, triangle};
use super::{load_files, refused, refused_with};
use crate::{Curve, Interpolation, Limits, Property, Scene, TextureSlot, to_glb};
use glam::Quat;
use photofit_scalar::vec3;
use serde_json::{Value, json};

/// A skinned triangle with a morph target below two joints, a rigid one below a named node, a camera, a light and
/// animations of every interpolation.
pub(super) fn moving() -> Builder {
    let mut b = triangle();
    let joints = b.accessor(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], 5121, "VEC4", 3);
    let weights = b.floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0], "VEC4", 3);
    let lift = b.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0], "VEC3", 3);
    let turn = b.floats(&[0.25, 0.0, 0.0, 0.25, 0.0, 0.0, 0.25, 0.0, 0.0], "VEC3", 3);
    let attributes = json!({"POSITION": 0, "NORMAL": 1, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let soft =
        json!({"attributes": attributes, "indices": 2, "targets": [{"POSITION": lift, "NORMAL": turn}]});
    let soft = json!({"name": "soft", "primitives": [soft], "extras": {"targetNames": ["lift"]}});
    push(&mut b.json["meshes"], soft);
    let morph = json!({"attributes": {"POSITION": 0}, "indices": 2, "targets": [{"POSITION": lift}]});
    push(&mut b.json["meshes"], json!({"primitives": [morph], "weights": [0.5]}));
    let half = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -1, 1].map(|x| x as f32);
    let binds = b.floats(
        &[[1.0, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.], half].concat(),
        "MAT4",
        2,
    );
    b.json["skins"] = json!([{"name": "arm", "joints": [2, 3], "inverseBindMatrices": binds, "skeleton": 2,
        "extras": {"rig": 3}}]);
    b.json["nodes"] = json!([
        {"name": "top", "children": [1, 2, 4, 5], "extras": {"level": [1, 2]}, "scale": [1, 1, 2]},
        {"name": "skinned", "mesh": 1, "skin": 0, "translation": [100, 0, 0]},
        {"name": "upper", "children": [3]},
        {"name": "lower", "translation": [0, 0, 1]},
        {"name": "rigid", "mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 5,6,7,1]},
        {"mesh": 2, "camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"name": "elsewhere"},
    ]);
    b.json["cameras"] =
        json!([{"type": "perspective", "name": "lens", "perspective": {"yfov": 0.5, "znear": 0.1}}]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point", "name": "lamp",
        "extras": {"on": true}}]}});
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extras"] = json!({"made": "by hand"});
    b.json["asset"]["copyright"] = json!("somebody");
    b.json["scenes"] = json!([{"nodes": [0], "name": "stage"}]);
    let times = b.floats(&[0.5, 1.5, 2.0], "SCALAR", 3);
    let s = std::f32::consts::FRAC_1_SQRT_2;
    // The last key is a half turn with the opposite sign: the way to it is a quarter turn all the same.
    let turns = b.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, s, s, 0.0, 0.0, -1.0, -0.0], "VEC4", 3);
    let spline = b.floats(
        &[
            [0.0; 3],
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0; 3],
            [2.0, 0.0, 0.0],
            [0.0; 3],
            [0.0; 3],
            [4.0; 3],
            [0.0; 3],
        ]
        .concat(),
        "VEC3",
        9,
    );
    let steps = b.floats(&[1.0, 2.0, 3.0], "SCALAR", 3);
    let channel = |sampler: usize, node: usize, path: &str| json!({"sampler": sampler, "target": {"node": node, "path": path}});
    b.json["animations"] = json!([
        {"name": "wave", "extras": "free", "channels": [
            channel(0, 3, "rotation"), channel(1, 0, "translation"), channel(2, 1, "weights"), channel(2, 5, "weights"),
        ], "samplers": [
            {"input": times, "output": turns},
            {"input": times, "output": spline, "interpolation": "CUBICSPLINE"},
            {"input": times, "output": steps, "interpolation": "STEP"},
        ]},
    ]);
    b
}

pub(super) fn again(scene: &Scene) -> Scene {
    load_files(&[("a.glb", &to_glb(scene).unwrap())]).unwrap()
}

#[test]
fn poses_are_those_of_the_specification() {
    let scene = moving().load();
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_eq!((scene.primitives.len(), scene.instances.len()), (3, 3));
    let meshes = |animation, time| {
        let mut posed = scene.clone();
        posed.set_pose(posed.pose(animation, time));
        posed.flatten().mesh
    };
    // The rest pose: the second joint stands at its bind place, scaled with the top node.
    let rest = meshes(None, 0.0);
    assert_eq!(rest.positions, scene.flatten().mesh.positions, "the flat scene is the default pose");
    assert_eq!(rest.positions[..3], [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)]);
    assert_eq!(rest.positions[3], vec3(5.0, 6.0, 14.0), "the rigid one");
    assert_eq!(rest.positions[6], vec3(0.0, 0.0, 1.0), "half of the morph target, scaled by 2");
    // A key: weights 2, the lower joint turned by 90 degrees about z, the top at (2, 0, 0).
    let key = meshes(Some(0), 1.5);
    let near = |a: photofit_scalar::Vec3f, b| assert!((a - b).length() < 1e-5, "{a:?} {b:?}");
    near(key.positions[0], vec3(2.0, 0.0, 4.0));
    near(key.positions[1], vec3(2.0, 1.0, 8.0));
    near(key.positions[2], vec3(2.0 - 0.5, 0.5, 12.0));
    near(key.positions[3], vec3(7.0, 6.0, 14.0));
    near(key.positions[6], vec3(2.0, 0.0, 4.0));
    assert!(key.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
    // Between keys: half of the turn; a spline that leaves with 1 per second and arrives at rest; steps wait.
    let between = meshes(Some(0), 1.0);
    let top = 0.125 + 0.5 * 2.0;
    near(between.positions[0], vec3(top, 0.0, 2.0));
    let (s, c) = 45.0_f32.to_radians().sin_cos();
    near(between.positions[1], vec3(top + c, s, 4.0));
    // Before the first key and after the last one.
    assert_eq!(meshes(Some(0), -9.0).positions, meshes(Some(0), 0.5).positions);
    assert_eq!(meshes(Some(0), 99.0).positions, meshes(Some(0), 2.0).positions);
    let pose = scene.pose(Some(0), 1.5);
    assert_eq!(pose.cameras[0].eye, glam::vec3(2.0, 0.0, 0.0));
    assert_eq!(pose.lights[0].position, glam::vec3(2.0, 0.0, 0.0));
}

#[test]
fn rotations_turn_the_shorter_way_at_a_constant_rate() {
    let angle = |degrees: f32| Quat::from_rotation_y(degrees.to_radians());
    let (a, b) = (angle(10.0), -angle(110.0));
    let curve = Curve {
        times: vec![1.0, 3.0],
        values: [a.to_array(), b.to_array()].concat(),
        interpolation: Interpolation::Linear,
    };
    for k in 0..=10 {
        let mut out = [0.0; 4];
        curve.sample(1.0 + 0.2 * k as f32, true, &mut out);
        let wanted = angle(10.0 + 10.0 * k as f32);
        let found = Quat::from_array(out);
        assert!(found.dot(wanted).abs() > 1.0 - 1e-6, "{k}: {found} {wanted}");
        assert!((found.length() - 1.0).abs() < 1e-6);
    }
    // A spline through the same keys has unit length too, though its numbers have not.
    let zero = [0.0; 4];
    let values = [zero, a.to_array(), zero, zero, angle(110.0).to_array(), zero].concat();
    let curve = Curve { values, interpolation: Interpolation::CubicSpline, ..curve };
    let mut out = [0.0; 4];
    curve.sample(2.0, true, &mut out);
    assert!(Quat::from_array(out).dot(angle(60.0)) > 1.0 - 1e-6, "{out:?}");
}

#[test]
fn everything_that_moves_comes_back() {
    let before = moving().load();
    let after = again(&before);
    assert_eq!(after.warnings, Vec::<String>::new());
    let (a, b) = (after.hierarchy.as_deref().unwrap(), before.hierarchy.as_deref().unwrap());
    assert_eq!(a.nodes, b.nodes);
    assert_eq!((&a.roots, &a.meshes, &a.skins), (&b.roots, &b.meshes, &b.skins));
    assert_eq!((&a.cameras, &a.lights, &a.placements), (&b.cameras, &b.lights, &b.placements));
    assert_eq!(a.animations, b.animations);
    assert_eq!(after.about, before.about);
    assert_eq!(after.about.root_extras, Some(json!({"made": "by hand"})));
    assert_eq!(after.materials, before.materials);
    for time in [0.0, 0.7, 1.9] {
        let pose = |s: &Scene| {
            let mut s = s.clone();
            s.set_pose(s.pose(Some(0), time));
            s.flatten().mesh
        };
        assert_eq!(pose(&before), pose(&after), "{time}");
    }
    assert_eq!(to_glb(&before).unwrap(), to_glb(&after).unwrap(), "the same bytes");
    assert_eq!(before.left_out(&after), Vec::<String>::new());
}

#[test]
fn additions_are_written_and_moves_by_hand_are_not_lost_in_silence() {
    let mut scene = moving().load();
    let mut added = scene.instances[1];
    added.transform.translation.x += 1.0;
    scene.instances.push(added);
    scene.lights.push(scene.lights[0].clone());
    let after = again(&scene);
    assert_eq!((after.instances.len(), after.lights.len(), after.cameras.len()), (4, 2, 1));
    assert_eq!(after.bounds(), scene.bounds());
    scene.instances[1].transform.translation.x += 1.0;
    let text = to_glb(&scene).unwrap_err().to_string();
    assert!(text.contains("instance 1") && text.contains("node 4"), "{text}");
    scene.hierarchy = None;
    assert_eq!(again(&scene).instances.len(), 4);
    scene = moving().load();
    scene.instances.pop();
    assert!(to_glb(&scene).unwrap_err().to_string().contains("3 primitives"));
}

#[test]
fn what_a_simplified_asset_does_not_keep_is_told() {
    let mut b = moving();
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual", "EXT_of_nobody"]);
    b.json["nodes"][4]["extensions"] = json!({"MY_tag": {}});
    let scene = b.load();
    assert_eq!(scene.ignored_extensions, ["EXT_of_nobody", "MY_tag"]);
    let lines = scene.left_out(&Scene::default());
    for part in [
        "1 skin with 2 joints",
        "2 morph targets",
        "1 animation (wave)",
        "7 nodes",
        "7 names",
        "extras",
        "1 camera",
        "1 light",
        "copyright",
        "MY_tag",
    ] {
        assert!(lines.iter().any(|l| l.contains(part)), "{part} in {lines:?}");
    }
    assert_eq!(triangle().load().left_out(&Scene::default()), Vec::<String>::new());
    let mut light = Scene::default();
    light.inherit(&scene);
    assert_eq!((light.cameras.len(), light.lights.len(), &light.about), (1, 1, &scene.about));
    let fewer = scene.left_out(&light);
    assert_eq!(fewer.len() + 3, lines.len(), "cameras, lights and the file's words are kept: {fewer:?}");
}

#[test]
fn broken_animations_are_left_out() {
    let left_out = |scene: Scene, words: &[&str]| {
        assert!(scene.hierarchy.as_ref().unwrap().animations.is_empty(), "{words:?}");
        let said = |w: &&String| words.iter().all(|part| w.contains(part)) && w.contains("left out");
        assert_eq!(scene.warnings.iter().filter(said).count(), 1, "{words:?} in {:?}", scene.warnings);
    };
    let with = |change: &dyn Fn(&mut Value), words: &[&str]| {
        let mut b = moving();
        change(&mut b.json);
        left_out(b.load(), words);
    };
    let with_times = |times: &[f32], words: &[&str]| {
        let mut b = moving();
        let input = b.floats(times, "SCALAR", times.len());
        b.json["animations"][0]["samplers"][0]["input"] = json!(input);
        left_out(b.load(), words);
    };
    with_times(&[0.0, 1.0, 1.0], &["animation 0 sampler 0", "keys 1 and 2", "rise"]);
    with_times(&[-1.0, 1.0, 2.0], &["animation 0 sampler 0", "from 0"]);
    with_times(&[0.0, f32::NAN, 2.0], &["animation 0 sampler 0", "finite"]);
    with_times(&[0.0, 1.0], &["animation 0", "6 numbers", "Rotation takes 4"]);
    let mut b = moving();
    b.json["animations"][0]["channels"][0]["target"]["node"] = json!(99);
    b.refused(&["channel 0", "node 99", "7 nodes"]);
    with(&|j| j["animations"][0]["channels"][0]["sampler"] = json!(9), &["channel 0", "sampler 9"]);
    with(
        &|j| j["animations"][0]["samplers"][1]["interpolation"] = json!("LINEAR"),
        &["channel 1", "9 numbers"],
    );
    with(&|j| j["animations"][0]["samplers"][0]["interpolation"] = json!("MAGIC"), &["sampler 0", "STEP"]);
    with(&|j| j["animations"][0]["samplers"][0]["output"] = json!(0), &["channel 0", "Rotation takes 4"]);
    // What cannot be animated is left out with a word.
    let mut b = moving();
    b.json["animations"][0]["channels"][1]["target"]["node"] = json!(4);
    b.json["animations"][0]["channels"][2]["target"]["node"] = json!(4);
    let scene = b.load();
    let hierarchy = scene.hierarchy.unwrap();
    assert_eq!(hierarchy.animations[0].channels.len(), 2);
    assert!(hierarchy.animations[0].channels.iter().any(|c| c.property == Property::Weights));
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert!(scene.warnings.iter().all(|w| w.contains("node 4")), "{:?}", scene.warnings);
}

#[test]
fn a_node_with_instances_places_its_mesh_as_often() {
    let mut b = triangle();
    let places = b.floats(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0], "VEC3", 3);
    let turns = b.accessor(&[0, 0, 0, 127, 0, 0, 127, 0, 0, 0, 0, 127], 5120, "VEC4", 3);
    b.json["accessors"][turns]["normalized"] = json!(true);
    let few = b.floats(&[1.0; 6], "VEC3", 2);
    let attributes = json!({"TRANSLATION": places, "ROTATION": turns});
    b.json["nodes"] = json!([{"name": "many", "mesh": 0, "translation": [10, 0, 0],
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}]);
    b.json["scenes"] = json!([{"nodes": [0]}]);
    b.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = b.load();
    let at = |i: usize| scene.instances[i].transform.translation.to_array();
    assert_eq!([at(0), at(1), at(2)], [[11.0, 0.0, 0.0], [10.0, 2.0, 0.0], [10.0, 0.0, 3.0]]);
    assert_eq!((scene.primitives.len(), scene.instances.len()), (1, 3), "one mesh");
    let turned = scene.instances[1].transform.transform_vector3(glam::Vec3::X);
    assert!(turned.abs_diff_eq(-glam::Vec3::X, 1e-5), "half a turn: {turned}");
    assert!(scene.warnings.is_empty() && scene.ignored_extensions.is_empty(), "{:?}", scene.warnings);
    assert_eq!(again(&scene).instances.len(), 3);
    for (attributes, word) in [
        (json!({"TRANSLATION": places, "SCALE": few}), "of 3 and of 2 elements"),
        (json!({}), "one must be there"),
        (json!({"TRANSLATION": 99}), "accessor 99"),
    ] {
        let mut bad = b.clone();
        bad.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = attributes;
        refused(&[("a.glb", &bad.glb())], &["EXT_mesh_gpu_instancing", word]);
    }
    let few = Limits { instances: 2, ..Limits::default() };
    refused_with(&[("a.glb", &b.glb())], &few, &["3 times", "at most 2"]);
}

#[test]
fn vertices_of_the_bind_pose_are_moved_as_poses_say() {
    let mut scene = moving().load();
    let told = scene.check_bind_vertices().unwrap_err();
    assert_eq!(told, "primitive 2 has no normals");
    assert_eq!(scene.deformation(None, 0.0).unwrap_err(), told, "every pose has vertices of its own then");
    let hierarchy = std::sync::Arc::make_mut(scene.hierarchy.as_mut().unwrap());
    let parts = hierarchy.meshes.iter_mut().flat_map(|m| &mut m.primitives);
    let binds = parts.filter_map(|p| p.bind.as_mut()).filter(|b| b.mesh.normals.is_empty());
    binds.for_each(|b| b.mesh.normals = vec![vec3(0.0, 0.6, 0.8); 3]);
    scene.check_bind_vertices().unwrap();
    let bind = |scene: &Scene| {
        let hierarchy = scene.hierarchy.as_ref().unwrap();
        let placed = scene.instances.iter().zip(&hierarchy.placements);
        let meshes: Vec<_> = placed
            .map(|(instance, placement)| {
                let mesh = &hierarchy.meshes[hierarchy.nodes[placement.node].mesh.unwrap()];
                let bind = mesh.primitives[placement.part].bind.as_ref();
                bind.map_or(&scene.primitives[instance.primitive].mesh, |b| &b.mesh).clone()
            })
            .collect();
        let of = |f: fn(&photofit_geometry::Mesh) -> &Vec<photofit_scalar::Vec3f>| {
            meshes.iter().flat_map(f).copied().collect::<Vec<_>>()
        };
        (of(|m| &m.positions), of(|m| &m.normals))
    };
    let check = |scene: &Scene| {
        let (positions, normals) = bind(scene);
        for (animation, time) in [(None, 0.0), (Some(0), 1.0), (Some(0), 1.5), (Some(0), 9.0)] {
            let mut posed = scene.clone();
            posed.set_pose(posed.pose(animation, time));
            let (flat, deformation) = (posed.flatten().mesh, scene.deformation(animation, time).unwrap());
            let near = |a: &[photofit_scalar::Vec3f], b: &[photofit_scalar::Vec3f]| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (*a - *b).length() < 1e-5)
            };
            assert!(near(&flat.positions, &deformation.positions(&positions)), "{animation:?} {time}");
            assert!(near(&flat.normals, &deformation.normals(&normals)), "{animation:?} {time}");
        }
    };
    check(&scene);
    // Other vertices move alike, from their default pose on.
    let (mut positions, mut normals) = bind(&scene);
    let before = scene.flatten().mesh;
    positions.iter_mut().for_each(|p| *p += vec3(0.25, -0.5, 0.125));
    normals.iter_mut().for_each(|n| *n = vec3(n.z, n.x, n.y));
    let targets = |scene: &mut Scene| {
        let hierarchy = std::sync::Arc::make_mut(scene.hierarchy.as_mut().unwrap());
        let parts = hierarchy.meshes.iter_mut().flat_map(|m| &mut m.primitives);
        let tangents = parts.filter_map(|p| p.bind.as_mut()).flat_map(|b| &mut b.targets);
        tangents.map(|t| std::mem::replace(&mut t.tangents, vec![vec3(1.0, 0.0, 0.0); 3]).len()).collect()
    };
    let _: Vec<usize> = targets(&mut scene);
    scene.set_bind_vertices(&positions, &normals);
    let left: Vec<usize> = targets(&mut scene.clone());
    assert_eq!(left, [0, 0], "targets add nothing to tangents that are not there");
    assert_eq!(bind(&scene), (positions, normals));
    let after = scene.flatten().mesh;
    assert_eq!(before.triangles, after.triangles);
    assert!(before.positions.iter().zip(&after.positions).all(|(a, b)| (*a - *b).length() > 0.2));
    check(&again(&scene));
    let mut twice = scene.clone();
    twice.instances.push(twice.instances[1]);
    assert_eq!(twice.check_bind_vertices().unwrap_err(), "primitive 1 is placed more than once");
    let mut mapped = scene.clone();
    let slot = TextureSlot::new(0);
    mapped.materials.iter_mut().for_each(|m| m.normal_texture = Some(slot));
    let told = mapped.deformation(None, 0.0).unwrap_err();
    assert_eq!(told, "primitive 0 has a normal map, but no tangents");
}

#[test]
fn nodes_that_deform_the_same_mesh_share_its_bind_pose() {
    let mut b = moving();
    push(&mut b.json["nodes"], json!({"mesh": 1, "skin": 0}));
    b.json["nodes"][0]["children"] = json!([1, 7, 2, 4, 5]);
    let scene = b.load();
    let primitives: std::collections::BTreeSet<_> = scene.instances.iter().map(|i| i.primitive).collect();
    assert_eq!((primitives.len(), scene.instances.len()), (4, 4), "each has a primitive of its own");
    assert_eq!(scene.check_bind_vertices().unwrap_err(), "primitive 0 of mesh 0 is placed more than once");
}
