//! Which way up pictures lie on meshes of every format.

use super::*;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write;

/// The unit square in `z = 0` with texture coordinates `(x, y)`, as `q.obj`, `q.ply` and `q.serialized`, and `b.pfm`: rows .1 .2
/// and, below it, .3 .4.
fn write_square(folder: &Path) {
    let corners = [[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let lines = |f: &dyn Fn(&[f32; 2]) -> String| corners.iter().map(f).collect::<String>();
    let obj = lines(&|[x, y]| format!("v {x} {y} 0\nvt {x} {y}\n")) + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    let properties: String = ["x", "y", "z", "u", "v"].map(|p| format!("property float {p}\n")).concat();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\n{properties}element face 2\nproperty list uchar int vertex_indices\n\
         end_header\n{}3 0 1 2\n3 0 2 3\n",
        lines(&|[x, y]| format!("{x} {y} 0 {x} {y}\n"))
    );
    // Single precision with texture coordinates, no name, 4 vertices, 2 triangles.
    let mut data = 0x1002_u32.to_le_bytes().to_vec();
    data.push(0);
    [4_u64, 2].iter().for_each(|n| data.extend(n.to_le_bytes()));
    corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]).for_each(|v| data.extend(v.to_le_bytes()));
    corners.as_flattened().iter().for_each(|v| data.extend(v.to_le_bytes()));
    [0_u32, 1, 2, 0, 2, 3].iter().for_each(|i| data.extend(i.to_le_bytes()));
    let mut packer = ZlibEncoder::new(vec![0x1c, 0x04, 4, 0], Compression::fast());
    packer.write_all(&data).unwrap();
    let mut pfm = b"Pf\n2 2\n-1\n".to_vec();
    [0.3_f32, 0.4, 0.1, 0.2].iter().for_each(|v| pfm.extend(v.to_le_bytes()));
    let serialized = packer.finish().unwrap();
    let files: [(&str, &[u8]); 4] = [
        ("q.obj", obj.as_bytes()),
        ("q.ply", ply.as_bytes()),
        ("q.serialized", &serialized),
        ("b.pfm", &pfm),
    ];
    files.iter().for_each(|(name, bytes)| fs::write(folder.join(name), bytes).unwrap());
}

#[test]
fn pictures_lie_on_meshes_as_in_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    write_square(folder.path());
    let load = |kind: &str, flip: &str, transform: &str| {
        let text = format!(
            "<scene version='3.0.0'>{SENSOR}<shape type='{kind}'><string name='filename' value='q.{kind}'/>{flip}
             <bsdf type='diffuse'><texture name='reflectance' type='bitmap'><string name='filename' value='b.pfm'/>
             <string name='filter_type' value='nearest'/><transform name='to_uv'>{transform}</transform></texture>
             </bsdf></shape></scene>"
        );
        fs::write(folder.path().join("s.xml"), text).unwrap();
        load_mitsuba(folder.path().join("s.xml"), &MitsubaOptions::default()).map_err(|e| e.to_string())
    };
    // Values of Mitsuba 3.9.1 at these places of the square, for formats that have row 0 at v = 0 and those with v = 1 there.
    let places = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
    let table = [
        ("", [0.1, 0.2, 0.3, 0.4], [0.3, 0.4, 0.1, 0.2]),
        ("<scale x='1' y='0.5'/>", [0.1, 0.2, 0.1, 0.2], [0.1, 0.2, 0.1, 0.2]),
        ("<translate y='0.5'/>", [0.3, 0.4, 0.1, 0.2], [0.1, 0.2, 0.3, 0.4]),
        ("<rotate z='1' angle='90'/>", [0.2, 0.4, 0.1, 0.3], [0.1, 0.3, 0.2, 0.4]),
    ];
    let flip = |value: bool| format!("<boolean name='flip_tex_coords' value='{value}'/>");
    let (yes, no) = (flip(true), flip(false));
    let formats = [
        ("obj", "", true),
        ("obj", &no, false),
        ("obj", &yes, true),
        ("ply", "", false),
        ("ply", &no, false),
        ("ply", &yes, true),
        ("serialized", "", false),
    ];
    for (kind, flip, turned) in formats {
        for (transform, straight, upside) in table {
            let s = load(kind, flip, transform).unwrap();
            let MitsubaShape::Mesh(mesh) = &s.shapes[0] else { panic!("a mesh") };
            let SurfaceNode::Diffuse { reflectance } = &s.materials[0].root else { panic!("textured") };
            let corner =
                |x: f32, y: f32| mesh.uvs[mesh.positions.iter().position(|p| (p.x, p.y) == (x, y)).unwrap()];
            let o = corner(0.0, 0.0);
            let found = places.map(|(x, y)| {
                let uv = o + (corner(1.0, 0.0) - o) * x + (corner(0.0, 1.0) - o) * y;
                reflectance.color(&SurfacePoint { uv, color: Vec4f::splat(1.0), piece: 0 }).x
            });
            assert_eq!(found, if turned { upside } else { straight }, "{kind} {flip} {transform}");
        }
    }
    let text = load("serialized", &yes, "").unwrap_err();
    assert!(text.contains("flip_tex_coords"), "as Mitsuba: {text}");
}
