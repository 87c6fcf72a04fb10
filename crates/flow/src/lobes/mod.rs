//! A guide without a network: in every leaf of a spatial tree a mixture of von Mises-Fisher lobes of the radiance that
//! arrives (Vorba et al. 2014 with the tree of Müller et al. 2017; the guides of Open PGL are of this kind), multiplied
//! with the lobe of the cosine at the vertex.

mod mixture;
mod vmf;

use crate::FlowError;
use crate::guide::{Guide, Query, Record, SHARE};
use mixture::{LOBES, Mixture};
use photofit_sampling::fibonacci_sphere;
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use vmf::Lobe;

/// Rounds of expectation and maximisation per call, and of the share.
const ROUNDS: usize = 4;
/// Largest weight of a record in units of its leaf's mean.
const WEIGHT_MAX: f32 = 20.0;
/// Records without direction that every lobe is thought to have seen beside the true ones: keeps few from making it
/// narrow or empty.
const PRIOR: f32 = 0.5;
/// What a call of [`Guide::learn`] leaves of the weight of earlier ones: the first records come from poor directions.
const MEMORY: f32 = 0.5;
/// Concentration of the lobes of an untrained mixture.
const KAPPA_FIRST: f32 = 3.0;

/// How lobes are learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeOptions {
    /// A leaf with more useful records in one call of [`Guide::learn`] is split.
    pub leaf_records: usize,
    /// Most levels of the tree.
    pub depth: u32,
    /// Fewer useful records than this leave a leaf as it is.
    pub least_records: usize,
}

impl Default for LobeOptions {
    /// Leaves of up to 100 records, 24 levels.
    fn default() -> Self {
        Self { leaf_records: 100, depth: 24, least_records: 32 }
    }
}

/// A node of the tree: the children of a split follow each other.
#[derive(Clone, Copy, Debug)]
enum Node {
    Split { axis: u8, at: f32, first: u32 },
    Leaf(u32),
}

#[derive(Clone, Copy, Debug)]
struct Leaf {
    lobes: Mixture,
    /// Records that made the lobes, those of earlier calls for less.
    seen: f32,
    share: f32,
    depth: u32,
}

/// Mixtures of lobes in a spatial tree.
#[derive(Clone, Debug)]
pub struct LobeGuide {
    options: LobeOptions,
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
}

/// The mixture of a leaf times the cosine.
#[derive(Clone, Copy, Debug)]
pub struct LobeLocal {
    lobes: Mixture,
    share: f32,
}

impl LobeGuide {
    /// An untrained guide: one leaf, all directions nearly alike, which is asked rarely.
    pub fn new(options: LobeOptions) -> Self {
        let lobe = |k| Lobe::new(1.0 / LOBES as f32, fibonacci_sphere(k, LOBES), KAPPA_FIRST);
        let lobes = Mixture::new(std::array::from_fn(lobe));
        let leaf = Leaf { lobes, seen: 0.0, share: SHARE[0], depth: 0 };
        Self { options, nodes: vec![Node::Leaf(0)], leaves: vec![leaf] }
    }

    /// Number of leaves.
    pub fn leaves(&self) -> usize {
        self.leaves.len()
    }

    #[inline]
    fn leaf(&self, p: Vec3f) -> usize {
        let mut at = 0;
        loop {
            match self.nodes[at] {
                Node::Leaf(leaf) => return leaf as usize,
                Node::Split { axis, at: plane, first } => {
                    at = first as usize + usize::from(p[usize::from(axis)] >= plane);
                }
            }
        }
    }

    /// Splits the leaf of `node` until its records fit, and gives `(leaf, its records)` for each that is left.
    fn settle(
        &mut self,
        node: usize,
        mut own: Vec<u32>,
        records: &[Record],
        out: &mut Vec<(usize, Vec<u32>)>,
    ) {
        match self.nodes[node] {
            Node::Split { axis, at, first } => {
                let right: Vec<u32> = own
                    .extract_if(.., |i| records[*i as usize].query.position[usize::from(axis)] >= at)
                    .collect();
                self.settle(first as usize, own, records, out);
                self.settle(first as usize + 1, right, records, out);
            }
            Node::Leaf(leaf) => {
                let depth = self.leaves[leaf as usize].depth;
                let plane = (own.len() > self.options.leaf_records && depth < self.options.depth)
                    .then(|| plane(&own, records))
                    .flatten();
                let Some((axis, at)) = plane else {
                    out.push((leaf as usize, own));
                    return;
                };
                self.leaves[leaf as usize].depth += 1;
                self.leaves[leaf as usize].seen *= 0.5;
                let copy = self.leaves[leaf as usize];
                let second = self.leaves.len() as u32;
                self.leaves.push(copy);
                let first = self.nodes.len() as u32;
                self.nodes.extend([Node::Leaf(leaf), Node::Leaf(second)]);
                self.nodes[node] = Node::Split { axis, at, first };
                self.settle(node, own, records, out);
            }
        }
    }
}

/// The axis along which positions spread most, and their mean on it; `None` where that leaves one side empty.
fn plane(own: &[u32], records: &[Record]) -> Option<(u8, f32)> {
    let n = own.len() as f64;
    let (mut sum, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
    for i in own {
        for (k, v) in records[*i as usize].query.position.to_array().into_iter().enumerate() {
            sum[k] += f64::from(v);
            squares[k] += f64::from(v).powi(2);
        }
    }
    let spread = |k: usize| squares[k] / n - (sum[k] / n).powi(2);
    let axis = (0..3).fold(0, |best, k| if spread(k) > spread(best) { k } else { best });
    let at = (sum[axis] / n) as f32;
    let above = own.iter().filter(|i| records[**i as usize].query.position[axis] >= at).count();
    (above > 0 && above < own.len()).then_some((axis as u8, at))
}

impl Leaf {
    /// Expectation and maximisation from the present mixture, then the share that fits the records best.
    fn fit(&mut self, own: &[u32], records: &[Record], first: bool) {
        let mean = own.iter().map(|i| incident(&records[*i as usize])).sum::<f32>() / own.len() as f32;
        let usable = mean > 0.0 && mean.is_finite();
        if !usable {
            return;
        }
        let before = *self;
        // The lobes so far count for the records that made them.
        let seen = MEMORY * self.seen;
        let known = std::array::from_fn(|k| self.lobes.lobe(k));
        let priors: [(f32, Vec3f); LOBES] = known.map(|l: Lobe| {
            let mass = seen * l.weight;
            (PRIOR + mass, l.mean * (mass * l.mean_length()))
        });
        for _ in 0..ROUNDS {
            let (mut mass, mut sums) = (priors.map(|p| p.0), priors.map(|p| p.1));
            let mut total: f32 = mass.iter().sum();
            for i in own {
                let r = &records[*i as usize];
                let weight = (incident(r) / mean).min(WEIGHT_MAX);
                let parts = self.lobes.parts(r.wi);
                let all: f32 = parts.iter().sum();
                if all <= 0.0 {
                    continue;
                }
                total += weight;
                for k in 0..LOBES {
                    let part = weight * parts[k] / all;
                    mass[k] += part;
                    sums[k] += r.wi * part;
                }
            }
            let lobe = |k: usize| Lobe::of_mean(mass[k] / total, sums[k] * (1.0 / mass[k]));
            self.lobes = Mixture::new(std::array::from_fn(lobe));
        }
        self.seen = seen + own.len() as f32;
        // What a mixture of an earlier call would have done with these records is not known of the first one.
        let usual = own.iter().map(|i| worth(&records[*i as usize])).sum::<f32>() / own.len() as f32;
        let mut share = if first { 0.5 * (SHARE[0] + SHARE[1]) } else { self.share };
        for _ in 0..ROUNDS {
            let (mut guided, mut total) = (0.0, 0.0);
            for i in own {
                let r = &records[*i as usize];
                let old = local(&before, &r.query);
                let other = if first {
                    r.pdf
                } else {
                    (r.pdf - before.share * old.lobes.density(r.wi)).max(0.0) / (1.0 - before.share)
                };
                let guide = local(self, &r.query).lobes.density(r.wi);
                let mixture = share * guide + (1.0 - share) * other;
                if mixture > 0.0 && mixture.is_finite() {
                    let weight = worth(r).min(WEIGHT_MAX * usual);
                    guided += weight * share * guide / mixture;
                    total += weight;
                }
            }
            if total > 0.0 {
                share = (guided / total).clamp(SHARE[0], SHARE[1]);
            }
        }
        self.share = share;
    }
}

#[inline]
fn incident(r: &Record) -> f32 {
    r.incident / r.pdf
}

/// The integrand over the density that chose the direction.
#[inline]
fn worth(r: &Record) -> f32 {
    r.value / r.pdf
}

#[inline]
fn local(leaf: &Leaf, at: &Query) -> LobeLocal {
    let n = if at.normal.dot(at.wo) < 0.0 { -at.normal } else { at.normal };
    LobeLocal { lobes: leaf.lobes.with_cosine(n), share: leaf.share }
}

impl Guide for LobeGuide {
    type Local = LobeLocal;

    #[inline]
    fn local(&self, at: &Query) -> LobeLocal {
        local(&self.leaves[self.leaf(at.position)], at)
    }

    #[inline]
    fn share(&self, local: &LobeLocal) -> f32 {
        local.share
    }

    #[inline]
    fn sample(&self, local: &LobeLocal, u: [f32; 2]) -> Option<(Vec3f, f32)> {
        let wi = local.lobes.sample(u)?;
        Some((wi, local.lobes.density(wi)))
    }

    #[inline]
    fn pdf(&self, local: &LobeLocal, wi: Vec3f) -> f32 {
        local.lobes.density(wi)
    }

    fn learn(&mut self, records: &[Record]) -> Result<(), FlowError> {
        let first = self.leaves.len() == 1 && self.leaves[0].share <= SHARE[0];
        let useful = (0..records.len() as u32).filter(|i| records[*i as usize].is_useful()).collect();
        let mut parts = Vec::new();
        self.settle(0, useful, records, &mut parts);
        let fitted: Vec<(usize, Leaf)> = parts
            .par_iter()
            .filter(|(_, own)| own.len() >= self.options.least_records)
            .map(|(index, own)| {
                let mut leaf = self.leaves[*index];
                leaf.fit(own, records, first);
                (*index, leaf)
            })
            .collect();
        for (index, leaf) in fitted {
            self.leaves[index] = leaf;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
