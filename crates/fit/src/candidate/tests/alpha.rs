//! Gradients of alpha where it is 0 or 1, and outlines of masks.

use super::*;

/// Unlit, with this field of view.
fn from_the_front(field_of_view: f32) -> View<'static, f64> {
    let (eye, to) = (glam::vec3(0.0, 0.0, 3.0), glam::Vec3::ZERO);
    let camera = Camera::look_at(eye, to, glam::Vec3::Y, field_of_view, 1.0, 0.1, 10.0);
    View {
        view_projection: matrix_rows(&camera.view_projection()),
        eye: vec3(0.0, 0.0, 3.0),
        lights: &[],
        width: SIZE * SAMPLES,
        height: SIZE * SAMPLES,
        samples: SAMPLES,
        shade_per_pixel: false,
        lod_bias: 0.0,
    }
}

#[test]
fn alpha_of_one_and_zero_has_a_gradient() {
    // One sheet in front of the background, all of it at one alpha: brighter or darker than what lies behind.
    for (alpha, mode, masks) in [
        (1.0, AlphaMode::Blend, Masks::Cut),
        (0.0, AlphaMode::Blend, Masks::Cut),
        (1.0, AlphaMode::Mask { cutoff: 0.5 }, Masks::Faded { slope: 1.0 }),
        (0.0, AlphaMode::Mask { cutoff: 0.5 }, Masks::Faded { slope: 1.0 }),
    ] {
        let mut setting = Setting::new(Kind::Transparent, Content::Random, 3);
        let c = &mut setting.candidate;
        c.maps.levels[0].texels.iter_mut().for_each(|t| t[channel::ALPHA] = alpha);
        c.maps.rebuild();
        c.classes.iter_mut().for_each(|class| class.alpha = mode);
        c.alpha.fill(mode);
        c.solid.clear();
        c.masked.clear();
        setting.passes.masks = masks;
        let g = setting.gradients(Value::Weighted);
        let (value, _) = setting.evaluate(Value::Weighted);
        // From the ends of its range alpha can go one way only: a one-sided difference of second order.
        let step = if alpha > 0.5 { -1e-4 } else { 1e-4 };
        let mut at = |n: f64| {
            let texels = &mut setting.candidate.maps.levels[0].texels;
            texels.iter_mut().for_each(|t| t[channel::ALPHA] = alpha + n * step);
            setting.candidate.maps.rebuild();
            setting.evaluate(Value::Weighted).0
        };
        let difference = (4.0 * at(1.0) - at(2.0) - 3.0 * value) / (2.0 * step);
        let sum: f64 = g.rendered.maps.levels[0].texels.iter().map(|t| t[channel::ALPHA]).sum();
        assert!((difference / sum - 1.0).abs() < 1e-5, "{mode:?} at {alpha}: {sum} against {difference}");
    }
}

#[test]
fn alpha_of_glass_stays_beside_blended_surfaces() {
    let (mesh, class) = mesh();
    let mut setting = Setting::new(Kind::Transparent, Content::Random, 5);
    let base = setting.candidate.maps.levels[0].clone();
    let classes = [(AlphaMode::Opaque, false), (AlphaMode::Blend, false), (AlphaMode::Blend, true)];
    let classes = classes.map(|(alpha, see_through)| SurfaceClass {
        alpha,
        sides: Sides::Both,
        see_through,
        ..SurfaceClass::default()
    });
    let smoothing = weld_exact(&mesh.positions);
    setting.candidate = Candidate::new(&mesh, &smoothing, class.clone(), classes.to_vec(), base);
    for free in [false, true] {
        if free {
            setting.candidate.free_mips();
        }
        let g = setting.gradients(Value::Weighted);
        for level in &g.rendered.maps.levels[..setting.candidate.fitted_levels().min(3)] {
            let of = |wanted: u32| {
                let own = mesh.triangles.iter().zip(&class).filter(|(_, c)| **c == wanted).map(|(t, _)| *t);
                let own: Vec<[u32; 3]> = own.collect();
                let shown = mesh_coverage(&mesh.uvs, &own, level.width, level.height, true).mask();
                let moved = |(t, shown): (&[f64; CHANNELS], bool)| shown && t[channel::ALPHA] != 0.0;
                level.texels.iter().zip(shown).filter(|(t, shown)| moved((t, *shown))).count()
            };
            let moved = [0, 1, 2].map(of);
            assert!(moved[0] == 0 && moved[1] > 20 && moved[2] == 0, "{moved:?} texels, free: {free}");
        }
    }
}

#[test]
fn what_lies_behind_a_candidate_of_any_alpha_is_drawn() {
    let n = 32;
    // A lamp, and a sheet in front of it; one half of the maps each.
    let card = |z: f32, left: f32| {
        let mut mesh = shapes::quad_grid(1, 1);
        mesh.positions.iter_mut().for_each(|p| p.z = z);
        mesh.uvs = mesh.positions.iter().map(|p| vec2(left + 0.1 * p.x, 0.5 - 0.1 * p.y)).collect();
        mesh
    };
    let mut both = card(-0.5, 0.75);
    let front = card(0.5, 0.25);
    let first = both.positions.len() as u32;
    both.triangles.extend(front.triangles.iter().map(|t| t.map(|i| i + first)));
    both.positions.extend(&front.positions);
    both.normals.extend(&front.normals);
    both.uvs.extend(&front.uvs);
    let blend = SurfaceClass { alpha: AlphaMode::Blend, sides: Sides::Both, ..SurfaceClass::default() };
    let view = from_the_front(0.2);
    for alpha in [0.5, 0.99, 0.999, 0.9999, 1.0] {
        let texel = |i: usize| {
            let lamp = i % n >= n / 2;
            let mut t = [0.0; CHANNELS];
            t[channel::NORMAL + 2] = 1.0;
            t[channel::ROUGHNESS] = 1.0;
            t[channel::EMISSIVE..channel::USED].fill(if lamp { 1000.0 } else { 0.0 });
            t[channel::ALPHA] = if lamp { 1.0 } else { alpha };
            t
        };
        let maps = Maps { width: n, height: n, texels: (0..n * n).map(texel).collect() };
        let class = vec![0; both.triangles.len()];
        let smoothing = weld_exact(&both.positions);
        let candidate = Candidate::<f64>::new(&both, &smoothing, class, vec![blend], maps);
        let background = vec![[0.0; 3]; SIZE * SIZE];
        let picture =
            CandidateView { view, background: &background, vertices: VertexSource::SHAPE, backs: false };
        // As the asset's own alpha, and pictures that are judged, are drawn: nothing of it is fitted.
        let passes = Passes { alpha_gradients: false, ..Passes::default() };
        let seen =
            candidate.draw(&candidate.vertices(), &picture, &passes).color[SIZE * (SIZE / 2) + SIZE / 2];
        let expected = 1000.0 * (1.0 - alpha);
        assert!((seen[0] - expected).abs() <= 1e-6 * expected, "alpha {alpha}: {} for {expected}", seen[0]);
    }
}

#[test]
fn the_outline_of_a_mask_is_found() {
    let n = 32;
    let mut card = shapes::quad_grid(2, 2);
    card.uvs = card.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y)).collect();
    let class = vec![0; card.triangles.len()];
    let mask = SurfaceClass {
        alpha: AlphaMode::Mask { cutoff: 0.5 },
        sides: Sides::Both,
        ..SurfaceClass::default()
    };
    // White and unlit, cut out to a disc of the given radius.
    let disc = |radius: f64| {
        let texel = |i: usize| {
            let [x, y] = [i % n, i / n].map(|k| (k as f64 + 0.5) / n as f64 * 2.0 - 1.0);
            let mut t = [0.0; CHANNELS];
            t[channel::EMISSIVE..channel::USED].fill(1.0);
            t[channel::NORMAL + 2] = 1.0;
            t[channel::ROUGHNESS] = 1.0;
            t[channel::ALPHA] = (0.5 + 8.0 * (radius - x.hypot(y))).clamp(0.0, 1.0);
            t
        };
        Maps { width: n, height: n, texels: (0..n * n).map(texel).collect() }
    };
    let smoothing = weld_exact(&card.positions);
    let candidate =
        |radius| Candidate::<f64>::new(&card, &smoothing, class.clone(), vec![mask], disc(radius));
    let background = vec![[0.1; 3]; SIZE * SIZE];
    let view = from_the_front(0.8);
    let picture =
        CandidateView { view, background: &background, vertices: VertexSource::SHAPE, backs: false };
    let cut = |c: &Candidate<f64>| c.draw(&c.vertices(), &picture, &Passes::default()).color;
    let covered = |c: &Candidate<f64>| cut(c).iter().map(|p| p[3]).sum::<f64>();
    let truth = candidate(0.7);
    let reference = cut(&truth);
    let mut fit = candidate(0.45);
    let before = covered(&fit) / covered(&truth);
    let mut g = fit.gradients();
    for k in 0..60 {
        let passes =
            Passes { masks: Masks::Faded { slope: 4_f32.powf(k as f32 / 60.0) }, ..Passes::default() };
        let value = |_: usize, p: &[[f64; 4]], g: &mut [[f64; 4]]| {
            PictureLoss::from(Loss::LogSrgbL1).value_and_gradient((SIZE, SIZE), p, &reference, 1.0, g)
        };
        fit.pull_back([picture], value, &passes, &mut g);
        for (t, g) in fit.maps.levels[0].texels.iter_mut().zip(&g.rendered.maps.levels[0].texels) {
            let g = g[channel::ALPHA];
            let step = if g == 0.0 { 0.0 } else { 0.06 * (1.0 - f64::from(k) / 60.0) * g.signum() };
            t[channel::ALPHA] = (t[channel::ALPHA] - step).clamp(0.0, 1.0);
        }
        fit.maps.rebuild();
    }
    let after = covered(&fit) / covered(&truth);
    assert!(before < 0.5, "starts with {before:.2} of the disc");
    assert!((after - 1.0).abs() < 0.03, "a disc of {before:.2} of the area became one of {after:.3}");
}
