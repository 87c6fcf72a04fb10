//! Compressed geometry through files.

use super::*;

/// A bent patch with values that no grid of powers of two has.
fn uneven() -> Mesh {
    let n = 12;
    let at = |i: usize, k: usize| ((i * n + k) as f32 * 0.618_034).fract();
    let mut mesh = Mesh::default();
    for (i, k) in (0..n * n).map(|v| (v / n, v % n)) {
        let (x, y) = (i as f32 / 11.0, k as f32 / 11.0);
        mesh.positions.push(vec3(
            3.0 * x + 100.0 / 3.0,
            2.9 * y - 7.0,
            0.3 * (5.0 * x).sin() * (4.0 * y).cos(),
        ));
        mesh.normals.push(vec3(0.3 * (9.0 * x).sin(), 0.4 * (7.0 * y).cos(), 1.0).normalize_or_zero());
        mesh.uvs.push(vec2(0.9 * x + 0.01 * at(i, k), 0.9 * y));
        mesh.uvs1.push(vec2(0.8 * y, 0.9 * x));
        mesh.colors.push(vec4(at(i, k), at(k, i), x, 0.7 * y));
    }
    for (i, k) in (0..(n - 1) * (n - 1)).map(|q| (q / (n - 1), q % (n - 1))) {
        let a = (i * n + k) as u32;
        mesh.triangles.extend([[a, a + n as u32, a + 1], [a + 1, a + n as u32, a + n as u32 + 1]]);
    }
    mesh
}

/// Errors are half a step at most, and near that somewhere: the grid is neither coarser nor finer than the precision says.
#[test]
fn compressed_geometry_comes_back_on_its_grid() {
    let mesh = uneven();
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    scene.primitives.push(Primitive { mesh: mesh.clone(), material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    // Powers of two: of the extent 3, so that its step is 2 to the power of 1 more; per unit.
    for (precision, position, coordinate, color, normal) in [
        (Precision::Fine, 14, 16, 12, 1e-3),
        (Precision::Medium, 13, 12, 10, 0.025),
        (Precision::Coarse, 12, 12, 10, 0.025),
    ] {
        let bytes = to_glb_with(&scene, Compression::Meshopt(precision)).unwrap();
        let again = from_glb(&bytes).unwrap();
        assert!(again.warnings.is_empty() && again.ignored_extensions.is_empty(), "{:?}", again.warnings);
        let found = &again.primitives[0].mesh;
        assert_eq!(found.triangles.len(), mesh.triangles.len());
        let mut worst = [0.0_f32; 3];
        // Vertices may be in another order.
        for (v, p) in found.positions.iter().enumerate() {
            let i = (0..mesh.positions.len()).find(|i| (mesh.positions[*i] - *p).length() < 0.01);
            let i = i.unwrap_or_else(|| panic!("{p:?} is no given position"));
            let off = |errors: &[f32]| errors.iter().fold(0.0_f32, |a, e| a.max(e.abs()));
            let uv = [mesh.uvs[i] - found.uvs[v], mesh.uvs1[i] - found.uvs1[v]];
            let all = [
                off(&(mesh.positions[i] - *p).to_array()),
                off(&[uv[0].x, uv[0].y, uv[1].x, uv[1].y]),
                off(&(mesh.colors[i] - found.colors[v]).to_array()),
            ];
            worst.iter_mut().zip(all).for_each(|(w, e)| *w = w.max(e));
            assert!((mesh.normals[i] - found.normals[v]).length() < normal, "normal {:?}", found.normals[v]);
        }
        for (worst, exponent) in worst.iter().zip([position, coordinate, color]) {
            let step = 2.0_f32.powi(-exponent);
            assert!((0.4 * step..0.51 * step).contains(worst), "{precision:?}: {worst} of a step of {step}");
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

/// What 12 and 8 bits of a projection lose at most, degrees: the worst directions lie about the middle of an octant.
#[test]
fn directions_are_off_by_as_much_as_the_documentation_says() {
    let n = 160;
    let about =
        |i: usize| vec3(1.0, 1.0 + 0.4 * (i % n) as f32 / n as f32, 1.0 + 0.4 * (i / n) as f32 / n as f32);
    let normals: Vec<Vec3f> = (0..n * n).map(|i| about(i).normalize_or_zero()).collect();
    let triangles = (0..normals.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mesh = Mesh { positions: normals.clone(), normals, triangles, ..Mesh::default() };
    let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
    scene.primitives.push(Primitive { mesh, material: 0 });
    scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
    for (precision, most) in [(Precision::Fine, 0.06), (Precision::Medium, 1.3)] {
        let read = from_glb(&to_glb_with(&scene, Compression::Meshopt(precision)).unwrap()).unwrap();
        let found = &read.primitives[0].mesh;
        let off = found.positions.iter().zip(&found.normals);
        let off = off.map(|(p, n)| (p.normalize_or_zero() - n.normalize_or_zero()).length().to_degrees());
        let worst = off.fold(0.0, f32::max);
        assert!((0.8 * most..most).contains(&worst), "{precision:?}: {worst} degrees");
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
    for precision in [Precision::Fine, Precision::Medium, Precision::Coarse] {
        save_glb_with(&path, &scene, Compression::Meshopt(precision)).unwrap();
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
}
