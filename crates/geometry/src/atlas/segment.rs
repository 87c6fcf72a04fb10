//! Charts of a mesh: first patches, each flattened or cut until it can be, then joined where the rules allow it.

use super::chart::{Chart, Places};
use super::cluster::cluster;
use super::cut::{bisect, components, sew_inside};
use super::flatten::{flatten, polish, project};
use super::join::Joiner;
use super::topology::{NONE, Topology};
use rayon::prelude::*;

/// The charts of all non-degenerate triangles, in the order of their first triangle; `bound` is the largest stretch.
pub(super) fn charts(topo: &Topology, bound: f64) -> Vec<Chart> {
    let mut sewn = vec![false; topo.opposite.len()];
    let flat = initial(topo, bound, &mut sewn);
    let mut charts = Joiner::new(topo, bound, flat, sewn).run();
    charts.par_iter_mut().for_each(|c| polish(c, topo, bound));
    charts.sort_by_key(|c| c.triangles.iter().copied().min());
    charts
}

/// Patches of the first segmentation, flattened; a patch that cannot be flattened is cut in two and tried again.
fn initial(topo: &Topology, bound: f64, sewn: &mut [bool]) -> Vec<Chart> {
    let (label, count) = cluster(topo);
    let total: f64 = (0..label.len() as u32).map(|t| topo.area(t)).sum();
    let mut parts = vec![Vec::new(); count as usize];
    for (t, &l) in label.iter().enumerate() {
        if l != NONE {
            parts[l as usize].push(t as u32);
        }
    }
    let mut places = Places::new(label.len());
    let mut member = vec![NONE; label.len()];
    let mut done = Vec::new();
    while !parts.is_empty() {
        let mut tried: Vec<Chart> = parts
            .drain(..)
            .map(|triangles| {
                sew_inside(topo, &triangles, sewn, &mut member);
                Chart::build(topo, triangles, sewn, &mut places)
            })
            .collect();
        let fine: Vec<bool> = tried
            .par_iter_mut()
            .map(|c| {
                project(c, topo);
                flatten(c, topo, bound, 8) && !is_long(c, total)
            })
            .collect();
        for (c, fine) in tried.into_iter().zip(fine) {
            if fine || c.triangles.len() == 1 {
                done.push(c);
                continue;
            }
            for &t in &c.triangles {
                (0..3).for_each(|e| sewn[(3 * t + e) as usize] = false);
            }
            let (a, b) = bisect(topo, &c.triangles, &mut member);
            for part in [a, b] {
                parts.extend(components(topo, &part, &mut member));
            }
        }
    }
    done
}

/// True for a chart that is too long to pack well.
fn is_long(chart: &Chart, total: f64) -> bool {
    let fill = chart.fill();
    let edges = chart.corners.iter().flat_map(|c| (0..3).map(move |k| (c[k], c[(k + 1) % 3])));
    let edge = edges.map(|(a, b)| (chart.uv[a as usize] - chart.uv[b as usize]).length()).fold(0.0, f64::max);
    // Cutting between long triangles would shorten nothing.
    fill.long > (fill.max_length() * total.sqrt()).max(1.5 * edge)
}
