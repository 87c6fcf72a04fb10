//! `render scene.xml` and `inspect scene.xml`.

use crate::support::{assert_one_error, photofit, stderr, stdout, succeeds};

/// A ball of glass full of milk, under a lamp, from inside of a thin fog.
const SCENE: &str = "<scene version='3.0.0'>
  <integrator type='volpath'><integer name='max_depth' value='12'/></integrator>
  <sensor type='perspective'><float name='fov' value='45'/>
    <transform name='to_world'><lookat origin='0,1,4' target='0,0,0' up='0,1,0'/></transform>
    <sampler type='independent'><integer name='sample_count' value='8'/></sampler>
    <film type='hdrfilm'><integer name='width' value='24'/><integer name='height' value='16'/></film>
    <ref name='medium' id='fog'/></sensor>
  <medium id='fog' type='homogeneous'><float name='sigma_t' value='0.05'/></medium>
  <medium id='milk' type='homogeneous'><rgb name='sigma_t' value='2,3,4'/><rgb name='albedo' value='0.99'/>
    <phase type='hg'><float name='g' value='0.5'/></phase></medium>
  <shape type='sphere'><bsdf type='dielectric'/><ref name='interior' id='milk'/><ref name='exterior' id='fog'/></shape>
  <shape type='rectangle'><transform name='to_world'><scale value='4'/><rotate x='1' angle='-90'/>
    <translate y='-1'/></transform></shape>
  <shape type='sphere'><point name='center' x='2' y='3' z='1'/><float name='radius' value='0.5'/>
    <emitter type='area'><rgb name='radiance' value='20,18,15'/></emitter></shape></scene>";

#[test]
fn scenes_with_media_render_to_the_same_bits_on_any_threads() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("milk.xml"), SCENE).unwrap();
    let files = ["1", "2"].map(|threads| {
        let name = format!("{threads}.png");
        succeeds(d, &["render", "milk.xml", "-o", &name, "--threads", threads]);
        std::fs::read(d.join(&name)).unwrap()
    });
    assert!(files[0] == files[1], "one thread and two");
    // The ball in the middle is as bright as it is because milk scatters.
    std::fs::write(d.join("ink.xml"), SCENE.replace("value='0.99'", "value='0'")).unwrap();
    succeeds(d, &["render", "ink.xml", "-o", "ink.png"]);
    let middle = |name: &str| {
        let picture = photofit_image::read(d.join(name)).unwrap();
        assert_eq!((picture.width, picture.height), (24, 16));
        (0..36).map(|i| picture.pixel(9 + i % 6, 5 + i / 6)[0]).sum::<f32>()
    };
    let (milk, ink) = (middle("1.png"), middle("ink.png"));
    assert!(milk > 1.5 * ink, "{milk} and {ink}");
    let text = stdout(&succeeds(d, &["inspect", "milk.xml"]));
    assert!(text.contains("2 media"), "{text}");
}

#[test]
fn media_that_cannot_be_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("bad.xml"), SCENE.replace("0.99", "1.01")).unwrap();
    let o = photofit(d, &["render", "bad.xml", "-o", "bad.png"]);
    assert_one_error(&o, "more light than there was", &["bad.xml", "albedo", "must lie in [0, 1]"]);
    assert!(!d.join("bad.png").exists(), "no picture");
}

#[test]
fn files_above_the_scene_need_an_option() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::create_dir(d.join("scene")).unwrap();
    std::fs::write(d.join("tri.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let shape = "<shape type='obj'><string name='filename' value='../tri.obj'/></shape>";
    std::fs::write(
        d.join("scene/s.xml"),
        format!("<scene version='3.0.0'><sensor type='perspective'/>{shape}</scene>"),
    )
    .unwrap();
    let o = photofit(d, &["inspect", "scene/s.xml"]);
    assert_one_error(
        &o,
        "above the scene's folder",
        &["s.xml", "../tri.obj", "--allow-parent-paths must be given"],
    );
    assert!(!stderr(&o).contains("allow_parent_paths"), "no field of the library: {}", stderr(&o));
    assert!(stdout(&succeeds(d, &["inspect", "scene/s.xml", "--allow-parent-paths"])).contains("1 shape, "));
    for command in [&["inspect", "tri.obj"][..], &["render", "tri.obj", "-o", "a.png"]] {
        let o = photofit(d, &[command, &["--allow-parent-paths"]].concat());
        assert_eq!(o.status.code(), Some(2), "{command:?}: only for scenes");
    }
}
