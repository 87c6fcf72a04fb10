//! PLY encodings with known results, and broken files.

use super::{load_files, png, refused};
use photofit_scalar::{vec2, vec3};

const HEADER: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nproperty double s\nproperty double t\n\
    element face 2\nproperty list uchar int vertex_indices\nproperty int flags\nend_header\n";

/// A quad, then a triangle, in one of the encodings.
fn encoded(format: &str) -> Vec<u8> {
    let mut out = format!("ply\nformat {format} 1.0\ncomment made here\n{HEADER}").into_bytes();
    let big = format == "binary_big_endian";
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    if format == "ascii" {
        for (x, y) in corners {
            out.extend_from_slice(format!("{x} {y} 0 255 0 188 {x} {y}\n").as_bytes());
        }
        out.extend_from_slice(b"4 0 1 2 3 7\n3 0 1 2 7\n");
        return out;
    }
    let mut put = |bytes: &[u8]| {
        let mut b = bytes.to_vec();
        if big {
            b.reverse();
        }
        out.extend_from_slice(&b);
    };
    for (x, y) in corners {
        for v in [x, y, 0.0] {
            put(&(v as f32).to_le_bytes());
        }
        for c in [255_u8, 0, 188] {
            put(&[c]);
        }
        for t in [x, y] {
            put(&f64::to_le_bytes(t));
        }
    }
    for face in [&[0, 1, 2, 3][..], &[0, 1, 2]] {
        put(&[face.len() as u8]);
        for i in face.iter().chain(&[7]) {
            put(&i32::to_le_bytes(*i));
        }
    }
    out
}

#[test]
fn all_encodings_say_the_same() {
    let scenes: Vec<_> = ["ascii", "binary_little_endian", "binary_big_endian"]
        .map(|f| load_files(&[("a.ply", &encoded(f))]).unwrap())
        .into();
    for scene in &scenes {
        assert_eq!(scene.primitives, scenes[0].primitives);
        let mesh = &scene.primitives[0].mesh;
        // The diagonal has three faces: a hard edge, at which the vertices 0 and 2 are split.
        assert_eq!(mesh.triangles, [[0, 1, 2], [4, 5, 3], [0, 1, 2]]);
        assert_eq!(mesh.positions[4..], [mesh.positions[0], mesh.positions[2]]);
        assert_eq!((mesh.positions[2], mesh.normals[2]), (vec3(1.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0)));
        assert_eq!(mesh.uvs[1], vec2(1.0, 1.0), "v is turned");
        assert!((mesh.colors[0].z - photofit_image::srgb_u8_to_linear(188)).abs() < 1e-6);
        assert_eq!(scene.materials[0].base_color, [1.0; 4]);
    }
}

#[test]
fn strips_with_restarts() {
    let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n9 0 1 2 3 -1 2 3 4 -1\n";
    let scene = load_files(&[("a.ply", text.as_bytes())]).unwrap();
    assert_eq!(scene.primitives[0].mesh.triangles, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert!(scene.primitives[0].mesh.normals.iter().all(|n| n.z > 0.99), "all face the same way");
}

#[test]
fn corner_coordinates_split_vertices() {
    let text = "ply\r\nformat ascii 1.0\r\ncomment TextureFile a.png\r\nelement vertex 4\r\nproperty float x\r\n\
        property float y\r\nproperty float z\r\nelement face 2\r\nproperty list uchar int vertex_indices\r\n\
        property list uchar float texcoord\r\nend_header\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n\
        3 0 1 2 6 0 0 1 0 1 1\r\n3 0 2 3 6 0.5 0 1 1 0 1\r\n";
    let picture = png(1, 1, [7; 4]);
    let scene = load_files(&[("a.ply", text.as_bytes()), ("a.png", &picture)]).unwrap();
    let mesh = &scene.primitives[0].mesh;
    assert_eq!((mesh.positions.len(), mesh.uvs.len(), mesh.triangles.len()), (5, 5, 2));
    assert!(scene.materials[0].base_color_texture.is_some());
}

#[test]
fn faces_look_where_their_normals_point() {
    // Two triangles of one plane, the second one wound the other way round.
    let header = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nelement face 2\n\
        property list uchar int vertex_indices\nend_header\n";
    let vertices = "0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n4 0 0 0 0 1\n5 0 0 0 0 1\n4 1 0 0 0 1\n";
    let ply = format!("{header}{vertices}3 0 1 2\n3 3 5 4\n");
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 4 0 0\nv 5 0 0\nv 4 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 4//1 6//1 5//1\n";
    for (name, text) in [("a.ply", ply.as_str()), ("a.obj", obj)] {
        let scene = load_files(&[(name, text.as_bytes())]).unwrap();
        let mesh = &scene.primitives[0].mesh;
        for t in 0..2 {
            let [a, b, c] = mesh.corners(t);
            assert!((b - a).cross(c - a).z > 0.0, "{name}, triangle {t}: {:?}", mesh.triangles);
        }
        let told = scene
            .warnings
            .iter()
            .any(|w| w == "faces that look away from their normals: 1, which are turned");
        assert!(told, "{name}: {:?}", scene.warnings);
    }
}

#[test]
fn clouds_are_loadable_and_found_by_the_check() {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 2 3\n";
    let scene = load_files(&[("a.ply", text.as_bytes())]).unwrap();
    assert_eq!(scene.primitives[0].mesh.positions.len(), 2);
    assert!(scene.validate_for_fit().unwrap_err().to_string().contains("2 points only"));
}

#[test]
fn broken_files() {
    let bad = |bytes: &[u8], words: &[&str]| refused(&[("bad.ply", bytes)], words);
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let good = encoded(format);
        let body = good.len() - 20;
        bad(&good[..body], &["element face"]);
        bad(&good[..60], &["header"]);
    }
    let swap = |from: &str, to: &str| {
        String::from_utf8(encoded("ascii")).unwrap().replacen(from, to, 1).into_bytes()
    };
    bad(&swap("vertex 4", "vertex 4000000000"), &["element vertex", "4000000000"]);
    bad(&swap("vertex 4", "vertex 99999999999999999999"), &["header line 4", "count"]);
    bad(&swap("face 2", "face 18446744073709551615"), &["element face"]);
    bad(&swap("4 0 1 2 3", "4 0 1 2 4"), &["element face 0", "index 4", "4 vertices"]);
    bad(&swap("4 0 1 2 3", "4 0 1 2 -1"), &["element face 0", "index -1"]);
    bad(&swap("4 0 1 2 3", "400000000 0 1 2 3"), &["element face 0", "list of 400000000"]);
    bad(&swap("0 0 0 255", "0 nan 0 255"), &["element vertex 0", "finite"]);
    bad(&swap("0 0 0 255", "0 x 0 255"), &["element vertex 0", "`x` is no number"]);
    bad(&swap("float x", "quad x"), &["header line", "PLY type"]);
    bad(&swap("float x", "float w"), &["element vertex", "x, y and z"]);
    bad(&swap("list uchar int", "list float int"), &["header line", "is a float; it must be an integer"]);
    bad(b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", &["header line 3", "follows no element"]);
    bad(&swap("format ascii", "format morse"), &["header line 2", "morse"]);
    bad(&swap("format ascii 1.0\n", "\n"), &["header", "format"]);
    bad(b"ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n", &["element vertex", "properties"]);
    let twice = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n0 0 0\n";
    bad(twice.as_bytes(), &["element vertex", "once"]);
    let mut little = encoded("binary_little_endian");
    // The first face claims 255 corners.
    let face = little.len() - (1 + 4 * 5) - (1 + 4 * 4);
    little[face] = 255;
    bad(&little, &["element face 0", "255"]);
}
