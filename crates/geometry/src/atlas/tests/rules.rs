//! Every promise of an atlas, checked independently of the code that makes it.

use super::super::Atlas;
use super::shapes::Shape;
use photofit_scalar::{Vec2, Vec2f, vec2};

/// Triangles flatter than this (height against the longest edge) carry no promise of stretch or orientation.
const FLAT: f64 = 2e-6;

/// Signed area in `(u, 1 - v)`.
pub(super) fn signed_area(c: &[Vec2f; 3]) -> f64 {
    let [a, b, c] = c.map(|p| vec2(f64::from(p.x), 1.0 - f64::from(p.y)));
    0.5 * ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x))
}

/// Checks all rules; names the first that is broken.
pub(super) fn check(shape: &Shape, atlas: &Atlas, bound: f64) -> Result<(), String> {
    let count = shape.triangles.len();
    if atlas.corner_uv.len() != count || atlas.triangle_chart.len() != count {
        return Err("one entry per triangle".into());
    }
    if let Some(t) = atlas.triangle_chart.iter().position(|&c| c >= atlas.charts) {
        return Err(format!("triangle {t}: no chart"));
    }
    for (t, c) in atlas.corner_uv.iter().enumerate() {
        if !c.iter().all(|p| (0.0..=1.0).contains(&p.x) && (0.0..=1.0).contains(&p.y)) {
            return Err(format!("triangle {t}: uvs {c:?} outside [0, 1]"));
        }
    }
    orientation_and_stretch(shape, atlas, bound)?;
    separation(atlas)?;
    inside_charts(atlas)
}

fn orientation_and_stretch(shape: &Shape, atlas: &Atlas, bound: f64) -> Result<(), String> {
    let size = f64::from(atlas.size);
    let mut sums = vec![(0.0, 0.0); atlas.charts as usize];
    let measure = |t: usize| {
        let [a, b, c] = shape.corners(t).map(|p| p.cast::<f64>());
        let (e, f) = (b - a, c - a);
        let longest = e.length().max(f.length()).max((f - e).length());
        (e, f, e.cross(f).length(), longest)
    };
    for t in 0..shape.triangles.len() {
        let s = &mut sums[atlas.triangle_chart[t] as usize];
        s.0 += signed_area(&atlas.corner_uv[t]);
        s.1 += 0.5 * measure(t).2;
    }
    for t in 0..shape.triangles.len() {
        let (e, f, cross, longest) = measure(t);
        if cross <= FLAT * longest * longest {
            continue;
        }
        let (uv, surface) = sums[atlas.triangle_chart[t] as usize];
        let density = (uv / surface).sqrt();
        // Rounding of uvs to single precision can turn triangles thinner than this, in texels.
        let thin = cross / longest * density * size < 1e-3;
        if signed_area(&atlas.corner_uv[t]) <= 0.0 && !thin {
            return Err(format!("triangle {t}: mirrored or flat, uvs {:?}", atlas.corner_uv[t]));
        }
        if thin || longest * density * size < 0.1 {
            continue;
        }
        // Map from an orthonormal frame of the triangle to the uvs.
        let [a, b, c] = atlas.corner_uv[t].map(|p| vec2(f64::from(p.x), f64::from(p.y)));
        let x = e * (1.0 / e.length());
        let (fx, fy) = (f.dot(x), cross / e.length());
        let du = (b - a) * (1.0 / e.length());
        let dv = ((c - a) - du * fx) * (1.0 / fy);
        let (p, q, r) = (du.length_squared(), du.dot(dv), dv.length_squared());
        let root = (0.25 * (p - r).powi(2) + q * q).sqrt();
        let (s1, s2) = ((0.5 * (p + r) + root).sqrt(), (0.5 * (p + r) - root).max(0.0).sqrt());
        let stretch = (s1 / density).max(density / s2);
        // Single-precision uvs move a corner by up to 6e-8, seen against the height of the triangle.
        let slack = 1.0 + 4e-7 * longest / (cross * density);
        if stretch.is_nan() || stretch > bound * 1.002 * slack {
            return Err(format!("triangle {t}: stretch {stretch} above {bound}"));
        }
    }
    Ok(())
}

/// True when the triangle meets the open square of half side `half` around `c`: clips the triangle by the square.
fn meets(p: &[Vec2<f64>; 3], c: Vec2<f64>, half: f64) -> bool {
    let mut polygon = p.to_vec();
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let out = |q: Vec2<f64>| sign * (q[axis] - c[axis]) - half;
        let mut next = Vec::new();
        for i in 0..polygon.len() {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            let (da, db) = (out(a), out(b));
            if da < 0.0 {
                next.push(a);
            }
            if (da < 0.0) != (db < 0.0) {
                next.push(a + (b - a) * (da / (da - db)));
            }
        }
        polygon = next;
    }
    !polygon.is_empty()
}

/// Charts keep their distance: conservatively covered texels are `padding` texels apart and from the border, and no
/// texel is read by bilinear lookups inside two charts.
fn separation(atlas: &Atlas) -> Result<(), String> {
    let n = atlas.size as usize;
    // Rounding of uvs, in texels.
    let guard = 1e-4;
    let square = owners(atlas, 0.5 - guard)?;
    if atlas.padding >= 2 {
        owners(atlas, 1.0 - guard)?;
    }
    let padding = atlas.padding as usize;
    for y in 0..n {
        for x in 0..n {
            let Some(c) = square[y * n + x] else { continue };
            if x < padding || y < padding || x + padding >= n || y + padding >= n {
                return Err(format!("chart {c}: texel ({x}, {y}) is in the border of {padding}"));
            }
            // Only texels ahead: each pair is seen once.
            for v in y..(y + padding + 1).min(n) {
                for u in x.saturating_sub(padding)..(x + padding + 1).min(n) {
                    if square[v * n + u].is_some_and(|d| d != c) {
                        return Err(format!(
                            "texels ({x}, {y}) and ({u}, {v}) of two charts within {padding}"
                        ));
                    }
                }
            }
        }
    }
    Ok(())
}

/// Chart that meets the square of half side `half` around each texel's centre; an error where two do.
fn owners(atlas: &Atlas, half: f64) -> Result<Vec<Option<u32>>, String> {
    let n = atlas.size as usize;
    let mut owner: Vec<Option<u32>> = vec![None; n * n];
    for (t, c) in atlas.corner_uv.iter().enumerate() {
        let p = c.map(|q| vec2(f64::from(q.x), f64::from(q.y)) * n as f64);
        let (lo, hi) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        let range = |a: f64, b: f64| ((a - 2.0).max(0.0) as usize)..((b + 3.0) as usize).min(n);
        for y in range(lo.y, hi.y) {
            for x in range(lo.x, hi.x) {
                let chart = atlas.triangle_chart[t];
                if owner[y * n + x] == Some(chart) || !meets(&p, vec2(x as f64 + 0.5, y as f64 + 0.5), half) {
                    continue;
                }
                if let Some(other) = owner[y * n + x].replace(chart) {
                    return Err(format!(
                        "texel ({x}, {y}) belongs to charts {other} and {chart} (half side {half})"
                    ));
                }
            }
        }
    }
    Ok(owner)
}

/// No sample of a fine lattice lies well inside two triangles.
fn inside_charts(atlas: &Atlas) -> Result<(), String> {
    let n = atlas.size as usize * 2;
    let mut owner = vec![None; n * n];
    for (t, c) in atlas.corner_uv.iter().enumerate() {
        // An odd offset keeps the lattice off the vertices.
        let p = c.map(|q| vec2(f64::from(q.x), f64::from(q.y)) * n as f64 - vec2(0.437, 0.391));
        let (lo, hi) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        let range =
            |a: f64, b: f64| (a.ceil().max(0.0) as usize)..((b.floor() + 1.0).max(0.0) as usize).min(n);
        for y in range(lo.y, hi.y) {
            for x in range(lo.x, hi.x) {
                let q = vec2(x as f64, y as f64);
                // Distance to each side, at least a little inside; either turn counts.
                let inside = |sign: f64| {
                    (0..3).all(|k| {
                        let (a, b) = (p[k], p[(k + 1) % 3]);
                        let d = b - a;
                        sign * (d.x * (q.y - a.y) - d.y * (q.x - a.x)) > 1e-3 * d.length()
                    })
                };
                if !(inside(1.0) || inside(-1.0)) {
                    continue;
                }
                if let Some(other) = owner[y * n + x].replace(t) {
                    return Err(format!("texel sample ({x}, {y}) lies in triangles {other} and {t}"));
                }
            }
        }
    }
    Ok(())
}
