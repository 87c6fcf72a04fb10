//! Compressed geometry through files.

use super::*;

#[test]
fn compressed_geometry_comes_back_on_its_grid() {
    let mut mesh = patch();
    mesh.positions.iter_mut().for_each(|p| *p = *p * 3.0 + vec3(100.0, -7.0, 0.0));
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    scene.primitives.push(Primitive { mesh: mesh.clone(), material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    // Half a step in each of so many components, and what the meshes' and the normals' own rounding adds.
    for (precision, position, normal, coordinate, color) in [
        (Precision::Fine, 2.0_f32.powi(-15), 1e-3, 2.0_f32.powi(-15), 2.0_f32.powi(-12)),
        (Precision::Medium, 2.0_f32.powi(-14), 0.01, 2.0_f32.powi(-12), 2.0_f32.powi(-10)),
        (Precision::Coarse, 2.0_f32.powi(-13), 0.01, 2.0_f32.powi(-12), 2.0_f32.powi(-10)),
    ] {
        let bytes = to_glb_with(&scene, Compression::Meshopt(precision)).unwrap();
        let again = from_glb(&bytes).unwrap();
        assert!(again.warnings.is_empty() && again.ignored_extensions.is_empty(), "{:?}", again.warnings);
        let found = &again.primitives[0].mesh;
        assert_eq!(found.triangles.len(), mesh.triangles.len());
        // Vertices may be in another order.
        for (v, p) in found.positions.iter().enumerate() {
            let near = |i: &usize| (mesh.positions[*i] - *p).length() < 1.5 * 3.0 * position;
            let i =
                (0..mesh.positions.len()).find(near).unwrap_or_else(|| panic!("{p:?} is no given position"));
            assert!((mesh.normals[i] - found.normals[v]).length() < normal, "normal {:?}", found.normals[v]);
            for (given, read) in [(&mesh.uvs, &found.uvs), (&mesh.uvs1, &found.uvs1)] {
                assert!((given[i] - read[v]).length() <= 1.5 * coordinate, "{:?} of {:?}", read[v], given[i]);
            }
            assert!((mesh.colors[i] - found.colors[v]).length() <= color, "colour {:?}", found.colors[v]);
        }
        let text = String::from_utf8_lossy(&bytes);
        let required = r#""extensionsRequired":["EXT_meshopt_compression","KHR_mesh_quantization"]"#;
        assert!(text.contains(required));
    }
}

#[test]
fn compressed_files_are_smaller_and_save_the_same_twice() {
    let n = 60;
    let at = |i: usize| (i % n) as f32 / (n - 1) as f32;
    let positions: Vec<Vec3f> = (0..n * n)
        .map(|i| vec3(at(i), at(i / n), 0.2 * (9.0 * at(i)).sin() * (7.0 * at(i / n)).cos()))
        .collect();
    let mut triangles = Vec::new();
    for i in (0..n * (n - 1)).filter(|i| i % n + 1 < n) {
        let a = i as u32;
        let b = a + n as u32;
        triangles.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
    }
    let normals = positions.iter().map(|p| vec3(p.x - 0.5, p.y - 0.5, 1.0).normalize_or_zero()).collect();
    let uvs = positions.iter().map(|p| vec2(p.x, p.y)).collect();
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    let mesh = Mesh { positions, normals, uvs, triangles, ..Mesh::default() };
    scene.primitives.push(Primitive { mesh, material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    let plain = to_glb(&scene).unwrap();
    let small = to_glb_with(&scene, Compression::Meshopt(Precision::Fine)).unwrap();
    assert!(3 * small.len() < plain.len(), "{} bytes of {}", small.len(), plain.len());
    assert_eq!(small, to_glb_with(&scene, Compression::Meshopt(Precision::Fine)).unwrap());
    let [medium, coarse] = [Precision::Medium, Precision::Coarse]
        .map(|precision| to_glb_with(&scene, Compression::Meshopt(precision)).unwrap().len());
    assert!(6 * medium < 5 * small.len() && coarse < medium, "{coarse} and {medium} of {}", small.len());
}

/// The directions of a sphere: what 12 and 8 bits of a projection lose at most, degrees.
#[test]
fn directions_are_off_by_as_much_as_the_documentation_says() {
    let mesh = photofit_geometry::shapes::icosphere(24);
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    scene.primitives.push(Primitive { mesh, material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    for (precision, most, least) in [(Precision::Fine, 0.055, 0.03), (Precision::Medium, 1.0, 0.5)] {
        let read = from_glb(&to_glb_with(&scene, Compression::Meshopt(precision)).unwrap()).unwrap();
        let found = &read.primitives[0].mesh;
        let off = found.positions.iter().zip(&found.normals);
        let off = off.map(|(p, n)| (p.normalize_or_zero() - n.normalize_or_zero()).length().to_degrees());
        let worst = off.fold(0.0, f32::max);
        assert!((least..most).contains(&worst), "{precision:?}: {worst} degrees");
    }
}

/// Borders stay closed where parts meet, however far apart the sizes of the parts are.
#[test]
fn compressed_parts_keep_the_border_that_they_share() {
    let part = |far: [f32; 3]| Mesh {
        positions: vec![vec3(0.1234567, 0.7, -0.3), vec3(0.9876543, 0.2, 0.4), Vec3f::from_array(far)],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let scene = Scene {
        primitives: [[40.0, 3.0, 1.0], [0.5, 0.6, 0.1]]
            .map(|far| Primitive { mesh: part(far), material: 0 })
            .to_vec(),
        instances: [0, 1].map(|primitive| Instance { primitive, transform: Affine3A::IDENTITY }).to_vec(),
        materials: vec![Material::clay()],
        ..Scene::default()
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("parts.glb");
    save_glb_with(&path, &scene, Compression::Meshopt(Precision::Fine)).unwrap();
    let flat = load(&path).unwrap().flatten().mesh;
    let near = |p: Vec3f| {
        let close = flat.positions.iter().filter(move |q| (**q - p).length() < 1e-3);
        close.map(|q| q.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    for p in &part([0.0; 3]).positions[..2] {
        let found = near(*p);
        assert!(found.len() == 2 && found[0] == found[1], "{p:?} has become {found:?}");
    }
}
