//! Views are functions of seed and index, frame what they look at, and have the sizes that are asked for.

use super::*;

#[test]
fn views_are_a_function_of_seed_and_index() {
    let at = |set, i, seed| Orbit::new(seed, &Lighting::Point, 8).setup(set, i, 8).camera.pinhole();
    assert_eq!(at(Set::Train, 3, 1), at(Set::Train, 3, 1));
    assert_ne!(at(Set::Train, 3, 1), at(Set::Train, 4, 1));
    assert_ne!(at(Set::Train, 3, 1), at(Set::Train, 3, 2));
    assert_ne!(at(Set::HeldOut, 3, 1).eye, at(Set::Report, 3, 1).eye);
}

#[test]
fn both_renderers_see_one_camera() {
    let camera = Orbit::new(5, &Lighting::Point, 8).setup(Set::Train, 0, 8).camera.pinhole();
    let view = View::pinhole(&camera);
    assert_eq!(ViewCamera::from(camera).view(), view);
    let lens = View { half: [0.3, 0.2], ..view };
    let traced = ViewCamera::Traced(lens);
    assert_eq!(traced.view(), lens);
    let (there, back) = (traced.pinhole(), View::pinhole(&traced.pinhole()));
    assert!(there.eye.abs_diff_eq(camera.eye, 1e-6), "{there:?}");
    assert!((back.half[0] - 0.3).abs() < 1e-5 && (back.half[1] - 0.2).abs() < 1e-5, "{back:?}");
    for (a, b) in back.axes.iter().zip(lens.axes) {
        assert!(a.abs_diff_eq(b, 1e-5), "{a} {b}");
    }
}

#[test]
fn a_view_without_its_picture_is_an_error() {
    let view = Orbit::new(0, &Lighting::Point, 8).setup(Set::Report, 0, 1);
    let told = |picture| Setup { picture, ..view.clone() }.given_picture(4).map_err(|e| e.to_string());
    assert_eq!(told(Some(3)), Ok(3));
    let rule = |is| Err(format!("picture of the view is {is}; it must be the number of one of 4 pictures"));
    assert_eq!((told(None), told(Some(4))), (rule("none"), rule("4")));
}

#[test]
fn a_share_of_training_views_shows_backs_and_changes_nothing_else() {
    let of = |backs| Orbit { backs, ..Orbit::new(2, &Lighting::Mixed, 8) };
    let (some, none) = (of(0.25), of(0.0));
    let shown = |set, parity: u64| (0..2000).filter(|i| some.setup(set, 2 * i + parity, 0).backs).count();
    // Of views under both kinds of light.
    for parity in [0, 1] {
        let count = shown(Set::Train, parity);
        assert!((440..560).contains(&count), "{count} of 2000");
        assert_eq!(shown(Set::HeldOut, parity) + shown(Set::Report, parity), 0);
    }
    let all = (0..100).map(|i| (some.setup(Set::Train, i, 0), none.setup(Set::Train, i, 0)));
    for (a, b) in all {
        assert!(!b.backs && a.camera == b.camera && format!("{:?}", a.lights) == format!("{:?}", b.lights));
    }
}

#[test]
fn logarithms_of_sizes_are_spread_evenly() {
    let of = |smallest| Orbit { smallest, ..Orbit::new(4, &Lighting::Point, 512) };
    let width = |o: &Orbit, set, i| o.setup(set, i, 9).width;
    let some = of(Some(16));
    for (set, count) in [(Set::Train, 4000), (Set::HeldOut, 40)] {
        let sizes: Vec<usize> = (0..count).map(|i| width(&some, set, i)).collect();
        assert!(sizes.iter().all(|s| (16..=512).contains(s)));
        for octave in 4..9 {
            let within = sizes.iter().filter(|s| (1 << octave..1 << (octave + 1)).contains(*s)).count();
            let share = within as f64 / count as f64;
            assert!((share - 0.2).abs() < 0.03, "{set:?}, from {} pixels: {share}", 1 << octave);
        }
    }
    // Nor does a size have a direction: shares and directions of held-out views are uncorrelated.
    let views = (0..200).map(|i| some.setup(Set::HeldOut, i, 200));
    let pairs: Vec<_> =
        views.map(|s| ((s.width as f64).log2(), s.camera.pinhole().eye.normalize())).collect();
    let mean = pairs.iter().map(|p| p.0).sum::<f64>() / 200.0;
    let pull = pairs.iter().map(|(size, eye)| eye.as_dvec3() * (size - mean)).sum::<glam::DVec3>() / 200.0;
    assert!(pull.length() < 0.1, "{pull}");
    assert_eq!(width(&some, Set::Report, 3), 512);
    assert_eq!(width(&of(None), Set::Train, 3), 512);
    // The camera is that of a picture of the full size.
    let [a, b] = [of(None), some].map(|o| o.setup(Set::Train, 3, 9).camera);
    assert_eq!(a, b);
}

#[test]
fn the_unit_sphere_fits_report_views() {
    for i in 0..8 {
        let c = Orbit::new(0, &Lighting::Point, 8).setup(Set::Report, i, 8).camera.pinhole();
        let d = c.eye.length();
        assert!((1.0 / d).asin() <= HALF_TANGENT.atan(), "view {i}");
    }
}

#[test]
fn distance_and_size_are_values_of_the_views() {
    let far = Orbit { distance: [3.0, 3.0], judged_distance: 4.0, ..Orbit::new(1, &Lighting::Point, 64) };
    let framing = 1.0 / HALF_TANGENT.atan().sin();
    let s = far.setup(Set::HeldOut, 2, 5);
    assert!((s.camera.pinhole().eye.length() / framing - 4.0).abs() < 1e-4);
    assert_eq!((s.width, s.height), (64, 64));
    // Training cameras are shifted across the view by at most .12 on each axis.
    let d = far.setup(Set::Train, 2, 0).camera.pinhole().eye.length() / framing;
    assert!((d - 3.0).abs() < 0.02, "{d}");
    assert_eq!((s.shrunk(4).width, s.shrunk(100).height), (16, 1));
}

#[test]
fn views_frame_what_is_looked_at() {
    let unit = Orbit::new(3, &Lighting::Point, 8);
    let moved = Orbit { bounds: Sphere { center: vec3(5.0, -2.0, 1.0), radius: 3.0 }, ..unit.clone() };
    for (set, index) in [(Set::Train, 0), (Set::Train, 7), (Set::HeldOut, 2), (Set::Report, 1)] {
        let (a, b) = (unit.setup(set, index, 5), moved.setup(set, index, 5));
        for p in [Vec3::ZERO, Vec3::new(0.3, -0.5, 0.2)] {
            let in_a = a.camera.pinhole().view_projection().project_point3(p);
            let q = p * 3.0 + Vec3::new(5.0, -2.0, 1.0);
            let in_b = b.camera.pinhole().view_projection().project_point3(q);
            assert!(in_a.truncate().abs_diff_eq(in_b.truncate(), 1e-4), "{set:?} {index}: {in_a} {in_b}");
        }
        let irradiance = |s: &Setup, at: Vec3f| match s.lights.0[0] {
            ViewLight::Point { position, intensity } => intensity.x / (position - at).length_squared(),
            _ => panic!("a point light"),
        };
        let (x, y) = (irradiance(&a, Vec3f::zero()), irradiance(&b, vec3(5.0, -2.0, 1.0)));
        assert!((x / y - 1.0).abs() < 1e-4, "{x} {y}");
    }
}
