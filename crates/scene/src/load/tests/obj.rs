//! OBJ and MTL features with known results, and broken files.

use super::{load_files, png, refused};
use crate::{AlphaMode, Material, Wrap};
use photofit_scalar::{vec2, vec3};

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn obj(text: &str) -> crate::Scene {
    load_files(&[("a.obj", text.as_bytes())]).unwrap()
}

#[test]
fn polygons_indices_and_attributes() {
    let scene = obj(&format!("{QUAD}vt 0 0\nvt 1 0.25\nvn 0 0 2\nf 1/1/1 2/2/1 3/2/1 4/1/1\n"));
    let mesh = &scene.primitives[0].mesh;
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 2));
    assert_eq!(mesh.uvs[..2], [vec2(0.0, 1.0), vec2(1.0, 0.75)], "v is turned");
    assert_eq!(mesh.normals[0], vec3(0.0, 0.0, 1.0));
    assert_eq!(scene.materials[0], Material { double_sided: true, ..Material::clay() });
    let negative = obj(&format!("{QUAD}f -4 -3 -2 -1 # all\n"));
    assert_eq!(negative.triangle_count(), 2);
    assert_eq!(negative.primitives[0].mesh.normals[3], vec3(0.0, 0.0, 1.0), "computed");
    assert!(negative.primitives[0].mesh.uvs.is_empty());
    let mixed = obj(&format!("{QUAD}vn 0 0 -1\nf 1//1 2//1 3//1\nf 1 3 \\\n 4\n"));
    assert_eq!(mixed.primitives[0].mesh.positions.len(), 6, "given and computed normals differ");
    let colored = obj("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 0.5\nf 1 2 3\n");
    assert!((colored.primitives[0].mesh.colors[2].z - 0.214_041).abs() < 1e-5);
    assert_eq!(
        colored.materials[0].base_color, [1.0; 4],
        "what the file gives no colour shows its vertices'"
    );
}

#[test]
fn computed_normals_cross_materials_and_seams_but_not_sharp_edges() {
    // A second quad on the left, turned up by a bit less than 55 degrees and by a bit more.
    let normal_at_the_fold = |degrees: f32| {
        let (y, x) = degrees.to_radians().sin_cos();
        let text = format!("{QUAD}v -{x} 0 {y}\nv -{x} 1 {y}\nusemtl a\nf 1 2 3 4\nusemtl b\nf 1 4 6 5\n");
        let scene = obj(&text);
        assert_eq!(scene.primitives.len(), 1, "unknown materials are clay");
        assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
        let mesh = &scene.primitives[0].mesh;
        assert_eq!(mesh.positions.len(), mesh.normals.len());
        (mesh.positions.len(), mesh.normals[0])
    };
    let (vertices, n) = normal_at_the_fold(54.0);
    let half = 27.0_f32.to_radians();
    assert_eq!(vertices, 6);
    assert!((n - vec3(half.sin(), 0.0, half.cos())).length() < 1e-5, "{n:?}");
    let (vertices, n) = normal_at_the_fold(56.0);
    assert_eq!((vertices, n), (8, vec3(0.0, 0.0, 1.0)));
}

#[test]
fn turned_triangles_keep_both_sides() {
    let mtl = "newmtl red\nKd 1 0 0\nnewmtl glass\nd 0.5\n";
    let text = format!("mtllib a.mtl\n{QUAD}f 1 2 3\nf 1 4 3\nusemtl red\nf 1 2 3\nusemtl glass\nf 3 2 1\n");
    let scene = load_files(&[("a.obj", text.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap();
    assert_eq!(scene.triangle_count(), 4);
    assert!(scene.primitives.iter().all(|p| scene.materials[p.material].double_sided));
}

#[test]
fn libraries_outside_of_the_folder_are_never_read_but_may_be_beside_the_asset() {
    let load = |library: &str| {
        let text = format!("mtllib {library}\n{QUAD}usemtl red\nf 1 2 3\n");
        let mtl = "newmtl red\nKd spectral a.rfl\nKd 1 0 0\n";
        load_files(&[("a.obj", text.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap()
    };
    for beside in ["C:\\work\\a.mtl", "/home/me/a.mtl", "../a.mtl"] {
        let scene = load(beside);
        assert_eq!(scene.materials[scene.primitives[0].material].base_color, [1.0, 0.0, 0.0, 1.0]);
        let told = |word: &str| scene.warnings.iter().any(|w| w.contains(word));
        assert!(told("`a.mtl`, the file of its name beside") && told("Kd spectral"), "{:?}", scene.warnings);
    }
    for outside in ["/etc/passwd", "../it cannot be read.mtl"] {
        let scene = load(outside);
        let told = |word: &str| scene.warnings.iter().any(|w| w.contains(word));
        assert!(told("inside of the asset's folder") && told("left out"), "{:?}", scene.warnings);
    }
}

#[test]
fn broken_statements_that_little_depends_on_are_left_out() {
    let keys = ["Ka spectral a.rfl", "Ks xyz 1 1 1", "Ns many", "Ni ?", "illum glossy", "Tf spectral a.rfl"];
    let more = ["Pr x", "Pm x", "Ps x", "Pc x", "Pcr x", "aniso x", "anisor x"];
    let load = |mtl: &str| {
        let text = format!("mtllib a.mtl\n{QUAD}usemtl m\nf 1 2 3\n");
        load_files(&[("a.obj", text.as_bytes()), ("a.mtl", mtl.as_bytes())])
    };
    let plain = load("newmtl m\nKd 1 0 0\nKs 0.5 0.5 0.5\n").unwrap();
    for key in keys.iter().chain(&more) {
        let scene = load(&format!("newmtl m\nKd 1 0 0\nKs 0.5 0.5 0.5\n{key}\n")).unwrap();
        assert_eq!(scene.materials, plain.materials, "{key}");
        assert_eq!(scene.warnings.len(), 1, "{key}: {:?}", scene.warnings);
        assert!(scene.warnings[0].contains("line 4"), "{key}: {:?}", scene.warnings);
    }
    for key in ["Kd x", "Ke x", "d x", "Tr x"] {
        assert!(load(&format!("newmtl m\n{key}\n")).is_err(), "{key}");
    }
}

#[test]
fn materials_and_maps() {
    let mtl = "newmtl red\nKd 1 0 0\nd 0.5\nKs 1 1 1\nbump x.png\nnewmtl wood\nKd 0.5 0.5 0.5\n\
        map_Kd -s 2 2 -o 0.25 0.5 -clamp on my wood.png\nKe 3 0 0\n";
    let text = format!(
        "mtllib a.mtl\n{QUAD}vt 0 0\nusemtl wood\nf 1/1 2/1 3/1\nusemtl red\nf 1 3 4\nusemtl wood\nf 1/1 2/1 3/1\n"
    );
    let picture = png(2, 1, [1, 2, 3, 255]);
    let scene =
        load_files(&[("a.obj", text.as_bytes()), ("a.mtl", mtl.as_bytes()), ("my wood.png", &picture)])
            .unwrap();
    assert_eq!(scene.primitives.len(), 2);
    let wood = &scene.materials[scene.primitives[0].material];
    assert_eq!(
        (wood.base_color, wood.roughness, wood.metallic),
        ([1.0, 1.0, 1.0, 1.0], 1.0, 0.0),
        "a map replaces Kd"
    );
    assert_eq!(wood.emissive, [3.0, 0.0, 0.0]);
    let slot = wood.base_color_texture.unwrap();
    assert_eq!(slot.sampler.wrap_u, Wrap::ClampToEdge);
    // File coordinates (0, 0) are (0.25, 0.5) in the map: v = 0.5 from the top too.
    let at = |u: f32, v: f32| {
        vec2(slot.transform[0][0] * u + slot.transform[0][2], slot.transform[1][1] * v + slot.transform[1][2])
    };
    assert_eq!(at(0.0, 1.0), vec2(0.25, 0.5));
    let red = &scene.materials[scene.primitives[1].material];
    assert_eq!((red.base_color, red.alpha_mode), ([1.0, 0.0, 0.0, 0.5], AlphaMode::Blend));
    assert_eq!(scene.triangle_count(), 3);
    assert!(red.normal_texture.is_none());
    assert!(
        scene.warnings.iter().any(|w| w.contains("a.mtl line 5") && w.contains("x.png")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn normals_keep_16_bits_where_colours_and_joined_maps_have_8() {
    let kept = |mtl: &str, slot: fn(&Material) -> Option<crate::TextureSlot>| {
        let (m, scene) = material(mtl);
        scene.images[slot(&m).unwrap().image].texels16.len()
    };
    assert_eq!(kept("norm deep.png\n", |m| m.normal_texture), 4);
    assert_eq!(kept("bump deep.png\n", |m| m.normal_texture), 4);
    assert_eq!(kept("map_Kd deep.png\n", |m| m.base_color_texture), 0);
    assert_eq!(kept("map_Pr deep.png\n", |m| m.metallic_roughness_texture), 0);
}

/// The material of these statements, with maps of 2 x 2 texels by name.
fn material(mtl: &str) -> (Material, crate::Scene) {
    let mtl = format!("newmtl m\n{mtl}");
    let text = format!("mtllib a.mtl\n{QUAD}vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
    let (color, grey) = (png(2, 2, [10, 200, 30, 255]), png(1, 2, [51, 51, 51, 255]));
    let (holes, bright) = (png(2, 2, [0, 0, 0, 77]), png(2, 1, [255, 255, 255, 255]));
    let samples: Vec<u16> = (1..13).map(|i| 5000 * i).collect();
    let deep = photofit_image::encode_png16(2, 2, 3, &samples, photofit_image::PngCompression::Fast).unwrap();
    let files: [(&str, &[u8]); 7] = [
        ("a.obj", text.as_bytes()),
        ("a.mtl", mtl.as_bytes()),
        ("color.png", &color),
        ("grey.png", &grey),
        ("holes.png", &holes),
        ("bright.png", &bright),
        ("deep.png", &deep),
    ];
    let scene = load_files(&files).unwrap();
    (scene.materials[scene.primitives[0].material].clone(), scene)
}

#[test]
fn numbers_are_read_as_blender_reads_them() {
    let of = |mtl: &str| material(mtl).0;
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} {b}");
    // A scan with Ns 0 is as dull as elsewhere, with and without a highlight asked for.
    assert_eq!(of("Ns 0\nillum 2\n").roughness, 1.0);
    assert_eq!(of("Kd 1 1 1\n").roughness, 1.0);
    assert_eq!(of("illum 2\n").roughness, 0.0);
    near(of("Ns 250\n").roughness, 0.5);
    assert_eq!((of("Ns 9000\n").roughness, of("Ns -3\n").roughness), (0.0, 1.0));
    assert_eq!(of("Ns 250\nPr 0.25\n").roughness, 0.25);
    assert_eq!((of("Pm 0.75\n").metallic, of("Ka 1 1 1\n").metallic), (0.75, 0.0));
    assert_eq!(of("illum 3\n").metallic, 1.0);
    near(of("illum 5\nKa 0.1 0.2 0.3\n").metallic, 0.2);
    assert_eq!(of("illum 3\nPm 0\n").metallic, 0.0);
    let specular = |mtl: &str| of(mtl).extensions.and_then(|e| e.specular).map(|s| (s.factor, s.color[0]));
    assert_eq!(specular("Ks 0.5 0.5 0.5\n"), None, "the reflection of the index of refraction");
    assert_eq!(specular("Ks 0 0 0\n"), Some((0.0, 1.0)));
    assert_eq!(specular("Ks 0.25 0.25 0.25\n"), Some((0.5, 1.0)));
    assert_eq!((specular("Ks 1 1 1\n"), specular("illum 2\n")), (Some((1.0, 2.0)), Some((1.0, 2.0))));
    assert_eq!(specular("Kd 1 1 1\n"), Some((0.0, 1.0)));
    let more = *of("Ni 1.25\nPs 0.5\nPc 1\nPcr 0.5\naniso 0.5\nanisor 0.25\n").extensions.unwrap();
    assert_eq!((more.ior, more.sheen.unwrap().color), (1.25, [0.5; 3]));
    let coat = more.clearcoat.unwrap();
    assert_eq!((coat.factor, coat.roughness), (0.25, 0.5));
    near(more.anisotropy.unwrap().rotation, std::f32::consts::FRAC_PI_2);
    let glass = *of("illum 4\nTf 1 1 1\n").extensions.unwrap();
    assert_eq!((glass.ior, glass.transmission.unwrap().factor), (1.5, 1.0));
    assert!(of("illum 2\nTf 1 1 1\n").extensions.unwrap().transmission.is_none(), "opaque files say so too");
    assert_eq!(of("Tr 0.25\n").base_color[3], 0.75);
    let thin = of("d -halo 0.5\n");
    assert_eq!((thin.base_color[3], thin.alpha_mode), (0.5, AlphaMode::Blend));
    assert_eq!(of("Ke 2 3 4\n").emissive, [2.0, 3.0, 4.0]);
}

#[test]
fn numbers_out_of_their_range_are_told_with_file_line_and_rule() {
    // Statement, what it must be, and what it is read as.
    let clamped = [
        ("Kd 1 -2 7", "0 to 1", "Kd 1 0 1"),
        ("Ks 9", "0 to 1", "Ks 1"),
        ("Ke -1 2 3", "at least 0", "Ke 0 2 3"),
        ("Ns 1e30", "0 to 1000", "Ns 1000"),
        ("Ns -3", "0 to 1000", "Ns 0"),
        ("Pr -0.5", "0 to 1", "Pr 0"),
        ("Pm 1e30", "0 to 1", "Pm 1"),
        ("d -4", "0 to 1", "d 0"),
        ("Tr 7", "0 to 1", "Tr 1"),
        ("Pc 1e30", "0 to 4", "Pc 4"),
        ("aniso -2", "0 to 1", "aniso 0"),
        ("Ni 1e30", "1 to 10", ""),
        ("Ni 0", "1 to 10", ""),
        ("illum 1e30", "0 to 10", ""),
        ("Pr nan", "finite", ""),
        ("Ns inf", "finite", ""),
    ];
    for (statement, must, same) in clamped {
        let (m, scene) = material(&format!("{statement}\n"));
        assert_eq!(m, material(&format!("{same}\n")).0, "{statement}");
        let [told] = &scene.warnings[..] else { panic!("{statement}: {:?}", scene.warnings) };
        assert!(told.contains("a.mtl line 2") && told.contains(must), "{statement}: {told}");
    }
    for fine in ["Kd 1.0001 0 0", "Ns 1000", "Ns 0", "Pr 1", "Ni 1", "illum 10", "Ke 90 0 0", "anisor -0.25"]
    {
        let (m, scene) = material(&format!("{fine}\n"));
        assert!(scene.warnings.is_empty() && m.base_color[0] <= 1.0, "{fine}: {:?}", scene.warnings);
    }
    // One line of warnings for a statement that a whole library has wrong.
    let (m, scene) = material("Pr 2\nNs 4000\nPr 3\nPr 4\n");
    assert_eq!((m.roughness, scene.warnings.len()), (1.0, 2), "{:?}", scene.warnings);
    assert!(scene.warnings[0].ends_with("(and 2 more of `Pr`)"), "{:?}", scene.warnings);
    let options = [
        ("-bm -1", "-bm 0", "`-bm -1` is below 0: 0 is taken"),
        ("-bm nan", "", "`-bm nan` has no meaning: it is left out"),
        ("-bm 1e30", "", "`-bm 1e30` has no meaning: it is left out"),
        ("-s inf 2", "-s 1 2", "`-s inf` has no meaning: it is left out"),
    ];
    for (options, plain, what) in options {
        let (m, scene) = material(&format!("norm {options} color.png\n"));
        assert_eq!(m, material(&format!("norm {plain} color.png\n")).0, "{options}");
        let told = |w: &String| w.contains("a.mtl line 2") && w.contains(what);
        assert!(scene.warnings.iter().any(told), "{options}: {:?}", scene.warnings);
        assert!(m.normal_texture.is_some(), "{options}");
    }
    let (_, scene) = material("norm -bm nan -s inf 2 -o 1 1e30 color.png\n");
    for option in ["`-bm nan`", "`-s inf`", "`-o 1e30`"] {
        assert!(scene.warnings.iter().any(|w| w.contains(option)), "{option}: {:?}", scene.warnings);
    }
}

#[test]
fn what_is_left_out_takes_nothing_from_a_statement_before_it() {
    for (good, bad) in [("Ni 1.25", "Ni 0"), ("illum 2", "illum 11"), ("norm color.png", "norm none.png")] {
        let (m, scene) = material(&format!("{good}\n{bad}\n"));
        assert_eq!(m, material(&format!("{good}\n")).0, "{bad}");
        assert_ne!(m, material("").0, "{good}");
        let told = |w: &String| w.contains("a.mtl line 3") && w.contains("left out");
        assert!(scene.warnings.iter().any(told), "{bad}: {:?}", scene.warnings);
    }
}

#[test]
fn what_a_whole_library_has_wrong_is_told_once_with_its_number() {
    let wrong = "Pr x\nPm 2\nnorm -bm nan color.png\nmap_Pr none.png\n";
    let (_, scene) = material(&wrong.repeat(50));
    let told =
        |word: &str| scene.warnings.iter().filter(|w| w.contains(word)).cloned().collect::<Vec<String>>();
    for (word, line, of) in [("`Pr` is left", 2, "Pr"), ("0 to 1", 3, "Pm"), ("-bm nan", 4, "norm -bm")] {
        let lines = told(word);
        let [one] = &lines[..] else { panic!("{word}: {:?}", scene.warnings) };
        assert!(one.contains(&format!("a.mtl line {line}:")), "{one}");
        assert!(one.ends_with(&format!("(and 49 more of `{of}`)")), "{one}");
    }
    let maps = told("none.png");
    assert_eq!(maps.len(), 8, "{:?}", scene.warnings);
    assert!(maps[7].ends_with("(and 42 more of `map_Pr`)"), "{:?}", scene.warnings);
}

#[test]
fn maps_are_joined_as_gltf_keeps_them() {
    let texel = |scene: &crate::Scene, slot: Option<crate::TextureSlot>| {
        let image = &scene.images[slot.unwrap().image];
        (image.width, image.height, image.texels[0])
    };
    let (m, scene) = material("Pr 0.5\nmap_Pr grey.png\nmap_Pm bright.png\n");
    assert_eq!((m.roughness, m.metallic), (1.0, 1.0), "maps stand in place of numbers");
    assert_eq!(texel(&scene, m.metallic_roughness_texture), (2, 2, [255, 51, 255, 255]));
    let (m, scene) = material("Pm 0.25\nmap_Ns grey.png\n");
    assert_eq!((m.roughness, m.metallic), (1.0, 0.25));
    assert_eq!(texel(&scene, m.metallic_roughness_texture), (1, 2, [255, 51, 255, 255]));
    let (m, scene) = material("map_Kd color.png\nmap_d grey.png\n");
    assert_eq!(m.alpha_mode, AlphaMode::Blend);
    assert_eq!(texel(&scene, m.base_color_texture), (2, 2, [10, 200, 30, 51]), "opacity as grey");
    let (m, scene) = material("Kd 1 0 0\nmap_d holes.png\n");
    assert_eq!(m.base_color, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(texel(&scene, m.base_color_texture), (2, 2, [255, 255, 255, 77]), "opacity as alpha");
    let (m, scene) = material("Ks 0 0 0\nmap_Ks grey.png\n");
    let specular = m.extensions.unwrap().specular.unwrap();
    assert_eq!((specular.factor, specular.color), (1.0, [2.0; 3]));
    assert_eq!(texel(&scene, specular.texture), (1, 2, [255, 255, 255, 51]));
    assert_eq!(material("map_Ke color.png\n").0.emissive, [1.0; 3]);
    let (m, scene) = material("norm -bm 0.5 color.png\nbump grey.png\n");
    assert_eq!((m.normal_scale, m.normal_texture.is_some()), (0.5, true));
    assert!(
        scene.warnings.iter().any(|w| w.contains("`m`") && w.contains("heights")),
        "{:?}",
        scene.warnings
    );
    assert!(material("bump color.png\n").0.normal_texture.is_some(), "a bump map with colours holds normals");
    let (m, scene) = material("map_Kd color.png\nmap_d -s 2 2 grey.png\n");
    assert_eq!(m.alpha_mode, AlphaMode::Opaque);
    assert!(scene.warnings.iter().any(|w| w.contains("map_d")), "{:?}", scene.warnings);
}

#[test]
fn broken_files() {
    let bad = |text: &str, words: &[&str]| refused(&[("bad.obj", text.as_bytes())], words);
    bad(&format!("{QUAD}f 1 2 9\n"), &["line 5", "index 9", "4"]);
    bad(&format!("{QUAD}f 1 2 0\n"), &["line 5", "index 0"]);
    bad(&format!("{QUAD}f 1 2 -5\n"), &["line 5", "index -5"]);
    bad(&format!("{QUAD}f 1/7 2/1 3/1\n"), &["line 5", "index 7"]);
    bad(&format!("{QUAD}f 1 2\n"), &["line 5", "3 corners"]);
    bad(&format!("{QUAD}f a b c\n"), &["line 5", "integers"]);
    bad("v 0 nan 0\n", &["line 1", "finite"]);
    bad("v 0 1e99 0\n", &["line 1", "finite"]);
    bad("v 0\n", &["line 1", "3 numbers"]);
    let many: String = (0..70).map(|i| format!("mtllib {i}.mtl\n")).collect();
    bad(&many, &["line 65", "at most 64"]);
    let files: [(&str, &[u8]); 3] =
        [("bad.obj", b"mtllib a.mtl\n"), ("a.mtl", b"newmtl a\nmap_Kd x.png\n"), ("x.png", b"no picture")];
    refused(&files, &["a.mtl line 2", "x.png"]);
    let files: [(&str, &[u8]); 2] = [("bad.obj", b"mtllib a.mtl\n"), ("a.mtl", b"newmtl a\nKd x\n")];
    refused(&files, &["a.mtl line 2", "number"]);
}

#[test]
fn a_missing_picture_is_a_warning_and_the_colour_stays() {
    let (m, scene) = material("Kd 0.1 0.2 0.3\nmap_Kd none.png\n");
    assert!(m.base_color_texture.is_none() && (m.base_color[2] - 0.3).abs() < 1e-6, "{:?}", m.base_color);
    let told = scene.warnings.iter().any(|w| w.contains("none.png") && w.contains("line"));
    assert!(told, "{:?}", scene.warnings);
}

#[test]
fn a_picture_elsewhere_is_taken_from_beside_the_library() {
    for path in ["C:\\Users\\x\\color.png", "/home/x/color.png", "../color.png", "maps/color.png"] {
        let (m, scene) = material(&format!("map_Kd {path}\n"));
        let told = scene.warnings.iter().filter(|w| w.contains("beside the library is taken")).count();
        assert!(m.base_color_texture.is_some() && told == 1, "{path}: {:?}", scene.warnings);
        let (m, scene) = material(&format!("map_Kd {}\n", path.replace("color", "none")));
        assert!(m.base_color_texture.is_none() && scene.warnings.len() == 1, "{path}: {:?}", scene.warnings);
    }
}

#[test]
fn a_missing_library_is_a_warning_and_points_are_found_by_the_check() {
    let scene = obj(&format!("mtllib none.mtl\n{QUAD}"));
    assert!(scene.warnings.iter().any(|w| w.contains("none.mtl")), "{:?}", scene.warnings);
    let text = scene.validate_for_fit().unwrap_err().to_string();
    assert!(text.contains("4 points only"), "{text}");
}

#[test]
fn names_in_latin_1_are_those_in_utf_8() {
    // The library is UTF-8, the asset Latin-1; two materials differ in such a letter alone.
    let mtl = "newmtl K\u{f6}rper\nKd 1 0 0\nnewmtl K\u{e4}rper\nKd 0 1 0\n";
    let text =
        format!("mtllib gr\u{fc}n.mtl\n{QUAD}usemtl K\u{e4}rper\nf 1 2 3\nusemtl K\u{f6}rper\nf 1 3 4\n");
    let latin: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    for text in [text.as_bytes(), &latin] {
        let scene = load_files(&[("a.obj", text), ("gr\u{fc}n.mtl", mtl.as_bytes())]).unwrap();
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let colors = scene.primitives.iter().map(|p| scene.materials[p.material].base_color);
        assert_eq!(colors.collect::<Vec<_>>(), [[0.0, 1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]]);
    }
}

#[test]
fn normals_that_are_no_numbers_are_computed() {
    let scene = obj(&format!("{QUAD}vn 0 0 1\nvn nan 0 1\nf 1//1 2//2 3//1\n"));
    assert_eq!(scene.primitives[0].mesh.normals, [vec3(0.0, 0.0, 1.0); 3]);
    assert_eq!(scene.warnings, ["normals without a direction: 1, which are computed"]);
}

#[test]
fn several_libraries_may_stand_on_a_line_and_names_may_have_spaces() {
    let use_both = format!("{QUAD}usemtl red\nf 1 2 3\nusemtl green\nf 1 3 4\n");
    let (red, green): (&[u8], &[u8]) = (b"newmtl red\nKd 1 0 0\n", b"\xef\xbb\xbfnewmtl green\nKd 0 1 0\n");
    let colors = |line: &str, files: &[(&str, &[u8])]| {
        let text = format!("{line}\n{use_both}");
        let scene = load_files(&[&[("a.obj", text.as_bytes())], files].concat()).unwrap();
        assert!(scene.warnings.is_empty(), "{line}: {:?}", scene.warnings);
        scene.primitives.iter().map(|p| scene.materials[p.material].base_color).collect::<Vec<_>>()
    };
    let wanted = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]];
    assert_eq!(colors("mtllib r.mtl  g.mtl", &[("r.mtl", red), ("g.mtl", green)]), wanted);
    let both = [red, b"newmtl green\nKd 0 1 0\n"].concat();
    assert_eq!(colors("mtllib my colours.mtl", &[("my colours.mtl", &both)]), wanted);
    // The name before the list.
    let other: &[u8] = b"newmtl red\nKd 0 0 1\nnewmtl green\nKd 0 0 1\n";
    assert_eq!(colors("mtllib my c.mtl", &[("my c.mtl", &both), ("c.mtl", other)]), wanted);
    // One of a list, or a list, again.
    let text = format!("mtllib r.mtl g.mtl\nmtllib g.mtl\nmtllib r.mtl r.mtl g.mtl\n{use_both}");
    let twice = load_files(&[("a.obj", text.as_bytes()), ("r.mtl", red), ("g.mtl", green)]).unwrap();
    assert_eq!(twice.materials.len(), 2, "each is read once");
    let many: String = (0..70).map(|k| format!(" {k}.mtl")).collect();
    let text = format!("mtllib{many}\n{use_both}");
    let error = load_files(&[("a.obj", text.as_bytes()), ("3.mtl", red)]).unwrap_err().to_string();
    assert!(error.contains("line 1") && error.contains("at most 64"), "{error}");
    // In two bytes each nothing can be read, which is told.
    let wide: Vec<u8> = "\u{feff}newmtl red\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let text = format!("mtllib r.mtl\n{use_both}");
    let scene = load_files(&[("a.obj", text.as_bytes()), ("r.mtl", &wide)]).unwrap();
    assert!(
        scene.warnings.iter().any(|w| w.contains("r.mtl") && w.contains("no material")),
        "{:?}",
        scene.warnings
    );
}

/// Files that nothing uses are files of the asset, too: no output may take their place.
#[test]
fn files_that_are_only_named_are_known() {
    let files: [(&str, &[u8]); 4] = [
        ("a.obj", b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"),
        ("a.mtl", b"newmtl m\ndisp d.png\nrefl -type sphere r.png\ndecal gone.png\n"),
        ("d.png", b"-"),
        ("r.png", b"-"),
    ];
    let scene = load_files(&files).unwrap();
    let names: Vec<_> = scene.files.iter().map(|f| f.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["a.mtl", "d.png", "r.png"]);
}
