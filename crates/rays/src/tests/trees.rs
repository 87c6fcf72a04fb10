//! The tree itself: complete, tight, of bounded depth, the same for any number of threads.

use super::super::wide::{LEAF, Node, WIDTH};
use super::{Random, Soup, bumpy_sphere, soup};
use crate::{Accel, Builder, Ray};
use photofit_scalar::{Vec3f, vec3};

/// Checks that every triangle is in the tree once and within the boxes above it; depth and packets of the tree.
fn check(mesh: &Soup) -> (usize, usize) {
    check_with(mesh, Builder::Binned)
}

fn check_with((positions, triangles): &Soup, builder: Builder) -> (usize, usize) {
    let accel = Accel::build_with(positions, triangles, builder).unwrap();
    let mut seen = vec![0; triangles.len()];
    let mut deepest = 0;
    let mut work = vec![(0, 1, [f32::NEG_INFINITY; 3], [f32::INFINITY; 3])];
    while let Some((at, depth, lo, hi)) = work.pop() {
        deepest = depth.max(deepest);
        let node: &Node = &accel.nodes[at as usize];
        let all: Vec<[[f32; WIDTH]; 2]> = (0..3).map(|k| node.planes[k].map(|p| p.to_array())).collect();
        for lane in 0..WIDTH {
            let corner = |side: usize| -> [f32; 3] { std::array::from_fn(|k| all[k][side][lane]) };
            let (child_lo, child_hi) = (corner(0), corner(1));
            if node.child[lane] == u32::MAX {
                assert!(child_lo == [f32::INFINITY; 3] && child_hi == [f32::NEG_INFINITY; 3], "an empty box");
                continue;
            }
            let within =
                |p: [f32; 3], lo: [f32; 3], hi: [f32; 3]| (0..3).all(|k| p[k] >= lo[k] && p[k] <= hi[k]);
            assert!(within(child_lo, lo, hi) && within(child_hi, lo, hi), "a box leaves that of its parent");
            if node.child[lane] & LEAF == 0 {
                work.push((node.child[lane], depth + 1, child_lo, child_hi));
                continue;
            }
            let packet = &accel.packets[(node.child[lane] & !LEAF) as usize];
            assert!(packet.count() > 0, "a leaf holds something");
            for i in 0..packet.count() {
                seen[packet.ids[i] as usize] += 1;
                let inside = packet.triangle(i).iter().all(|p| within(p.to_array(), child_lo, child_hi));
                assert!(inside, "a triangle leaves its box");
            }
        }
    }
    assert!(seen.iter().all(|&n| n == 1), "every triangle is in one leaf");
    (deepest, accel.packets.len())
}

#[test]
fn trees_are_complete_and_leaves_are_full() {
    let mut random = Random(21);
    for count in (1..40).chain([100, 1000, 9000]) {
        let (depth, packets) = check(&soup(count, 0.05, &mut random));
        assert!(packets >= count.div_ceil(4) && packets <= count.div_ceil(2), "{count}: {packets} packets");
        assert!(depth <= 2 + count.ilog2() as usize / 2, "{count}: depth {depth}");
    }
    let sphere = bumpy_sphere(64);
    let (_, packets) = check(&sphere);
    assert!(packets * 3 < sphere.1.len(), "{packets} packets for {} triangles", sphere.1.len());
}

/// Small triangles around points.
fn around(centers: impl Iterator<Item = (Vec3f, f32)>) -> Soup {
    let corners = [vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.3), vec3(-1.0, -1.0, 0.0)];
    let positions: Vec<Vec3f> = centers.flat_map(|(c, size)| corners.map(|p| c + p * size)).collect();
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    (positions, triangles)
}

#[test]
fn no_input_makes_a_deep_tree() {
    // The same triangle many times: full leaves, halved again and again.
    let n = 40_000_u32;
    let (depth, packets) = check(&(bumpy_sphere(4).0, vec![[0, 1, 2]; n as usize]));
    assert!(depth <= 12 && packets <= n as usize / 2, "depth {depth}, {packets} packets");
    // One around the other, one beside the other at ever smaller distances, points on a line, points of one place.
    let step = |i: u32| 0.999_f32.powi(i as i32 % 20_000);
    let shells = around((0..n).map(|i| (Vec3f::zero(), step(i))));
    let cascade = around((0..n).map(|i| (vec3(step(i), 0.0, 0.0), 1e-3 * step(i))));
    let towards = around((0..n).map(|i| (vec3(step(i), step(i), 1.0) * 0.5, step(i))));
    let points = around((0..n).map(|i| (vec3(i as f32, 0.0, 0.0), 0.0)));
    let place = around((0..n).map(|_| (vec3(1.0, 2.0, 3.0), 0.0)));
    for mesh in [shells, cascade, towards, points, place] {
        let (depth, _) = check(&mesh);
        assert!(depth <= 56 + 16, "depth {depth}");
    }
}

#[test]
fn clustered_trees_are_complete_and_answer_the_same() {
    let mut random = Random(23);
    let mut meshes: Vec<Soup> =
        [1, 2, 3, 4, 5, 9, 33, 1000].map(|count| soup(count, 0.05, &mut random)).into();
    meshes.push(bumpy_sphere(40));
    // Degenerate: all in one place, and ever smaller around a point.
    meshes.push((bumpy_sphere(4).0, vec![[0, 1, 2]; 3000]));
    meshes.push(around((0..5000).map(|i| (Vec3f::zero(), 0.99_f32.powi(i % 2000)))));
    for mesh in &meshes {
        let binned = Accel::build(&mesh.0, &mesh.1).unwrap();
        for builder in [Builder::Clustered, Builder::Reinserted] {
            let (depth, packets) = check_with(mesh, builder);
            assert!(depth <= 120 && packets <= mesh.1.len(), "{builder:?}: depth {depth}, {packets} packets");
            let other = Accel::build_with(&mesh.0, &mesh.1, builder).unwrap();
            for _ in 0..500 {
                let origin = random.point(2.0);
                let ray = Ray::new(origin, random.point(0.7) - origin);
                assert_eq!(other.closest_hit(&ray), binned.closest_hit(&ray), "{builder:?}");
                assert_eq!(other.occluded(&ray), binned.occluded(&ray), "{builder:?}");
                let p = random.point(1.5);
                assert_eq!(other.closest_point(p, 1e9), binned.closest_point(p, 1e9), "{builder:?}");
            }
        }
    }
}

#[test]
fn a_deep_tree_is_walked() {
    // Rays along the axis of nested shells pass all boxes.
    let n = 3000;
    let (positions, triangles) = around((0..n).map(|i| (Vec3f::zero(), 0.99_f32.powi(i % 1500))));
    let accel = Accel::build(&positions, &triangles).unwrap();
    let ray = Ray::new(vec3(0.0, 0.0, 5.0), vec3(0.0, 0.0, -1.0));
    let mut hits = 0;
    accel.for_each_hit(&ray, |_| hits += 1);
    assert_eq!(hits, n);
    let nearest = accel.closest_hit(&ray).unwrap();
    accel.for_each_hit(&ray, |hit| assert!(hit.t >= nearest.t, "{hit:?} against {nearest:?}"));
}

#[test]
fn trees_do_not_depend_on_threads() {
    // Large enough for sets that are counted in parallel.
    let mesh = soup(140_000, 0.02, &mut Random(22));
    for builder in [Builder::Binned, Builder::Clustered, Builder::Reinserted] {
        do_not_depend_on_threads(&mesh, builder);
    }
}

fn do_not_depend_on_threads(mesh: &Soup, builder: Builder) {
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Accel::build_with(&mesh.0, &mesh.1, builder).unwrap())
    };
    let (one, three) = (build(1), build(3));
    assert!(one.nodes.len() == three.nodes.len() && one.packets.len() == three.packets.len());
    let same = |(a, b): (&Node, &Node)| {
        let bits =
            |n: &Node| n.planes.as_flattened().iter().flat_map(|p| p.to_array()).map(f32::to_bits).collect();
        let (x, y): (Vec<u32>, Vec<u32>) = (bits(a), bits(b));
        x == y && a.child == b.child
    };
    assert!(one.nodes.iter().zip(&*three.nodes).all(same), "{builder:?}: nodes differ");
    assert!(
        one.packets.iter().zip(&*three.packets).all(|(a, b)| a.ids == b.ids),
        "{builder:?}: leaves differ"
    );
}

#[test]
fn the_cost_of_a_tree_counts_what_lines_meet() {
    let corners = vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 1.0)];
    let one = Accel::build(&corners, &[[0, 1, 2]]).unwrap();
    assert_eq!(one.cost(), [1.0, 1.0], "the root and its only leaf fill the box");
    let (positions, triangles) = bumpy_sphere(64);
    let cost = |builder| Accel::build_with(&positions, &triangles, builder).unwrap().cost();
    let [binned, clustered, reinserted] =
        [Builder::Binned, Builder::Clustered, Builder::Reinserted].map(cost);
    assert!(reinserted[0] < 0.99 * clustered[0], "reinsertion improves: {reinserted:?} {clustered:?}");
    assert!(binned[0] < reinserted[0] && binned[1] < reinserted[1], "{binned:?} {reinserted:?}");
}
