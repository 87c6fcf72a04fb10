//! Gradients of Mitsuba scenes: textures of trees against central differences, and the published derivative images of
//! Mitsuba's own tests (not part of this repository).

use crate::{Adjoint, GradientSamples, Parameter, Parts, RenderOptions, Renderer, View, World, WorldOptions};
use crate::{BsdfSource, MaterialValue};
use photofit_image::Image;
use photofit_scalar::Vec3f;
use photofit_scene::graph::{Bitmap, SurfaceGraph, SurfaceNode, Texture};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};
use std::path::Path;
use std::sync::Arc;

const MATRIX: &str = "<matrix value='-1 0 0 0  0 1 0 0  0 0 -1 4  0 0 0 1'/>";
const TURNED: &str =
    "<transform name='to_world'><matrix value='0 0 -1 1.25  0 1 0 0  1 0 0 1  0 0 0 1'/></transform>";

fn load(side: usize, max_depth: u32, body: &str) -> (World, View, RenderOptions) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    let text = format!(
        "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='{max_depth}'/>
         </integrator><sensor type='perspective'><string name='focal_length' value='50mm'/>
         <transform name='to_world'>{MATRIX}</transform><film type='hdrfilm'>
         <integer name='width' value='{side}'/><integer name='height' value='{side}'/>
         <rfilter type='box'/></film></sensor>{body}</scene>"
    );
    std::fs::write(&path, text).unwrap();
    let scene = load_mitsuba(path, &MitsubaOptions::default()).unwrap();
    let (view, options) = (View::from_mitsuba(&scene.sensor), RenderOptions::from_mitsuba(&scene));
    let plain = WorldOptions::default();
    (World::with_options(Parts::from_mitsuba(scene), plain).unwrap(), view, options)
}

const BALL: &str =
    "<shape type='sphere'><transform name='to_world'><scale value='0.25'/></transform></shape>";

/// The scene, Mitsuba's `max_depth`, and the material and value of a published case.
fn case(name: &str) -> (String, u32, usize, MaterialValue) {
    let square = "<shape type='rectangle'/>";
    let light = "<emitter type='constant'><rgb name='radiance' value='3'/></emitter>";
    match name {
        "diffuse_albedo" => {
            (format!("{square}{BALL}<emitter type='constant'/>"), 2, 0, MaterialValue::Reflectance)
        }
        "diffuse_albedo_g_i" => {
            let green = format!(
                "<shape type='rectangle'>{TURNED}<bsdf type='diffuse'>
                 <rgb name='reflectance' value='0.1, 1, 0.1'/></bsdf></shape>"
            );
            // Shapes without a BSDF share one material.
            (format!("{square}{BALL}{green}{light}"), 3, 1, MaterialValue::Reflectance)
        }
        "area_light_radiance" => {
            let white = "<shape type='rectangle'><bsdf type='diffuse'><rgb name='reflectance' value='1'/></bsdf></shape>";
            let lamp = format!(
                "<shape type='rectangle'>{TURNED}<emitter type='area'><rgb name='radiance' value='3'/></emitter></shape>"
            );
            (format!("{white}{BALL}{lamp}"), 2, 2, MaterialValue::Emission)
        }
        _ => {
            let lamp = "<shape type='rectangle'><emitter type='area'><rgb name='radiance' value='1'/></emitter></shape>";
            (lamp.into(), 2, 0, MaterialValue::Emission)
        }
    }
}

/// Derivatives of the means of blocks of 8 x 8 pixels; the references have noise of their own, and single precision of
/// a difference divided by 0.001.
#[test]
#[ignore = "needs the reference images: PHOTOFIT_GRADIENTS names their folder"]
fn derivative_images_of_mitsuba() {
    const BLOCK: usize = 8;
    let folder = std::env::var("PHOTOFIT_GRADIENTS").expect("PHOTOFIT_GRADIENTS names the folder");
    for name in [
        "diffuse_albedo",
        "diffuse_albedo_g_i",
        "area_light_radiance",
        "directly_visible_area_light_radiance",
    ] {
        let file = format!("test_{name}_image_fwd_ref.exr");
        let reference = photofit_image::read(Path::new(&folder).join(file)).unwrap();
        let (body, depth, material, value) = case(name);
        // The plane alone is changed; it shares its material with the ball where neither has one.
        let body = if name == "diffuse_albedo" {
            let own = "<bsdf type='diffuse'/>";
            body.replacen("<shape type='rectangle'/>", &format!("<shape type='rectangle'>{own}</shape>"), 1)
        } else {
            body
        };
        let side = reference.width;
        let (world, view, options) = load(side, depth, &body);
        let parameter = Parameter::Material { materials: vec![material], value };
        let adjoint = Adjoint::new(&world, &view, options, &[parameter]).unwrap();
        // Nothing but rounding: a lamp of radiance 1 has a derivative of 0.978 there.
        let tolerance = if name.starts_with("directly") { 0.03 } else { 0.02 };
        let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        let (mut sum, mut expected_sum) = (0.0, 0.0);
        for by in (0..side).step_by(BLOCK) {
            for bx in (0..side).step_by(BLOCK) {
                let share = 1.0 / (BLOCK * BLOCK) as f32;
                let inside = |x: usize, y: usize| x / BLOCK == bx / BLOCK && y / BLOCK == by / BLOCK;
                let loss = Image::from_fn(side, side, 3, |x, y, _| if inside(x, y) { share } else { 0.0 });
                let samples = GradientSamples { spp: 256, seed: Some((by * side + bx) as u64) };
                let (gradient, error) = adjoint.render_vjp_with_error(&loss, samples).unwrap();
                for c in 0..3 {
                    let expected = (0..BLOCK * BLOCK)
                        .map(|i| f64::from(reference.pixel(bx + i % BLOCK, by + i / BLOCK)[c]))
                        .sum::<f64>()
                        / (BLOCK * BLOCK) as f64;
                    let (found, sigma) = (gradient.parameters[0].values[c], error.parameters[0].values[c]);
                    let bound = (tolerance * expected.abs()).max(4.0 * sigma) + 2e-3;
                    let off = (found - expected).abs();
                    assert!(off <= bound, "{name} ({bx}, {by}) {c}: {found} +- {sigma} of {expected}");
                    worst = worst.max(off);
                    (squares, count) = (squares + off * off, count + 1.0);
                    (sum, expected_sum) = (sum + found, expected_sum + expected);
                }
            }
        }
        let (rms, mean, reference) = (f64::sqrt(squares / count), sum / count, expected_sum / count);
        println!("{name:<40} mean {mean:.5} of {reference:.5}, blocks: rms {rms:.1e}, worst {worst:.1e}");
        assert!((mean - reference).abs() < tolerance * reference.abs(), "{name}");
    }
}

/// A bitmap of random grey or coloured texels, changed by offsets.
fn bitmap(channels: usize, offsets: &[f64]) -> Texture {
    let image = Image::from_fn(4, 4, channels, |x, y, c| {
        let i = y * 4 + x;
        let base = 0.3 + 0.05 * ((7 * i + 3 * c) % 8) as f32;
        base + offsets.get(3 * i + c).map_or(0.0, |o| *o as f32)
    });
    let image = Arc::new(Bitmap::new(&image, photofit_scene::Wrap::Repeat, photofit_scene::Filter::Bilinear));
    Texture::Bitmap { image, to_uv: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], scale: 1.0 }
}

#[test]
fn textures_of_trees() {
    let body = "<shape type='rectangle'><bsdf type='diffuse'/></shape>
                <shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/>
                <translate y='-0.9' z='0.9'/></transform><bsdf type='roughconductor'><float name='alpha' value='0.3'/>
                </bsdf></shape><emitter type='point'><point name='position' x='1' y='1.5' z='3'/>
                <rgb name='intensity' value='9'/></emitter><emitter type='constant'/>";
    let set = |world: &mut World, which: usize, offsets: &[f64]| {
        let mut materials = [world.given[0].clone(), world.given[1].clone()];
        let diffuse = SurfaceNode::Diffuse { reflectance: bitmap(3, if which == 0 { offsets } else { &[] }) };
        let root = SurfaceNode::TwoSided { front: Box::new(diffuse), back: None };
        materials[0].scattering = BsdfSource::Graph(Arc::new(SurfaceGraph { root, emission: None }));
        let number = |x| Texture::Constant(Vec3f::splat(x));
        let alpha = bitmap(1, if which == 1 { offsets } else { &[] });
        let surface = photofit_shading::bsdf::Microfacet::isotropic(Default::default(), 0.3);
        let rough =
            Some(photofit_scene::graph::Roughness { surface, alpha_u: alpha.clone(), alpha_v: alpha });
        let root =
            SurfaceNode::Conductor { eta: number(0.2), k: number(3.5), reflectance: number(0.9), rough };
        materials[1].scattering = BsdfSource::Graph(Arc::new(SurfaceGraph { root, emission: None }));
        materials.iter().enumerate().for_each(|(i, m)| world.set_material(i, m).unwrap());
    };
    let weights = Image::from_fn(16, 16, 3, |x, y, c| 0.2 + ((5 * x + 3 * y + c) % 7) as f32 / 7.0);
    for (which, places) in [(0, vec![[0, 0]]), (1, vec![[1, 3], [1, 4]])] {
        let make = |offsets: &[f64]| {
            let (mut world, view, options) = load(16, 4, body);
            set(&mut world, which, offsets);
            (world, view, RenderOptions { spp: 64, ..options })
        };
        let (world, view, options) = make(&[]);
        let adjoint = Adjoint::new(&world, &view, options, &[Parameter::Graph { places }]).unwrap();
        let direction: Vec<f64> = (0..48).map(|i| 0.5 + 0.5 * f64::from(i * 5 % 8) / 8.0).collect();
        // Grey texels have their gradient in the first channel, and their offset there.
        let used = |i: usize| which == 0 || i.is_multiple_of(3);
        let direction: Vec<f64> =
            direction.iter().enumerate().map(|(i, d)| if used(i) { *d } else { 0.0 }).collect();
        let samples = |seed| GradientSamples { spp: 64, seed: Some(seed) };
        let replayed: Vec<f64> = (0..8)
            .map(|seed| {
                let gradient = adjoint.render_vjp(&weights, samples(seed)).unwrap();
                gradient.parameters[0].values.iter().zip(&direction).map(|(g, d)| g * d).sum()
            })
            .collect();
        let step = 0.04;
        let loss = |sign: f64, seed: u64| {
            let offsets: Vec<f64> = direction.iter().map(|d| sign * step * d).collect();
            let (world, view, options) = make(&offsets);
            let mut renderer = Renderer::new(&world, &view, RenderOptions { seed, ..options }).unwrap();
            while !renderer.pass(|| false).done {}
            let p = renderer.picture();
            (0..256)
                .map(|i| (0..3).map(|c| f64::from(p.data[4 * i + c] * weights.data[3 * i + c])).sum::<f64>())
                .sum::<f64>()
        };
        let differences: Vec<f64> =
            (0..8).map(|seed| (loss(1.0, 50 + seed) - loss(-1.0, 50 + seed)) / (2.0 * step)).collect();
        let statistics = |v: &[f64]| {
            let mean = v.iter().sum::<f64>() / v.len() as f64;
            let squares = v.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
            (mean, (squares / (v.len() * (v.len() - 1)) as f64).sqrt())
        };
        let ((a, sa), (b, sb)) = (statistics(&replayed), statistics(&differences));
        println!("tree {which}: replay {a} +- {sa}, differences {b} +- {sb}");
        let sigma = sa.hypot(sb);
        assert!((a - b).abs() <= (0.02 * b.abs()).max(4.0 * sigma), "{which}: {a} {sa} {b} {sb}");
        assert!(sigma < 0.15 * b.abs(), "{which}: {a} {sa} {b} {sb}");
    }
}
