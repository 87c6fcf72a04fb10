//! `sdfgrid` shapes.

use super::*;

/// Loads a shape with these properties beside `d.vol`, which has these values, or the bytes that `change` makes of it.
fn load(
    properties: &str,
    size: [usize; 3],
    values: &[f32],
    change: impl Fn(&mut Vec<u8>),
) -> Result<MitsubaScene, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = encode_grid(size, values, [DVec3::ZERO, DVec3::ONE]);
    change(&mut bytes);
    fs::write(folder.path().join("d.vol"), bytes).unwrap();
    let path = folder.path().join("s.xml");
    let shape = format!("<shape type='sdfgrid'><string name='filename' value='d.vol'/>{properties}</shape>");
    fs::write(&path, format!("<scene version='3.0.0'>{SENSOR}{shape}</scene>")).unwrap();
    load_mitsuba(path, &MitsubaOptions::default()).map_err(|e| e.to_string())
}

const VALUES: [f32; 12] = [-1.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0];

#[test]
fn grids_of_distances_are_read_as_they_are() {
    let s = load("", [3, 2, 2], &VALUES, |_| ()).unwrap();
    let MitsubaShape::DistanceGrid { size, values, smooth } = &s.shapes[0] else { panic!("a grid") };
    assert_eq!((*size, values.as_slice(), *smooth), ([3, 2, 2], &VALUES[..], true));
    let s = load(
        "<string name='normals' value='analytic'/><transform name='to_world'><scale value='2'/></transform>",
        [3, 2, 2],
        &VALUES,
        |_| (),
    )
    .unwrap();
    assert!(matches!(s.shapes[0], MitsubaShape::DistanceGrid { smooth: false, .. }));
    assert_eq!(s.instances[0].transform.matrix3.x_axis, DVec3::X * 2.0);
}

#[test]
fn bad_grids_name_the_file_what_is_and_what_must_be() {
    let fails = |properties: &str, size: [usize; 3], values: &[f32], change: &dyn Fn(&mut Vec<u8>)| {
        load(properties, size, values, change).unwrap_err()
    };
    let none = |_: &mut Vec<u8>| ();
    let with = |index: usize, v: f32| {
        let mut values = VALUES;
        values[index] = v;
        values
    };
    let side = |bytes: &mut Vec<u8>| bytes[8..12].copy_from_slice(&(1_i32 << 30).to_le_bytes());
    for (text, part) in [
        (fails("", [2, 2, 1], &VALUES, &none), "there are 3 channels; there must be 1"),
        (fails("", [12, 1, 1], &VALUES, &none), "12 x 1 x 1 samples; it must have 2 or more"),
        (fails("", [3, 2, 2], &with(7, f32::NAN), &none), "value 7 is NaN; it must be finite"),
        (fails("", [3, 2, 2], &with(4, f32::INFINITY), &none), "value 4 is inf; it must be finite"),
        (fails("", [3, 2, 2], &with(0, 0.0), &none), "0 of 12 values are below 0; some must be"),
        (fails("", [3, 2, 2], &VALUES.map(|v| v - 20.0), &none), "12 of 12 values are below 0"),
        (fails("", [3, 2, 2], &VALUES, &side), "1073741824 x 2 x 2 voxels; there must be 1 to 134217728"),
        (fails("", [3, 2, 2], &VALUES, &|b| b.truncate(90)), "has 90 bytes; it must have 96"),
    ] {
        assert!(text.contains(part) && text.contains("d.vol") && text.contains("line 5"), "{part} in {text}");
    }
    let text = fails("<string name='normals' value='flat'/>", [3, 2, 2], &VALUES, &none);
    assert!(text.contains("normals is `flat`; it must be analytic or smooth"), "{text}");
    let lamp = "<emitter type='area'><rgb name='radiance' value='1'/></emitter>";
    let text = fails(lamp, [3, 2, 2], &VALUES, &none);
    assert!(text.contains("not supported") && text.contains("an emitter on an sdfgrid"), "{text}");
}
