//! Auxiliary images of blended surfaces, and what the camera sees through them.

use super::scenes::{looking, square};
use crate::{Aov, Parts, RenderOptions, Renderer, World};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};

/// Coverage and grey of the layers; the albedo and the depth that are expected.
type Case = (&'static [(f32, f32)], f32, Option<f32>);

/// Layers of coverage and grey at z = 0, -1, -2, each twice as large as the last one.
fn layers(stack: &[(f32, f32)]) -> World {
    let shapes: String = (0..)
        .zip(stack)
        .map(|(k, (coverage, grey))| {
            format!(
                "<shape type='rectangle'><transform name='to_world'><scale value='{}'/><translate z='-{k}'/></transform>
                 <bsdf type='mask'><float name='opacity' value='{coverage}'/><bsdf type='diffuse'>
                 <rgb name='reflectance' value='{grey}'/></bsdf></bsdf></shape>",
                4 << k
            )
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    let sensor = "<sensor type='perspective'><film type='hdrfilm'/></sensor>";
    std::fs::write(
        &path,
        format!("<scene version='3.0.0'>{sensor}{shapes}<emitter type='constant'/></scene>"),
    )
    .unwrap();
    World::new(Parts::from_mitsuba(load_mitsuba(path, &MitsubaOptions::default()).unwrap())).unwrap()
}

#[test]
fn auxiliary_images_of_blended_surfaces_have_no_noise() {
    // Albedo: the mean of all. Position: of the layer of which most is seen, or of none.
    let cases: [Case; 5] = [
        (&[(1.0, 0.3), (1.0, 0.9)], 0.3, Some(0.0)),
        (&[(0.4, 0.2), (1.0, 0.8)], 0.4 * 0.2 + 0.6 * 0.8, Some(-1.0)),
        (&[(0.6, 0.2), (1.0, 0.8)], 0.6 * 0.2 + 0.4 * 0.8, Some(0.0)),
        (&[(0.0, 0.2), (0.3, 0.5), (1.0, 0.9)], 0.3 * 0.5 + 0.7 * 0.9, Some(-2.0)),
        (&[(0.3, 0.5)], 0.3 * 0.5, None),
    ];
    let view = looking([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], 0.4);
    for (stack, albedo, z) in cases {
        let world = layers(stack);
        let aovs = vec![Aov::Albedo, Aov::Normal, Aov::Position, Aov::Instance];
        let options = RenderOptions { aovs, ..square(8, 4) };
        let mut renderer = Renderer::new(&world, &view, options).unwrap();
        while !renderer.pass(|| false).done {}
        let get = |aov: Aov| renderer.aov(aov).unwrap();
        let (seen, normal, position) = (get(Aov::Albedo), get(Aov::Normal), get(Aov::Position));
        for i in 0..64 {
            assert!((seen.data[3 * i] - albedo).abs() < 1e-3, "{stack:?}: {} {albedo}", seen.data[3 * i]);
            let facing = if z.is_some() { 1.0 } else { 0.0 };
            assert!((normal.data[3 * i + 2] - facing).abs() < 1e-5, "{stack:?}");
            assert!((position.data[3 * i + 2] - z.unwrap_or(0.0)).abs() < 1e-4, "{stack:?}");
            let layer = z.map_or(0.0, |z| 1.0 - z);
            assert!((get(Aov::Instance).data[i] - layer).abs() < 1e-6, "{stack:?}");
        }
    }
}
