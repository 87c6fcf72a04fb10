//! Known answers of baking.

use super::reference::Place;
use super::{AlphaClass, BakeError, BakeSettings, Baked, Reference, bake};
use crate::visibility::{Visibility, VisibilitySettings, visibility};
use photofit_geometry::{Mesh, shapes};
use photofit_pathtrace::AccelError;
use photofit_raster::channel;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{
    AlphaMode, Filter, FlatScene, Material, Sampler, Scene, SurfaceLibrary, TextureImage, TextureSlot, Wrap,
};
use std::ops::ControlFlow;

/// A reference in the making.
#[derive(Default)]
struct World {
    flat: FlatScene,
    scene: Scene,
}

impl World {
    fn add(&mut self, mesh: &Mesh, material: Material) -> &mut Self {
        let base = self.flat.mesh.positions.len() as u32;
        let m = &mut self.flat.mesh;
        m.positions.extend(&mesh.positions);
        m.normals.extend(&mesh.normals);
        let uvs =
            if mesh.uvs.is_empty() { vec![vec2(0.0, 0.0); mesh.positions.len()] } else { mesh.uvs.clone() };
        m.uvs.extend(uvs);
        m.tangents.extend(if mesh.tangents.is_empty() {
            mesh.normals.iter().map(|n| n.orthonormal_pair().0.extend(1.0)).collect()
        } else {
            mesh.tangents.clone()
        });
        m.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
        let material_index = self.scene.materials.len() as u32;
        self.flat.triangle_material.extend(mesh.triangles.iter().map(|_| material_index));
        self.scene.materials.push(material);
        self
    }

    fn image(&mut self, width: usize, texels: Vec<[u8; 4]>) -> Option<TextureSlot> {
        let height = texels.len() / width;
        self.scene.images.push(TextureImage { name: "image".into(), width, height, texels });
        let sampler =
            Sampler { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::ClampToEdge, filter: Filter::Bilinear };
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Some(TextureSlot { image: self.scene.images.len() - 1, sampler, tex_coord: 0, transform })
    }

    fn with<R>(&self, ask: impl FnOnce(&Reference<'_>) -> R) -> R {
        let library = SurfaceLibrary::new(&self.scene);
        ask(&Reference::new(&self.flat, &self.scene.materials, &library).unwrap())
    }

    fn visibility(&self) -> Visibility {
        self.with(|r| visibility(r, &quick()))
    }

    fn bake(&self, seen: &Visibility, target: &Mesh, settings: &BakeSettings) -> Baked {
        self.with(|r| bake(r, seen, target, None, settings, &go_on)).unwrap()
    }
}

fn quick() -> VisibilitySettings {
    VisibilitySettings { rays: 200_000, ..VisibilitySettings::default() }
}

fn go_on(_: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn size(side: usize) -> BakeSettings {
    BakeSettings { width: side, height: side, ..BakeSettings::default() }
}

fn painted(color: [f32; 3]) -> Material {
    Material { base_color: [color[0], color[1], color[2], 1.0], ..Material::clay() }
}

/// Each triangle on its own patch of the atlas; vertices split, normals kept, tangents along the patch.
fn patches(mesh: &Mesh) -> Mesh {
    let side = (mesh.triangles.len() as f32).sqrt().ceil();
    let mut out = Mesh::default();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let cell = vec2((t as f32 % side).floor(), (t as f32 / side).floor());
        let [a, b, c] = mesh.corners(t);
        // Solves uv derivatives for this patch: u along b - a, v along c - a.
        let (e1, e2) = (b - a, c - a);
        for (k, &i) in corners.iter().enumerate() {
            let local = [vec2(0.1, 0.1), vec2(0.8, 0.1), vec2(0.1, 0.8)][k];
            out.positions.push(mesh.positions[i as usize]);
            let n = mesh.normals[i as usize];
            out.normals.push(n);
            out.uvs.push((cell + local) / side);
            let tangent = (e1 - n * n.dot(e1)).normalize_or_zero();
            let w = if n.cross(tangent).dot(e2) < 0.0 { -1.0 } else { 1.0 };
            out.tangents.push(tangent.extend(w));
        }
        let base = 3 * t as u32;
        out.triangles.push([base, base + 1, base + 2]);
    }
    out
}

fn moved(mesh: &Mesh, scale: f32, shift: Vec3f) -> Mesh {
    let mut out = mesh.clone();
    out.positions.iter_mut().for_each(|p| *p = *p * scale + shift);
    out
}

fn color_of(texel: &[f32; 16]) -> [f32; 3] {
    [texel[0], texel[1], texel[2]]
}

/// World-space normal that shading makes of a baked texel, and the point of the target there.
fn shaded(target: &Mesh, baked: &Baked) -> Vec<(usize, Vec3f, Vec3f)> {
    let (w, h) = (baked.maps.width, baked.maps.height);
    let cover = photofit_geometry::atlas::mesh_coverage(&target.uvs, &target.triangles, w, h, true);
    (0..w * h)
        .filter(|&i| baked.valid[i])
        .map(|i| {
            let b = cover.barycentric[i];
            let t = target.triangles[cover.triangle[i] as usize].map(|i| i as usize);
            let mix = |a: &[Vec3f]| a[t[0]] * b[0] + a[t[1]] * b[1] + a[t[2]] * b[2];
            let tangents: Vec<Vec3f> = target.tangents.iter().map(|t| t.xyz()).collect();
            let texel = &baked.maps.texels[i];
            let map = vec3(texel[channel::NORMAL], texel[channel::NORMAL + 1], texel[channel::NORMAL + 2]);
            let n =
                photofit_shading::perturb(mix(&target.normals), mix(&tangents), target.tangents[t[0]].w, map);
            (i, n, mix(&target.positions))
        })
        .collect()
}

fn degrees(a: Vec3f, b: Vec3f) -> f32 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

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
        let cover = photofit_geometry::atlas::mesh_coverage(&target.uvs, &target.triangles, 96, 96, true);
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

/// A deterministic byte.
fn noise(i: usize) -> u8 {
    ((i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u8
}

/// A square sheet with tangents.
fn sheet(cells: u32) -> Mesh {
    let mut mesh = shapes::quad_grid(cells, cells);
    // v grows downwards, against +y: the bitangent of glTF (towards v = 0 in texture space, green up) is +y.
    mesh.tangents = mesh.normals.iter().map(|_| vec3(1.0, 0.0, 0.0).extend(1.0)).collect();
    mesh
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
        assert_eq!((texel[channel::ALPHA], texel[channel::GAMMA]), (1.0, 0.0));
    }
    // Four samples average: the mean of the picture stays.
    let mean = |b: &Baked| b.maps.texels.iter().map(|t| t[0]).sum::<f32>() / (n * n) as f32;
    let smooth = world.bake(&Visibility::everything(18), &target, &size(n));
    assert!((mean(&smooth) - mean(&baked)).abs() < 0.01, "{} and {}", mean(&smooth), mean(&baked));
}

#[test]
fn masks_are_sampled_and_holes_give_no_colour() {
    // Stripes of 8 texels: white and solid, then green and cut.
    let mut world = World::default();
    let stripes: Vec<[u8; 4]> =
        (0..64 * 64).map(|i| if (i % 64) / 8 % 2 == 0 { [255; 4] } else { [0, 255, 0, 0] }).collect();
    let base_color_texture = world.image(64, stripes);
    let mut masked =
        Material { base_color_texture, alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..Material::clay() };
    masked.base_color = [1.0; 4];
    world.add(&sheet(1), masked);
    world.add(&moved(&sheet(1), 1.0, vec3(0.0, 0.0, -0.01)), painted([0.8, 0.1, 0.1]));
    let seen = world.visibility();
    let target = sheet(1);
    let ask = |classes: Option<&[AlphaClass]>| {
        world.with(|r| bake(r, &seen, &target, classes, &size(20), &go_on)).unwrap()
    };
    let baked = ask(Some(&[AlphaClass::Mask; 2]));
    let alpha: f32 = baked.maps.texels.iter().map(|t| t[channel::ALPHA]).sum::<f32>() / 400.0;
    assert!((alpha - 0.5).abs() < 0.03, "coverage {alpha}");
    assert!(baked.cut.iter().filter(|&&c| c).count() > 50, "texels inside of the holes");
    assert!(
        baked.maps.texels.iter().any(|t| (0.2..0.8).contains(&t[channel::ALPHA])),
        "borders are partly covered"
    );
    for (i, t) in baked.maps.texels.iter().enumerate().filter(|(i, _)| baked.valid[*i]) {
        // Bilinear filtering mixes the two at the border itself.
        assert!(t[0] > 0.2 && t[1] > 0.9, "texel {i}: {:?}", color_of(t));
    }
    let mut filled = baked.clone();
    filled.fill(None);
    for i in 0..400 {
        assert!(filled.maps.texels[i][0] > 0.2, "texel {i} is filled");
        assert_eq!(filled.maps.texels[i][channel::ALPHA], baked.maps.texels[i][channel::ALPHA]);
    }
    // The opaque class sees only the sheet behind; without classes the holes show it.
    for t in ask(Some(&[AlphaClass::Opaque; 2])).maps.texels {
        assert_eq!((color_of(&t), t[channel::ALPHA]), ([0.8, 0.1, 0.1], 1.0));
    }
    let mixed = ask(None);
    assert!(mixed.cut.iter().all(|&c| !c) && mixed.maps.texels.iter().any(|t| t[1] < 0.2));
}

#[test]
fn blended_alpha_weighs_colours() {
    let mut world = World::default();
    // Each baked texel holds a dense red and a thin blue one.
    let texels: Vec<[u8; 4]> =
        (0..64).map(|i| if i % 2 == 0 { [255, 0, 0, 192] } else { [0, 0, 255, 64] }).collect();
    let base_color_texture = world.image(8, texels);
    let glass = Material {
        base_color_texture,
        base_color: [1.0; 4],
        alpha_mode: AlphaMode::Blend,
        ..Material::clay()
    };
    world.add(&sheet(1), glass);
    let fine = BakeSettings { samples_per_side: 8, ..size(4) };
    let baked = world.bake(&Visibility::everything(2), &sheet(1), &fine);
    let mean = |c: usize| baked.maps.texels.iter().map(|t| t[c]).sum::<f32>() / 16.0;
    assert!((mean(channel::ALPHA) - 128.0 / 255.0).abs() < 0.01, "alpha {}", mean(channel::ALPHA));
    assert!((0.57..0.62).contains(&mean(0)), "the denser half weighs more: {} and {}", mean(0), mean(2));
    assert!((mean(0) + mean(2) - 1.0).abs() < 0.01, "straight colours: {} and {}", mean(0), mean(2));
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
fn spread_normals_widen_the_roughness() {
    let mut world = World::default();
    world.add(&shapes::icosphere(16), Material { roughness: 0.2, ..Material::clay() });
    let target = patches(&shapes::icosphere(1));
    let seen = world.visibility();
    // A few texels for a whole face: the normals of a texel differ much.
    let wide = BakeSettings { widen_roughness: true, samples_per_side: 8, ..size(16) };
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
fn unlit_surfaces_become_emission() {
    let mut world = World::default();
    world.add(&sheet(1), Material { unlit: true, ..painted([0.5, 0.25, 0.75]) });
    let seen = Visibility::everything(2);
    let t = world.bake(&seen, &sheet(1), &size(2)).maps.texels[0];
    assert_eq!(color_of(&t), [0.0; 3]);
    assert_eq!((&t[channel::EMISSIVE..channel::USED], t[channel::GAMMA]), (&[0.5, 0.25, 0.75][..], 1.0));
    let kept = BakeSettings { unlit_as_emission: false, ..size(2) };
    assert_eq!(color_of(&world.bake(&seen, &sheet(1), &kept).maps.texels[0]), [0.5, 0.25, 0.75]);
}

#[test]
fn results_do_not_depend_on_threads_and_a_bake_can_be_stopped() {
    let mut world = World::default();
    world.add(&shapes::displaced_sphere(12, 0.2, 3, 5), Material { double_sided: true, ..Material::clay() });
    let target = patches(&shapes::displaced_sphere(3, 0.2, 3, 5));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let seen = world.visibility();
            let baked = world.bake(&seen, &target, &size(64));
            (seen, baked.maps, baked.valid, baked.statistics)
        })
    };
    assert!(run(1) == run(3), "results differ");
    let stop = |share: f32| if share > 0.3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let seen = world.visibility();
    assert_eq!(
        world.with(|r| bake(r, &seen, &target, None, &size(64), &stop)).unwrap_err(),
        BakeError::Stopped
    );
}

#[test]
fn bad_input_is_refused() {
    let mut world = World::default();
    world.add(&sheet(1), Material::clay());
    let seen = Visibility::everything(2);
    let check = |target: &Mesh, seen: &Visibility, settings: &BakeSettings, expected: &str| {
        let error = world.with(|r| bake(r, seen, target, None, settings, &go_on)).unwrap_err().to_string();
        assert_eq!(error, expected);
    };
    let good = sheet(1);
    let broken = |edit: fn(&mut Mesh)| {
        let mut m = sheet(1);
        edit(&mut m);
        m
    };
    let s = size(4);
    check(&Mesh::default(), &seen, &s, "the target has no triangles");
    check(&broken(|m| m.tangents.clear()), &seen, &s, "target: 0 tangents, expected 4");
    check(&broken(|m| m.positions[2].y = f32::NAN), &seen, &s, "target: position of vertex 2 is not finite");
    check(&broken(|m| m.uvs[1].x = f32::INFINITY), &seen, &s, "target: uv of vertex 1 is not finite");
    check(
        &broken(|m| m.triangles[1][0] = 9),
        &seen,
        &s,
        "target: triangle 1: vertex index 9 is out of range, there are 4 vertices",
    );
    check(&good, &Visibility::everything(1), &s, "reference: 1 sides' visibility, expected 2");
    check(&good, &seen, &size(0), "width is 0: must be 1 to 16384");
    let far = BakeSettings { max_distance: f32::NAN, ..s };
    check(&good, &seen, &far, "max_distance is NaN: must lie in (0, 10]");

    let refuse = |edit: fn(&mut FlatScene)| {
        let mut flat = world.flat.clone();
        edit(&mut flat);
        let library = SurfaceLibrary::new(&world.scene);
        Reference::new(&flat, &world.scene.materials, &library).unwrap_err()
    };
    assert_eq!(
        refuse(|f| f.mesh.positions[3].z = f32::NAN),
        BakeError::Geometry { mesh: "reference", source: AccelError::NonFinite { vertex: 3 } }
    );
    assert_eq!(
        refuse(|f| f.triangle_material[1] = 4),
        BakeError::Material { triangle: 1, material: 4, materials: 1 }
    );
    assert_eq!(refuse(|f| f.mesh.triangles.clear()), BakeError::Empty { what: "reference" });
    assert!(matches!(refuse(|f| f.mesh.normals.truncate(1)), BakeError::Length { what: "normals", .. }));
}

#[test]
fn degenerate_targets_are_survived() {
    let mut world = World::default();
    world.add(&sheet(2), Material::clay());
    let mut target = sheet(2);
    target.triangles.extend([[0, 0, 1], [2, 2, 2]]);
    target.normals[4] = Vec3f::zero();
    target.tangents[4] = Vec3f::zero().extend(1.0);
    target.uvs[8] = vec2(7.0, -3.0);
    let baked = world.bake(&Visibility::everything(8), &target, &size(8));
    assert!(baked.maps.texels.iter().flatten().all(|x| x.is_finite()), "finite maps");
    assert!(baked.statistics.valid_texels > 30, "{:?}", baked.statistics);
}

#[test]
fn visibility_knows_inside_from_outside() {
    let sphere = shapes::icosphere(8);
    let cube = moved(&shapes::cube(), 0.2, Vec3f::zero());
    let n = sphere.triangles.len();
    let mut world = World::default();
    world.add(&sphere, Material::clay()).add(&cube, Material::clay());
    let seen = world.visibility();
    assert!(
        (0..n).all(|t| seen.front[t] > 0.98 && seen.back[t] == 0.0),
        "a convex shell sees all of the sky"
    );
    assert!((n..n + 12).all(|t| !seen.is_visible(t)), "the cube inside is hidden");
    assert_eq!(seen.hidden(), 12);

    // Holes, glass and back faces let light through.
    let clear = Material { base_color: [1.0, 1.0, 1.0, 0.1], ..Material::clay() };
    for (mode, visible) in [
        (AlphaMode::Opaque, false),
        (AlphaMode::Mask { cutoff: 0.5 }, true),
        (AlphaMode::Mask { cutoff: 0.05 }, false),
        (AlphaMode::Blend, true),
    ] {
        let mut world = World::default();
        world.add(&sphere, Material { alpha_mode: mode, ..clear.clone() }).add(&cube, Material::clay());
        let seen = world.visibility();
        assert!((n..n + 12).all(|t| seen.is_visible(t) == visible), "{mode:?}");
        // What is wholly cut out cannot be seen itself.
        assert_eq!(seen.is_visible(0), mode != AlphaMode::Mask { cutoff: 0.5 }, "{mode:?}");
    }
    let mut inward = sphere.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let mut room = World::default();
    room.add(&inward, Material::clay()).add(&cube, Material::clay());
    assert!(
        (n..n + 12).all(|t| room.visibility().is_visible(t)),
        "a room without back faces shows its inside"
    );
    let all = VisibilitySettings { cull_back_faces: false, ..quick() };
    assert!(room.with(|r| visibility(r, &all)).front[n..].iter().all(|&x| x == 0.0));
}

#[test]
fn accessibility_has_its_closed_form() {
    // The floor under the middle of a square ceiling of side 2 at height 1: form factor 0.5541 (Howell, C-11, 4 quarters).
    let mut floor = moved(&sheet(1), 1e-3, Vec3f::zero());
    floor.triangles.truncate(1);
    let mut ceiling = sheet(1);
    ceiling.positions.iter_mut().for_each(|p| p.z = 1.0);
    let mut world = World::default();
    world.add(&floor, Material::clay()).add(&ceiling, Material::clay());
    let s = VisibilitySettings { min_rays: 20_000, max_rays: 20_000, rays: 1_000_000, ..quick() };
    let seen = world.with(|r| visibility(r, &s));
    let quarter = 1.0 / 2.0_f64.sqrt() * (1.0 / 2.0_f64.sqrt()).atan() / std::f64::consts::PI;
    let expected = 1.0 - 4.0 * quarter;
    assert!((f64::from(seen.front[0]) - expected).abs() < 0.005, "{} against {expected}", seen.front[0]);
    assert!(seen.front[1] > 0.99 && seen.back[1] == 0.0);
}

#[test]
fn a_place_knows_its_cut() {
    let mut world = World::default();
    let image = world.image(2, vec![[255, 255, 255, 255], [255, 255, 255, 0]]);
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    world.add(&sheet(1), Material { base_color_texture: image, alpha_mode: mask, ..Material::clay() });
    world.with(|r| {
        // Triangle 0: upper left, lower left, lower right.
        assert!(!r.is_cut(&Place { triangle: 0, u: 0.9, v: 0.05 }), "left");
        assert!(r.is_cut(&Place { triangle: 0, u: 0.05, v: 0.9 }), "right");
    });
}
