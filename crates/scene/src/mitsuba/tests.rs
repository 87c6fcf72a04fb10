//! Small scenes written by the tests: what is read, and what is refused.

mod distances;
mod projected;
mod uvs;

use super::*;
use crate::graph::{SurfaceNode, SurfacePoint, Texture};
use crate::{LightKind, Limits};
use glam::DVec3;
use photofit_scalar::{Vec4f, vec2, vec3};
use photofit_shading::bsdf::Bsdf;
use std::fs;

const SENSOR: &str = r#"<sensor type="perspective"><float name="fov" value="90"/>
  <transform name="to_world"><lookat origin="0,0,-5" target="0,0,0" up="0,1,0"/></transform>
  <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
  <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="20"/>
  <rfilter type="box"/></film></sensor>"#;

/// Loads a scene of these elements from a folder of its own.
fn load_text(body: &str) -> Result<MitsubaScene, String> {
    load_files(&[("scene.xml", &format!("<scene version=\"3.0.0\">{body}</scene>"))], &[])
}

fn load_files(files: &[(&str, &str)], parameters: &[(&str, &str)]) -> Result<MitsubaScene, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let parameters = parameters.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
    let options = MitsubaOptions { parameters, ..MitsubaOptions::default() };
    load_mitsuba(folder.path().join(files[0].0), &options).map_err(|e| e.to_string())
}

fn scene(body: &str) -> MitsubaScene {
    load_text(&format!("{SENSOR}{body}")).unwrap()
}

#[test]
fn one_of_several_sensors_sees() {
    let second = SENSOR.replace("value=\"90\"", "value=\"45\"");
    let text = format!("<scene version=\"3.0.0\">{SENSOR}{second}</scene>");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.xml");
    fs::write(&file, text).unwrap();
    let of = |sensor| load_mitsuba(&file, &MitsubaOptions { sensor, ..MitsubaOptions::default() });
    let half = |sensor| of(sensor).unwrap().sensor.half[0];
    assert!((half(0) - 1.0).abs() < 1e-9 && (half(1) - 22.5_f64.to_radians().tan()).abs() < 1e-9);
    assert_eq!(of(0).unwrap().sensors, 2);
    let text = of(2).unwrap_err().to_string();
    assert!(
        text.contains("scene.xml") && text.contains("has 2 sensors") && text.contains("number 2"),
        "{text}"
    );
}

#[test]
fn the_sensor_sees_what_mitsuba_sees() {
    let s = scene("").sensor;
    assert_eq!(s.eye, DVec3::new(0.0, 0.0, -5.0));
    // Seen along +z with y up, -x lies to the right.
    assert!((s.axes[0] - DVec3::NEG_X).length() < 1e-12 && (s.axes[2] - DVec3::NEG_Z).length() < 1e-12);
    assert!((s.half[0] - 1.0).abs() < 1e-9 && (s.half[1] - 0.5).abs() < 1e-9, "{:?}", s.half);
    assert_eq!((s.film.size, s.samples, s.film.filter), ([40, 20], 8, MitsubaFilter::Box));
    let of = |text: &str| {
        let text = format!("<sensor type='perspective'>{text}</sensor>");
        load_text(&text).unwrap().sensor
    };
    // The defaults: 50 mm, 768 x 576, Gaussian.
    let s = of("");
    assert!((2.0 * s.half[0].atan().to_degrees() - 38.1848).abs() < 1e-3, "{:?}", s.half);
    assert_eq!((s.film.size, s.film.filter), ([768, 576], MitsubaFilter::Gaussian(0.5)));
    let fov = "<float name='fov' value='60'/>";
    let tan = 30.0_f64.to_radians().tan();
    for (axis, wanted) in [
        ("x", tan),
        ("y", tan * 4.0 / 3.0),
        ("smaller", tan * 4.0 / 3.0),
        ("larger", tan),
        ("diagonal", tan * 0.8),
    ] {
        let s = of(&format!("{fov}<string name='fov_axis' value='{axis}'/>"));
        assert!((s.half[0] - wanted).abs() < 1e-9, "{axis}: {:?}", s.half);
    }
    let s = of("<film type='hdrfilm'><integer name='width' value='100'/><integer name='height' value='50'/>
        <integer name='crop_offset_x' value='10'/><integer name='crop_width' value='20'/></film>
        <float name='principal_point_offset_x' value='0.25'/>");
    assert_eq!((s.film.crop_offset, s.film.crop_size, s.shift), ([10, 0], [20, 50], [0.25, 0.0]));
    let text =
        "<sensor type='orthographic'><transform name='to_world'><scale x='2' y='3'/></transform></sensor>";
    let s = load_text(text).unwrap().sensor;
    assert_eq!((s.projection, s.half), (Projection::Orthographic, [2.0, 2.25]));
}

#[test]
fn transforms_apply_in_order() {
    let s = scene(
        "<shape type='rectangle'><transform name='to_world'><scale value='2'/><rotate z='1' angle='90'/>
         <translate value='1,2,3'/></transform></shape>",
    );
    let p = s.instances[0].transform.transform_point3(DVec3::new(1.0, 0.0, 0.0));
    assert!((p - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-12, "{p}");
    let s = scene(
        "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 5 0 2 0 6 0 0 3 7 0 0 0 1'/>
         </transform></shape>",
    );
    let p = s.instances[0].transform.transform_point3(DVec3::ONE);
    assert_eq!(p, DVec3::new(6.0, 8.0, 10.0));
}

#[test]
fn parameters_includes_references_and_groups() {
    let main = format!(
        "<scene version='3.0.0'><default name='kind' value='sphere'/><include filename='parts/b.xml'/>{SENSOR}
         <shape type='shapegroup' id='g'><shape type='$kind'><ref id='m'/></shape><shape type='disk'/></shape>
         <shape type='instance'><ref id='g'/></shape>
         <shape type='instance'><ref id='g'/><transform name='to_world'><translate x='1'/></transform></shape>
         </scene>"
    );
    let part = "<scene version='3.0.0'><default name='kind' value='cube'/><bsdf type='diffuse' id='m'>
        <rgb name='reflectance' value='$grey'/></bsdf><default name='grey' value='0.1'/></scene>";
    let fails = load_files(&[("s.xml", &main), ("parts/b.xml", part)], &[]).unwrap_err();
    assert!(fails.contains("b.xml line 2") && fails.contains("grey"), "{fails}");
    let s = load_files(&[("s.xml", &main), ("parts/b.xml", part)], &[("grey", "0.25")]).unwrap();
    assert_eq!((s.shapes.len(), s.instances.len()), (2, 4));
    assert!(matches!(s.shapes[0], MitsubaShape::Sphere { radius: 1.0, .. }));
    assert_eq!(s.instances[2].transform.translation, DVec3::X);
    match s.materials[s.instances[0].material].root {
        SurfaceNode::Constant(Bsdf::Diffuse(d)) => assert_eq!(d.reflectance.x, 0.25),
        ref other => panic!("{other:?}"),
    }
    let text = load_files(&[("s.xml", &main), ("parts/b.xml", part)], &[("grey", "0"), ("gray", "0")]);
    assert!(text.unwrap_err().contains("gray"));
}

#[test]
fn meshes_keep_their_side_and_their_texture_coordinates() {
    // The winding contradicts the normals: the normals decide.
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nvn 0 0 -1\nusemtl nothing\nf 1/1/1 2/1/1 3/1/1\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float u\nproperty float v\nproperty float heat_0\nelement face 1\n\
        property list uchar int vertex_indices\nproperty float c_0\nproperty float c_1\nproperty float c_2\n\
        end_header\n0 0 0 0 0.25 7\n1 0 0 0 0.25 8\n0 1 0 0 0.25 9\n3 0 1 2 0.1 0.2 0.3\n";
    let body = format!(
        "<scene version='3.0.0'>{SENSOR}<shape type='obj'><string name='filename' value='m/a.obj'/></shape>
         <shape type='ply'><string name='filename' value='m/a.ply'/><bsdf type='diffuse'>
           <texture name='reflectance' type='mesh_attribute'><string name='name' value='face_c'/></texture>
         </bsdf></shape>
         <shape type='ply'><string name='filename' value='m/a.ply'/><boolean name='flip_normals' value='true'/>
         <bsdf type='blendbsdf'><bsdf type='diffuse'/><bsdf type='conductor'/>
           <texture name='weight' type='mesh_attribute'><string name='name' value='vertex_heat'/></texture>
         </bsdf></shape></scene>"
    );
    let s = load_files(&[("s.xml", &body), ("m/a.obj", obj), ("m/a.ply", ply)], &[]).unwrap();
    let mesh = |i: usize| match &s.shapes[i] {
        MitsubaShape::Mesh(m) => m,
        other => panic!("{other:?}"),
    };
    assert_eq!((mesh(0).triangles[0], mesh(0).uvs[0]), ([0, 2, 1], vec2(0.0, 0.75)));
    assert_eq!((mesh(1).uvs[0], mesh(1).normals[0]), (vec2(0.0, 0.25), vec3(0.0, 0.0, 1.0)));
    assert_eq!(mesh(2).normals[0], vec3(0.0, 0.0, -1.0));
    let at = SurfacePoint { uv: vec2(0.0, 0.0), color: Vec4f::splat(1.0), piece: 0 };
    match &s.materials[s.instances[1].material].root {
        SurfaceNode::Diffuse { reflectance } => assert_eq!(reflectance.color(&at), vec3(0.1, 0.2, 0.3)),
        other => panic!("{other:?}"),
    }
    assert_eq!(mesh(2).colors.iter().map(|c| c.x).collect::<Vec<_>>(), [7.0, 8.0, 9.0]);
}

#[test]
fn every_primitive_shows_its_front_outside() {
    for (kind, area) in [("rectangle", 4.0), ("cube", 24.0), ("disk", PI), ("cylinder", 2.0 * PI)] {
        let s = scene(&format!("<shape type='{kind}'/>"));
        let MitsubaShape::Mesh(m) = &s.shapes[0] else { panic!("a mesh") };
        let mut sum = 0.0_f64;
        for t in 0..m.triangles.len() {
            let [a, b, c] = m.corners(t).map(|p| p.cast::<f64>());
            let n = (b - a).cross(c - a);
            sum += 0.5 * n.length();
            for &i in &m.triangles[t] {
                assert!(n.dot(m.normals[i as usize].cast()) > 0.0, "{kind} {t}");
            }
        }
        assert!((sum - area).abs() < 1e-4 * area, "{kind}: {sum}");
        assert!(m.uvs.iter().all(|uv| (0.0..=1.0).contains(&uv.x) && (0.0..=1.0).contains(&uv.y)), "{kind}");
    }
    let s = scene("<shape type='sphere'><boolean name='flip_normals' value='true'/></shape>");
    let MitsubaShape::Mesh(m) = &s.shapes[0] else { panic!("a mesh") };
    assert!(m.positions.iter().zip(&m.normals).all(|(p, n)| p.dot(*n) < 0.0));
}

use std::f64::consts::PI;

#[test]
fn emitters_and_bounds() {
    let s = scene(
        "<emitter type='point'><point name='position' x='1' y='2' z='3'/><rgb name='intensity' value='4'/></emitter>
         <emitter type='spot'><float name='cutoff_angle' value='40'/></emitter>
         <emitter type='directional'><vector name='direction' value='0,0,-2'/></emitter>
         <emitter type='constant'><rgb name='radiance' value='1,2,3'/></emitter>
         <shape type='sphere'><emitter type='area'><rgb name='radiance' value='5'/></emitter></shape>
         <integrator type='moment'><integrator type='path'><integer name='max_depth' value='3'/></integrator>
         </integrator>",
    );
    assert_eq!(s.lights[0].position, glam::vec3(1.0, 2.0, 3.0));
    assert_eq!(s.lights[0].intensity, [4.0; 3]);
    let LightKind::Spot { inner, outer } = s.lights[1].kind else { panic!("a spot") };
    assert!((inner.to_degrees() - 30.0).abs() < 1e-4 && (outer.to_degrees() - 40.0).abs() < 1e-4);
    assert_eq!(s.lights[2].direction, glam::vec3(0.0, 0.0, -1.0));
    assert_eq!(s.environment.unwrap().image.data, [1.0, 2.0, 3.0]);
    let glow = s.materials[s.instances[0].material].emission.as_ref().unwrap();
    assert!(matches!(glow, Texture::Constant(c) if c.x == 5.0));
    assert_eq!(s.integrator.max_depth, 2);
}

#[test]
fn all_that_is_not_supported_is_listed_with_its_line() {
    let text = load_text(&format!(
        "{}\n<shape type='hair'/>\n<bsdf type='diffuse' id='x'><float name='sparkle' value='1'/>\
         <rgb name='reflectance' value='1'/><rgb name='reflectance' value='0'/></bsdf>\n\
         <shape type='sphere'><ref id='x'/></shape>\n<emitter type='sunsky'/><flower/>",
        SENSOR.replace('\n', " ")
    ))
    .unwrap_err();
    for part in [
        "line 2: shape `hair`",
        "line 3: the property `sparkle`",
        "line 3: a second `reflectance`",
        "line 5: emitter `sunsky`",
        "<flower>",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn bad_files_are_errors_that_name_the_line() {
    let deep = "<a>".repeat(100_000);
    let many = "<include filename='s.xml'/>";
    let cases: &[(&str, &str)] = &[
        ("", "sensor"),
        ("<sensor type='perspective'><float name='fov' value='nan'/></sensor>", "line 1"),
        ("<sensor type='perspective'><float name='fov' value='180'/></sensor>", "180"),
        (
            "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='65536'/>
             <integer name='height' value='65536'/></film></sensor>",
            "65536 x 65536 pixels, 4294967296; it may have 268435456",
        ),
        (
            "<sensor type='perspective'><film type='x'><integer name='width' value='0'/></film></sensor>",
            "width is 0; it must be 1 to",
        ),
        (
            "<bsdf type='diffuse' id='x'><rgb name='reflectance' value='#ff88'/></bsdf><shape type='cube'><ref id='x'/></shape>",
            "six hexadecimal",
        ),
        ("<shape type='obj'/>", "filename"),
        ("<shape type='obj'><string name='filename' value='/etc/passwd'/></shape>", "relative"),
        ("<shape type='obj'><string name='filename' value='none.obj'/></shape>", "none.obj"),
        ("<shape type='sphere'><float name='radius' value='-1'/></shape>", "positive"),
        ("<shape type='sphere'><ref id='nothing'/></shape>", "nothing"),
        ("<bsdf type='diffuse' id='a'/><bsdf type='diffuse' id='a'/>", "once"),
        (
            "<bsdf type='twosided' id='a'><ref id='a'/></bsdf><shape type='cube'><ref id='a'/></shape>",
            "nested",
        ),
        (
            "<shape type='sphere'><bsdf type='diffuse'><rgb name='reflectance' value='2'/></bsdf></shape>",
            "[0, 1]",
        ),
        (
            "<shape type='sphere'><bsdf type='diffuse'><rgb name='reflectance' value='1,2'/></bsdf></shape>",
            "3 numbers",
        ),
        ("<shape type='sphere'><transform name='to_world'><matrix value='1 2'/></transform></shape>", "16"),
        ("<shape type='sphere'><transform name='to_world'><rotate angle='5'/></transform></shape>", "axis"),
        ("<shape type='instance'><ref id='g'/></shape><shape type='sphere' id='g'/>", "shapegroup"),
        ("<integrator type='path'><integer name='max_depth' value='1e9'/></integrator>", "whole number"),
        ("<emitter type='constant'/><emitter type='constant'/>", "one environment"),
        (many, "include each other"),
        (&deep, "nested"),
        ("<&>", "XML"),
    ];
    for (body, part) in cases {
        let text =
            load_files(&[("s.xml", &format!("<scene version='3.0.0'>{body}</scene>"))], &[]).unwrap_err();
        assert!(text.contains(part) && text.contains("s.xml"), "{part} in {text}");
    }
    let bomb = "<!DOCTYPE s [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><scene version='3.0.0'>&b;</scene>";
    assert!(load_files(&[("s.xml", bomb)], &[]).is_err());
    assert!(load_files(&[("s.xml", "<notes/>")], &[]).unwrap_err().contains("<scene>"));
}

#[test]
fn volumes_are_bounded() {
    let medium = "<shape type='cube'><bsdf type='null'/><medium name='interior' type='heterogeneous'>
        <volume name='sigma_t' type='gridvolume'><string name='filename' value='v.vol'/></volume></medium></shape>";
    let main = format!("<scene version='3.0.0'>{SENSOR}{medium}</scene>");
    let grid = |size: [i32; 3], channels: i32, values: &[f32]| {
        let mut bytes = b"VOL\x03".to_vec();
        for n in [1, size[0], size[1], size[2], channels] {
            bytes.extend(n.to_le_bytes());
        }
        bytes.extend([0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0].iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
        bytes
    };
    let load_as = |main: &str, bytes: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("s.xml"), main).unwrap();
        fs::write(folder.path().join("v.vol"), bytes).unwrap();
        load_mitsuba(folder.path().join("s.xml"), &MitsubaOptions::default()).map_err(|e| e.to_string())
    };
    let load = |bytes: &[u8]| load_as(&main, bytes);
    let good = load(&grid([2, 1, 1], 1, &[0.5, 1.5])).unwrap();
    assert_eq!((good.media[0].extinction.values[1].x, good.instances[0].interior), (1.5, Some(0)));
    for (bytes, part) in [
        (Vec::new(), "is empty"),
        (b"VOL\x02".to_vec(), "the first bytes are `VOL\\x02`; they must be VOL"),
        (b"VOL\x03".to_vec(), "has 4 bytes; the header alone must have 48"),
        (grid([1 << 20, 1 << 20, 1 << 20], 1, &[]), "1048576 x 1048576 x 1048576 voxels; there must be 1 to"),
        (grid([2, 2, 2], 1, &[0.0]), "bytes"),
        (grid([-1, 1, 1], 1, &[0.0]), "voxels"),
        (grid([1, 1, 1], 1, &[f32::NAN]), "finite"),
        (grid([1, 1, 1], 2, &[0.0, 0.0]), "there are 2 channels; there must be 1 or 3"),
    ] {
        let text = load(&bytes).unwrap_err();
        assert!(text.contains(part) && text.contains("v.vol"), "{part} in {text}");
    }
    // A box of its own must have its corners in order.
    let own = main.replace(
        "<string name='filename'",
        "<boolean name='use_grid_bbox' value='true'/><string name='filename'",
    );
    let mut turned = grid([1, 1, 1], 1, &[0.5]);
    assert!(load_as(&own, &turned).is_ok());
    turned[36..40].copy_from_slice(&(-1.0_f32).to_le_bytes());
    let text = load_as(&own, &turned).unwrap_err();
    assert!(
        text.contains("v.vol") && text.contains("goes from [0, 0, 0] to [-1, 1, 1]; the second"),
        "{text}"
    );
}

#[test]
fn media_and_who_is_in_them() {
    let sensor = SENSOR.replace("</sensor>", "<ref name='medium' id='fog'/></sensor>");
    let s = load_text(&format!(
        "{sensor}<medium type='homogeneous' id='fog'/>
         <medium type='heterogeneous' id='smoke'><volume name='sigma_t' type='constvolume'>
         <rgb name='value' value='1,2,3'/></volume><rgb name='albedo' value='0.1,0.2,0.3'/>
         <float name='scale' value='4'/><phase type='hg'><float name='g' value='-0.4'/></phase></medium>
         <shape type='sphere'><bsdf type='null'/><ref name='interior' id='smoke'/><ref name='exterior' id='fog'/></shape>
         <shape type='cube'><ref name='interior' id='smoke'/></shape><shape type='disk'/>"
    ))
    .unwrap();
    // In the order in which shapes and then the sensor name them, each once.
    assert_eq!(s.media.len(), 2);
    let (smoke, fog) = (&s.media[0], &s.media[1]);
    assert_eq!((s.instances[0].interior, s.instances[0].exterior), (Some(0), Some(1)));
    assert_eq!((s.instances[1].interior, s.instances[1].exterior), (Some(0), None));
    assert_eq!((s.instances[2].interior, s.instances[2].exterior, s.sensor.medium), (None, None, Some(1)));
    assert_eq!((smoke.extinction.values[0], smoke.scale, smoke.g), (vec3(1.0, 2.0, 3.0), 4.0, -0.4));
    assert_eq!(smoke.albedo.values[0], vec3(0.1, 0.2, 0.3));
    // The defaults of Mitsuba.
    assert_eq!((fog.extinction.values[0], fog.scale, fog.g), (vec3(1.0, 1.0, 1.0), 1.0, 0.0));
    assert_eq!(fog.albedo.values[0], vec3(0.75, 0.75, 0.75));
    let of = |medium: &str| load_text(&format!("{SENSOR}<shape type='cube'>{medium}</shape>")).unwrap_err();
    for (medium, part) in [
        ("<medium type='homogeneous'/>", "interior or exterior"),
        (
            "<medium name='interior' type='homogeneous'><phase type='hg'><float name='g' value='1'/></phase></medium>",
            "between -1 and 1",
        ),
        (
            "<medium name='interior' type='homogeneous'><float name='scale' value='-1'/></medium>",
            "not negative",
        ),
        ("<medium name='interior' type='homogeneous'><rgb name='albedo' value='1.5'/></medium>", "[0, 1]"),
        ("<medium name='interior' type='homogeneous'><rgb name='sigma_t' value='-1'/></medium>", "negative"),
        ("<medium name='interior' type='homogeneous'><phase type='rayleigh'/></medium>", "phase `rayleigh`"),
        ("<medium name='interior' type='ocean'/>", "medium `ocean`"),
    ] {
        let text = of(medium);
        assert!(text.contains(part), "{part} in {text}");
    }
    let two = "<medium type='homogeneous'/><medium type='homogeneous'/></sensor>";
    let text = load_text(&SENSOR.replace("</sensor>", two)).unwrap_err();
    assert!(text.contains("several media"), "{text}");
}

#[test]
fn texels_are_finite() {
    // The last four bytes are a NaN.
    let pfm = "Pf\n2 1\n1\n\0\0\0\0\u{7f}\u{e9}\0";
    let body = "<shape type='sphere'><bsdf type='diffuse'><texture name='reflectance' type='bitmap'>\
                <string name='filename' value='a.pfm'/></texture></bsdf></shape>";
    let main = format!("<scene version='3.0.0'>{SENSOR}{body}</scene>");
    let text = load_files(&[("s.xml", &main), ("a.pfm", pfm)], &[]).unwrap_err();
    assert!(text.contains("a.pfm: the texel in column 1 of row 0 is not finite; it must be"), "{text}");
}

#[test]
fn limits_hold() {
    let obj: String = (0..100).map(|i| format!("v {i} 0 0\n")).collect::<String>() + "f 1 2 3\n";
    let body = "<shape type='obj'><string name='filename' value='a.obj'/></shape>";
    let main = format!("<scene version='3.0.0'>{SENSOR}{body}</scene>");
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.xml"), main).unwrap();
    fs::write(folder.path().join("a.obj"), obj).unwrap();
    let limits = Limits { vertices: 50, ..Limits::default() };
    let options = MitsubaOptions { limits, ..MitsubaOptions::default() };
    let text = load_mitsuba(folder.path().join("s.xml"), &options).unwrap_err().to_string();
    assert!(text.contains("50 vertices"), "{text}");
}

#[test]
fn files_outside_of_the_folder_take_an_option() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::create_dir(folder.path().join("in")).unwrap();
    fs::write(folder.path().join("a.obj"), obj).unwrap();
    fs::write(folder.path().join("b.xml"), "<scene version='3.0.0'/>").unwrap();
    let load = |body: &str, allow_parent_paths: bool| {
        let text = format!("<scene version='3.0.0'>{SENSOR}{body}</scene>");
        fs::write(folder.path().join("in/s.xml"), text).unwrap();
        let options = MitsubaOptions { allow_parent_paths, ..MitsubaOptions::default() };
        load_mitsuba(folder.path().join("in/s.xml"), &options).map_err(|e| e.to_string())
    };
    let shape = |name: &str| format!("<shape type='obj'><string name='filename' value='{name}'/></shape>");
    for body in [
        shape("../a.obj"),
        format!("<path value='..'/>{}", shape("a.obj")),
        "<include filename='../b.xml'/>".to_owned(),
    ] {
        let text = load(&body, false).unwrap_err();
        assert!(
            text.contains("outside") && text.contains("allow_parent_paths") && text.contains("line"),
            "{text}"
        );
        assert!(load(&body, true).is_ok(), "{body}");
    }
    // The folder above is not searched either.
    assert!(load(&shape("a.obj"), false).unwrap_err().contains("does not exist"));
    assert_eq!(load(&shape("a.obj"), true).unwrap().shapes.len(), 1);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path().join("a.obj"), folder.path().join("in/link.obj")).unwrap();
        assert!(load(&shape("link.obj"), false).unwrap_err().contains("outside"));
    }
}

#[test]
fn checkerboards_lie_on_meshes_as_in_mitsuba() {
    // Values of Mitsuba 3.9.1 for the same quad: reflectances at these places.
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";
    let places = [(0.1, 0.1), (0.1, 0.4), (0.1, 0.6), (0.1, 0.9), (0.4, 0.3), (0.6, 0.2)];
    for (transform, wanted) in [
        ("", [0.2, 0.2, 0.4, 0.4, 0.2, 0.4]),
        ("<scale x='3' y='3'/>", [0.2, 0.2, 0.4, 0.4, 0.4, 0.2]),
        ("<scale x='1' y='1.5'/>", [0.4, 0.2, 0.2, 0.4, 0.4, 0.2]),
        ("<translate x='0.5' y='0.25'/>", [0.2, 0.4, 0.4, 0.2, 0.4, 0.4]),
        ("<rotate z='1' angle='30'/>", [0.4, 0.4, 0.2, 0.4, 0.4, 0.2]),
    ] {
        let body = format!(
            "<scene version='3.0.0'>{SENSOR}<shape type='obj'><string name='filename' value='q.obj'/>
             <bsdf type='diffuse'><texture name='reflectance' type='checkerboard'>
             <transform name='to_uv'>{transform}</transform></texture></bsdf></shape></scene>"
        );
        let s = load_files(&[("s.xml", &body), ("q.obj", obj)], &[]).unwrap();
        let MitsubaShape::Mesh(mesh) = &s.shapes[0] else { panic!("a mesh") };
        let SurfaceNode::Diffuse { reflectance } = &s.materials[0].root else { panic!("textured") };
        for ((x, y), wanted) in places.into_iter().zip(wanted) {
            // The quad's coordinates are linear in its positions.
            let corner = |px: f32, py: f32| {
                let v = mesh.positions.iter().position(|p| p.x == px && p.y == py).unwrap();
                mesh.uvs[v]
            };
            let o = corner(0.0, 0.0);
            let uv = o + (corner(1.0, 0.0) - o) * x + (corner(0.0, 1.0) - o) * y;
            let at = SurfacePoint { uv, color: Vec4f::splat(1.0), piece: 0 };
            assert_eq!(reflectance.color(&at).x, wanted, "{transform} at {x} {y}");
        }
    }
}

#[test]
fn colours_in_hexadecimal_digits_are_linear() {
    let s = scene("<emitter type='constant'><rgb name='radiance' value='#ff8800'/></emitter>");
    assert_eq!(s.environment.unwrap().image.data, [1.0, 136.0 / 255.0, 0.0]);
}

#[test]
fn many_attributes_and_many_unknown_elements_take_linear_time() {
    let attributes: String = (0..100_000).map(|i| format!("a{i}='0' ")).collect();
    let text = load_text(&format!("<shape type='sphere' {attributes}/>")).unwrap_err();
    assert!(text.contains("line 1") && text.contains("attributes; it may have 64"), "{text}");
    let flowers: String = (0..100_000).map(|i| format!("<flower id='f{i}'/>\n")).collect();
    let text = load_text(&format!("{SENSOR}{flowers}")).unwrap_err();
    assert!(text.contains("and 99936 more"), "{text}");
}

#[test]
fn principled_surfaces_let_light_through() {
    let root = |bsdf: &str| scene(&format!("<shape type='sphere'>{bsdf}</shape>")).materials[0].root.clone();
    let glass = root(
        "<bsdf type='principled'><float name='spec_trans' value='0.8'/><float name='anisotropic' value='0.5'/>\
         </bsdf>",
    );
    assert!(glass.transmits() && glass.needs_partials(), "{glass:?}");
    let opaque = root("<bsdf type='principled'><float name='roughness' value='0.2'/></bsdf>");
    assert!(!opaque.transmits() && !opaque.needs_partials(), "{opaque:?}");
    let sheet = root(
        "<bsdf type='principledthin'><float name='diff_trans' value='1.5'/><float name='spec_trans' value='0.3'/>\
         <float name='eta' value='1.3'/></bsdf>",
    );
    assert!(matches!(sheet, SurfaceNode::Constant(Bsdf::PrincipledThin(_))) && sheet.transmits());
    let body =
        "<shape type='sphere'><bsdf type='principledthin'><float name='eta' value='1'/></bsdf></shape>";
    let error = load_text(&format!("{SENSOR}{body}")).unwrap_err();
    assert!(error.contains("eta is 1; it must be greater than 1"), "{error}");
    for (property, rule) in [("spec_trans", "must lie in [0, 1]"), ("diff_trans", "must lie in [0, 2]")] {
        let body = format!(
            "<shape type='sphere'><bsdf type='principledthin'><float name='{property}' value='2.5'/></bsdf></shape>"
        );
        let error = load_text(&format!("{SENSOR}{body}")).unwrap_err();
        assert!(error.contains(rule), "{error}");
    }
}
