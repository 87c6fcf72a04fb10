//! A cloud of two balls is found again from pictures around it.

use super::*;
use crate::Silent;
use crate::progress::Heard;
use core::sync::atomic::{AtomicU64, Ordering};
use glam::Vec3;
use photofit_scalar::vec3;
use photofit_scene::Camera;

const SIDE: usize = 20;
const CENTER: DVec3 = DVec3::new(4.0, -1.0, 2.0);

fn view(k: usize) -> View {
    let (turn, height) = (2.4 * k as f32, [0.8, -0.6, 0.1][k % 3]);
    let eye = CENTER.as_vec3() + Vec3::new(3.6 * turn.sin(), 1.8 * height, 3.6 * turn.cos());
    View::pinhole(&Camera::look_at(eye, CENTER.as_vec3(), Vec3::Y, 0.7, 1.0, 0.1, 20.0))
}

/// Light and dark behind the cloud tell density from albedo.
fn surroundings() -> Surroundings {
    let sky = Image::from_fn(8, 4, 3, |x, y, _| if (x + y) % 2 == 0 { 0.9 } else { 0.1 });
    let sun = LightSource::Directional { direction: vec3(0.3, 1.0, 0.4), irradiance: Vec3f::splat(6.0) };
    Surroundings { lights: vec![sun], environment: Some(EnvironmentMap::new(sky)) }
}

const BOUNDS: [DVec3; 2] = [DVec3::new(3.0, -2.0, 1.0), DVec3::new(5.0, 0.0, 3.0)];

/// Two balls of `side` voxels per side in the cube of side 2 around [`CENTER`].
fn balls(side: usize) -> Grid {
    let at = |i: usize| (i as f32 + 0.5) / side as f32 * 2.0 - 1.0;
    let (mut extinction, mut albedo) = (Vec::new(), Vec::new());
    for i in 0..side * side * side {
        let p = Vec3::new(at(i % side), at(i / side % side), at(i / side / side));
        let ball =
            |center: Vec3, radius: f32| (1.5 - ((p - center) / radius).length_squared()).clamp(0.0, 1.0);
        let (a, b) = (ball(Vec3::new(-0.3, 0.1, 0.2), 0.5), ball(Vec3::new(0.4, -0.2, -0.2), 0.4));
        extinction.push(4.0 * a + 3.0 * b);
        albedo.extend(if a >= b { [0.9, 0.6, 0.3] } else { [0.3, 0.5, 0.9] });
    }
    Grid { size: [side; 3], extinction, albedo, emission: Vec::new() }
}

fn options(size: usize, steps: u64) -> RecoverVolumeOptions {
    RecoverVolumeOptions {
        bounds: Some(BOUNDS),
        size,
        steps,
        gradient_spp: 4,
        max_depth: 6,
        ..Default::default()
    }
}

fn pictures(views: &[View]) -> Vec<Image> {
    let model = balls(16).model(&surroundings(), &BOUNDS, &options(16, 0), [SIDE; 2]).expect("valid");
    views.iter().map(|v| model.picture(v, 256, 99).expect("rendered")).collect()
}

fn rmse(a: &[f32], b: &[f32]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn a_cloud_is_found_from_coarse_to_fine() {
    let views: Vec<View> = (0..7).map(view).collect();
    let options = options(16, 80);
    let r = recover_volume(&surroundings(), &views, &pictures(&views), &options, &Silent).expect("found");
    assert_eq!((r.size, r.held_out, r.bounds), ([16; 3], Some(6), BOUNDS));
    assert_eq!(r.grids, [(0, 8), (51, 16)]);
    let truth = balls(16);
    let start = Grid::start([16; 3], &BOUNDS, &options);
    let dense = |v: &[f32]| -> Vec<f32> {
        (0..v.len()).filter(|i| truth.extinction[i / 3] > 1.0).map(|i| v[i]).collect()
    };
    let extinction = [&start.extinction, &r.extinction].map(|e| rmse(e, &truth.extinction));
    let albedo = [&start.albedo, &r.albedo].map(|a| rmse(&dense(a), &dense(&truth.albedo)));
    println!("extinction {extinction:?}, albedo {albedo:?}");
    assert!(extinction[1] < 0.65 * extinction[0], "{extinction:?}");
    assert!(albedo[1] < 0.8 * albedo[0], "{albedo:?}");
    let best = r.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    assert!(best > r.history[0].quality + 5.0, "{} {best}", r.history[0].quality);
}

/// Two balls that glow in their colours, and nothing else that shines.
#[test]
fn a_cloud_is_found_by_its_own_light() {
    let views: Vec<View> = (0..7).map(view).collect();
    let options = RecoverVolumeOptions { emission: true, albedo: Some([0.0; 3]), ..options(16, 80) };
    let mut truth = balls(16);
    truth.emission = truth.albedo.iter().zip(0..).map(|(a, i)| a * truth.extinction[i / 3]).collect();
    truth.albedo.fill(0.0);
    let dark = Surroundings::default();
    let model = truth.model(&dark, &BOUNDS, &options, [SIDE; 2]).expect("valid");
    let pictures: Vec<Image> = views.iter().map(|v| model.picture(v, 256, 99).expect("rendered")).collect();
    let r = recover_volume(&dark, &views, &pictures, &options, &Silent).expect("found");
    assert_eq!(r.model.parameters.len(), 2);
    let nothing = vec![0.0; truth.emission.len()];
    let emission = [&nothing, &r.emission].map(|e| rmse(e, &truth.emission));
    let best = r.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    println!("emission {emission:?}, {} to {best} dB", r.history[0].quality);
    assert!(emission[1] < 0.8 * emission[0], "{emission:?}");
    assert!(best > r.history[0].quality + 5.0, "{} {best}", r.history[0].quality);
    // Without it there is no light at all.
    let options = RecoverVolumeOptions { emission: false, ..options };
    let error = recover_volume(&dark, &views, &pictures, &options, &Silent).unwrap_err();
    assert!(error.to_string().contains("light"), "{error}");
}

#[test]
fn known_albedo_stays() {
    let views: Vec<View> = (0..4).map(view).collect();
    let known = RecoverVolumeOptions { albedo: Some([0.5, 0.6, 0.7]), ..options(8, 4) };
    let r = recover_volume(&surroundings(), &views, &pictures(&views), &known, &Silent).expect("found");
    assert!(r.albedo.chunks(3).all(|a| a == [0.5, 0.6, 0.7]) && r.model.parameters.len() == 1);
}

/// Asks to stop after so many reports.
struct Stopping(AtomicU64);

impl Progress for Stopping {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {
        let _ = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1));
    }

    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

#[test]
fn stopped_fits_go_on_to_the_same_bits() {
    let views: Vec<View> = (0..4).map(view).collect();
    let pictures = pictures(&views);
    let run = |checkpointing, progress: &dyn Progress| {
        let options = RecoverVolumeOptions { checkpointing, ..options(16, 60) };
        recover_volume(&surroundings(), &views, &pictures, &options, progress).expect("found")
    };
    let whole = run(Checkpointing::default(), &Silent);
    let dir = tempfile::tempdir().expect("a folder");
    let kept = Checkpointing { checkpoint: Some(dir.path().into()), resume: true, time_limit: None };
    // In the first grid, then in the second.
    for reports in [2, 8] {
        let part = run(kept.clone(), &Stopping(AtomicU64::new(reports)));
        assert!(part.stopped, "after {reports} reports");
        assert_eq!(part.size, whole.size, "on the grid that was asked for");
        assert_eq!(part.extinction, part.model.of(0));
        assert_eq!((part.extinction.len(), part.albedo.len()), (whole.extinction.len(), whole.albedo.len()));
    }
    let last = run(kept, &Silent);
    assert!(last.resumed > 0 && !last.stopped && last.steps == whole.steps);
    assert!(last.extinction == whole.extinction && last.albedo == whole.albedo);
    let rises = |w: &[HistoryPoint]| w[0].step <= w[1].step && w[0].seconds <= w[1].seconds;
    assert!(last.history.windows(2).all(rises), "{:?}", last.history);
}

#[test]
fn a_fit_in_a_used_folder_that_is_stopped_goes_on_as_itself() {
    let views: Vec<View> = (0..4).map(view).collect();
    let pictures = pictures(&views);
    let run = |rate: f64, checkpointing, progress: &dyn Progress| {
        let options = RecoverVolumeOptions { rate, checkpointing, ..options(16, 40) };
        recover_volume(&surroundings(), &views, &pictures, &options, progress).expect("found")
    };
    let dir = tempfile::tempdir().expect("a folder");
    let kept = |resume| Checkpointing { checkpoint: Some(dir.path().into()), resume, time_limit: None };
    run(0.05, kept(false), &Silent);
    // Another fit, which is stopped in its first grid.
    assert!(run(0.02, kept(false), &Stopping(AtomicU64::new(2))).stopped);
    let on = run(0.02, kept(true), &Silent);
    let whole = run(0.02, Checkpointing::default(), &Silent);
    assert!(!on.stopped && on.extinction == whole.extinction && on.albedo == whole.albedo);
}

#[test]
fn the_box_is_what_all_cameras_see() {
    let views: Vec<View> = (0..9).map(view).collect();
    let [lo, hi] = seen_by(&views).expect("a box");
    assert!((0.5 * (lo + hi)).distance(CENTER) < 1e-5, "{lo} {hi}");
    // Half the side is the nearest eye's distance times the sine of half its angle.
    let near = views.iter().map(|v| v.eye.distance(CENTER)).fold(f64::INFINITY, f64::min);
    assert!((0.5 * (hi - lo).x - near * 0.35_f64.sin()).abs() < 1e-5, "{lo} {hi}");
    let parallel = |x: f32| {
        let eye = Vec3::new(x, 0.0, 5.0);
        View::pinhole(&Camera::look_at(eye, eye - Vec3::Z, Vec3::Y, 0.7, 1.0, 0.1, 20.0))
    };
    let error = seen_by(&[parallel(0.0), parallel(1.0)]).unwrap_err().to_string();
    assert!(error.contains("one direction"), "{error}");
}

#[test]
fn finer_grids_hold_what_coarser_ones_held() {
    // x + 2 y + 4 z at the centres of voxels stays that within the outermost centres.
    let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
    let plane = |[nx, ny, nz]: [usize; 3]| -> Vec<f32> {
        let of = |i: usize| at(i % nx, nx) + 2.0 * at(i / nx % ny, ny) + 4.0 * at(i / nx / ny, nz);
        (0..nx * ny * nz).map(of).collect()
    };
    let (from, to) = ([4, 3, 5], [8, 6, 10]);
    let (found, wanted) = (resample(&plane(from), from, 1, to), plane(to));
    let inner = |i: usize| {
        let p = [i % 8, i / 8 % 6, i / 48];
        p.iter().zip(to).all(|(i, n)| *i > 0 && i + 1 < n)
    };
    for i in (0..480).filter(|i| inner(*i)) {
        assert!((found[i] - wanted[i]).abs() < 1e-5, "{i}: {} {}", found[i], wanted[i]);
    }
    let colors: Vec<f32> = (0..60).flat_map(|_| [0.1, 0.5, 0.9]).collect();
    assert!(
        resample(&colors, from, 3, to)
            .chunks(3)
            .all(|c| (c[0] - 0.1).abs() < 1e-6 && (c[2] - 0.9).abs() < 1e-6)
    );
}

/// Values follow the noise that they were fitted under: a second fit of the same numbers has other noise.
#[test]
fn grids_have_noise_of_their_own() {
    let seeds: Vec<u64> = (0..4).map(|level| seed_of(7, level)).collect();
    assert_eq!(seeds[0], 7);
    assert!((0..4).all(|k| !seeds[..k].contains(&seeds[k])), "{seeds:?}");
    let views: Vec<View> = (0..4).map(view).collect();
    let pictures = pictures(&views);
    let two = recover_volume(&surroundings(), &views, &pictures, &options(16, 0), &Silent).expect("found");
    assert_eq!(two.model.options.seed, options(16, 0).seed, "the result has that of the user");
}

/// Extinction goes up to where more changes nothing, however large the box is.
#[test]
fn ranges_follow_the_size_of_the_box() {
    for size in [1e-8, 1.0, 1e8] {
        let bounds = [DVec3::ZERO, DVec3::splat(size)];
        let options = RecoverVolumeOptions { emission: true, ..options(8, 0) };
        let grid = Grid::start([8; 3], &bounds, &options);
        let model = grid.model(&surroundings(), &bounds, &options, [SIDE; 2]).expect("valid");
        let [least, most] = model.ranges(0)[0];
        let thickness = f64::from(most) * size / f64::from(Volume::THICKEST);
        assert!(least == 0.0 && (0.99..=1.0).contains(&thickness), "{size}: {least} to {most}");
        assert!(model.within(0) == model.of(0), "{size}: the start is within");
    }
}

#[test]
fn wrong_options_are_named() {
    let views = [view(0)];
    let fails = |surroundings: &Surroundings, options: &RecoverVolumeOptions| {
        recover_volume(surroundings, &views, &[Image::new(8, 8, 4)], options, &Silent)
            .unwrap_err()
            .to_string()
    };
    let lit = surroundings();
    for (options, text) in [
        (RecoverVolumeOptions { size: 0, ..options(8, 1) }, "size is 0; it must be 1 to 512"),
        (
            RecoverVolumeOptions { anisotropy: 1.0, ..options(8, 1) },
            "anisotropy is 1; it must be more than -1",
        ),
        (RecoverVolumeOptions { albedo: Some([0.5, 2.0, 0.0]), ..options(8, 1) }, "it must be 0 to 1"),
        (RecoverVolumeOptions { bounds: Some([DVec3::ONE; 2]), ..options(8, 1) }, "have a volume"),
    ] {
        let error = fails(&lit, &options);
        assert!(error.contains(text), "{error}");
    }
    assert!(fails(&Surroundings::default(), &options(8, 1)).contains("have no light"));
}

#[test]
fn light_that_is_no_number_is_told_once_for_all_grids() {
    let views: Vec<View> = (0..2).map(view).collect();
    let pictures = pictures(&views);
    let told = |intensity: f32| {
        let mut light = surroundings();
        light.lights.push(LightSource::Point { position: CENTER, intensity: Vec3f::splat(intensity) });
        let heard = Heard::default();
        recover_volume(&light, &views, &pictures, &options(16, 0), &heard).expect("found");
        heard.0.into_inner().expect("not poisoned")
    };
    assert_eq!(told(1.0), [""; 0]);
    let told = told(3e38);
    assert!(told.len() == 1 && told[0].contains("contributions were not finite"), "{told:?}");
}
