//! Animations: properties of nodes as functions of time.

use crate::error::{Fault, fault};
use crate::nodes::{Hierarchy, NodeTransform};
use glam::Quat;
use serde_json::Value;

/// Named motion of nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Animation {
    /// Name in the file.
    pub name: String,
    /// Application data of the file.
    pub extras: Option<Value>,
    /// What moves.
    pub channels: Vec<Channel>,
    /// How it moves; channels may share a curve.
    pub curves: Vec<Curve>,
}

/// A property of a node that follows a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Index into [`Hierarchy::nodes`].
    pub node: usize,
    /// The property.
    pub property: Property,
    /// Index into [`Animation::curves`].
    pub curve: usize,
}

/// What can move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Property {
    /// Translation of the node: 3 values.
    Translation,
    /// Rotation of the node: 4 values, a unit quaternion (x, y, z, w).
    Rotation,
    /// Scale of the node: 3 values.
    Scale,
    /// Weights of the morph targets of the node's mesh: one value for each.
    Weights,
}

/// How values between keys follow from those at keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpolation {
    /// The value of the last key.
    Step,
    /// Linear; rotations turn at a constant rate the shorter way.
    #[default]
    Linear,
    /// Hermite splines: each key has an incoming tangent, a value and an outgoing tangent, per second.
    CubicSpline,
}

/// Values at keys.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Times of the keys in seconds, at least one, not negative, rising strictly.
    pub times: Vec<f32>,
    /// Key by key `width` values; three times as many for [`Interpolation::CubicSpline`]: tangents in, values, tangents
    /// out.
    pub values: Vec<f32>,
    /// Between the keys.
    pub interpolation: Interpolation,
}

impl Curve {
    /// Numbers of a value.
    pub fn width(&self) -> usize {
        self.values.len() / (self.times.len().max(1) * self.rows())
    }

    fn rows(&self) -> usize {
        if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 }
    }

    /// The value at a time, clamped to the first and the last key, into `out`. `rotation` says that it is a
    /// quaternion, which comes out with unit length.
    ///
    /// # Panics
    /// If `out` has not [`Self::width`] elements, or there is no key.
    pub fn sample(&self, time: f32, rotation: bool, out: &mut [f32]) {
        let width = self.width();
        assert_eq!(out.len(), width, "one number for each of the curve's");
        let key = |k: usize, row: usize| &self.values[(k * self.rows() + row) * width..][..width];
        let value = |k: usize| key(k, usize::from(self.rows() == 3));
        let last = self.times.len() - 1;
        let after = self.times.partition_point(|&t| t <= time);
        if after == 0 || after > last || self.interpolation == Interpolation::Step {
            out.copy_from_slice(value(after.max(1) - 1));
        } else {
            let (a, b) = (after - 1, after);
            let span = self.times[b] - self.times[a];
            let t = (time - self.times[a]) / span;
            if self.interpolation == Interpolation::CubicSpline {
                let (t2, t3) = (t * t, t * t * t);
                let weights = [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2];
                let (from, leaving, to, arriving) = (value(a), key(a, 2), value(b), key(b, 0));
                for (i, x) in out.iter_mut().enumerate() {
                    let tangents = weights[1] * leaving[i] + weights[3] * arriving[i];
                    *x = weights[0] * from[i] + weights[2] * to[i] + span * tangents;
                }
            } else if rotation {
                let (p, q) = (quaternion(value(a)), quaternion(value(b)));
                out.copy_from_slice(&p.slerp(q, t).to_array());
            } else {
                let (from, to) = (value(a), value(b));
                out.iter_mut().enumerate().for_each(|(i, x)| *x = from[i] + (to[i] - from[i]) * t);
            }
        }
        if rotation {
            let unit = quaternion(out);
            out.copy_from_slice(&unit.to_array());
        }
    }
}

/// Of unit length; no rotation where the numbers have no length.
fn quaternion(values: &[f32]) -> Quat {
    let q = Quat::from_array([values[0], values[1], values[2], values[3]]);
    let length = q.length();
    if length > 1e-20 { q / length } else { Quat::IDENTITY }
}

impl Animation {
    /// Time of the last key, seconds.
    pub fn duration(&self) -> f32 {
        self.curves.iter().filter_map(|c| c.times.last()).fold(0.0, |a, &t| a.max(t))
    }

    /// Puts the values at a time into transforms and morph weights, one of each for every node.
    pub(crate) fn apply(&self, time: f32, transforms: &mut [NodeTransform], weights: &mut [Vec<f32>]) {
        for channel in &self.channels {
            let curve = &self.curves[channel.curve];
            if channel.property == Property::Weights {
                let out = &mut weights[channel.node];
                out.resize(curve.width(), 0.0);
                curve.sample(time, false, out);
                continue;
            }
            let NodeTransform::Parts { translation, rotation, scale } = &mut transforms[channel.node] else {
                continue;
            };
            match channel.property {
                Property::Translation => curve.sample(time, false, translation.as_mut()),
                Property::Scale => curve.sample(time, false, scale.as_mut()),
                _ => {
                    let mut q = [0.0; 4];
                    curve.sample(time, true, &mut q);
                    *rotation = Quat::from_array(q);
                }
            }
        }
    }

    /// The place in the fault is within the animation.
    pub(crate) fn check(&self, hierarchy: &Hierarchy) -> Result<(), Fault> {
        for (s, curve) in self.curves.iter().enumerate() {
            let fail = |rule: String| Err(fault(format!("sampler {s}"), rule));
            let first = curve.times.first().copied().unwrap_or(-1.0);
            if !(first >= 0.0 && curve.times.iter().all(|t| t.is_finite())) {
                return fail(
                    "has no key, or one at a negative or infinite time; it must have finite times from 0 on"
                        .into(),
                );
            }
            if let Some(k) = curve.times.windows(2).position(|w| w[0] >= w[1]) {
                let (a, b) = (curve.times[k], curve.times[k + 1]);
                return fail(format!("keys {k} and {} are at {a} and {b} s; times must rise", k + 1));
            }
            if let Some(k) = curve.values.iter().position(|v| !v.is_finite()) {
                return fail(format!("output {k} is {}; it must be finite", curve.values[k]));
            }
            if !curve.values.len().is_multiple_of(curve.times.len() * curve.rows()) {
                let (keys, values) = (curve.times.len(), curve.values.len());
                return fail(format!("has {values} output numbers for {keys} keys; they must divide evenly"));
            }
        }
        for (c, channel) in self.channels.iter().enumerate() {
            let fail = |rule: String| Err(fault(format!("channel {c}"), rule));
            let (Some(node), Some(curve)) =
                (hierarchy.nodes.get(channel.node), self.curves.get(channel.curve))
            else {
                let (n, s) = (hierarchy.nodes.len(), self.curves.len());
                let (node, curve) = (channel.node, channel.curve);
                return fail(format!(
                    "names node {node} and sampler {curve}; there are {n} nodes and {s} samplers"
                ));
            };
            let wanted = match channel.property {
                Property::Rotation => 4,
                Property::Weights => node.mesh.map_or(0, |m| hierarchy.meshes[m].targets()),
                _ => 3,
            };
            if curve.width() != wanted {
                let found = curve.width();
                return fail(format!(
                    "has {found} numbers for each key; {:?} takes {wanted}",
                    channel.property
                ));
            }
            if channel.property != Property::Weights && matches!(node.transform, NodeTransform::Matrix(_)) {
                return fail(format!("node {} has a matrix; animated nodes have none", channel.node));
            }
        }
        Ok(())
    }
}
