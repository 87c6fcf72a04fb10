//! A guide without a network: in every leaf of a spatial tree a mixture of von Mises-Fisher lobes of the radiance that
//! arrives (Vorba et al. 2014 with the tree of Müller et al. 2017; the guides of Open PGL are of this kind), which follow
//! the parallax of near light (Ruppert et al. 2020), multiplied with the lobe of the cosine at the vertex.

mod leaf;
mod mixture;
mod parallax;
mod vmf;

use crate::FlowError;
use crate::guide::{Guide, Learn, Query, Record};
use leaf::Leaf;
use mixture::Mixture;
use parallax::{extent, median};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Concentration of the lobes of an untrained mixture.
const KAPPA_FIRST: f32 = 3.0;

/// How lobes are learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeOptions {
    /// A leaf with more useful records in one call of [`Learn::learn`] is split, where that leaves both halves at least
    /// [`Self::least_records`].
    pub leaf_records: usize,
    /// Most levels of the tree.
    pub depth: u32,
    /// Fewer useful records than this leave a leaf as it is.
    pub least_records: usize,
}

impl Default for LobeOptions {
    /// Leaves of up to 400 records, 24 levels.
    fn default() -> Self {
        Self { leaf_records: 400, depth: 24, least_records: 32 }
    }
}

/// A node of the tree: the children of a split follow each other.
#[derive(Clone, Copy, Debug)]
enum Node {
    Split { axis: u8, at: f32, first: u32 },
    Leaf(u32),
}

/// Mixtures of lobes in a spatial tree.
#[derive(Clone, Debug)]
pub struct LobeGuide {
    options: LobeOptions,
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    /// Whether [`Learn::learn`] was called: directions were chosen without a guide before.
    began: bool,
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
        Self { options, nodes: vec![Node::Leaf(0)], leaves: vec![Leaf::untrained()], began: false }
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
                    .then(|| plane(&own, records, self.options.least_records.max(1)))
                    .flatten();
                let Some((axis, at)) = plane else {
                    out.push((leaf as usize, own));
                    return;
                };
                let own_leaf = &mut self.leaves[leaf as usize];
                own_leaf.depth += 1;
                own_leaf.seen *= 0.5;
                own_leaf.parallax = own_leaf.parallax.fading(0.5);
                let copy = *own_leaf;
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

/// Where to split: across the axis along which positions spread most, at their mean or else at their median, so that at
/// least `least` records lie on either side; else across the next axis. `None` where all would leave a side with fewer: a
/// child of so few records learns nothing.
fn plane(own: &[u32], records: &[Record], least: usize) -> Option<(u8, f32)> {
    let along = |axis: usize| own.iter().map(move |i| records[*i as usize].query.position[axis]);
    let n = own.len() as f64;
    let moments = [0, 1, 2].map(|axis| {
        let mean = along(axis).map(f64::from).sum::<f64>() / n;
        let spread = along(axis).map(|v| (f64::from(v) - mean).powi(2)).sum::<f64>();
        (mean as f32, spread)
    });
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| moments[*b].1.total_cmp(&moments[*a].1));
    let fits = |axis: usize, at: f32| {
        let above = along(axis).filter(|v| *v >= at).count();
        above.min(own.len() - above) >= least
    };
    let plane = |axis: usize| {
        let mean = moments[axis].0;
        if fits(axis, mean) {
            Some(mean)
        } else {
            Some(median(&mut along(axis).collect::<Vec<_>>())).filter(|at| fits(axis, *at))
        }
    };
    axes.into_iter().find_map(|axis| Some((axis as u8, plane(axis)?)))
}

impl Guide for LobeGuide {
    type Local = LobeLocal;

    #[inline]
    fn local(&self, at: &Query) -> LobeLocal {
        self.leaves[self.leaf(at.position)].local(at)
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
}

impl Learn for LobeGuide {
    fn learn(&mut self, records: &[Record]) -> Result<(), FlowError> {
        let unguided = !self.began;
        let useful: Vec<u32> =
            (0..records.len() as u32).filter(|i| records[*i as usize].is_useful()).collect();
        let mut parts = Vec::new();
        let extent = extent(useful.iter().map(|i| &records[*i as usize]));
        self.settle(0, useful, records, &mut parts);
        let fitted: Vec<(usize, Leaf)> = parts
            .par_iter()
            .filter(|(_, own)| own.len() >= self.options.least_records)
            .map(|(index, own)| {
                let mut leaf = self.leaves[*index];
                leaf.learn(own, records, extent, unguided);
                (*index, leaf)
            })
            .collect();
        for (index, leaf) in fitted {
            self.leaves[index] = leaf;
        }
        self.began = true;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
