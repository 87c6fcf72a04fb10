//! Least-squares refit of the vertex attributes to the input surface after the last move of a vertex.
//!
//! The collapses choose attributes for the place that a vertex has then; refinement moves it and flips change what is
//! interpolated. Here the interpolated attributes meet those of samples of the input surface in the sense of least
//! squares, where triangles stay as they are.

use super::engine::Engine;
use super::refine::{Original, Sample};
use super::topology::NONE;
use super::wedge::Wedges;
use crate::VertexFit;
use std::ops::Range;

/// Weight of the present value of a wedge against its samples, in shares of the mean of what samples weigh at a wedge.
const MEMORY: f64 = 0.02;
/// Conjugate gradient steps at most, and the share of the right side at which the residual ends them.
const STEPS: usize = 40;
const ENOUGH: f64 = 1e-5;
/// Cosine between normals of a sample and of its place below which they belong to two sides of an edge.
const SAME_SIDE: f64 = 0.5;
/// Samples whose texture coordinates are farther off than so many times the median, and than this share of the triangle's, belong to
/// another chart.
const SAME_CHART: f64 = 4.0;
const SHARE_OF_TRIANGLE: f64 = 0.25;
/// Wedges of a vertex whose values differ by a squared distance below this share of their squared length change as one, so that no
/// seam of texture coordinates is seen in the shading: normals of 18 degrees.
const ALIKE: f64 = 0.1;
/// Weight of the present value in samples, at least: where there are few, none decides alone.
const LEAST_MEMORY: f64 = 0.5;

/// Attributes of the input surface, `width` per wedge, and the wedge of each corner.
#[derive(Debug)]
pub(super) struct Attributes {
    pub(super) width: usize,
    pub(super) values: Vec<f64>,
    pub(super) corners: Vec<[u32; 3]>,
}

impl Attributes {
    /// Value `j` at a sample.
    fn at(&self, s: &Sample, j: usize) -> f64 {
        let [u, v] = s.within;
        let of = self.corners[s.source as usize].map(|w| self.values[w as usize * self.width + j]);
        of[0] * (1.0 - u - v) + of[1] * u + of[2] * v
    }
}

/// Fits the attributes of all wedges but those of vertices that stay; texture coordinates of seams keep theirs. `samples` are in place.
pub(super) fn refit(engine: &mut Engine<'_>, original: &Original, samples: &[Sample]) {
    let Some(input) = &original.attributes else { return };
    let Some(mut wedges) = engine.wedges.take() else { return };
    let of_vertices = of_vertices(engine, &wedges);
    for (block, coordinates) in wedges.blocks() {
        let terms = terms(engine, &wedges, input, samples, &block, coordinates);
        let moves_as = moves_as(engine, &of_vertices, &wedges, &block, coordinates);
        fit(&mut wedges, input, &terms, &moves_as, &block);
    }
    engine.wedges = Some(wedges);
}

/// Each vertex with each of its wedges, sorted.
fn of_vertices(engine: &Engine<'_>, wedges: &Wedges) -> Vec<(u32, u32)> {
    let live = (0..engine.topology.triangles.len()).filter(|t| engine.topology.is_live(*t as u32));
    let corners = live.flat_map(|t| (0..3).map(move |k| (t, k)));
    let mut out: Vec<(u32, u32)> =
        corners.map(|(t, k)| (engine.topology.triangles[t][k], wedges.corners[t][k])).collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// The wedge that each one changes with, or [`NONE`] where it stays: the first of its vertex that is alike; itself, where it is the only one,
/// for texture coordinates.
fn moves_as(
    engine: &Engine<'_>,
    of_vertices: &[(u32, u32)],
    wedges: &Wedges,
    block: &Range<usize>,
    coordinates: bool,
) -> Vec<u32> {
    let are_alike = |a: u32, b: u32| {
        let [mut away, mut length] = [0.0; 2];
        for j in block.clone() {
            let (x, y) = (wedges.value(a, j), wedges.value(b, j));
            (away, length) = (away + (x - y).powi(2), length + 0.5 * (x * x + y * y));
        }
        away < ALIKE * length
    };
    let mut first = vec![NONE; wedges.values.len() / wedges.width];
    for same in of_vertices.chunk_by(|a, b| a.0 == b.0).filter(|same| !engine.fixed[same[0].0 as usize]) {
        if coordinates && same.len() > 1 {
            continue;
        }
        for (k, (_, wedge)) in same.iter().enumerate() {
            let mut before = same[..k].iter().map(|(_, w)| first[*w as usize]);
            first[*wedge as usize] = before.find(|w| are_alike(*w, *wedge)).unwrap_or(*wedge);
        }
    }
    first
}

/// Samples of one group with their place, whose attributes are of the same kind there: those of one side of an edge of normals, or of one chart.
fn terms<'a>(
    engine: &Engine<'_>,
    wedges: &Wedges,
    input: &Attributes,
    samples: &'a [Sample],
    block: &Range<usize>,
    coordinates: bool,
) -> Vec<(&'a Sample, [u32; 3])> {
    let place = |s: &Sample| wedges.corners[s.triangle as usize];
    let here = |s: &Sample, j: usize| (0..3).map(|k| s.at[k] * wedges.value(place(s)[k], j)).sum::<f64>();
    let same_group = |s: &&Sample| engine.group[s.source as usize] == engine.group[s.triangle as usize];
    let live = samples.iter().filter(|s| engine.topology.is_live(s.triangle)).filter(same_group);
    let mut terms: Vec<(&Sample, [u32; 3])> = live.map(|s| (s, place(s))).collect();
    if coordinates {
        let away =
            |s: &Sample| block.clone().map(|j| (here(s, j) - input.at(s, j)).powi(2)).sum::<f64>().sqrt();
        let mut all: Vec<f64> = terms.iter().map(|(s, _)| away(s)).collect();
        all.sort_unstable_by(f64::total_cmp);
        let most = SAME_CHART * all.get(all.len() / 2).copied().unwrap_or(0.0);
        let reach = |w: &[u32; 3]| {
            let between = |a: u32, b: u32| {
                block.clone().map(|j| (wedges.value(a, j) - wedges.value(b, j)).powi(2)).sum::<f64>().sqrt()
            };
            between(w[0], w[1]).max(between(w[1], w[2])).max(between(w[2], w[0]))
        };
        terms.retain(|(s, w)| away(s) <= most.max(SHARE_OF_TRIANGLE * reach(w)));
    } else if wedges.are_normals(block) {
        terms.retain(|(s, _)| {
            let [mut dot, mut a, mut b] = [0.0; 3];
            for j in block.clone() {
                let (x, y) = (here(s, j), input.at(s, j));
                (dot, a, b) = (dot + x * y, a + x * x, b + y * y);
            }
            dot > SAME_SIDE * (a * b).sqrt()
        });
    }
    terms
}

/// Fits one block of attributes.
fn fit(
    wedges: &mut Wedges,
    input: &Attributes,
    terms: &[(&Sample, [u32; 3])],
    moves_as: &[u32],
    block: &Range<usize>,
) {
    let mut number = vec![NONE; moves_as.len()];
    let mut unknowns = 0;
    for w in terms.iter().flat_map(|t| t.1.map(|w| moves_as[w as usize])).filter(|w| *w != NONE) {
        let of = &mut number[w as usize];
        if *of == NONE {
            *of = unknowns;
            unknowns += 1;
        }
    }
    if unknowns == 0 {
        return;
    }
    let number = |w: u32| match moves_as[w as usize] {
        NONE => NONE,
        first => number[first as usize],
    };
    let weight: f64 = terms.iter().map(|(s, _)| s.weight * s.at.length_squared()).sum();
    let memory = (MEMORY * weight / f64::from(unknowns)).max(LEAST_MEMORY * terms[0].0.weight);
    // Triangles with samples, numbered as they come.
    let (mut slot, mut corners) = (vec![NONE; wedges.corners.len()], Vec::new());
    for (s, place) in terms {
        let slot = &mut slot[s.triangle as usize];
        if *slot == NONE {
            *slot = corners.len() as u32;
            corners.push(place.map(number));
        }
    }
    let slot = |s: &Sample| slot[s.triangle as usize] as usize;
    let mut system = VertexFit::new(corners, unknowns as usize);
    (0..unknowns as usize).for_each(|n| system.hold(n, memory));
    for (s, _) in terms {
        system.add(slot(s), s.at.to_array(), s.weight);
    }
    for j in block.clone() {
        let mut right = vec![0.0; unknowns as usize];
        for (s, place) in terms {
            let residual = input.at(s, j) - (0..3).map(|k| s.at[k] * wedges.value(place[k], j)).sum::<f64>();
            system.spread(&mut right, slot(s), s.at.to_array(), s.weight * residual);
        }
        let change = system.solve(&right, STEPS, ENOUGH);
        for w in (0..moves_as.len() as u32).filter(|w| number(*w) != NONE) {
            wedges.change(w, j, change[number(w) as usize]);
        }
    }
}
