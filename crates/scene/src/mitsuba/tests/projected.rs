//! Projectors, and spots with a texture.

use super::*;
use crate::LightPicture;
use crate::graph::SurfacePoint;
use glam::Vec3;

/// Loads emitters beside a grey picture of two columns, 0 and 2, called `p.pfm`, and one of a negative value, `bad.pfm`.
fn load(emitters: &str) -> Result<MitsubaScene, String> {
    let folder = tempfile::tempdir().unwrap();
    let picture = |head: &str, values: &[f32]| {
        let mut bytes = head.as_bytes().to_vec();
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    };
    fs::write(folder.path().join("p.pfm"), picture("Pf\n2 1\n-1\n", &[0.0, 2.0])).unwrap();
    fs::write(folder.path().join("bad.pfm"), picture("Pf\n1 1\n-1\n", &[-1.0])).unwrap();
    let path = folder.path().join("s.xml");
    fs::write(&path, format!("<scene version='3.0.0'>{SENSOR}{emitters}</scene>")).unwrap();
    load_mitsuba(path, &MitsubaOptions::default()).map_err(|e| e.to_string())
}

fn bitmap(name: &str, file: &str) -> String {
    format!(
        "<texture type='bitmap' name='{name}'><string name='filename' value='{file}'/>
         <string name='filter_type' value='nearest'/></texture>"
    )
}

const LOOK: &str =
    "<transform name='to_world'><lookat origin='0,0,-5' target='0,0,0' up='0,1,0'/></transform>";

fn value(picture: &LightPicture, u: f32) -> f32 {
    picture.texture.color(&SurfacePoint { uv: vec2(u, 0.5), color: Vec4f::zero(), piece: 0 }).x
}

#[test]
fn projectors_throw_upright_pictures() {
    let text = format!(
        "<emitter type='projector'>{LOOK}<float name='fov' value='90'/><float name='scale' value='3'/>{}</emitter>",
        bitmap("irradiance", "p.pfm")
    );
    let scene = load(&text).unwrap();
    let light = &scene.lights[0];
    assert_eq!(
        (light.kind, light.position, light.direction),
        (LightKind::Projector, Vec3::NEG_Z * 5.0, Vec3::Z)
    );
    // The irradiance at distance 1 is pi times the picture.
    assert!(light.intensity.iter().all(|i| (f64::from(*i) - 3.0 * PI).abs() < 1e-5));
    let picture = light.picture.as_ref().unwrap();
    // As the sensor at this place sees: -x lies to the right, the first row at the top.
    assert!((picture.u - Vec3::NEG_X).length() < 1e-6 && (picture.v - Vec3::NEG_Y).length() < 1e-6);
    assert!(
        (picture.half[0] - 1.0).abs() < 1e-6 && (picture.half[1] - 0.5).abs() < 1e-6,
        "{:?}",
        picture.half
    );
    assert_eq!((value(picture, 0.2), value(picture, 0.8)), (0.0, 2.0));
    // Without a picture: white and square, 50 mm.
    let plain = load("<emitter type='projector'/>").unwrap();
    let picture = plain.lights[0].picture.as_ref().unwrap();
    let tangent = 0.5 * (36.0_f32 * 36.0 + 24.0 * 24.0).sqrt() / 50.0 / 2.0_f32.sqrt();
    assert!(picture.half.iter().all(|h| (h - tangent).abs() < 1e-5), "{:?}", picture.half);
    assert_eq!(value(picture, 0.5), 1.0);
}

#[test]
fn spots_throw_textures_over_their_cone() {
    let text = format!(
        "<emitter type='spot'>{LOOK}<float name='cutoff_angle' value='45'/>{}</emitter>",
        bitmap("texture", "p.pfm")
    );
    let light = load(&text).unwrap().lights.remove(0);
    let picture = light.picture.unwrap();
    // Along the axes of the emitter itself.
    assert!((picture.u - Vec3::X).length() < 1e-6 && (picture.v - Vec3::Y).length() < 1e-6);
    assert!(picture.half.iter().all(|h| (h - 1.0).abs() < 1e-6), "{:?}", picture.half);
    assert_eq!((value(&picture, 0.2), value(&picture, 0.8)), (0.0, 2.0));
    assert_eq!(load("<emitter type='spot'/>").unwrap().lights[0].picture, None);
}

#[test]
fn lights_that_throw_nothing_sensible_are_refused() {
    let turned = |inside: &str| format!("<transform name='to_world'>{inside}</transform>");
    let of = |kind: &str, inside: &str| format!("<emitter type='{kind}'>{inside}</emitter>");
    let checker = "<texture type='checkerboard' name='texture'/>";
    for (text, part) in [
        (of("projector", &bitmap("irradiance", "bad.pfm")), "negative"),
        (of("spot", &bitmap("texture", "bad.pfm")), "negative"),
        (of("spot", "<rgb name='texture' value='1'/>"), "it must vary"),
        (of("spot", &(turned("<scale x='2'/>") + checker)), "stretched"),
        (of("projector", &turned("<scale value='2'/>")), "scaled"),
        (
            of("projector", &turned("<matrix value='1 1 0 0 1 0 0 0 1'/>")),
            "emitter `projector` are not at right",
        ),
        (of("projector", "<float name='scale' value='-1'/>"), "scale is -1"),
        (of("projector", "<float name='fov' value='180'/>"), "180"),
        (of("projector", "<texture type='mesh_attribute' name='irradiance'/>"), "vertices"),
        (of("point", &bitmap("intensity", "p.pfm")), "a textured intensity of emitter `point`"),
    ] {
        let found = load(&text).unwrap_err();
        assert!(found.contains(part), "{part} in {found}");
    }
    // Uniform scale and mirrors are none of it.
    assert!(load(&of("spot", &(turned("<scale value='2'/><scale x='-1'/>") + checker))).is_ok());
}
