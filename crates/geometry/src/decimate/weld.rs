//! Welding of vertices by position.

use super::components::Sets;
use glam::DVec3;

/// Longest run of candidates looked at per vertex; bounds the time on crowded inputs.
const CANDIDATES: usize = 32;

/// Maps every vertex to a representative with the same position, or one within `tolerance`; returns the map to
/// compact indices and the number of distinct vertices.
///
/// The compact index order is that of the first vertex of each class.
pub(super) fn weld(positions: &[DVec3], tolerance: f64) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(positions.len());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    let bits = |i: u32| positions[i as usize].to_array().map(|x| (x + 0.0).to_bits());
    order.sort_unstable_by_key(|&i| (bits(i), i));
    for pair in order.windows(2) {
        if bits(pair[0]) == bits(pair[1]) {
            sets.join(pair[0], pair[1]);
        }
    }
    if tolerance > 0.0 {
        order.dedup_by_key(|i| bits(*i));
        join_near(positions, tolerance, &mut order, &mut sets);
    }
    sets.compact()
}

/// Joins vertices closer than `tolerance`, found through a grid of cells sorted by their index.
fn join_near(positions: &[DVec3], tolerance: f64, order: &mut [u32], sets: &mut Sets) {
    let cell = 64.0 * tolerance;
    let origin = positions.iter().fold(DVec3::INFINITY, |a, &p| a.min(p)) - cell;
    // A tiny tolerance must not overflow the 21 bits per axis; coarser cells are only slower.
    let extent = positions.iter().fold(0.0_f64, |a, &p| a.max((p - origin).max_element()));
    let cell = cell.max(extent / 2e6);
    let key = |p: DVec3| {
        let c = ((p - origin) / cell).max(DVec3::ZERO);
        ((c.x as u64) << 42) | ((c.y as u64) << 21) | (c.z as u64)
    };
    order.sort_unstable_by_key(|&i| (key(positions[i as usize]), i));
    let keys: Vec<u64> = order.iter().map(|&i| key(positions[i as usize])).collect();
    for (k, &i) in order.iter().enumerate() {
        let p = positions[i as usize];
        let (lo, hi) = (key(p - tolerance), key(p + tolerance));
        let end = (k + 1 + CANDIDATES).min(order.len());
        for (j, &other) in order.iter().enumerate().take(end).skip(k + 1) {
            if keys[j] != keys[k] {
                break;
            }
            if positions[other as usize].distance_squared(p) <= tolerance * tolerance {
                sets.join(i, other);
            }
        }
        if lo == hi {
            continue;
        }
        for corner in 0..8 {
            let d = DVec3::select(
                glam::BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0),
                DVec3::splat(tolerance),
                DVec3::splat(-tolerance),
            );
            let other = key(p + d);
            if other == keys[k] {
                continue;
            }
            let start = keys.partition_point(|&x| x < other);
            for j in start..(start + CANDIDATES).min(order.len()) {
                if keys[j] != other {
                    break;
                }
                if positions[order[j] as usize].distance_squared(p) <= tolerance * tolerance {
                    sets.join(i, order[j]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn welds_equal_and_near_positions_only() {
        let p = |x: f64| DVec3::new(x, 0.5, -x);
        let points =
            [p(0.0), p(1.0), p(0.0), p(1.0 + 1e-7), p(0.5), DVec3::new(-0.0, 0.5, 0.0), p(1.0 + 1e-3)];
        let (map, n) = weld(&points, 1e-6);
        assert_eq!(map, [0, 1, 0, 1, 2, 0, 3]);
        assert_eq!(n, 4);
        assert_eq!(weld(&points, 0.0).1, 5, "exact welding keeps the near pair apart");
    }

    #[test]
    fn near_pairs_across_cell_borders_are_found() {
        let mut points = Vec::new();
        for i in 0..2000 {
            let x = f64::from(i) * 3.21e-5;
            points.push(DVec3::new(x, 2.0 * x, -x));
            points.push(DVec3::new(x + 4e-7, 2.0 * x - 4e-7, -x + 3e-7));
        }
        assert_eq!(weld(&points, 1e-6).1, 2000);
    }
}
