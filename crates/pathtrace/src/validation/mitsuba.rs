//! Scenes read from XML against the same scenes built by hand, and against closed forms.

use super::scenes::{cornell, cornell_view, square};
use crate::{Parts, RenderOptions, Renderer, View, World, WorldOptions};
use photofit_image::Image;
use photofit_scene::mitsuba::{MitsubaOptions, MitsubaScene, load_mitsuba};

fn load(body: &str) -> MitsubaScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    std::fs::write(&path, format!("<scene version='3.0.0'>{body}</scene>")).unwrap();
    load_mitsuba(path, &MitsubaOptions::default()).unwrap()
}

fn render(body: &str) -> Image {
    let scene = load(body);
    let (view, options) = (View::from_mitsuba(&scene.sensor), RenderOptions::from_mitsuba(&scene));
    let plain = WorldOptions::default();
    let world = World::with_options(Parts::from_mitsuba(scene), plain).unwrap();
    let mut renderer = Renderer::new(&world, &view, options).unwrap();
    while !renderer.pass(|| false).done {}
    renderer.picture()
}

fn sensor(more: &str, film: &str, spp: u32) -> String {
    format!(
        "<sensor type='perspective'>{more}<sampler type='independent'>
         <integer name='sample_count' value='{spp}'/></sampler><film type='hdrfilm'>{film}
         <rfilter type='box'/></film></sensor>"
    )
}

const SQUARE: &str = "<integer name='width' value='16'/><integer name='height' value='16'/>";

#[test]
fn a_sphere_around_the_camera_is_as_bright_as_its_series() {
    // Emission 0.5 and reflectance 0.5 everywhere: 0.5 (1 + 0.5 + 0.25 + ...), cut after four events.
    let picture = render(&format!(
        "{}<integrator type='path'><integer name='max_depth' value='5'/></integrator>
         <shape type='sphere'><float name='radius' value='10'/><boolean name='flip_normals' value='true'/>
         <bsdf type='diffuse'><rgb name='reflectance' value='0.5'/></bsdf>
         <emitter type='area'><rgb name='radiance' value='0.5'/></emitter></shape>",
        sensor("", SQUARE, 64)
    ));
    let mean = picture.data.chunks_exact(4).map(|p| f64::from(p[0])).sum::<f64>() / 256.0;
    assert!((mean - 0.96875).abs() < 2e-3, "{mean}");
}

#[test]
fn hidden_emitters_light_what_the_camera_sees_through_them() {
    // A lamp between the camera and a floor, its back to the camera.
    let picture = |hide: bool, z: f64| {
        render(&format!(
            "{}<integrator type='path'><integer name='max_depth' value='2'/>
             <boolean name='hide_emitters' value='{hide}'/></integrator>
             <shape type='rectangle'><bsdf type='diffuse'><rgb name='reflectance' value='0.5'/></bsdf></shape>
             <shape type='rectangle'><transform name='to_world'><scale value='0.5'/><rotate x='1' angle='180'/>
             <translate z='{z}'/></transform><bsdf type='diffuse'><rgb name='reflectance' value='0'/></bsdf>
             <emitter type='area'><rgb name='radiance' value='3'/></emitter></shape>",
            sensor(
                "<float name='fov' value='60'/><transform name='to_world'>
                 <lookat origin='0,0,3' target='0,0,0' up='0,1,0'/></transform>",
                SQUARE,
                64
            )
        ))
    };
    let (hidden, shown, free) = (picture(true, 2.0), picture(false, 2.0), picture(true, 4.0));
    let mean = |p: &Image, x: std::ops::Range<usize>| {
        x.clone().map(|x| f64::from(p.pixel(x, 8)[0])).sum::<f64>() / x.len() as f64
    };
    let (seen, blocked) = (mean(&hidden, 6..10), mean(&shown, 6..10));
    assert!(blocked == 0.0, "the back of the lamp is black: {blocked}");
    // Irradiance below the middle of a lamp of side 1 at distance 2: its form factor is .0735.
    assert!((seen - 0.5 * 3.0 * 0.0735).abs() < 0.01, "{seen}");
    assert!(mean(&free, 6..10) < 0.5 * seen, "farther away it gives less");
    for p in [&hidden, &free] {
        assert_eq!((p.pixel(0, 0)[3], p.pixel(8, 8)[3]), (0.0, 1.0), "coverage is that of the floor");
    }
    // The lamp itself leaves no trace where nothing lies behind it.
    let alone = |hide: bool| {
        render(&format!(
            "{}<integrator type='path'><boolean name='hide_emitters' value='{hide}'/></integrator>
             <shape type='sphere'><emitter type='area'><rgb name='radiance' value='3'/></emitter></shape>",
            sensor(
                "<transform name='to_world'><lookat origin='0,0,4' target='0,0,0' up='0,1,0'/></transform>",
                SQUARE,
                4
            )
        ))
    };
    assert_eq!(alone(true).pixel(8, 8), [0.0; 4]);
    assert_eq!(alone(false).pixel(8, 8), [3.0, 3.0, 3.0, 1.0]);
}

#[test]
fn a_point_light_over_a_square_obeys_the_inverse_square() {
    // Straight down from height 2 on a square with reflectance 0.5: radiance 0.5 / pi * I cos / r^2.
    let picture = render(&format!(
        "{}<integrator type='direct'/><shape type='rectangle'><transform name='to_world'><scale value='10'/>
         </transform></shape><emitter type='point'><point name='position' x='0' y='0' z='4'/>
         <rgb name='intensity' value='8'/></emitter>",
        sensor(
            "<float name='fov' value='0.1'/><transform name='to_world'>
             <lookat origin='0,0,2' target='0,0,0' up='0,1,0'/></transform>",
            SQUARE,
            4
        )
    ));
    let expected = 0.5 / std::f32::consts::PI * 8.0 / 16.0;
    assert!((picture.pixel(8, 8)[1] - expected).abs() < 1e-4, "{:?} {expected}", picture.pixel(8, 8));
}

#[test]
fn a_crop_is_a_part_of_the_picture_and_a_parallel_view_keeps_sizes() {
    let world = "<integrator type='path'><integer name='max_depth' value='1'/></integrator>
        <shape type='rectangle'><bsdf type='diffuse'/><emitter type='area'><texture name='radiance' type='checkerboard'>
        <transform name='to_uv'><scale value='3'/></transform></texture></emitter></shape>";
    let look =
        "<transform name='to_world'><lookat origin='0.3,0.1,3' target='0,0,0' up='0,1,0'/></transform>";
    let full = render(&format!("{}{world}", sensor(look, SQUARE, 256)));
    let film = format!(
        "{SQUARE}<integer name='crop_offset_x' value='4'/><integer name='crop_offset_y' value='6'/>
         <integer name='crop_width' value='8'/><integer name='crop_height' value='5'/>"
    );
    let part = render(&format!("{}{world}", sensor(look, &film, 256)));
    assert_eq!((part.width, part.height), (8, 5));
    for (x, y) in [(0, 0), (7, 0), (3, 4)] {
        let (a, b) = (part.pixel(x, y)[0], full.pixel(x + 4, y + 6)[0]);
        assert!((a - b).abs() < 0.02, "{x} {y}: {a} {b}");
    }
    // The square fills a parallel view of the same size from any distance, and half of one twice as large.
    for (scale, share) in [(1.0, 1.0), (2.0, 0.25)] {
        let text = sensor(
            &format!(
                "<transform name='to_world'><scale x='{scale}' y='{scale}'/>
                 <lookat origin='0,0,7' target='0,0,0' up='0,1,0'/></transform>"
            ),
            SQUARE,
            16,
        );
        let seen = render(&format!("{}{world}", text.replace("perspective", "orthographic")));
        let alpha = seen.data.chunks_exact(4).map(|p| p[3]).sum::<f32>() / 256.0;
        assert!((alpha - share).abs() < 0.01, "{scale}: {alpha}");
    }
}

#[test]
fn environments_are_turned_as_mitsuba_turns_them() {
    // The column of u = 1/8 shows the directions between +x and -z.
    let folder = tempfile::tempdir().unwrap();
    let image = Image::from_fn(4, 3, 3, |x, _, _| if x == 0 { 1.0 } else { 0.0 });
    photofit_image::write_exr(folder.path().join("e.exr"), &[("", &image, &["R", "G", "B"])]).unwrap();
    let at = |toward: &str, mirrored: bool| {
        let scale = if mirrored { "<scale x='-1' y='1' z='1'/>" } else { "" };
        let text = format!(
            "<scene version='3.0.0'>{}<integrator type='path'/><emitter type='envmap'>
             <string name='filename' value='e.exr'/><transform name='to_world'>{scale}</transform></emitter></scene>",
            sensor(
                &format!(
                    "<float name='fov' value='0.1'/><transform name='to_world'>
                     <lookat origin='0,0,0' target='{toward}' up='0,1,0'/></transform>"
                ),
                SQUARE,
                1
            )
        );
        let path = folder.path().join("scene.xml");
        std::fs::write(&path, text).unwrap();
        let scene = load_mitsuba(&path, &MitsubaOptions::default()).unwrap();
        let (view, options) = (View::from_mitsuba(&scene.sensor), RenderOptions::from_mitsuba(&scene));
        let world = World::new(Parts::from_mitsuba(scene)).unwrap();
        let mut renderer = Renderer::new(&world, &view, options).unwrap();
        while !renderer.pass(|| false).done {}
        renderer.picture().pixel(8, 8)[0]
    };
    for (toward, mirrored, wanted) in
        [("1,0,-1", false, 1.0), ("1,0,1", false, 0.0), ("-1,0,-1", false, 0.0), ("-1,0,-1", true, 1.0)]
    {
        let found = at(toward, mirrored);
        assert!((found - wanted).abs() < 0.01, "{toward} {mirrored}: {found}");
    }
}

/// The box of [`cornell`] in XML.
fn cornell_xml() -> String {
    let side = |color: &str, place: &str| {
        format!(
            "<shape type='rectangle'><transform name='to_world'><scale value='0.5'/>{place}</transform>
             <bsdf type='twosided'><bsdf type='diffuse'><rgb name='reflectance' value='{color}'/></bsdf></bsdf></shape>"
        )
    };
    let cube = |size: &str, angle: f32, at: &str| {
        format!(
            "<shape type='cube'><transform name='to_world'><scale value='0.5'/><scale value='{size}'/>
             <rotate y='1' angle='{}'/><translate value='{at}'/></transform>
             <bsdf type='diffuse'><rgb name='reflectance' value='0.73'/></bsdf></shape>",
            angle.to_degrees()
        )
    };
    let look = "<float name='fov' value='37.24225668'/><transform name='to_world'>
        <lookat origin='0,0.5,2.2' target='0,0.5,0' up='0,1,0'/></transform>";
    sensor(look, SQUARE, 256)
        + "<integrator type='path'><integer name='max_depth' value='17'/></integrator>"
        + &side("0.73", "<rotate x='1' angle='-90'/>")
        + &side("0.73", "<rotate x='1' angle='90'/><translate y='1'/>")
        + &side("0.73", "<translate y='0.5' z='-0.5'/>")
        + &side("0.63,0.06,0.05", "<rotate y='1' angle='90'/><translate x='-0.5' y='0.5'/>")
        + &side("0.14,0.45,0.09", "<rotate y='1' angle='-90'/><translate x='0.5' y='0.5'/>")
        + "<shape type='rectangle'><transform name='to_world'><scale value='0.15'/><rotate x='1' angle='90'/>
           <translate y='0.998'/></transform><bsdf type='diffuse'><rgb name='reflectance' value='0'/></bsdf>
           <emitter type='area'><rgb name='radiance' value='17,12,4'/></emitter></shape>"
        + &cube("0.3,0.6,0.3", 0.3, "-0.2,0.3,-0.15")
        + &cube("0.3,0.3,0.3", -0.3, "0.2,0.15,0.15")
}

#[test]
fn a_box_reads_as_it_is_built() {
    let world = World::new(cornell()).unwrap();
    let (expected, variance) = super::scenes::render(&world, &cornell_view(), square(16, 256));
    let found = render(&cornell_xml());
    let (mut sum, mut level, mut noise) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    for i in 0..256 {
        for c in 0..3 {
            sum[c] += f64::from(found.data[4 * i + c] - expected.data[4 * i + c]);
            level[c] += f64::from(expected.data[4 * i + c]);
            noise[c] += 2.0 * f64::from(variance.data[3 * i + c]) / 256.0;
        }
    }
    for c in 0..3 {
        let bound = 4.0 * noise[c].sqrt();
        assert!(sum[c].abs() < bound.min(0.01 * level[c]), "{c}: {sum:?} {noise:?} {level:?}");
    }
}

#[test]
fn media_fill_what_their_boundaries_enclose() {
    // A ball of radius 1 that absorbs, seen through its middle from outside, and from its centre.
    let scene = |at: f32, sensor_medium: &str| {
        let look = format!(
            "<float name='fov' value='0.1'/><float name='near_clip' value='1e-6'/><transform name='to_world'>
             <lookat origin='0,0,{at}' target='0,0,-9' up='0,1,0'/></transform>{sensor_medium}"
        );
        format!(
            "<medium type='homogeneous' id='m'><rgb name='sigma_t' value='1,0.5,0'/><float name='scale' value='2'/>
             <rgb name='albedo' value='0'/></medium><integrator type='volpath'/>
             <emitter type='constant'><rgb name='radiance' value='3'/></emitter>{}
             <shape type='sphere'><bsdf type='null'/><ref name='interior' id='m'/></shape>",
            sensor(&look, SQUARE, 2)
        )
    };
    for (at, sensor_medium, length) in [(4.0, "", 2.0_f32), (0.0, "<ref name='medium' id='m'/>", 1.0)] {
        let picture = render(&scene(at, sensor_medium));
        for (c, sigma) in [2.0, 1.0, 0.0].into_iter().enumerate() {
            let (found, wanted) = (picture.pixel(7, 7)[c], 3.0 * (-sigma * length).exp());
            assert!((found - wanted).abs() < 1e-4, "from {at}, channel {c}: {found}, expected {wanted}");
        }
    }
}

#[test]
fn grids_of_density_lie_where_they_are_put() {
    // Along x: nothing in the first half of the box [-1, 1]^3, extinction 2 in the other; nothing outside of the box.
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = b"VOL\x03".to_vec();
    for n in [1_i32, 4, 1, 1, 1] {
        bytes.extend(n.to_le_bytes());
    }
    bytes.extend([0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0.0_f32, 0.0, 2.0, 2.0].iter().flat_map(|x| x.to_le_bytes()));
    std::fs::write(folder.path().join("g.vol"), bytes).unwrap();
    let seen = |x: f32| {
        let look = format!(
            "<float name='fov' value='0.01'/><transform name='to_world'>
             <lookat origin='{x},0,6' target='{x},0,0' up='0,1,0'/></transform>"
        );
        let text = format!(
            "<scene version='3.0.0'>{}<integrator type='volpath'><integer name='max_depth' value='1'/></integrator>
             <emitter type='constant'/><shape type='sphere'><float name='radius' value='4'/><bsdf type='null'/>
             <medium name='interior' type='heterogeneous'><volume name='sigma_t' type='gridvolume'>
             <string name='filename' value='g.vol'/><transform name='to_world'><scale value='2'/>
             <translate value='-1'/></transform></volume></medium></shape></scene>",
            sensor(&look, SQUARE, 64)
        );
        let path = folder.path().join("scene.xml");
        std::fs::write(&path, text).unwrap();
        let scene = load_mitsuba(&path, &MitsubaOptions::default()).unwrap();
        let (view, options) = (View::from_mitsuba(&scene.sensor), RenderOptions::from_mitsuba(&scene));
        let world = World::new(Parts::from_mitsuba(scene)).unwrap();
        let (picture, variance) = super::scenes::render(&world, &view, options);
        super::statistics::mean_of(&picture, &variance, 64, 0)
    };
    for (x, depth) in [(-2.0, 0.0), (-0.8, 0.0), (0.0, 2.0), (0.5, 4.0), (0.9, 4.0), (1.2, 0.0)] {
        let ((mean, error), wanted) = (seen(x), f64::exp(-depth));
        assert!((mean - wanted).abs() < 4.0 * error + 1e-3, "{x}: {mean} +- {error}, expected {wanted}");
    }
}
