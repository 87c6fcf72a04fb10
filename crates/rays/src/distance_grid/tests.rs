//! Grids of distances against closed forms, and rays that must not slip through.

use super::*;

/// Distances to a sphere around `center`, of `n` samples a side.
fn ball(n: usize, center: DVec3, radius: f64) -> DistanceGrid {
    let at = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
    let values = (0..n * n * n).map(|i| (at(i).distance(center) - radius) as f32).collect();
    DistanceGrid::new([n; 3], values).unwrap()
}

/// The nearest hit.
fn closest(grid: &DistanceGrid, o: DVec3, d: DVec3) -> Option<DistanceHit> {
    let mut best: Option<DistanceHit> = None;
    grid.candidates(o, d, f32::INFINITY, &mut |hit, _| {
        if best.is_none_or(|b| hit.t < b.t) {
            best = Some(hit);
        }
        best.map(|b| b.t as f32 * (1.0 + 1e-6))
    });
    best
}

/// Numbers in [0, 1) that follow from their index.
fn random(i: u64) -> f64 {
    let mut z = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z >> 11) as f64 / (1_u64 << 53) as f64
}

fn direction(i: u64) -> DVec3 {
    let (z, phi) = (2.0 * random(2 * i) - 1.0, std::f64::consts::TAU * random(2 * i + 1));
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * phi.cos(), r * phi.sin(), z)
}

#[test]
fn a_ball_is_met_where_the_sphere_is() {
    // Trilinear interpolation over a cell of side 1 is off by at most 3/8 of the second derivative, which is 1 / radius.
    let (center, radius) = (DVec3::new(20.3, 19.6, 20.1), 13.0);
    let grid = ball(41, center, radius);
    let bound = 0.375 / radius;
    let (mut farthest, mut turned, mut smooth) = (0.0_f64, 0.0_f64, 0.0_f64);
    for i in 0..20_000 {
        let o = center + direction(2 * i) * 60.0;
        let aim = center + direction(2 * i + 1) * (0.9 * radius);
        let d = (aim - o).normalize();
        let hit = closest(&grid, o, d).expect("aims at the ball");
        assert!(hit.front);
        let b = (o - center).dot(d);
        let exact = -b - (b * b - (o - center).length_squared() + radius * radius).sqrt();
        let n = (o + d * exact - center).normalize();
        farthest = farthest.max((hit.t - exact).abs() * n.dot(d).abs());
        let (p, gradient) = grid.on_surface(hit.cell, o + d * hit.t);
        assert!((p - (o + d * hit.t)).length() < 1e-9, "a hit lies on the surface");
        turned = turned.max(gradient.angle_between(p - center));
        smooth = smooth.max(grid.smooth_normal(p, DVec3::ONE).angle_between(p - center));
    }
    assert!(farthest < bound && farthest > 0.1 * bound, "{farthest} against {bound}");
    // A gradient turns by about half a cell over the radius; interpolated normals by less.
    assert!(turned < 0.7 / radius && smooth < 0.5 * turned, "{turned} {smooth}");
}

#[test]
fn no_ray_leaves_a_closed_surface() {
    // Noise below 0 in the middle, positive at the border: a surface with many sheets and thin parts.
    let n = 14;
    let values: Vec<f32> = (0..n * n * n)
        .map(|i| {
            let p = [i % n, i / n % n, i / n / n];
            let border = p.iter().any(|x| *x == 0 || *x == n - 1);
            let noise = random(i as u64) as f32 - 0.7;
            if border {
                1.0
            } else if random(7 * i as u64) < 0.05 {
                0.0
            } else {
                noise
            }
        })
        .collect();
    let grid = DistanceGrid::new([n; 3], values.clone()).unwrap();
    let inside = (0..values.len()).find(|i| values[*i] < -0.5).expect("the noise has such a value");
    let start = DVec3::new((inside % n) as f64, (inside / n % n) as f64, (inside / n / n) as f64);
    for i in 0..40_000 {
        // Along axes and diagonals of the grid too: these rays run in faces and through corners.
        let d = match i % 4 {
            0 => DVec3::AXES[i as usize / 4 % 3] * if i % 8 == 0 { 1.0 } else { -1.0 },
            1 => DVec3::new(1.0, if i % 8 == 1 { 1.0 } else { -1.0 }, ((i / 8 % 3) as f64) - 1.0),
            _ => direction(i),
        };
        let mut crossed = Vec::new();
        grid.candidates(start, d, f32::INFINITY, &mut |hit, limit| {
            crossed.push(hit);
            Some(limit)
        });
        crossed.sort_by(|a, b| a.t.total_cmp(&b.t));
        // A crossing in a face or an edge is found in all cells there.
        crossed.dedup_by(|a, b| a.front == b.front && (a.t - b.t).abs() < 1e-9);
        assert!(crossed.len() % 2 == 1, "{d}: inside to outside by {crossed:?}");
        let first = crossed[0];
        assert!(!first.front && crossed.is_sorted_by(|a, b| a.front != b.front), "{d}: {crossed:?}");
    }
}

#[test]
fn points_are_put_on_the_surface_of_their_cell() {
    // Noise, and points anywhere in the cell or far from it: the gradient leads out of many cells.
    let n = 9;
    let values = (0..n * n * n).map(|i| random(i) as f32 - 0.5).collect();
    let grid = DistanceGrid::new([n as usize; 3], values).unwrap();
    for cell in 0..grid.cells() as u32 {
        let low = grid.corner(grid.cells[cell as usize]).as_dvec3();
        for k in 0..20 {
            let far = if k < 10 { 1.0 } else { 5.0 };
            let i = 3 * (20 * u64::from(cell) + k);
            let p = low + DVec3::new(random(i), random(i + 1), random(i + 2)) * far - (far - 1.0) * 0.5;
            let (q, gradient) = grid.on_surface(cell, p);
            let inside = q - low;
            assert_eq!(inside.clamp(DVec3::ZERO, DVec3::ONE), inside, "{q} in the cell at {low}");
            let value = grid.cell(grid.cells[cell as usize]).value(inside);
            assert!(value.abs() < 1e-8 && gradient.is_finite(), "{value} at {q}");
        }
    }
}

#[test]
fn hits_beyond_the_limit_do_not_count_and_rays_may_start_anywhere() {
    let center = DVec3::splat(8.0);
    let grid = ball(17, center, 5.0);
    let along = |o: DVec3, limit: f32| {
        let mut all = Vec::new();
        grid.candidates(o, DVec3::X, limit, &mut |hit, limit| {
            all.push((hit.t.round(), hit.front));
            Some(limit)
        });
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    let o = DVec3::new(-1e6, 8.3, 7.9);
    assert_eq!(along(o, f32::INFINITY), [(1e6 + 3.0, true), (1e6 + 13.0, false)]);
    assert_eq!(along(o, 1e6 + 8.0), [(1e6 + 3.0, true)]);
    assert_eq!(along(o, 1e6), []);
    assert_eq!(along(DVec3::new(8.0, 8.3, 7.9), f32::INFINITY), [(5.0, false)]);
    assert_eq!(along(DVec3::new(20.0, 8.3, 7.9), f32::INFINITY), []);
}

#[test]
fn bad_grids_are_refused_in_words() {
    let fails = |size: [usize; 3], values: Vec<f32>| DistanceGrid::new(size, values).unwrap_err().to_string();
    let text = fails([1, 2, 2], vec![0.0; 4]);
    assert!(text.contains("1 x 2 x 2") && text.contains("2 or more"), "{text}");
    assert!(fails([1 << 20, 1 << 20, 1 << 20], Vec::new()).contains("2^27"));
    assert_eq!(fails([2; 3], vec![0.0; 7]), "there are 7 values; there must be 8, one a sample");
    let mut values = vec![1.0; 8];
    assert_eq!(
        fails([2; 3], values.clone()),
        "all values are 0 or more; some must be below 0 and some must not"
    );
    values[5] = f32::NAN;
    assert_eq!(fails([2; 3], values), "value 5 is NaN; it must be finite");
    let n = 164;
    let noise = (0..n * n * n).map(|i| if i % 2 == 0 { -1.0 } else { 1.0 }).collect();
    assert!(fails([n; 3], noise).contains("it may pass through 4194304"));
}
