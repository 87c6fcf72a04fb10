//! Clouds made on the spot: every encoding holds the same points, and broken files are refused by name and place.

use super::{Points, load_points_with};
use crate::{Limits, SceneError};
use photofit_scalar::{Vec3f, vec3};

fn read_with(name: &str, bytes: &[u8], limits: &Limits) -> Result<Points, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load_points_with(path, limits)
}

fn read(name: &str, bytes: &[u8]) -> Result<Points, SceneError> {
    read_with(name, bytes, &Limits::default())
}

fn refused(name: &str, bytes: &[u8], words: &[&str]) {
    let text = match read(name, bytes) {
        Ok(_) => panic!("{name} is accepted; expected {words:?}"),
        Err(e) => e.to_string(),
    };
    assert!(text.contains(name) && !text.contains('\n'), "one line with the name: {text}");
    for word in words {
        assert!(text.contains(word), "says `{word}`: {text}");
    }
}

const HEAD: &str = "# .PCD v0.7 - a comment\nVERSION 0.7\nFIELDS x y z rgba _ normal_x normal_y normal_z label\n\
    SIZE 4 8 4 4 1 4 4 4 2\nTYPE F F F U U F F F I\nCOUNT 1 1 1 1 3 1 1 1 1\nWIDTH 2\nHEIGHT 2\n\
    VIEWPOINT 1 2 3 0 1 0 0\nPOINTS 4\n";

/// The numbers of four points; the third has no measurement.
fn records() -> Vec<(f32, f64, f32, u32, [f32; 3])> {
    let up = [0.0, 0.0, 2.0];
    vec![
        (1.0, 2.0, 3.0, 0xff_80_40_20, up),
        (-1.5, 0.25, 4.0, 0x00_ff_ff_ff, up),
        (f32::NAN, 0.0, 0.0, 0, up),
        (0.0, -2.0, 8.0, 0, [0.0; 3]),
    ]
}

fn field_bytes(r: &(f32, f64, f32, u32, [f32; 3])) -> Vec<Vec<u8>> {
    let mut out = vec![
        r.0.to_le_bytes().to_vec(),
        r.1.to_le_bytes().to_vec(),
        r.2.to_le_bytes().to_vec(),
        r.3.to_le_bytes().to_vec(),
        vec![9, 9, 9],
    ];
    out.extend(r.4.iter().map(|n| n.to_le_bytes().to_vec()));
    out.push((-5_i16).to_le_bytes().to_vec());
    out
}

fn ascii() -> Vec<u8> {
    let mut text = HEAD.to_owned() + "DATA ascii\n";
    for (x, y, z, c, n) in records() {
        text += &format!("{x} {y} {z} {c} 9 9 9 {} {} {} -5\n", n[0], n[1], n[2]);
    }
    text.into_bytes()
}

fn binary() -> Vec<u8> {
    let mut out = (HEAD.to_owned() + "DATA binary\n").into_bytes();
    records().iter().for_each(|r| out.extend(field_bytes(r).concat()));
    out
}

/// Compressed with literals alone, which any expander reads.
fn compressed() -> Vec<u8> {
    let mut out = (HEAD.to_owned() + "DATA binary_compressed\n").into_bytes();
    let fields: Vec<Vec<Vec<u8>>> = records().iter().map(field_bytes).collect();
    let plain: Vec<u8> = (0..9).flat_map(|f| fields.iter().flat_map(move |r| r[f].clone())).collect();
    let packed: Vec<u8> =
        plain.chunks(32).flat_map(|c| std::iter::once(c.len() as u8 - 1).chain(c.iter().copied())).collect();
    out.extend((packed.len() as u32).to_le_bytes());
    out.extend((plain.len() as u32).to_le_bytes());
    out.extend(packed);
    out
}

#[test]
fn the_encodings_of_pcd_hold_the_same() {
    for (what, bytes) in [("ascii", ascii()), ("binary", binary()), ("compressed", compressed())] {
        let points = read("a.pcd", &bytes).unwrap();
        assert_eq!(points.skipped, 1, "{what}");
        assert_eq!(
            points.positions,
            [vec3(1.0, 2.0, 3.0), vec3(-1.5, 0.25, 4.0), vec3(0.0, -2.0, 8.0)],
            "{what}"
        );
        assert_eq!(points.normals[0], vec3(0.0, 0.0, 1.0), "{what}: unit length");
        assert_eq!(points.normals[2], Vec3f::zero(), "{what}: none");
        let red = photofit_image::srgb_u8_to_linear(0x80);
        assert_eq!((points.colors[0].x, points.colors[1]), (red, Vec3f::splat(1.0)), "{what}");
        assert_eq!(points.warnings, ["the field `label` is ignored"], "{what}");
        // The points lie behind the pose of the header and in front of the identity.
        assert_eq!(points.sensor.unwrap().axes[2], [0.0, 0.0, 1.0], "{what}");
    }
}

#[test]
fn the_pose_of_a_sensor_is_read() {
    let before = String::from_utf8(ascii()).unwrap().replace("VIEWPOINT 1 2 3", "VIEWPOINT 1 2 9");
    let sensor = read("a.pcd", before.as_bytes()).unwrap().sensor.unwrap();
    assert_eq!(sensor.eye, [1.0, 2.0, 9.0]);
    // A half turn around x.
    assert_eq!(sensor.axes, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
    let amid = before.replace("VIEWPOINT 1 2 9", "VIEWPOINT 0 0 3.5").replace("0 -2 8 ", "0 -2 -8 ");
    assert_eq!(read("a.pcd", amid.as_bytes()).unwrap().sensor, None, "no pose has the points before it");
}

#[test]
fn packed_float_colours_are_their_bits() {
    let packed = f32::from_bits(0x00_20_40_80);
    let text = format!(
        "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n0 0 1 {packed:e}\n"
    );
    let points = read("a.pcd", text.as_bytes()).unwrap();
    assert_eq!(points.colors[0].z, photofit_image::srgb_u8_to_linear(0x80));
    assert_eq!(points.colors[0].x, photofit_image::srgb_u8_to_linear(0x20));
    assert_eq!(points.sensor, None, "a row of points is no image");
}

fn ply(kind: &str, rows: &[[f64; 3]]) -> Vec<u8> {
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\n\
        property {kind} z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        rows.len()
    )
    .into_bytes();
    for row in rows {
        for x in row {
            if kind == "double" {
                out.extend(x.to_le_bytes());
            } else {
                out.extend((*x as f32).to_le_bytes());
            }
        }
        out.extend([255, 0, 128]);
    }
    out
}

#[test]
fn survey_coordinates_keep_their_digits() {
    let rows = [[3.5e6 + 0.001, 5.8e6, 100.0], [3.5e6 + 1.002, 5.8e6 + 2.0, 101.5]];
    let points = read("a.ply", &ply("double", &rows)).unwrap();
    for (p, row) in points.positions.iter().zip(rows) {
        for k in 0..3 {
            assert!((f64::from(p[k]) + points.origin[k] - row[k]).abs() < 1e-6, "{p:?}");
        }
    }
    assert_eq!(points.colors[1].x, 1.0);
    let near =
        read("a.ply", &ply("float", &[[0.0, 1.0, 2.0], [1.0, f64::NAN, 1.0], [4.0, 4.0, 4.0]])).unwrap();
    assert_eq!((near.origin, near.positions.len(), near.skipped), ([0.0; 3], 2, 1));
}

#[test]
fn meshes_are_read_as_their_vertices() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 3 0\n3 0 1 2\n";
    let points = read("a.ply", text.as_bytes()).unwrap();
    assert_eq!((points.positions.len(), points.normals[2]), (3, vec3(0.0, 1.0, 0.0)));
}

#[test]
fn broken_pcd_files() {
    let good = String::from_utf8(ascii()).unwrap();
    let swap = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1).into_bytes()
    };
    let bad = |bytes: &[u8], words: &[&str]| refused("bad.pcd", bytes, words);
    bad(b"", &["empty"]);
    bad(b"hello", &["header line 1", "DATA"]);
    bad(b"hello\n", &["header line 1", "`hello`"]);
    bad(&swap("FIELDS x", "FIELDS w"), &["FIELDS", "x, y and z"]);
    bad(&swap("SIZE 4", "SIZE 3"), &["field x"]);
    bad(&swap("SIZE 4 ", "SIZE "), &["header line 4", "SIZE"]);
    bad(&swap("TYPE F", "TYPE Q"), &["field x", "Q4"]);
    bad(&swap("COUNT 1 1 1 1 3", "COUNT 1 1 1 1 99999999"), &["field _"]);
    bad(&swap("WIDTH 2", "WIDTH -2"), &["header line", "count"]);
    bad(&swap("POINTS 4", "POINTS 5"), &["POINTS", "2 x 2"]);
    bad(&swap("DATA ascii", "DATA morse"), &["DATA is `morse`; it must be ascii, binary"]);
    bad(&swap("WIDTH 2", "WIDTH 4000000000"), &["POINTS"]);
    bad(&swap("ascii\n1 2 3", "ascii\n1 2"), &["point 0", "11 numbers"]);
    bad(&swap("ascii\n1 2 3", "ascii\n1 x 3"), &["point 0", "`x`"]);
    let huge = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4000000000\nHEIGHT 4000000000\nDATA binary\n";
    bad(huge.as_bytes(), &["at most 64000000 points"]);
    let claim = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 50000000\nHEIGHT 1\nDATA binary\nxxxx";
    bad(claim.as_bytes(), &["50000000 points of 12 bytes"]);
    bad(claim.replace("binary", "ascii").as_bytes(), &["50000000 points"]);
    let bomb = claim.replace("binary", "binary_compressed").replace("xxxx", "");
    let mut bomb = bomb.into_bytes();
    bomb.extend([4, 0, 0, 0]);
    bomb.extend(600_000_000_u32.to_le_bytes());
    bomb.extend([1, 2, 3, 4]);
    bad(&bomb, &["4 compressed bytes", "600000000"]);
    let all = binary();
    bad(&all[..all.len() - 1], &["4 points of"]);
    let mut packed = compressed();
    let at = packed.len() - 100;
    packed[at..].fill(255);
    bad(&packed, &["LZF"]);
    let none = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\nnan nan nan\n";
    bad(none.as_bytes(), &["none of 1 points has finite coordinates"]);
    bad(none.replace("WIDTH 1", "WIDTH 0").as_bytes(), &["has no point; it must have at least one point"]);
}

#[test]
fn other_bad_files() {
    refused("a.laz", b"LASF", &[".ply or .pcd", "laz"]);
    refused("a.ply", b"hello", &["`ply`"]);
    refused("a.ply", b"ply\nformat ascii 1.0\nend_header\n", &["element `vertex`"]);
    refused(
        "a.ply",
        b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        &["at least one point"],
    );
    let small = Limits { vertices: 1, ..Limits::default() };
    for (name, bytes) in [("a.pcd", ascii()), ("a.ply", ply("float", &[[0.0; 3], [1.0; 3]]))] {
        let text = read_with(name, &bytes, &small).unwrap_err().to_string();
        assert!(text.contains("at most 1 "), "{text}");
    }
}

#[test]
fn random_damage_never_panics() {
    for (name, good) in [
        ("a.pcd", ascii()),
        ("a.pcd", binary()),
        ("a.pcd", compressed()),
        ("a.ply", ply("double", &[[1.0, 2.0, 3.0]; 3])),
    ] {
        let mut state = 1_u32;
        for _ in 0..400 {
            let mut bytes = good.clone();
            for _ in 0..3 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let at = state as usize % bytes.len();
                bytes[at] ^= (state >> 24) as u8;
            }
            // Errors and clouds are both fine.
            let _ = super::parse(std::path::Path::new(name), &bytes, &Limits::default());
        }
    }
}
