//! Cutting polygons into triangles.

use photofit_scalar::{Vec3, Vec3f, vec3};

/// Polygons with more corners are cut as fans, so that no file costs quadratic time.
const MOST_CORNERS: usize = 32;

/// Cuts the polygon with these corners into `corners.len() - 2` triangles of indices into `corners`.
///
/// Convex polygons become fans; others are cut ear by ear in the plane of their mean (Newell) normal.
pub(crate) fn triangulate(corners: &[Vec3f], out: &mut Vec<[usize; 3]>) {
    let n = corners.len();
    let fan = |out: &mut Vec<[usize; 3]>| out.extend((2..n).map(|k| [0, k - 1, k]));
    if !(4..=MOST_CORNERS).contains(&n) {
        return fan(out);
    }
    let p: Vec<Vec3<f64>> = corners.iter().map(|p| p.cast()).collect();
    let mut normal = vec3(0.0, 0.0, 0.0);
    for k in 0..n {
        normal += (p[k] - p[0]).cross(p[(k + 1) % n] - p[0]);
    }
    let turn = |a: usize, b: usize, c: usize| (p[b] - p[a]).cross(p[c] - p[b]).dot(normal);
    if (0..n).all(|k| turn(k, (k + 1) % n, (k + 2) % n) >= 0.0) {
        return fan(out);
    }
    let mut rest: Vec<usize> = (0..n).collect();
    while rest.len() > 3 {
        let m = rest.len();
        let inside = |q: usize, [a, b, c]: [usize; 3]| {
            turn(a, b, q) >= 0.0 && turn(b, c, q) >= 0.0 && turn(c, a, q) >= 0.0
        };
        let corner = |k: usize| [rest[(k + m - 1) % m], rest[k], rest[(k + 1) % m]];
        let ear = (0..m).find(|&k| {
            let t = corner(k);
            turn(t[0], t[1], t[2]) > 0.0 && !rest.iter().any(|q| !t.contains(q) && inside(*q, t))
        });
        // A polygon that crosses itself may have no ear: any corner goes.
        let k = ear.unwrap_or(0);
        out.push(corner(k));
        rest.remove(k);
    }
    out.push([rest[0], rest[1], rest[2]]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Vec3f]) -> f32 {
        let mut out = Vec::new();
        triangulate(corners, &mut out);
        assert_eq!(out.len(), corners.len() - 2, "{corners:?}");
        out.iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| corners[i]);
                0.5 * (b - a).cross(c - a).z
            })
            .sum()
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        let arrow = [vec3(0.0, 0.0, 0.0), vec3(2.0, -1.0, 0.0), vec3(0.5, 0.0, 0.0), vec3(2.0, 1.0, 0.0)];
        for turn in 0..4 {
            let mut turned = arrow;
            turned.rotate_left(turn);
            let mut out = Vec::new();
            triangulate(&turned, &mut out);
            for t in &out {
                let [a, b, c] = t.map(|i| turned[i]);
                assert!((b - a).cross(c - a).z > 0.0, "turned by {turn}: {t:?} faces forward");
            }
            assert!((area(&turned) - 0.5).abs() < 1e-6, "turned by {turn}");
        }
    }

    #[test]
    fn degenerate_polygons_still_give_all_triangles() {
        area(&[vec3(0.0, 0.0, 0.0); 5]);
        area(&[vec3(0.0, 0.0, 0.0), vec3(1.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)]);
        let many: Vec<Vec3f> = (0..1000).map(|k| vec3((k as f32).cos(), (k as f32).sin(), 0.0)).collect();
        area(&many);
    }
}
