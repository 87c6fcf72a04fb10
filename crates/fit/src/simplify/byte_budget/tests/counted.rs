//! How many triangles the maps of a fit share their bytes with.

use super::*;
use crate::simplify::byte_budget::bytes_without_textures;
use photofit_geometry::shapes::quad_grid;

/// A rock whose triangles have normals of their own, so that each has three vertices.
fn faceted() -> Scene {
    let smooth = displaced_sphere(16, 0.25, 4, 3);
    let corners = smooth.triangles.iter().flatten();
    let mut mesh = photofit_geometry::Mesh {
        positions: corners.map(|v| smooth.positions[*v as usize]).collect(),
        triangles: (0..smooth.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..photofit_geometry::Mesh::default()
    };
    mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    of(mesh, Material::clay())
}

/// Triangles that follow from bytes are counted by what a fit writes, whatever the asset's own geometry takes: a quarter to nine tenths
/// of the file where maps share it, all of it where colours of vertices are all there is.
#[test]
fn triangles_of_new_maps_are_counted_by_what_they_take() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    for (asset, most) in [(faceted(), 60_000), (rock(), 40_000)] {
        for (appearance, shares) in
            [(Appearance::Maps, &[0.25, 0.5, 0.75, 0.9][..]), (Appearance::VertexColors, &[1.0])]
        {
            let o = SimplifyOptions {
                appearance,
                own_textures: false,
                triangles_by_bytes: true,
                max_bytes: Some(most),
                texture_size: 128,
                steps: 0,
                ..options()
            };
            let made = simplify(&asset, &path, &o, &Silent).unwrap();
            let light = photofit_scene::load(&path).unwrap();
            let bytes = bytes_without_textures(&light, Compression::None).unwrap() as f64;
            let part = bytes / most as f64;
            let near = shares.iter().any(|share| (0.85 * share..=1.05 * share).contains(&part));
            let all = made.triangles_out == made.triangles_in;
            assert!(all || near, "{appearance:?}: {part} of {most}");
            assert!(!all || (appearance, most) == (Appearance::VertexColors, 40_000), "fewer are asked for");
            let told = made.plan.to_string();
            // Names and types of images take a few bytes more or less than in the start.
            let near = [-1.0, 0.0, 1.0].map(|off| format!("takes {:.0}% of the bytes", 100.0 * part + off));
            let holds = near.iter().any(|percent| told.contains(percent));
            assert!(told.contains("run  triangles by bytes") && holds, "{near:?}: {told}");
            assert!(std::fs::metadata(&path).unwrap().len() <= most);
        }
    }
}

/// Looks decide how many triangles share the bytes with maps: many where the shape alone shows, few where it is flat and its texture
/// is not.
#[test]
fn the_number_of_triangles_is_that_whose_file_looks_best() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let bumpy = of(displaced_sphere(40, 0.3, 5, 3), Material::clay());
    let mut flat = Scene { primitives: vec![Primitive { mesh: quad_grid(20, 20), material: 0 }], ..tiled() };
    // Patches of 2 x 2 texels.
    let patches = (0..128_u32 * 128).map(|k| {
        let [_, r, g, b] = (k / 256 * 64 + k % 128 / 2 + 1).wrapping_mul(0x9e37_79b9).to_le_bytes();
        [r, g, b, 255]
    });
    flat.images =
        vec![TextureImage { width: 128, height: 128, texels: patches.collect(), ..TextureImage::default() }];
    // Half of the bytes is what is tried first.
    for (asset, most, texture_size, expected) in
        [(bumpy, 60_000, 64, 0.6..1.0), (flat, 16_000, 128, 0.1..0.4)]
    {
        let o = SimplifyOptions {
            own_textures: false,
            triangles_by_bytes: true,
            max_bytes: Some(most),
            texture_size,
            resolution: 128,
            steps: 0,
            ..options()
        };
        let made = simplify(&asset, &path, &o, &Silent).unwrap();
        let light = photofit_scene::load(&path).unwrap();
        let part = bytes_without_textures(&light, Compression::None).unwrap() as f64 / most as f64;
        assert!(expected.contains(&part), "{part} of {most}: {}", made.plan);
        assert!(made.plan.to_string().contains("the best of "), "{}", made.plan);
    }
}

/// An asset without textures may keep its materials where colours of vertices are asked for.
#[test]
fn materials_without_textures_may_be_written_for_colours_of_vertices() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let smooth = of(displaced_sphere(24, 0.25, 4, 3), Material { name: "stone".into(), ..Material::clay() });
    let o = SimplifyOptions {
        appearance: Appearance::VertexColors,
        target: Target::Triangles(600),
        resolution: 64,
        steps: 2,
        own_textures: true,
        ..options()
    };
    let made = simplify(&smooth, &path, &o, &Silent).unwrap();
    assert_eq!(made.written, Written::Decimated, "{:?}", made.stages);
    let told = made.plan.to_string();
    assert!(told.contains("skip colours of vertices") && !told.contains("open "), "{told}");
    let made =
        simplify(&tiled(), &path, &SimplifyOptions { target: Target::Triangles(200), ..o }, &Silent).unwrap();
    assert_ne!(made.written, Written::Decimated, "its textures have no place");
    assert!(made.plan.to_string().contains("run  colours of vertices"), "{}", made.plan);
}
