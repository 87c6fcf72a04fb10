//! What the fit reads of its maps is what other programs read of the exported textures.

use crate::candidate::Candidate;
use crate::simplify::{Normalised, to_scene};
use photofit_geometry::{shapes, weld::weld_exact};
use photofit_gradcheck::Uniform;
use photofit_raster::texture::{
    AlphaMode, Filter, MipRule, Pyramid, Sampler, Wrap, level_of_detail, lookup, sample,
};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::{Vec2f, vec2, vec4};
use photofit_scene::{Instance, Material, Primitive, Scene, SurfaceLibrary, UvDerivatives};

const SIZE: (usize, usize) = (13, 10);
/// One step of 8 bits (half from the base level, half from the coarse one) where the sRGB transfer is steepest, and the
/// same of the weights, which are at least a quarter.
const COLOR: f32 = 2.3 / 255.0 + 0.006;
const LINEAR: f32 = 1.05 / 255.0;

/// Maps whose hidden colours differ from the visible ones.
fn maps() -> Maps {
    let mut random = Uniform::new(5);
    let mut maps = Maps::filled(SIZE.0, SIZE.1, [0.0; CHANNELS]);
    for t in &mut maps.texels {
        let alpha = random.range(0.25, 1.0) as f32;
        for c in 0..3 {
            t[channel::BASE_COLOR + c] = (alpha * 0.8 + random.range(0.0, 0.2) as f32).min(1.0);
        }
        t[channel::ALPHA] = alpha;
        t[channel::ROUGHNESS] = random.range(0.2, 1.0) as f32;
        t[channel::METALLIC] = random.range(0.0, 1.0) as f32;
        t[channel::NORMAL + 2] = 1.0;
    }
    maps
}

/// A square with these maps, and the scene that is written of it.
fn fitted(mode: AlphaMode) -> (Candidate, Scene) {
    let mesh = shapes::quad_grid(1, 1);
    let reference = Scene {
        primitives: vec![Primitive { mesh: mesh.clone(), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![Material { alpha_mode: mode, ..Material::clay() }],
        ..Scene::default()
    };
    let n = Normalised::new(&reference).unwrap();
    let class = n.light_asset.classes.iter().position(|c| c.written == mode).unwrap();
    let drawn = n.light_asset.drawn_classes();
    let classes = vec![class as u32; mesh.triangles.len()];
    let candidate = Candidate::new(&mesh, &weld_exact(&mesh.positions), classes, drawn, maps());
    let scene = to_scene(&candidate, &n.light_asset);
    (candidate, scene)
}

/// Largest differences of base colour, and of coverage, roughness and metalness, between a pyramid and the file.
fn differences(pyramid: &Pyramid<f32, CHANNELS>, scene: &Scene, mode: AlphaMode) -> (f32, f32) {
    let library = SurfaceLibrary::new(scene);
    let clamp = Wrap::ClampToEdge;
    let sampler = Sampler { wrap_u: clamp, wrap_v: clamp, filter: Filter::Trilinear };
    let mut random = Uniform::new(8);
    let (mut color, mut linear) = (0.0_f32, 0.0_f32);
    for i in 0..400 {
        let uv = vec2(random.range(0.0, 1.0) as f32, random.range(0.0, 1.0) as f32);
        // Magnified, and minified to every level.
        let texels = [0.4, 1.0, 1.6, 2.0, 3.3, 5.0, 9.0][i % 7];
        let (dx, dy) = (vec2(texels / SIZE.0 as f32, 0.0), vec2(0.0, texels / SIZE.1 as f32));
        let duv: [Vec2f; 2] = [vec2(dx.x, dy.x), vec2(dx.y, dy.y)];
        let lod = level_of_detail(&duv, SIZE.0, SIZE.1, 0.0, pyramid.levels.len() - 1);
        let ours = sample(pyramid, &lookup(pyramid, uv, Some(&lod), &sampler));
        let (white, footprint) = (vec4(1.0, 1.0, 1.0, 1.0), UvDerivatives::same(dx, dy));
        let theirs = library.lookup(0, uv, uv, white, Some(&footprint));
        for (c, t) in theirs.base_color.to_array().iter().enumerate() {
            color = color.max((ours[channel::BASE_COLOR + c] - t).abs());
        }
        linear = linear.max((ours[channel::ROUGHNESS] - theirs.roughness).abs());
        linear = linear.max((ours[channel::METALLIC] - theirs.metallic).abs());
        let alpha = ours[channel::ALPHA];
        let near_cutoff = matches!(mode, AlphaMode::Mask { cutoff } if (alpha - cutoff).abs() < LINEAR);
        if !near_cutoff {
            linear = linear.max((mode.coverage(alpha) - theirs.alpha).abs());
        }
    }
    (color, linear)
}

#[test]
fn the_fit_reads_its_maps_as_the_judge_reads_the_file() {
    for mode in [AlphaMode::Opaque, AlphaMode::Mask { cutoff: 0.5 }, AlphaMode::Blend] {
        let (candidate, scene) = fitted(mode);
        let (color, linear) = differences(&candidate.maps, &scene, mode);
        assert!(color < COLOR && linear < LINEAR, "{mode:?}: {color} {linear}");
        // The same with the other rule: the comparison can tell.
        let opaque = mode == AlphaMode::Opaque;
        let rule = MipRule::Coverage { colors: channel::ALPHA, alpha: channel::ALPHA };
        let other = if opaque { rule } else { MipRule::Area };
        let other = Pyramid::with_rule(candidate.maps.levels[0].clone(), other);
        let (color, _) = differences(&other, &scene, mode);
        assert!(color > 2.0 * COLOR, "{mode:?} by the wrong rule: {color}");
    }
}
