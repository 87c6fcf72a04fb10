//! Animations.

use super::{Writer, named, with_extras};
use crate::animation::{Animation, Interpolation, Property};
use serde_json::{Value, json};
use std::collections::HashMap;

/// Writes an animation; weights of nodes whose mesh is not `shown` are left out. `None` where no channel is left.
pub(super) fn write(
    animation: &Animation,
    shown: &dyn Fn(usize) -> bool,
    writer: &mut Writer,
) -> Option<Value> {
    // Weights are written as single numbers, other values as vectors: a curve may serve both.
    let mut written: HashMap<(usize, bool), usize> = HashMap::new();
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    for channel in &animation.channels {
        let weights = channel.property == Property::Weights;
        if weights && !shown(channel.node) {
            continue;
        }
        let sampler = *written.entry((channel.curve, weights)).or_insert_with(|| {
            let curve = &animation.curves[channel.curve];
            let width = if weights { 1 } else { curve.width() };
            let interpolation = match curve.interpolation {
                Interpolation::Step => "STEP",
                Interpolation::Linear => "LINEAR",
                Interpolation::CubicSpline => "CUBICSPLINE",
            };
            let input = times(&curve.times, writer);
            let output = writer.floats(&curve.values, width, None);
            samplers.push(json!({"input": input, "output": output, "interpolation": interpolation}));
            samplers.len() - 1
        });
        let path = match channel.property {
            Property::Translation => "translation",
            Property::Rotation => "rotation",
            Property::Scale => "scale",
            Property::Weights => "weights",
        };
        channels.push(json!({"sampler": sampler, "target": {"node": channel.node, "path": path}}));
    }
    if channels.is_empty() {
        return None;
    }
    let value = json!({"channels": channels, "samplers": samplers});
    Some(with_extras(named(value, &animation.name), &animation.extras))
}

/// The accessor of these times, one for all equal ones.
fn times(times: &[f32], writer: &mut Writer) -> usize {
    let bits: Vec<u32> = times.iter().map(|t| t.to_bits()).collect();
    if let Some(&accessor) = writer.times.get(&bits) {
        return accessor;
    }
    let accessor = writer.floats(times, 1, None);
    writer.accessors[accessor]["min"] = json!([times.first()]);
    writer.accessors[accessor]["max"] = json!([times.last()]);
    writer.times.insert(bits, accessor);
    accessor
}
