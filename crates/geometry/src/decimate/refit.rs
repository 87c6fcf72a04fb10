//! Least-squares refit of the vertex attributes to the input surface after the last move of a vertex.
//!
//! The collapses choose attributes for the place that a vertex has then; refinement moves it and flips change what is
//! interpolated. Here the interpolated attributes meet those of samples of the input surface in the sense of least
//! squares, where triangles stay as they are.

use super::engine::Engine;
use super::refine::{Original, Sample};
use super::topology::NONE;
use super::wedge::Wedges;
use std::ops::Range;

/// Weight of the present value of a wedge against its samples, in shares of the mean of what samples weigh at a wedge.
const MEMORY: f64 = 0.02;
/// Conjugate gradient steps at most, and the share of the residual that ends them.
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

/// What one solve works on: samples with their three wedges, numbered among those that may change, or [`NONE`].
struct System<'a> {
    terms: Vec<(&'a Sample, [u32; 3])>,
    /// Weight of the present value of each unknown.
    memory: f64,
    unknowns: usize,
}

/// Fits the attributes of all wedges but those of vertices that stay; texture coordinates of seams keep theirs. `samples` are in place.
pub(super) fn refit(engine: &mut Engine<'_>, original: &Original, samples: &[Sample]) {
    let Some(input) = &original.attributes else { return };
    let Some(mut wedges) = engine.wedges.take() else { return };
    let (alone, free) = free(engine, &wedges);
    for (block, coordinates) in wedges.blocks() {
        let free = if coordinates { &alone } else { &free };
        let terms = terms(engine, &wedges, input, samples, &block, coordinates);
        let first = alike(engine, &wedges, &block);
        fit(&mut wedges, input, &terms, (free, &first), &block);
    }
    engine.wedges = Some(wedges);
}

/// Wedges that are the only one of a vertex which may change, and all wedges of such vertices.
fn free(engine: &Engine<'_>, wedges: &Wedges) -> (Vec<bool>, Vec<bool>) {
    let count = wedges.values.len() / wedges.width;
    let mut only = vec![NONE; engine.positions.len()];
    let (mut alone, mut free) = (vec![false; count], vec![false; count]);
    let mut shared = vec![false; engine.positions.len()];
    let live = || (0..engine.topology.triangles.len()).filter(|t| engine.topology.is_live(*t as u32));
    let corners = || live().flat_map(|t| (0..3).map(move |k| (t, k)));
    let of = |(t, k): (usize, usize)| (engine.topology.triangles[t][k] as usize, wedges.corners[t][k]);
    for (v, w) in corners().map(of) {
        shared[v] |= only[v] != NONE && only[v] != w;
        only[v] = w;
    }
    for (v, w) in corners().map(of) {
        free[w as usize] = !engine.fixed[v];
        alone[w as usize] = !engine.fixed[v] && !shared[v];
    }
    (alone, free)
}

/// The first of the wedges of a vertex that are alike, for each wedge.
fn alike(engine: &Engine<'_>, wedges: &Wedges, block: &Range<usize>) -> Vec<u32> {
    let mut first: Vec<u32> = (0..(wedges.values.len() / wedges.width) as u32).collect();
    let mut of_vertex: Vec<(u32, u32)> = Vec::new();
    for t in (0..engine.topology.triangles.len()).filter(|t| engine.topology.is_live(*t as u32)) {
        of_vertex.extend((0..3).map(|k| (engine.topology.triangles[t][k], wedges.corners[t][k])));
    }
    of_vertex.sort_unstable();
    of_vertex.dedup();
    let are_alike = |a: u32, b: u32| {
        let [mut away, mut length] = [0.0; 2];
        for j in block.clone() {
            let (x, y) = (wedges.value(a, j), wedges.value(b, j));
            (away, length) = (away + (x - y).powi(2), length + 0.5 * (x * x + y * y));
        }
        away < ALIKE * length
    };
    for same in of_vertex.chunk_by(|a, b| a.0 == b.0) {
        for (k, (_, wedge)) in same.iter().enumerate() {
            let before = same[..k].iter().map(|(_, w)| first[*w as usize]);
            first[*wedge as usize] = before.into_iter().find(|w| are_alike(*w, *wedge)).unwrap_or(*wedge);
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
    (free, first): (&[bool], &[u32]),
    block: &Range<usize>,
) {
    let mut number = vec![NONE; free.len()];
    let mut unknowns = 0;
    for w in terms.iter().flat_map(|t| t.1).filter(|w| free[*w as usize]) {
        let of = &mut number[first[w as usize] as usize];
        if *of == NONE {
            *of = unknowns;
            unknowns += 1;
        }
    }
    if unknowns == 0 {
        return;
    }
    let number = |w: u32| if free[w as usize] { number[first[w as usize] as usize] } else { NONE };
    let weight: f64 = terms.iter().map(|(s, _)| s.weight * s.at.length_squared()).sum();
    let system = System {
        terms: terms.iter().map(|(s, w)| (*s, w.map(number))).collect(),
        memory: (MEMORY * weight / f64::from(unknowns)).max(LEAST_MEMORY * terms[0].0.weight),
        unknowns: unknowns as usize,
    };
    for j in block.clone() {
        let residual = |s: &Sample, place: &[u32; 3]| {
            input.at(s, j) - (0..3).map(|k| s.at[k] * wedges.value(place[k], j)).sum::<f64>()
        };
        let residuals: Vec<f64> = terms.iter().map(|(s, place)| residual(s, place)).collect();
        let change = system.solve(&residuals);
        for w in (0..first.len() as u32).filter(|w| number(*w) != NONE) {
            wedges.change(w, j, change[number(w) as usize]);
        }
    }
}

impl System<'_> {
    /// The change of the unknowns that makes up for the residuals of the terms, by conjugate gradients.
    fn solve(&self, residuals: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.unknowns];
        let mut r = vec![0.0; self.unknowns];
        let mut diagonal = vec![self.memory; self.unknowns];
        for ((s, place), residual) in self.terms.iter().zip(residuals) {
            for (k, n) in place.iter().enumerate().filter(|(_, n)| **n != NONE) {
                r[*n as usize] += s.weight * s.at[k] * residual;
                diagonal[*n as usize] += s.weight * s.at[k] * s.at[k];
            }
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scaled = |r: &[f64]| r.iter().zip(&diagonal).map(|(r, d)| r / d).collect::<Vec<f64>>();
        let mut z = scaled(&r);
        let mut p = z.clone();
        let mut energy = dot(&r, &z);
        let least = ENOUGH * ENOUGH * energy;
        let mut image = vec![0.0; self.unknowns];
        for _ in 0..STEPS {
            if energy <= least || energy <= f64::MIN_POSITIVE {
                break;
            }
            self.apply(&p, &mut image);
            let step = energy / dot(&p, &image);
            for i in 0..self.unknowns {
                x[i] += step * p[i];
                r[i] -= step * image[i];
            }
            z = scaled(&r);
            let next = dot(&r, &z);
            let ratio = next / energy;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + ratio * *p);
            energy = next;
        }
        x
    }

    /// The matrix of the normal equations times `x`.
    fn apply(&self, x: &[f64], out: &mut [f64]) {
        out.iter_mut().zip(x).for_each(|(o, x)| *o = self.memory * x);
        for (s, place) in &self.terms {
            let of = |n: u32| if n == NONE { 0.0 } else { x[n as usize] };
            let sum = s.weight * (0..3).map(|k| s.at[k] * of(place[k])).sum::<f64>();
            for (k, n) in place.iter().enumerate().filter(|(_, n)| **n != NONE) {
                out[*n as usize] += s.at[k] * sum;
            }
        }
    }
}
