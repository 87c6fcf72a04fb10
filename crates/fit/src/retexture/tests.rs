//! A coarse arm that bends takes its looks from a fine one, over the moments of its animation.

use super::*;
use crate::Silent;
use crate::engine::animated::arm::arm;
use crate::engine::cpu::Cpu;
use crate::engine::plan::Runs;
use crate::engine::reference::Reference;
use crate::engine::views::{Set, Views};
use crate::progress::Heard;
use photofit_geometry::Mesh;
use photofit_scalar::{Vec3f, vec2};
use photofit_scene::{Extensions, Material, Sampler, Sheen, TextureSlot};

const TIMES: [f32; 4] = [0.0, 0.4, 0.7, 1.0];

fn moments() -> Vec<Moment> {
    TIMES.into_iter().map(|time| Moment { animation: Some(0), time }).collect()
}

/// A coarser arm in grey, with its animations in another order.
fn light() -> Scene {
    let mut scene = arm(8, 16);
    scene.name = "light".into();
    scene.materials = vec![Material::clay()];
    scene.images.clear();
    Arc::make_mut(scene.hierarchy.as_mut().unwrap()).animations.reverse();
    scene
}

fn options() -> RetextureOptions {
    RetextureOptions {
        moments: moments(),
        resolution: 96,
        texture_size: 32,
        steps: 100,
        report_views: 8,
        ..RetextureOptions::default()
    }
}

#[test]
fn a_light_arm_looks_like_a_heavy_one_while_both_bend() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("arm.glb");
    let heavy = arm(24, 32);
    let r = retexture(&heavy, &light(), &file, &options(), &Silent).unwrap();
    println!("start {:?}\nfitted {:?}\n{}", r.start, r.quality, r.plan);
    assert!(r.quality.psnr > r.start.psnr + 1.0, "{} {}", r.start.psnr, r.quality.psnr);
    assert!(r.quality.psnr > 30.0 && r.quality.flip < r.start.flip, "{:?} {:?}", r.start, r.quality);
    assert_eq!((r.steps, r.stopped, r.views.len()), (100, false, 8));
    // What runs is what is told.
    let told = |what: &str| r.plan.runs(what);
    assert_eq!(told("position gradients"), Some(Runs::No));
    assert_eq!(told("base colour gradients"), Some(Runs::Yes));
    assert_eq!(told("emission gradients"), Some(Runs::No));
    assert_eq!(told("animation"), Some(Runs::Yes));
    assert!(r.plan.to_string().contains("4 moments of bend"), "{}", r.plan);
    // The file moves as the light asset did.
    let (written, given) = (photofit_scene::load(&file).unwrap(), light());
    assert!(written.hierarchy.as_deref().unwrap().animation("bend").is_some());
    for time in TIMES {
        let mesh = |s: &Scene| {
            let mut posed = s.clone();
            posed.set_pose(s.pose(s.hierarchy.as_ref().unwrap().animation("bend"), time));
            posed.flatten().mesh.positions
        };
        let (w, g) = (mesh(&written), mesh(&given));
        let far = |p: &Vec3f| g.iter().map(|q| (*p - *q).length()).fold(f32::INFINITY, f32::min);
        assert!(w.iter().all(|p| far(p) < 1e-5), "at {time} s");
    }
}

#[test]
fn the_candidate_is_drawn_at_the_moment_of_the_shot() {
    // The maps of an asset fitted onto itself show the same pictures as the asset, at every moment.
    let scene = arm(24, 32);
    let n = Normalised::over(&scene, &moments()).unwrap();
    let bare = bare(&scene).unwrap();
    let poses = Animated::new(&bare, &n).playing(&n.light_asset.animations);
    let rest = poses.flat(Moment::default()).unwrap();
    let mut candidate = candidate(&n, &rest, 256).unwrap();
    let rays = n.surface().unwrap();
    let seen = visibility(&rays, &VisibilitySettings::default());
    let at_rest = candidate.vertices_of(OrientedPoints::of(&rest.mesh));
    candidate.set_maps(baked(&n, (&rays, &seen), &candidate, (at_rest, None), &Silent).unwrap().0);
    let reference = crate::engine::reference::ReferenceKind::RASTERIZED;
    let plan = SurfacePlan::new(&candidate, FitRequest { steps: 10, moves: true, reference });
    let mut model = Cpu::new(Posed::new(Surface::new(candidate, &plan), &poses, None)).unwrap();
    let theirs = Animated::new(&scene, &n);
    let reference = Rasterized::new(&n.flat, &n.library).animated(&theirs);
    let shots = |at: Option<Moment>| {
        let views = OverMoments { views: Orbit::new(5, &Lighting::Point, 64), moments: moments() };
        let one = |i: u64| {
            let mut s = views.setup(Set::Report, i, 4);
            s.moment = at.unwrap_or(s.moment);
            let picture = reference.picture(&views.setup(Set::Report, i, 4)).unwrap();
            crate::engine::views::Shot::new(&s, picture.image, Sampling::SUPERSAMPLED, 0, i)
        };
        (0..4).map(one).collect::<Vec<_>>()
    };
    let mut error = |at: Option<Moment>| {
        use crate::engine::model::Model;
        let shots = shots(at);
        let pictures = model.pictures(&shots).unwrap();
        let over: Vec<_> = shots.iter().map(|s| s.over_noise().reference).collect();
        let squares = over.iter().zip(&pictures).flat_map(|(r, p)| r.iter().zip(p));
        let squares = squares.flat_map(|(r, p)| (0..3).map(move |k| f64::from(r[k] - p[k]).powi(2)));
        let (sum, count) = squares.fold((0.0, 0.0), |(s, n), e| (s + e, n + 1.0));
        f64::sqrt(sum / count)
    };
    let (right, wrong) = (error(None), error(Some(Moment { animation: Some(0), time: 0.2 })));
    assert!(right < 0.03 && wrong > 4.0 * right, "{right} {wrong}");
}

#[test]
fn materials_beyond_the_rasterizer_are_judged_as_they_are_at_the_moments() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("arm.glb");
    let mut heavy = arm(24, 32);
    for m in &mut heavy.materials {
        let sheen = Sheen { color: [0.2, 0.3, 1.0], roughness: 0.4, ..Sheen::default() };
        m.extensions = Some(Box::new(Extensions { sheen: Some(sheen), ..Extensions::default() }));
    }
    let few = RetextureOptions { resolution: 48, steps: 1, report_views: 4, ..options() };
    let r = retexture(&heavy, &light(), &file, &few, &Silent).unwrap();
    assert_eq!(r.judged, Judged::PathTraced);
    assert!(r.left_out.is_empty(), "{:?}", r.left_out);
    assert_eq!(r.not_fitted, ["material extensions, their textures as mean values: sheen"]);
    // Both bend alike, or the outlines would differ; both are blue, or the colours would.
    assert!(r.quality.psnr > 26.0 && (r.quality.luminance - 1.0).abs() < 0.1, "{:?}", r.quality);
    let plain = retexture(&arm(24, 32), &light(), &file, &few, &Silent).unwrap();
    assert_eq!((plain.judged, plain.not_fitted.len()), (Judged::Rasterized, 0));
    let blue = |views: &[ReportView]| {
        let sum = |k: usize| views[0].reference.data.iter().skip(k).step_by(3).sum::<f32>();
        sum(2) / sum(0)
    };
    // What is blue in the pictures beside their grey background.
    let [velvet, plain] = [&r.views, &plain.views].map(|v| blue(v) - 1.0);
    assert!(velvet > 1.5 * plain, "{velvet} {plain}");
}

#[test]
fn what_cannot_be_fitted_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("x.glb");
    let text = |heavy: &Scene, light: &Scene, o: &RetextureOptions| {
        let text = retexture(heavy, light, &file, o, &Silent).unwrap_err().to_string();
        assert!(!file.exists());
        text
    };
    let heavy = arm(6, 8);
    let mut none = light();
    Arc::make_mut(none.hierarchy.as_mut().unwrap()).animations.remove(1);
    assert_eq!(
        text(&heavy, &none, &options()),
        "moment is in animation 0 of the reference; light must have it, by name"
    );
    let late = RetextureOptions { moments: vec![Moment { animation: Some(7), time: 0.0 }], ..options() };
    assert!(text(&heavy, &light(), &late).contains("the asset has 2"));
    let mut outside = light();
    outside.primitives[1].mesh.uvs[2].x = 1.5;
    let told = text(&heavy, &outside, &options());
    assert!(told.starts_with("light_asset has the texture coordinates [1.5"), "{told}");
    assert!(told.contains("in primitive 1; they must lie in the unit square"), "{told}");
    let mut bare = light();
    bare.primitives[1].mesh.uvs.clear();
    assert!(text(&heavy, &bare, &options()).contains("primitive 1"));
    let small = RetextureOptions { texture_size: 4, ..options() };
    assert_eq!(text(&heavy, &light(), &small), "texture_size is 4; it must be 16 to 8192");
}

/// An asset with other positions in its bind pose, and the normals that go with them.
fn reshaped(mut scene: Scene, to: impl Fn(Vec3f) -> Vec3f) -> Scene {
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let hierarchy = scene.hierarchy.clone().unwrap();
    for (primitive, mesh) in scene.primitives.iter().zip(&hierarchy.meshes) {
        let bind = mesh.primitives[0].bind.as_ref().map_or(&primitive.mesh, |b| &b.mesh);
        let moved: Vec<_> = bind.positions.iter().map(|p| to(*p)).collect();
        let weld = photofit_geometry::weld::weld_exact(&bind.positions);
        let incidence = photofit_geometry::Incidence::new(&bind.triangles, &weld);
        normals.extend(photofit_geometry::normals::vertex_normals(
            &incidence,
            &moved,
            photofit_geometry::normals::Weighting::Angle,
        ));
        positions.extend(moved);
    }
    scene.set_bind_vertices(&positions, &normals);
    scene
}

/// Where the vertices of an asset are at a moment of its first animation of a name.
fn positions_at(scene: &Scene, name: &str, time: f32) -> Vec<Vec3f> {
    let mut posed = scene.clone();
    posed.set_pose(scene.pose(scene.hierarchy.as_ref().unwrap().animation(name), time));
    posed.flatten().mesh.positions
}

#[test]
fn the_shape_at_rest_is_found_in_pictures_of_poses() {
    // The light asset is the heavy one with a thinner tube, and a waist in it; pictures show it bent alone.
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("arm.glb");
    let heavy = arm(12, 16);
    let waist = |p: Vec3f| {
        let thin = 0.88 - 0.08 * (3.0 * p.y).sin();
        photofit_scalar::vec3(thin * p.x, p.y, thin * p.z)
    };
    let light = reshaped(heavy.clone(), waist);
    let moments = [0.5, 0.8, 1.0].map(|time| Moment { animation: Some(0), time }).to_vec();
    let o = RetextureOptions { fit_shape: true, moments, resolution: 128, steps: 250, batch: 4, ..options() };
    let r = retexture(&heavy, &light, &file, &o, &Silent).unwrap();
    let written = photofit_scene::load(&file).unwrap();
    // Files may hold vertices in another order: the mean distance to the nearest one of the truth, in the bind pose and in
    // poses that no picture showed.
    let off = |scene: &Scene, time: f32| {
        let (found, truth) = (positions_at(scene, "bend", time), positions_at(&heavy, "bend", time));
        let nearest = |p: &Vec3f| truth.iter().map(|q| (*p - *q).length()).fold(f32::INFINITY, f32::min);
        found.iter().map(nearest).sum::<f32>() / found.len() as f32
    };
    println!("start {:?}\nfitted {:?}\n{}", r.start, r.quality, r.plan);
    for time in [0.0, 0.3, 1.0] {
        let [before, after] = [&light, &written].map(|s| off(s, time));
        println!("at {time} s: mean distance {before:.4} became {after:.4}");
        assert!(after < 0.4 * before, "at {time} s: {before} became {after}");
    }
    assert!(
        r.written == Written::Fitted && r.quality.psnr > r.start.psnr + 3.0,
        "{:?} {:?}",
        r.start,
        r.quality
    );
    assert_eq!(r.plan.runs("position gradients"), Some(Runs::Yes));
    assert_eq!(r.plan.runs("silhouette gradients"), Some(Runs::Yes));
}

#[test]
fn a_shape_that_cannot_be_moved_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("x.glb");
    let o = RetextureOptions { fit_shape: true, steps: 2, ..options() };
    let mut twice = light();
    let hierarchy = Arc::make_mut(twice.hierarchy.as_mut().unwrap());
    hierarchy.placements.push(hierarchy.placements[1]);
    twice.instances.push(twice.instances[1]);
    let told = retexture(&arm(6, 8), &twice, &file, &o, &Silent).unwrap_err().to_string();
    assert_eq!(told, "light_asset primitive 1 is placed more than once; its shape cannot be fitted");
    let mut flat = light();
    let hierarchy = Arc::make_mut(flat.hierarchy.as_mut().unwrap());
    hierarchy.nodes[4].transform =
        photofit_scene::NodeTransform::Matrix(glam::Affine3A::from_scale(glam::vec3(1.0, 0.0, 1.0)));
    hierarchy.animations[1].channels.truncate(1);
    let pose = flat.pose(None, 0.0);
    flat.set_pose(pose);
    let told = retexture(&arm(6, 8), &flat, &file, &o, &Silent).unwrap_err().to_string();
    assert_eq!(told, "light_asset is flat where it stands at rest; its shape cannot be fitted");
    let told = retexture(&arm(6, 8), &turned(light()), &file, &o, &Silent).unwrap_err().to_string();
    let backs =
        "light_asset has vertex normals that point to the back of 320 triangles; its shape cannot be fitted";
    assert_eq!(told, backs);
    assert!(!file.exists());
}

#[test]
fn a_bake_that_no_fit_improves_is_written() {
    // The asset itself: its bake is all but exact, and what is fitted to pictures of half the size is less so.
    let asset = arm(24, 32);
    let dir = tempfile::tempdir().unwrap();
    let options = RetextureOptions { resolution: 64, texture_size: 256, steps: 50, ..options() };
    let r = retexture(&asset, &asset, &dir.path().join("arm.glb"), &options, &Silent).unwrap();
    println!("{:?} {:?} {:?}", r.start, r.quality, r.written);
    // The file holds what the start is, but for the rounding of its positions.
    assert!(r.written == Written::Baked && (r.quality.psnr - r.start.psnr).abs() < 1e-3, "{:?}", r.written);
}

#[test]
fn a_fit_that_ends_at_once_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let checkpointing =
        Checkpointing { time_limit: Some(std::time::Duration::ZERO), ..Checkpointing::default() };
    let ended = RetextureOptions { resolution: 32, steps: 5, checkpointing, ..options() };
    let r = retexture(&arm(24, 32), &light(), &dir.path().join("arm.glb"), &ended, &Silent).unwrap();
    assert!(r.steps == 0 && r.plan.phases.is_empty(), "{}", r.plan);
    let row = r.plan.items.iter().find(|i| i.what == "map gradients").unwrap();
    assert!(row.runs == Runs::No && row.why.starts_with("no steps are made"), "{row:?}");
    assert_eq!(r.plan.runs("logarithmic loss"), Some(Runs::No));
}

#[test]
fn vertex_colours_of_the_light_asset_go_with_its_materials() {
    let dir = tempfile::tempdir().unwrap();
    let heavy = arm(24, 32);
    let options = RetextureOptions { steps: 0, report_views: 2, ..options() };
    let made = |light: &Scene| {
        let file = dir.path().join("arm.glb");
        let quality = retexture(&heavy, light, &file, &options, &Silent).unwrap().quality;
        (photofit_scene::load(&file).unwrap(), quality)
    };
    let mut colored = light();
    for p in &mut colored.primitives {
        p.mesh.colors = vec![photofit_scalar::vec4(0.1, 0.5, 0.9, 1.0); p.mesh.positions.len()];
    }
    // Those of a skinned mesh are written from its bind pose.
    let hierarchy = Arc::make_mut(colored.hierarchy.as_mut().unwrap());
    let bind = hierarchy.meshes[0].primitives[0].bind.as_mut().unwrap();
    bind.mesh.colors = colored.primitives[0].mesh.colors.clone();
    let (written, quality) = made(&colored);
    assert!(written.primitives.iter().all(|p| p.mesh.colors.is_empty()));
    assert_eq!(quality, made(&light()).1, "as without colours");
}

#[test]
fn maps_are_painted_where_the_textures_of_the_light_asset_are_read() {
    let (plain, mut packed) = (light(), light());
    // As programs that quantise store them: in another range, brought back by the transform of the textures.
    let pack =
        |mesh: &mut Mesh| mesh.uvs.iter_mut().for_each(|uv| *uv = vec2(8.0 * uv.x - 3.0, 8.0 * uv.y - 3.0));
    packed.primitives.iter_mut().for_each(|p| pack(&mut p.mesh));
    let hierarchy = Arc::make_mut(packed.hierarchy.as_mut().unwrap());
    let parts = hierarchy.meshes.iter_mut().flat_map(|m| &mut m.primitives);
    parts.filter_map(|p| p.bind.as_mut()).for_each(|b| pack(&mut b.mesh));
    let transform = [[0.125, 0.0, 0.375], [0.0, 0.125, 0.375]];
    let slot = TextureSlot { image: 0, sampler: Sampler::default(), tex_coord: 0, transform };
    packed.materials[0].normal_texture = Some(slot);
    let [a, b] = [&plain, &packed].map(|s| bare(s).unwrap());
    let meshes = |s: &Scene| {
        let parts = s.hierarchy.as_ref().unwrap().meshes.iter().flat_map(|m| m.primitives.clone());
        let binds = parts.filter_map(|p| p.bind.map(|b| b.mesh));
        s.primitives.iter().map(|p| p.mesh.clone()).chain(binds).collect::<Vec<_>>()
    };
    assert_eq!(meshes(&a).len(), 3);
    for (a, b) in meshes(&a).iter().zip(&meshes(&b)) {
        assert!(a.uvs.iter().zip(&b.uvs).all(|(a, b)| (a.x - b.x).abs() + (a.y - b.y).abs() < 1e-5));
    }
    // What rounding leaves outside of the unit square is moved into it.
    let mut rounded = light();
    rounded.primitives[1].mesh.uvs[0].x = -1e-6;
    assert_eq!(bare(&rounded).unwrap().primitives[1].mesh.uvs[0].x, 0.0);
}

/// An asset with normals that point to the back of its triangles.
fn turned(mut scene: Scene) -> Scene {
    let turn = |mesh: &mut Mesh| mesh.normals.iter_mut().for_each(|n| *n = -*n);
    scene.primitives.iter_mut().for_each(|p| turn(&mut p.mesh));
    let hierarchy = Arc::make_mut(scene.hierarchy.as_mut().unwrap());
    let parts = hierarchy.meshes.iter_mut().flat_map(|m| &mut m.primitives);
    parts.filter_map(|p| p.bind.as_mut()).for_each(|b| turn(&mut b.mesh));
    scene
}

#[test]
fn rays_do_not_follow_normals_that_point_to_the_back() {
    let heavy = arm(24, 32);
    let colors = |light: &Scene| {
        let n = Normalised::over(&heavy, &[]).unwrap();
        let bare = bare(light).unwrap();
        let rest = Animated::new(&bare, &n).flat(Moment::default()).unwrap();
        let candidate = candidate(&n, &rest, 64).unwrap();
        let at_rest = candidate.vertices_of(OrientedPoints::of(&rest.mesh));
        let round = opposed(&rest.mesh).contains(&true).then(|| candidate.round_normals());
        let vertices = (at_rest, round.as_deref());
        let rays = n.surface().unwrap();
        let seen = visibility(&rays, &VisibilitySettings::default());
        let (maps, _) = baked(&n, (&rays, &seen), &candidate, vertices, &Silent).unwrap();
        maps.texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect::<Vec<_>>()
    };
    // Rays go along the surface where vertex normals cannot be followed, which finds nearly the same.
    let (right, opposed) = (colors(&light()), colors(&turned(light())));
    let far = right.iter().zip(&opposed).filter(|(a, b)| (*a - *b).abs() > 0.05).count();
    assert!(far * 50 < right.len(), "{far} of {} values differ", right.len());
}

#[test]
fn assets_whose_normals_point_to_other_sides_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let few =
        RetextureOptions { resolution: 48, steps: 0, report_views: 1, moments: Vec::new(), ..options() };
    let told = |heavy: &Scene, light: &Scene| {
        let heard = Heard::default();
        let made = retexture(heavy, light, &dir.path().join("arm.glb"), &few, &heard).unwrap();
        (heard.0.into_inner().unwrap(), made.quality.psnr)
    };
    let (right, heavy) = (arm(24, 32), turned(arm(24, 32)));
    let (none, psnr) = told(&right, &light());
    assert_eq!(none, [""; 0]);
    let (none, both) = told(&heavy, &turned(light()));
    assert_eq!(none, [""; 0]);
    assert!(both > psnr - 3.0, "{both} and {psnr} dB");
    let wanted = |heavy: u32, light: u32| {
        format!(
            "back of {heavy} of 1664 triangles of the reference and of {light} of 320 triangles of the light asset"
        )
    };
    for (heavy, light, wanted) in
        [(&heavy, light(), wanted(1664, 0)), (&right, turned(light()), wanted(0, 320))]
    {
        let (told, other) = told(heavy, &light);
        assert!(told.len() == 1 && told[0].contains(&wanted), "{told:?}, expected {wanted}");
        assert!(other < psnr - 3.0, "{other} and {psnr} dB");
    }
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn poses_on_a_device_are_those_of_the_cpu() {
    use crate::engine::gpu::GpuSurface;
    use crate::engine::model::Model;
    use crate::engine::views::Shot;
    let scene = arm(12, 16);
    let n = Normalised::over(&scene, &moments()).unwrap();
    let bare = bare(&scene).unwrap();
    let poses = Animated::new(&bare, &n).playing(&n.light_asset.animations);
    let candidate = candidate(&n, &poses.flat(Moment::default()).unwrap(), 64).unwrap();
    let reference = crate::engine::reference::ReferenceKind::RASTERIZED;
    let plan = SurfacePlan::new(&candidate, FitRequest { steps: 10, moves: true, reference });
    let model = Posed::new(Surface::new(candidate, &plan), &poses, None);
    let theirs = Animated::new(&scene, &n);
    let reference = Rasterized::new(&n.flat, &n.library).animated(&theirs);
    let views = OverMoments { views: Orbit::new(5, &Lighting::Point, 48), moments: moments() };
    let shots = |still: bool| -> Vec<Shot> {
        let one = |i: u64| {
            let s = views.setup(Set::Train, i, 4);
            let mut shot = Shot::new(&s, reference.picture(&s).unwrap().image, Sampling::SUPERSAMPLED, 0, i);
            shot.moment = if still { Moment::default() } else { shot.moment };
            shot
        };
        (0..4).map(one).collect()
    };
    let loss = loss::PictureLoss::RELATIVE_SQUARES;
    let (moving, still) = (shots(false), shots(true));
    let mut cpu = Cpu::new(model.clone()).unwrap();
    let mut device = GpuSurface::new(photofit_gpu::test_device(), model, &moving).unwrap();
    let start = cpu.values(0).unwrap().into_owned();
    let mut off = |shots: &[Shot], device: &mut GpuSurface<Posed<'_>>| {
        let (a, b) = (cpu.pictures(&moving).unwrap(), device.pictures(shots).unwrap());
        let pairs: Vec<_> = a.iter().flatten().zip(b.iter().flatten()).collect();
        let far = pairs.iter().filter(|(a, b)| (0..4).any(|k| (a[k] - b[k]).abs() > 1e-3)).count();
        far as f64 / pairs.len() as f64
    };
    let (same, other) = (off(&moving, &mut device), off(&still, &mut device));
    println!("{same:.1e} of the pixels differ; of the asset as it stands {other:.1e}");
    assert!(same < 2e-3 && other > 0.02, "{same:e} {other:e}");
    for step in 0..6 {
        // Two of the four pictures in each: poses come again.
        let shots = [moving[step % 4].clone(), moving[(step + 1) % 4].clone()];
        cpu.step(&shots, loss, &[0.01]).unwrap();
        device.step(&shots, loss, &[0.01]).unwrap();
    }
    let (a, b) = (cpu.losses().unwrap(), device.losses().unwrap());
    assert!(a.len() == 6 && a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-3), "{a:?} {b:?}");
    let difference =
        |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
    let (x, y) = (cpu.values(0).unwrap(), device.values(0).unwrap());
    let [moved, apart] = [difference(&start, &x), difference(&x, &y)];
    println!("losses {a:?}; moved {moved:.2e}, apart {apart:.1e}");
    assert!(apart < 0.02 * moved, "{apart:e} of {moved:e}");
    // A step without motion is another one.
    device.step(&still[1..3], loss, &[0.0]).unwrap();
    cpu.step(&moving[1..3], loss, &[0.0]).unwrap();
    let (a, b) = (cpu.losses().unwrap()[0], device.losses().unwrap()[0]);
    assert!((a / b - 1.0).abs() > 0.01, "{a} {b}");
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "gpu: needs an adapter"]
fn an_arm_that_bends_is_fitted_on_a_device_as_on_the_cpu() {
    let dir = tempfile::tempdir().unwrap();
    let gpu = photofit_gpu::test_device();
    let run = |device: Device| {
        let few = RetextureOptions { steps: 40, device, ..options() };
        retexture(&arm(24, 32), &light(), &dir.path().join("arm.glb"), &few, &Silent).unwrap()
    };
    let (cpu, there) = (run(Device::default()), run(Device::gpu(gpu.clone(), true, "asked for")));
    assert!(there.device.contains(&gpu.report().name), "{}", there.device);
    let plan = there.plan.to_string();
    assert!(
        plan.contains("asked for") && plan.contains("poses of the reference are drawn on the CPU"),
        "{plan}"
    );
    println!("{:.3} dB on the CPU, {:.3} dB on the device", cpu.quality.psnr, there.quality.psnr);
    assert!((cpu.quality.psnr - there.quality.psnr).abs() < 0.1 && cpu.written == there.written);
}

/// An animation in which a node mirrors the small tube at its end.
fn mirroring(mut scene: Scene) -> Scene {
    let animation = &mut Arc::make_mut(scene.hierarchy.as_mut().unwrap()).animations[1];
    let node = animation.channels.iter().map(|c| c.node).max().unwrap();
    let scale =
        photofit_scene::Curve { values: vec![1.0, 1.0, 1.0, -1.0, 1.0, 1.0], ..animation.curves[0].clone() };
    animation.channels.push(photofit_scene::Channel {
        node,
        property: photofit_scene::Property::Scale,
        curve: animation.curves.len(),
    });
    animation.curves.push(scale);
    scene
}

#[test]
fn a_moment_that_turns_triangles_inside_out_is_refused_before_work() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("x.glb");
    for steps in [0, 4] {
        let o =
            RetextureOptions { steps, moments: vec![Moment { animation: Some(0), time: 1.0 }], ..options() };
        let told = retexture(&arm(6, 8), &mirroring(light()), &file, &o, &Silent).unwrap_err().to_string();
        assert_eq!(told, "moment at 1 s turns triangles inside out; it must not");
    }
    assert!(!file.exists());
}

#[test]
fn a_checkpoint_of_other_poses_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("x.glb");
    let checkpointing = |resume| Checkpointing {
        checkpoint: Some(dir.path().join("state")),
        resume,
        ..Checkpointing::default()
    };
    let moments = vec![Moment { animation: Some(0), time: 1.0 }];
    let o = |resume| RetextureOptions {
        steps: 2,
        report_views: 2,
        moments: moments.clone(),
        checkpointing: checkpointing(resume),
        ..options()
    };
    retexture(&arm(6, 8), &light(), &file, &o(false), &Silent).unwrap();
    let mut other = light();
    let animation = &mut Arc::make_mut(other.hierarchy.as_mut().unwrap()).animations[1];
    let last = animation.curves[0].values.len() - 4;
    animation.curves[0].values[last..].copy_from_slice(&[0.0, 0.0, 0.0, 1.0]);
    let told = retexture(&arm(6, 8), &other, &file, &o(true), &Silent).unwrap_err().to_string();
    assert!(told.contains("poses of the light asset"), "{told}");
}
