//! Borders and vertices that stay where they are.

use super::*;

/// Positions on open borders, as sorted bits.
fn loops(mesh: &Mesh) -> Vec<[u32; 3]> {
    let weld = crate::weld::weld_exact(&mesh.positions);
    let positions = weld.pick(&mesh.positions);
    let triangles = weld.triangles(&mesh.triangles);
    let mut edges: Vec<[u32; 2]> = triangles
        .iter()
        .flat_map(|t| (0..3).map(|k| [t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])]))
        .collect();
    edges.sort_unstable();
    let open = edges.chunk_by(|a, b| a == b).filter(|run| run.len() == 1).flat_map(|run| run[0]);
    let mut bits: Vec<[u32; 3]> = open.map(|v| positions[v as usize].to_array().map(f32::to_bits)).collect();
    bits.sort_unstable();
    bits.dedup();
    bits
}

#[test]
fn locked_borders_stay_to_the_bit_under_any_budget() {
    let mut mesh = grid(20, |x, y| 0.1 * (6.0 * x).sin() * (5.0 * y).cos());
    // A small open part that would be dropped first, and a closed one.
    let uvs = mesh.uvs.clone();
    append(&mut mesh, &grid(3, |_, _| 0.0), vec3(0.02, 0.02, 0.02), vec3(2.0, 0.0, 0.0));
    append(&mut mesh, &sphere(4), vec3(0.2, 0.2, 0.2), vec3(0.5, 0.5, 1.0));
    mesh.uvs = uvs.into_iter().chain(std::iter::repeat(vec2(0.0, 0.0))).take(mesh.positions.len()).collect();
    let before = loops(&mesh);
    assert_eq!(before.len(), 80 + 12);
    for keep_uvs in [false, true] {
        for budget in [500, 20, 1] {
            let options = Options { lock_border: true, keep_uvs, ..Options::new(Target::Triangles(budget)) };
            let d = decimate(&mesh, &[], &[], &options).expect("valid");
            let after = loops(&d.mesh);
            let gone = before.iter().filter(|p| after.binary_search(p).is_err()).count();
            assert_eq!(gone, 0, "budget {budget}, uvs {keep_uvs}");
            let locked = d.mesh.positions.iter().zip(&d.locked).filter(|(_, l)| **l);
            let mut locked: Vec<_> = locked.map(|(p, _)| p.to_array().map(f32::to_bits)).collect();
            locked.sort_unstable();
            locked.dedup();
            assert_eq!(locked, before, "what is told to be locked is the border");
            // A disc of n border vertices has n - 2 triangles at least.
            let least = 78 + 10;
            assert!(d.mesh.triangles.len() <= budget.max(least + 30), "{}", d.mesh.triangles.len());
        }
    }
    assert!(to(&mesh, 20, |_| {}).locked.is_empty());
}

#[test]
fn halves_with_locked_borders_meet() {
    let whole = grid(24, |x, y| 0.1 * (9.0 * x).sin() * (7.0 * y).cos());
    let side = |left: bool| {
        let is_left = |t: &[u32; 3]| t.iter().map(|i| whole.positions[*i as usize].x).sum::<f32>() < 1.5;
        let triangles = whole.triangles.iter().filter(|t| is_left(t) == left).copied().collect();
        Mesh { triangles, ..whole.clone() }
    };
    // Through the same sums as the halves: they turn -0 into 0.
    let (mut all, mut both) = (Mesh::default(), Mesh::default());
    append(&mut all, &whole, vec3(1.0, 1.0, 1.0), vec3(0.0, 0.0, 0.0));
    for left in [true, false] {
        let d = to(&side(left), 200, |o| o.lock_border = true).mesh;
        append(&mut both, &d, vec3(1.0, 1.0, 1.0), vec3(0.0, 0.0, 0.0));
    }
    assert!(both.triangles.len() < whole.triangles.len() / 2);
    assert_eq!(loops(&both), loops(&all), "no open border between the halves");
}

#[test]
fn locked_vertices_stay_to_the_bit_under_any_budget() {
    let mut mesh = grid(20, |x, y| 0.1 * (6.0 * x).sin() * (5.0 * y).cos());
    append(&mut mesh, &sphere(4), vec3(0.2, 0.2, 0.2), vec3(0.5, 0.5, 1.0));
    mesh.uvs.resize(mesh.positions.len(), vec2(0.0, 0.0));
    let corner = mesh.triangles[0][0] as usize;
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v == corner || v % 37 == 5).collect();
    let bits = |p: &Vec3f| p.to_array().map(f32::to_bits);
    let wanted: std::collections::BTreeSet<_> =
        mesh.positions.iter().zip(&locked).filter(|(_, l)| **l).map(|(p, _)| bits(p)).collect();
    // Nothing of the sphere is seen, but what is locked is not dropped.
    let of_grid = 2 * 20 * 20;
    let seen: Vec<f32> = (0..mesh.triangles.len()).map(|t| if t < of_grid { 1.0 } else { 0.0 }).collect();
    for keep_uvs in [false, true] {
        for budget in [500, 60, 1] {
            let how = Options { locked: locked.clone(), keep_uvs, ..Options::new(Target::Triangles(budget)) };
            let d = decimate(&mesh, &[], &seen, &how).expect("valid");
            let used: std::collections::BTreeSet<u32> = d.mesh.triangles.iter().flatten().copied().collect();
            let told = d.mesh.positions.iter().zip(&d.locked).enumerate();
            let told: std::collections::BTreeSet<_> = told
                .filter(|(v, (_, l))| **l && used.contains(&(*v as u32)))
                .map(|(_, (p, _))| bits(p))
                .collect();
            assert_eq!(told, wanted, "budget {budget}, uvs {keep_uvs}");
            assert!(d.mesh.triangles.len() <= budget.max(4 * wanted.len()), "{}", d.mesh.triangles.len());
        }
    }
    let short = Options { locked: vec![true], ..Options::new(Target::Triangles(1)) };
    let refused = decimate(&mesh, &[], &[], &short);
    assert!(matches!(refused, Err(DecimateError::Length { name: "locked", found: 1, .. })), "{refused:?}");
}

#[test]
fn a_locked_vertex_keeps_a_triangle_that_hangs_at_another_vertex() {
    let mut mesh = grid(8, |_, _| 0.0);
    mesh.uvs.clear();
    let base = mesh.positions.len() as u32;
    let w = mesh.positions[40];
    mesh.positions.extend([w + vec3(0.0, 0.0, 0.4), w + vec3(0.05, 0.0, 0.4)]);
    mesh.triangles.push([40, base, base + 1]);
    for end in [base, base + 1] {
        let locked = (0..mesh.positions.len() as u32).map(|v| v == end).collect();
        let how = Options { locked, ..Options::new(Target::Triangles(1)) };
        let d = decimate(&mesh, &[], &[], &how).expect("valid");
        let at = mesh.positions[end as usize];
        assert!(d.mesh.triangles.iter().flatten().any(|v| d.mesh.positions[*v as usize] == at), "{end}");
    }
}

#[test]
fn of_welded_vertices_the_locked_one_gives_the_position() {
    let mut mesh = grid(8, |_, _| 0.0);
    mesh.uvs.clear();
    // A seam of two vertices that differ by rounding.
    let (at, near) = (40, mesh.positions.len() as u32);
    let moved = mesh.positions[at] + vec3(1e-7, 0.0, 0.0);
    assert_ne!(moved, mesh.positions[at]);
    mesh.positions.push(moved);
    let first = mesh.triangles.iter_mut().rev().find(|t| t.contains(&(at as u32))).unwrap();
    first.iter_mut().filter(|v| **v == at as u32).for_each(|v| *v = near);
    for locked in [at as u32, near] {
        let d = to(&mesh, 10, |o| o.locked = (0..=near).map(|v| v == locked).collect());
        let wanted = mesh.positions[locked as usize];
        let all: Vec<Vec3f> =
            d.mesh.triangles.iter().flatten().map(|v| d.mesh.positions[*v as usize]).collect();
        assert!(all.contains(&wanted), "{locked}");
        assert!(all.iter().all(|p| *p == wanted || (*p - wanted).length() > 1e-6), "{locked}: they are one");
    }
}

#[test]
fn what_is_not_locked_keeps_half_of_its_share() {
    // Of a locked plane nothing may go; the ball beside it is a third of the triangles.
    let mut mesh = grid(20, |_, _| 0.0);
    mesh.uvs.clear();
    let plane = (mesh.positions.len(), mesh.triangles.len());
    append(&mut mesh, &sphere(6), vec3(0.2, 0.2, 0.2), vec3(0.5, 0.5, 1.0));
    let all = mesh.triangles.len();
    let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v < plane.0).collect();
    let made = |budget: usize| {
        let how = Options { locked: locked.clone(), ..Options::new(Target::Triangles(budget)) };
        decimate(&mesh, &[], &[], &how).expect("valid").mesh.triangles.len()
    };
    for budget in [1, 300, plane.1, plane.1 + 2] {
        let rest = made(budget) - plane.1;
        let share = (all - plane.1) as f64 * budget as f64 / all as f64;
        assert!((rest as f64 - (0.5 * share).ceil()).abs() <= 2.0, "{budget}: {rest} of a share of {share}");
    }
    // With enough room a budget is what it says.
    let budget = plane.1 + (all - plane.1) * 3 / 4;
    assert!((budget - 2..=budget).contains(&made(budget)), "{} of {budget}", made(budget));
}
