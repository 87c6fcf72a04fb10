//! Procedural meshes through the whole of [`unwrap`](super::unwrap).

mod rules;
mod shapes;

use super::{Atlas, AtlasError, UnwrapOptions, unwrap};
use photofit_scalar::{Vec3f, vec2, vec3};
use rules::{check, signed_area};
use shapes::Shape;

fn options(size: u32) -> UnwrapOptions {
    UnwrapOptions { size, ..UnwrapOptions::default() }
}

fn run(shape: &Shape, options: &UnwrapOptions) -> Atlas {
    let group = vec![0; shape.triangles.len()];
    unwrap(&shape.positions, &shape.triangles, &group, options).expect("valid numbers have an atlas")
}

/// Unwraps, checks every rule, and checks the number of charts and the occupancy.
fn good(name: &str, shape: &Shape, size: u32, charts: std::ops::RangeInclusive<u32>, occupancy: f32) {
    let atlas = run(shape, &options(size));
    if let Err(e) = check(shape, &atlas, 2.0) {
        panic!("{name}: {e}");
    }
    assert!(charts.contains(&atlas.charts), "{name}: {} charts, expected {charts:?}", atlas.charts);
    assert!(atlas.occupancy >= occupancy, "{name}: occupancy {} below {occupancy}", atlas.occupancy);
}

#[test]
fn smooth_and_flat_shapes() {
    good("cube", &shapes::cube(), 256, 2..=6, 0.6);
    good("grid", &shapes::grid(20, |_, _| 0.0), 256, 1..=1, 0.95);
    good("wave", &shapes::grid(30, |x, y| 0.1 * (6.0 * x).sin() * (5.0 * y).cos()), 256, 1..=8, 0.6);
    good("icosphere", &shapes::icosphere(3), 512, 8..=30, 0.6);
    good("torus", &shapes::torus(48, 24), 512, 6..=40, 0.6);
}

#[test]
fn one_triangle_and_nothing() {
    let p = vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0)];
    good("one", &Shape { positions: p, triangles: vec![[0, 1, 2]] }, 64, 1..=1, 0.2);
    let none = unwrap(&[], &[], &[], &options(64)).expect("an empty mesh is valid");
    assert_eq!((none.charts, none.corner_uv.len()), (0, 0));
}

#[test]
fn many_parts_and_soup() {
    good("parts", &shapes::scattered(300, 5), 512, 300..=300, 0.15);
    good("more parts than the coarse search takes", &shapes::scattered(420, 6), 256, 420..=420, 0.1);
    good("random connections", &shapes::random_connections(80, 400), 256, 1..=400, 0.0);
    good("random heights", &shapes::noise(24), 256, 1..=1100, 0.1);
}

#[test]
fn folds_and_layers() {
    good("pleats", &shapes::pleats(40), 256, 1..=80, 0.1);
    good("helix", &shapes::helix(3, 24), 256, 2..=40, 0.1);
    good("two-sided sheet", &shapes::doubled(&shapes::grid(8, |_, _| 0.0)), 256, 1..=4, 0.4);
    good("twice the same sheet", &shapes::repeated(&shapes::grid(8, |_, _| 0.0)), 256, 1..=130, 0.1);
}

#[test]
fn slivers_and_degenerate_triangles() {
    good("needles", &shapes::needles(60), 256, 1..=20, 0.1);
    good("disc of 800 spokes", &shapes::spokes(800, 0.0), 256, 1..=10, 0.5);
    good("cone of 800 spokes", &shapes::spokes(800, 2.0), 256, 1..=16, 0.5);
    good("ribbon of 1 by 400", &shapes::ribbon(400), 256, 10..=100, 0.1);
    let mut broken = shapes::icosphere(2);
    let n = broken.triangles.len();
    for i in 0..n / 3 {
        let [a, b, _] = broken.triangles[i * 3];
        // A point, an edge, and a cap on the middle of an edge.
        let middle = (broken.positions[a as usize] + broken.positions[b as usize]) * 0.5;
        broken.positions.push(middle);
        let m = broken.positions.len() as u32 - 1;
        broken.triangles.extend([[a, a, a], [a, b, b], [a, m, b]]);
    }
    good("degenerate among others", &broken, 256, 4..=40, 0.4);
    let p = vec![vec3(1.0, 2.0, 3.0); 6];
    let points = Shape { positions: p, triangles: vec![[0, 1, 2], [3, 4, 5], [0, 3, 5]] };
    good("only points", &points, 64, 1..=1, 0.0);
}

#[test]
fn non_manifold_fan() {
    good("fan of pages", &shapes::pages(12), 256, 1..=12, 0.2);
    good("fan of 450 pages", &shapes::pages(450), 256, 1..=450, 0.05);
}

#[test]
fn offset_and_scale_do_not_matter() {
    let sphere = shapes::icosphere(2);
    let whole = run(&sphere, &options(256));
    // Powers of two scale without rounding, so that the atlas is the same.
    for scale in [2.0_f32.powi(-20), 2.0_f32.powi(60)] {
        let mut scaled = run(&sphere.mapped(|p| p * scale), &options(256));
        scaled.texels_per_unit *= scale;
        assert_eq!(scaled, whole, "scale {scale}");
    }
    good("scale 1e-6", &sphere.mapped(|p| p * 1e-6), 256, 8..=30, 0.5);
    good("scale 1e18", &sphere.mapped(|p| p * 1e18), 256, 8..=30, 0.5);
    // At 1e6 single precision resolves 1/16: vertices coincide and move.
    good("offset 1e6", &sphere.mapped(|p| p + Vec3f::splat(1e6)), 256, 1..=320, 0.2);
    good("offset 1e6, size 1e3", &sphere.mapped(|p| p * 1e3 + Vec3f::splat(1e6)), 256, 4..=40, 0.5);
}

#[test]
fn texels_per_unit_is_the_density() {
    let shape = shapes::grid(4, |_, _| 0.0);
    let atlas = run(&shape, &options(256));
    let area: f64 = atlas.corner_uv.iter().map(signed_area).sum();
    let want = f64::from(atlas.texels_per_unit).powi(2) / (256.0 * 256.0);
    assert!((area - want).abs() < 1e-4 * want, "uv area of a unit square {area}, expected {want}");
    assert!(
        (f64::from(atlas.occupancy) - area).abs() < 1e-4,
        "occupancy {} is the uv area {area}",
        atlas.occupancy
    );
}

#[test]
fn importance_scales_the_area() {
    let shape = shapes::scattered(2, 1);
    let mut weights = options(512);
    weights.importance = vec![1.0, 1.0, 9.0, 9.0];
    let atlas = run(&shape, &weights);
    check(&shape, &atlas, 2.0).expect("the rules hold with weights");
    let share = |t: usize| {
        let [a, b, c] = shape.corners(t);
        signed_area(&atlas.corner_uv[t]) / f64::from((b - a).cross(c - a).length())
    };
    let ratio = share(2) / share(0);
    assert!((ratio - 9.0).abs() < 0.05, "nine times the area per surface, found {ratio}");
    weights.importance = vec![0.0, 0.0, 1.0, 1.0];
    let clamped = run(&shape, &weights);
    assert!(
        clamped.corner_uv[..2].iter().all(|c| signed_area(c) > 0.0),
        "a weight of zero keeps some texels"
    );
    // In one flat sheet, unequal halves become charts of unequal density.
    let sheet = shapes::grid(8, |_, _| 0.0);
    let left = |t: &[u32; 3]| t.iter().all(|&i| sheet.positions[i as usize].x <= 0.5);
    weights.importance = sheet.triangles.iter().map(|t| if left(t) { 16.0 } else { 1.0 }).collect();
    let atlas = run(&sheet, &weights);
    check(&sheet, &atlas, 2.0).expect("the rules hold with weights in one sheet");
    assert_eq!(atlas.charts, 2);
}

#[test]
fn charts_stay_inside_groups() {
    let shape = shapes::grid(10, |_, _| 0.0);
    let group: Vec<u32> = (0..shape.triangles.len() as u32).map(|t| u32::from(t > 77)).collect();
    let atlas = unwrap(&shape.positions, &shape.triangles, &group, &options(256)).expect("valid");
    check(&shape, &atlas, 2.0).expect("the rules hold with groups");
    let mut of = vec![None; atlas.charts as usize];
    for (t, &c) in atlas.triangle_chart.iter().enumerate() {
        assert_eq!(
            *of[c as usize].get_or_insert(group[t]),
            group[t],
            "triangle {t}: chart {c} crosses groups"
        );
    }
}

#[test]
fn mesh_splits_vertices_only_at_seams() {
    let shape = shapes::icosphere(2);
    let atlas = run(&shape, &options(256));
    let (mesh, source) = atlas.build_mesh(&shape.positions, &shape.triangles);
    assert_eq!(mesh.triangles.len(), shape.triangles.len());
    let mut pairs = Vec::new();
    for (t, tri) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let i = tri[k] as usize;
            assert_eq!(source[i], shape.triangles[t][k], "triangle {t}: source of corner {k}");
            assert_eq!(mesh.positions[i], shape.positions[source[i] as usize]);
            assert_eq!(mesh.uvs[i], atlas.corner_uv[t][k], "triangle {t}: uv of corner {k}");
        }
    }
    for (i, uv) in mesh.uvs.iter().enumerate() {
        pairs.push((source[i], uv.x.to_bits(), uv.y.to_bits()));
    }
    let all = pairs.len();
    pairs.sort_unstable();
    pairs.dedup();
    assert_eq!(pairs.len(), all, "no vertex appears twice with the same uv");
    assert!(all < 2 * shape.positions.len(), "most vertices stay whole: {all}");
}

#[test]
fn same_bits_for_any_number_of_threads() {
    let shape = shapes::torus(40, 20);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| run(&shape, &options(256)))
    };
    let (one, four) = (with(1), with(4));
    assert_eq!(one, four);
}

#[test]
fn little_room_lowers_the_padding_and_then_fails() {
    let shape = shapes::scattered(60, 3);
    let mut small = options(24);
    small.padding = Some(8);
    let atlas = run(&shape, &small);
    assert!(atlas.padding < 8, "60 charts with 8 texels between them do not fit into 24 x 24");
    check(&shape, &atlas, 2.0).expect("the rules hold with the lower padding");
    let group = vec![0; shape.triangles.len()];
    let error = unwrap(&shape.positions, &shape.triangles, &group, &options(7)).expect_err("49 texels");
    assert_eq!(error, AtlasError::TooManyCharts { charts: 60, size: 7 });
}

#[test]
fn bad_input_is_refused() {
    let p = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, f32::NAN, 0.0)];
    let fail =
        |t: [u32; 3], group: &[u32], o: UnwrapOptions| unwrap(&p, &[t], group, &o).expect_err("must fail");
    assert_eq!(fail([0, 1, 2], &[0], options(64)), AtlasError::Position { vertex: 2 });
    assert_eq!(fail([0, 1, 3], &[0], options(64)), AtlasError::Index { triangle: 0, vertex: 3 });
    let length = |name, found| AtlasError::Length { name, found, triangles: 1 };
    assert_eq!(fail([0, 1, 1], &[], options(64)), length("group", 0));
    let weights = |importance| UnwrapOptions { importance, ..options(64) };
    assert_eq!(fail([0, 1, 1], &[0], weights(vec![1.0, 1.0])), length("importance", 2));
    for w in [-1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(fail([0, 1, 1], &[0], weights(vec![w])), AtlasError::Importance { triangle: 0 });
    }
    for size in [0, 16_385] {
        assert_eq!(fail([0, 1, 1], &[0], options(size)), AtlasError::Size { size });
    }
    for bound in [1.0, f32::NEG_INFINITY] {
        let bad = UnwrapOptions { max_stretch: bound, ..options(64) };
        assert_eq!(fail([0, 1, 1], &[0], bad), AtlasError::StretchBound { bound });
    }
}

#[test]
fn the_rules_notice_a_broken_atlas() {
    let shape = shapes::cube();
    let atlas = run(&shape, &options(256));
    check(&shape, &atlas, 2.0).expect("whole");
    let broken = |change: &dyn Fn(usize, &mut [photofit_scalar::Vec2f; 3])| {
        let mut copy = atlas.clone();
        copy.corner_uv.iter_mut().enumerate().for_each(|(t, c)| change(t, c));
        check(&shape, &copy, 2.0).expect_err("a broken rule must show")
    };
    let chart = atlas.triangle_chart.clone();
    let texel = 1.0 / 256.0;
    let moved = broken(&|t, c| {
        if chart[t] == 1 {
            c.iter_mut().for_each(|p| *p += vec2(-3.0 * texel, 1.0 * texel));
        }
    });
    assert!(moved.contains("texel"), "{moved}");
    let mirrored = broken(&|_, c| c.iter_mut().for_each(|p| p.x = 1.0 - p.x));
    assert!(mirrored.contains("mirrored"), "{mirrored}");
    let stretched = broken(&|t, c| {
        if t == 0 {
            c[0] = (c[1] + c[2]) * 0.5 + (c[0] - (c[1] + c[2]) * 0.5) * 0.3;
        }
    });
    assert!(stretched.contains("stretch"), "{stretched}");
    let outside = broken(&|_, c| c.iter_mut().for_each(|p| p.y -= 0.95));
    assert!(outside.contains("outside"), "{outside}");
    let folded = broken(&|t, c| *c = if t == 1 { atlas.corner_uv[0] } else { *c });
    assert!(folded.contains("texel"), "{folded}");
}
