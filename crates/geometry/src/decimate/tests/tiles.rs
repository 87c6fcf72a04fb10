//! Texture coordinates that lie in one tile of the texture stay there.

use super::super::*;
use super::grid;
use photofit_scalar::{Vec2f, vec2, vec3};

/// A bumpy disc whose coordinates touch the unit square's border all around, at curved edges, and are mapped then.
fn disc(x_shift: f32, uv: impl Fn(f32, f32) -> Vec2f) -> Mesh {
    let mut mesh = grid(24, |x, y| 0.08 * (9.0 * x).sin() * (7.0 * y).cos());
    for (p, to) in mesh.positions.iter_mut().zip(&mut mesh.uvs) {
        let (x, y) = (2.0 * p.x - 1.0, 2.0 * p.y - 1.0);
        let (x, y) = (x * (1.0 - 0.5 * y * y).sqrt(), y * (1.0 - 0.5 * x * x).sqrt());
        (p.x, p.y) = (x + x_shift, y);
        *to = uv(0.5 + 0.5 * x, 0.5 + 0.5 * y);
    }
    mesh
}

/// Both in one mesh, each a group.
fn side_by_side(mut mesh: Mesh, second: &Mesh) -> (Mesh, Vec<u32>) {
    let (count, base) = (mesh.triangles.len(), mesh.positions.len() as u32);
    mesh.positions.extend(&second.positions);
    mesh.uvs.extend(&second.uvs);
    mesh.triangles.extend(second.triangles.iter().map(|t| t.map(|v| v + base)));
    let group = (0..mesh.triangles.len()).map(|t| u32::from(t >= count)).collect();
    (mesh, group)
}

/// Least and most of the coordinates of a group.
fn reach(mesh: &Mesh, group: &[u32], g: u32) -> [[f32; 2]; 2] {
    let of = (0..mesh.triangles.len()).filter(|t| group[*t] == g).flat_map(|t| mesh.triangles[t]);
    of.map(|v| mesh.uvs[v as usize]).fold([[f32::INFINITY, f32::NEG_INFINITY]; 2], |reach, uv| {
        [[reach[0][0].min(uv.x), reach[0][1].max(uv.x)], [reach[1][0].min(uv.y), reach[1][1].max(uv.y)]]
    })
}

fn lies_in(reach: [f32; 2], least: f32, most: f32) -> bool {
    reach[0] >= least && reach[1] <= most
}

/// Decimates to ever fewer triangles.
fn each(mesh: &Mesh, group: &[u32], check: impl Fn(usize, &Mesh, &[u32])) {
    for n in [900, 300, 100, 40] {
        let options = Options { keep_uvs: true, ..Options::new(Target::Triangles(n)) };
        let d = decimate(mesh, group, &[], &options).unwrap();
        check(n, &d.mesh, &d.group);
    }
}

#[test]
fn uvs_of_a_group_that_lie_in_the_unit_square_stay_there() {
    let (mesh, group) = side_by_side(disc(0.0, vec2), &disc(3.0, |u, v| vec2(3.0 * u, v)));
    each(&mesh, &group, |n, mesh, group| {
        let [u, v] = reach(mesh, group, 0);
        assert!(lies_in(u, 0.0, 1.0) && lies_in(v, 0.0, 1.0), "{n} triangles: {u:?} {v:?}");
        let [u, v] = reach(mesh, group, 1);
        assert!(u[1] > 2.5 && lies_in(v, 0.0, 1.0), "{n} triangles: u is tiled, v is not: {u:?} {v:?}");
    });
}

#[test]
fn uvs_stay_in_any_tile_and_in_what_rounding_adds_to_it() {
    // Beside normals, whose negative parts nothing bounds; u starts a hair before its tile, v lies in the second one.
    let second = disc(0.0, |u, v| vec2(u - 9.6e-9, 1.0006 + 0.9981 * v));
    let over = disc(3.0, |u, v| vec2(3.0 * u - 1.0, 1.00065 * v));
    let (mut mesh, group) = side_by_side(second, &over);
    mesh.normals = vec![vec3(-0.6, 0.0, 0.8); mesh.positions.len()];
    let given = reach(&mesh, &group, 0)[0];
    assert!(given[0] < 0.0);
    let most = reach(&mesh, &group, 1)[1][1];
    assert!(most > 1.0);
    each(&mesh, &group, |n, mesh, group| {
        let [u, v] = reach(mesh, group, 0);
        assert!(lies_in(u, given[0], 1.0) && lies_in(v, 1.0, 2.0), "{n} triangles: {u:?} {v:?}");
        let [u, v] = reach(mesh, group, 1);
        assert!(u[1] > 1.5 && lies_in(v, 0.0, most), "{n} triangles: u is tiled, v is not: {u:?} {v:?}");
        assert!(mesh.normals.iter().all(|n| (*n - vec3(-0.6, 0.0, 0.8)).length() < 1e-3));
    });
}

#[test]
fn tiles_are_those_that_coordinates_need() {
    use super::super::wedge::tile;
    let free = [f64::NEG_INFINITY, f64::INFINITY];
    assert_eq!(tile([0.2, 0.7], 1.0), [0.0, 1.0]);
    assert_eq!(tile([-0.7, -0.2], 1.0), [-1.0, 0.0]);
    assert_eq!(tile([2.0012, 3.9974], 2.0), [2.0, 4.0], "the second tile, scaled");
    assert_eq!(tile([0.0, 1.000_65], 1.0), [0.0, 1.000_65]);
    assert_eq!(tile([-9.6e-9, 0.5], 1.0), [-9.6e-9, 1.0]);
    assert_eq!(tile([0.5, 1.5], 1.0), free, "two tiles");
    assert_eq!(tile([0.0, 1.01], 1.0), free, "more than rounding");
}
