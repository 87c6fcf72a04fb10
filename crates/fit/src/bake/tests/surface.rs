//! Colours, normals and which surface is chosen.

use super::{World, color_of, degrees, go_on, moved, noise, painted, patches, shaded, sheet, size};
use crate::bake::{AlphaClass, BakeClass, BakeSettings, Baked, Target, bake};
use crate::visibility::Visibility;
use photofit_geometry::{Mesh, atlas, shapes};
use photofit_raster::channel;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Material;

#[test]
fn sphere_normals_survive_on_a_coarse_icosphere() {
    let mut world = World::default();
    world.add(&shapes::icosphere(40), Material::clay());
    let target = patches(&shapes::icosphere(3));
    let baked = world.bake(&world.visibility(), &target, &size(192));
    let texels = shaded(&target, &baked);
    assert!(texels.len() > 8000, "{} texels", texels.len());
    let errors: Vec<f32> = texels.iter().map(|(_, n, p)| degrees(*n, p.normalize_or_zero())).collect();
    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
    let worst = errors.iter().copied().fold(0.0, f32::max);
    assert!(mean < 0.3, "mean {mean} degrees");
    assert!(worst < 2.5, "worst {worst} degrees");
    let s = baked.statistics;
    assert_eq!((s.missed, s.hidden, s.cut), (0, 0, 0), "{s:?}");
    assert!(s.by_ray as f64 > 0.99 * s.samples as f64, "{s:?}");
    assert_eq!(s.valid_texels, s.covered_texels);
}

#[test]
fn a_two_colour_cube_keeps_its_colours() {
    let (red, blue) = ([0.8, 0.1, 0.1], [0.1, 0.1, 0.7]);
    let cube = shapes::cube();
    let along_x = |m: &Mesh, t: usize| m.normals[m.triangles[t][0] as usize].x.abs() > 0.5;
    let half = |keep: bool| {
        let mut m = cube.clone();
        m.triangles = (0..12).filter(|&t| along_x(&cube, t) == keep).map(|t| cube.triangles[t]).collect();
        m
    };
    let mut world = World::default();
    world.add(&half(true), painted(red)).add(&half(false), painted(blue));
    for scale in [1.0, 1.01, 0.99] {
        let target = patches(&moved(&cube, scale, Vec3f::zero()));
        let baked = world.bake(&world.visibility(), &target, &size(96));
        let cover = atlas::mesh_coverage(&target.uvs, &target.triangles, 96, 96, true);
        let mut wrong = 0;
        for i in (0..96 * 96).filter(|&i| baked.valid[i]) {
            let want = if along_x(&target, cover.triangle[i] as usize) { red } else { blue };
            let got = color_of(&baked.maps.texels[i]);
            wrong += usize::from((0..3).any(|k| (got[k] - want[k]).abs() > 1e-5));
        }
        assert_eq!(wrong, 0, "texels of a wrong colour at scale {scale}");
        assert!(baked.statistics.valid_texels > 1900, "{:?}", baked.statistics);
    }
}

#[test]
fn an_inner_shell_never_reaches_the_outer_one() {
    let (red, blue) = ([0.8, 0.1, 0.1], [0.1, 0.1, 0.7]);
    let sphere = shapes::icosphere(16);
    let mut inner = moved(&sphere, 0.97, Vec3f::zero());
    let mut world = World::default();
    world.add(&sphere, painted(red)).add(&inner, painted(blue));
    // The faces of the target dip below the inner shell.
    let target = patches(&shapes::icosphere(2));
    let blues = |baked: &Baked| {
        (0..baked.valid.len()).filter(|&i| baked.valid[i] && baked.maps.texels[i][2] > 0.2).count()
    };
    let seen = world.visibility();
    assert_eq!(seen.hidden(), inner.triangles.len(), "all of the inner shell");
    let baked = world.bake(&seen, &target, &size(128));
    assert_eq!(blues(&baked), 0);
    assert_eq!((baked.statistics.missed, baked.statistics.hidden), (0, 0), "{:?}", baked.statistics);
    // Without visibility it does reach it: the test can fail.
    let naive = world.bake(&Visibility::everything(sphere.triangles.len() * 2), &target, &size(128));
    assert!(blues(&naive) > 100);
    // Nor does the far side of a thin double-sided wall.
    inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    inner.normals.iter_mut().for_each(|n| *n = -*n);
    let mut wall = World::default();
    wall.add(&sphere, Material { double_sided: true, ..painted(red) });
    wall.add(&inner, Material { double_sided: true, ..painted(blue) });
    assert_eq!(blues(&wall.bake(&wall.visibility(), &target, &size(128))), 0);
}

#[test]
fn equal_sheets_reproduce_textures() {
    let n = 24;
    let mut world = World::default();
    let colors: Vec<[u8; 4]> =
        (0..n * n).map(|i| [noise(i), noise(i + 7000), noise(i + 9000), 255]).collect();
    let base_color_texture = world.image(n, colors.clone());
    let metallic_roughness: Vec<[u8; 4]> =
        (0..n * n).map(|i| [0, noise(i + 100), noise(i + 300), 255]).collect();
    let metallic_roughness_texture = world.image(n, metallic_roughness.clone());
    let bumps: Vec<[u8; 4]> =
        (0..n * n).map(|i| [100 + noise(i + 500) / 4, 100 + noise(i + 900) / 4, 220, 255]).collect();
    let normal_texture = world.image(n, bumps.clone());
    let material = Material {
        base_color_texture,
        metallic_roughness_texture,
        normal_texture,
        emissive: [2.0, 3.0, 4.0],
        ..Material::default()
    };
    world.add(&sheet(3), material);
    let target = sheet(2);
    let exact = BakeSettings { samples_per_side: 1, ..size(n) };
    let baked = world.bake(&Visibility::everything(18), &target, &exact);
    assert!(baked.valid.iter().all(|&v| v), "all texels baked");
    let bits = |x: f32| (x * 255.0).round() as u8;
    let srgb = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    for (i, texel) in baked.maps.texels.iter().enumerate() {
        assert_eq!(
            [0, 1, 2].map(|k| bits(srgb(texel[k]))),
            [colors[i][0], colors[i][1], colors[i][2]],
            "texel {i}"
        );
        assert_eq!(bits(texel[channel::ROUGHNESS]), metallic_roughness[i][1], "texel {i}");
        assert_eq!(bits(texel[channel::METALLIC]), metallic_roughness[i][2], "texel {i}");
        let want = vec3(bumps[i][0], bumps[i][1], bumps[i][2]);
        let want = vec3(f32::from(want.x), f32::from(want.y), f32::from(want.z)) * (2.0 / 255.0);
        let want = (want - vec3(1.0, 1.0, 1.0)).normalize_or_zero();
        let got = vec3(texel[channel::NORMAL], texel[channel::NORMAL + 1], texel[channel::NORMAL + 2]);
        assert!((got - want).length() < 1e-5, "texel {i}: {got:?} for {want:?}");
        assert_eq!(&texel[channel::EMISSIVE..channel::USED], &[2.0, 3.0, 4.0]);
        assert_eq!((texel[channel::ALPHA], texel[channel::SPECULAR_SUPPRESSION]), (1.0, 0.0));
    }
    // Four samples average: the mean of the picture stays.
    let mean = |b: &Baked| b.maps.texels.iter().map(|t| t[0]).sum::<f32>() / (n * n) as f32;
    let smooth = world.bake(&Visibility::everything(18), &target, &size(n));
    assert!((mean(&smooth) - mean(&baked)).abs() < 0.01, "{} and {}", mean(&smooth), mean(&baked));
}

#[test]
fn spread_normals_widen_the_roughness() {
    let mut world = World::default();
    world.add(&shapes::icosphere(16), Material { roughness: 0.2, ..Material::clay() });
    let target = patches(&shapes::icosphere(1));
    let seen = world.visibility();
    // A few texels for a whole face: the normals of a texel differ much.
    let wide = BakeSettings { widen_roughness: true, samples_per_side: 8, filter_width: 1.0, ..size(16) };
    let plain = BakeSettings { widen_roughness: false, ..wide };
    let mean = |s: &BakeSettings| {
        let b = world.bake(&seen, &target, s);
        b.maps
            .texels
            .iter()
            .zip(&b.valid)
            .filter(|(_, v)| **v)
            .map(|(t, _)| t[channel::ROUGHNESS])
            .sum::<f32>()
            / b.statistics.valid_texels as f32
    };
    assert!((mean(&plain) - 0.2).abs() < 1e-5);
    let widened = mean(&wide);
    assert!((0.25..0.8).contains(&widened), "{widened}");
}

#[test]
fn the_back_of_a_double_sided_sheet_faces_the_target() {
    let mut world = World::default();
    world.add(&sheet(1), Material { double_sided: true, ..Material::clay() });
    let mut behind = sheet(1);
    behind.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    behind.normals.iter_mut().for_each(|n| *n = -*n);
    let baked = world.bake(&world.visibility(), &behind, &size(8));
    for (_, n, _) in shaded(&behind, &baked) {
        assert!(degrees(n, vec3(0.0, 0.0, -1.0)) < 0.01, "{n:?}");
    }
    assert_eq!(baked.statistics.valid_texels, 64);
    // A single-sided one is not there from behind.
    let mut single = World::default();
    single.add(&sheet(1), Material::clay());
    let baked = single.bake(&single.visibility(), &behind, &size(8));
    assert_eq!((baked.statistics.valid_texels, baked.statistics.missed), (0, 256));
    assert!((baked.statistics.missed_share() - 1.0).abs() < 1e-12);
}

#[test]
fn unlit_surfaces_become_emission() {
    let mut world = World::default();
    world.add(&sheet(1), Material { unlit: true, ..painted([0.5, 0.25, 0.75]) });
    let seen = Visibility::everything(2);
    let t = world.bake(&seen, &sheet(1), &size(2)).maps.texels[0];
    assert_eq!(color_of(&t), [0.0; 3]);
    assert_eq!(
        (&t[channel::EMISSIVE..channel::USED], t[channel::SPECULAR_SUPPRESSION]),
        (&[0.5, 0.25, 0.75][..], 1.0)
    );
    let kept = BakeSettings { unlit_as_emission: false, ..size(2) };
    assert_eq!(color_of(&world.bake(&seen, &sheet(1), &kept).maps.texels[0]), [0.5, 0.25, 0.75]);
}

#[test]
fn opposed_surfaces_and_right_ones_are_not_mixed() {
    let half = |[lo, hi]: [f32; 2], cells, [u, width]: [f32; 2], side: f32| {
        let mut mesh = sheet(cells);
        mesh.positions.iter_mut().for_each(|p| p.x = lo + (hi - lo) * 0.5 * (p.x + 1.0));
        mesh.uvs.iter_mut().for_each(|uv| uv.x = u + width * uv.x);
        mesh.normals.iter_mut().for_each(|n| *n *= side);
        mesh
    };
    let whole = [0.0, 1.0];
    // Two sheets that touch without a common edge, the right one with normals that point to its back.
    let mut world = World::default();
    world.add(&half([-1.0, 0.0], 1, whole, 1.0), Material::clay());
    world.add(&half([0.0, 1.0], 2, whole, -1.0), Material::clay());
    // The seam of the target lies elsewhere, and within a texel of the atlas.
    let (x, u) = (0.05, 0.5025);
    let mut target = half([-1.0, x], 1, [0.0, u], 1.0);
    let right = half([x, 1.0], 1, [u, 1.0 - u], -1.0);
    let base = target.positions.len() as u32;
    target.positions.extend(&right.positions);
    target.normals.extend(&right.normals);
    target.tangents.extend(&right.tangents);
    target.uvs.extend(&right.uvs);
    target.triangles.extend(right.triangles.iter().map(|t| t.map(|v| v + base)));
    let directions = vec![vec3(0.0, 0.0, 1.0); target.positions.len()];
    let of = |opposed| BakeClass { opposed, ..AlphaClass::Opaque.into() };
    let classes = [of(false), of(false), of(true), of(true)];
    let onto = Target { mesh: &target, directions: Some(&directions), classes: Some(&classes) };
    let settings = BakeSettings { widen_roughness: true, ..size(41) };
    let seen = Visibility::everything(10);
    let baked = world.with(|r| bake(r, &seen, &onto, &settings, &go_on)).unwrap();
    let texels = shaded(&target, &baked);
    assert_eq!(texels.len(), 41 * 41);
    for (i, n, p) in texels {
        let wanted = vec3(0.0, 0.0, if p.x < x { 1.0 } else { -1.0 });
        assert!(degrees(n, wanted) < 0.1, "at x = {}: {n:?}, expected {wanted:?}", p.x);
        let roughness = baked.maps.texels[i][channel::ROUGHNESS];
        assert!((roughness - Material::clay().roughness).abs() < 1e-3, "spread at x = {}: {roughness}", p.x);
    }
}
