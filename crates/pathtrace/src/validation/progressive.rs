//! Passes, threads, resuming, adaptive sampling, auxiliary images.

use super::scenes::{cornell, cornell_view, square};
use crate::{Aov, Filter, RenderOptions, Renderer, View, World};
use photofit_image::Image;
use std::sync::atomic::{AtomicUsize, Ordering};

fn finish(mut renderer: Renderer<'_>) -> Image {
    while !renderer.pass(|| false).done {}
    renderer.picture()
}

#[test]
fn threads_and_interruptions_change_no_bit() {
    let world = World::new(cornell()).unwrap();
    let options = || RenderOptions {
        noise: Some(0.3),
        aovs: Aov::ALL.to_vec(),
        previous: Some(cornell_view()),
        ..square(40, 128)
    };
    let new = || Renderer::new(&world, &cornell_view(), options()).unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| finish(new()));
    let many = rayon::ThreadPoolBuilder::new().num_threads(5).build().unwrap().install(|| finish(new()));
    assert_eq!(one.data, many.data);
    // Stopped after every few tiles, saved, and resumed by a renderer that knows nothing.
    let mut renderer = new();
    let mut rounds = 0;
    loop {
        let left = AtomicUsize::new(4);
        let progress = renderer
            .pass(|| left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1)).is_err());
        let bytes = renderer.save("cornell", "");
        renderer = new();
        renderer.resume("cornell", &[""], &bytes).unwrap();
        assert_eq!(renderer.save("cornell", ""), bytes, "a state survives");
        rounds += 1;
        if progress.done {
            break;
        }
    }
    assert!(rounds > 10, "{rounds} interruptions");
    assert_eq!(one.data, renderer.picture().data);
}

#[test]
fn one_long_pass_is_many_short_ones() {
    let world = World::new(cornell()).unwrap();
    for (noise, spp) in [(None, 37), (Some(0.3), 64)] {
        let options = RenderOptions { noise, aovs: vec![Aov::Albedo], ..square(40, spp) };
        let new = || Renderer::new(&world, &cornell_view(), options.clone()).unwrap();
        let (mut short, mut long) = (new(), new());
        while !short.pass(|| false).done {}
        long.finish();
        assert!(long.progress().done && long.save("cornell", "") == short.save("cornell", ""), "{noise:?}");
        // Those that have begun are finished alike.
        let mut begun = new();
        begun.pass(|| false);
        begun.finish();
        assert!(begun.save("cornell", "") == short.save("cornell", ""), "{noise:?}, begun");
    }
}

#[test]
fn states_are_refused_where_they_do_not_belong() {
    let world = World::new(cornell()).unwrap();
    let make = |options: RenderOptions| Renderer::new(&world, &cornell_view(), options).unwrap();
    let mut renderer = make(square(20, 4));
    renderer.pass(|| false);
    let bytes = renderer.save("a", "");
    let refused = |options: RenderOptions, name: &str, bytes: &[u8]| {
        let error = make(options).resume(name, &["", "b"], bytes).unwrap_err().to_string();
        assert!(error.contains("cannot be continued"), "{error}");
        error
    };
    assert!(refused(square(20, 4), "b", &bytes).contains("another scene or light;"));
    let guided = renderer.save("a", "c");
    assert!(refused(square(20, 4), "a", &guided).contains("another guide or training of a guide;"));
    assert!(refused(square(20, 4), "b", &guided).contains("another scene or light, guide or training"));
    assert_eq!(make(square(20, 4)).resume("a", &["", "b", "c"], &guided).unwrap(), 2);
    assert_eq!(renderer.state_bytes(), guided.len());
    assert!(refused(RenderOptions { seed: 1, ..square(20, 4) }, "a", &bytes).contains("another seed;"));
    assert!(refused(square(21, 4), "a", &bytes).contains("another size"));
    assert!(refused(square(20, 4), "a", &bytes[..40]).contains("damaged"));
    assert!(refused(square(20, 4), "a", b"").contains("short"));
    let mut flipped = bytes.clone();
    flipped[100] ^= 1;
    assert!(refused(square(20, 4), "a", &flipped).contains("damaged"));
    // More samples than before are no other picture.
    let mut more = make(square(20, 16));
    more.resume("a", &[""], &bytes).unwrap();
    assert_eq!(finish(more).data, finish(make(square(20, 16))).data);
}

#[test]
fn adaptive_sampling_spends_where_the_noise_is() {
    let world = World::new(cornell()).unwrap();
    let view = View { half: [1.2, 1.2], ..cornell_view() };
    let options = RenderOptions { noise: Some(0.12), aovs: vec![Aov::Samples], ..square(112, 512) };
    let mut renderer = Renderer::new(&world, &view, options).unwrap();
    while !renderer.pass(|| false).done {}
    let progress = renderer.progress();
    assert!(progress.noise < 0.14, "{progress:?}");
    assert!(progress.samples < progress.total * 9 / 10, "{progress:?}");
    let samples = renderer.aov(Aov::Samples).unwrap();
    let (least, most) = samples.data.iter().fold((f32::MAX, 0.0_f32), |(a, b), x| (a.min(*x), b.max(*x)));
    assert!(least >= 32.0 && most > 2.0 * least, "{least} to {most}");
}

#[test]
fn pixels_without_a_sample_are_counted() {
    let world = World::new(cornell()).unwrap();
    let mut renderer = Renderer::new(&world, &cornell_view(), square(40, 2)).unwrap();
    assert_eq!(renderer.progress().unsampled, 1600);
    // Stopped before its second tile.
    let asked = AtomicUsize::new(0);
    let progress = renderer.pass(|| asked.fetch_add(1, Ordering::Relaxed) > 0);
    assert!(progress.samples > 0 && progress.unsampled == 1600 - progress.samples, "{progress:?}");
    assert_eq!(renderer.pass(|| false).unsampled, 0);
}

#[test]
fn auxiliary_images_show_what_the_camera_sees() {
    let world = World::new(cornell()).unwrap();
    let view = cornell_view();
    let moved = View { eye: view.eye + glam::DVec3::new(0.1, 0.0, 0.0), ..view };
    let options = RenderOptions { aovs: Aov::ALL.to_vec(), previous: Some(moved), ..square(32, 16) };
    let mut renderer = Renderer::new(&world, &view, options).unwrap();
    while !renderer.pass(|| false).done {}
    let get = |aov: Aov| renderer.aov(aov).unwrap();
    let picture = renderer.picture();
    // The middle of the back wall, above the boxes.
    let (x, y) = (16, 9);
    assert_eq!(get(Aov::Instance).pixel(x, y), [3.0]);
    let position = get(Aov::Position);
    let p = position.pixel(x, y);
    assert!((p[2] + 0.5).abs() < 1e-3 && p[1] > 0.5, "{p:?}");
    assert!((get(Aov::Depth).pixel(x, y)[0] - 2.7).abs() < 1e-3);
    for aov in [Aov::Normal, Aov::GeometricNormal] {
        let n = get(aov);
        assert!((n.pixel(x, y)[2] - 1.0).abs() < 1e-4, "{:?}", n.pixel(x, y));
    }
    assert!((get(Aov::Albedo).pixel(x, y)[0] - 0.73).abs() < 1e-4);
    // The camera moves by 0.1 to the left: things move to the right.
    let (motion, expected) = (get(Aov::Motion), 0.1 / (2.7 * view.half[0]) * 16.0);
    assert!((motion.pixel(x, y)[0] - expected).abs() < 1e-2, "{:?} {expected}", motion.pixel(x, y));
    let (direct, indirect) = (get(Aov::Direct), get(Aov::Indirect));
    for i in 0..picture.pixels() {
        let sum = direct.data[3 * i] + indirect.data[3 * i];
        assert!((sum - picture.data[4 * i]).abs() < 1e-4 * (1.0 + sum), "direct and indirect light add up");
    }
    assert!(indirect.pixel(x, y)[0] > 0.01 && direct.pixel(x, y)[0] > 0.01);
    assert!(get(Aov::Variance).data.iter().all(|v| v.is_finite() && *v >= 0.0));
    assert!(get(Aov::Samples).data.iter().all(|n| *n == 16.0));
    for aov in Aov::ALL {
        assert_eq!(Aov::named(aov.name()), Some(aov));
        assert_eq!(get(aov).channels, aov.channels().len(), "{aov}");
    }
}

#[test]
fn filters_blur_and_keep_the_mean() {
    let world = World::new(cornell()).unwrap();
    let shot = |filter| {
        let options = RenderOptions { filter, aovs: vec![Aov::Albedo], ..square(32, 64) };
        let mut renderer = Renderer::new(&world, &cornell_view(), options).unwrap();
        while !renderer.pass(|| false).done {}
        renderer.aov(Aov::Albedo).unwrap()
    };
    let sharp = shot(Filter::Box);
    let sum = |i: &Image| i.data.iter().map(|v| f64::from(*v)).sum::<f64>();
    // Squares of differences between neighbours: edges count by their height.
    let rough = |i: &Image| i.data.windows(4).map(|w| (w[3] - w[0]).powi(2)).sum::<f32>();
    for filter in [Filter::Tent { radius: 2.0 }, Filter::Gaussian { sigma: 1.0 }] {
        let soft = shot(filter);
        assert!((sum(&soft) / sum(&sharp) - 1.0).abs() < 0.05, "{filter:?}");
        assert!(rough(&soft) < 0.7 * rough(&sharp), "{filter:?}: {} {}", rough(&soft), rough(&sharp));
    }
}
