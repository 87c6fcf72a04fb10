//! Animations.

use super::accessor::Need;
use super::document::Document;
use crate::animation::{Animation, Channel, Curve, Interpolation, Property};
use crate::error::{Fault, fault};
use crate::nodes::{Hierarchy, NodeTransform};
use gltf::json::animation as json;
use gltf::json::validation::Checked;

/// All animations, whose nodes and meshes are those of `hierarchy`. At most `limits.vertices` keys and as many output
/// numbers are read. Broken ones are left out with a warning.
pub(super) fn read(
    document: &Document<'_>,
    hierarchy: &Hierarchy,
    warnings: &mut Vec<String>,
) -> Result<Vec<Animation>, Fault> {
    let mut total = 0_u64;
    let mut out = Vec::with_capacity(document.root.animations.len());
    for (a, animation) in document.root.animations.iter().enumerate() {
        let place = format!("animation {a}");
        let mut channels = Vec::with_capacity(animation.channels.len());
        for (c, channel) in animation.channels.iter().enumerate() {
            let property = match channel.target.path {
                Checked::Valid(json::Property::Translation) => Property::Translation,
                Checked::Valid(json::Property::Rotation) => Property::Rotation,
                Checked::Valid(json::Property::Scale) => Property::Scale,
                Checked::Valid(json::Property::MorphTargetWeights) => Property::Weights,
                Checked::Invalid => {
                    warnings.push(format!(
                        "{place} channel {c}: its target is none of this reader and is ignored"
                    ));
                    continue;
                }
            };
            let (node, curve) = (channel.target.node.value(), channel.sampler.value());
            let target = hierarchy.nodes.get(node).ok_or_else(|| {
                let rule = format!("names node {node}; there are {} nodes", hierarchy.nodes.len());
                fault(format!("{place} channel {c}"), rule)
            })?;
            let lost = match property {
                Property::Weights => target.mesh.is_none_or(|m| hierarchy.meshes[m].targets() == 0),
                _ => matches!(target.transform, NodeTransform::Matrix(_)),
            };
            if lost {
                let what = if property == Property::Weights { "no morph targets" } else { "a matrix" };
                warnings.push(format!("{place} channel {c} is ignored: node {node} has {what}"));
                continue;
            }
            channels.push(Channel { node, property, curve });
        }
        if channels.is_empty() {
            warnings.push(format!("{place} moves nothing and is ignored"));
            continue;
        }
        let samplers = animation.samplers.iter().enumerate();
        let curves: Result<Vec<_>, Fault> = samplers
            .map(|(s, sampler)| curve(document, sampler, &format!("{place} sampler {s}"), &mut total))
            .collect();
        let animation = Animation {
            name: animation.name.clone().unwrap_or_default(),
            extras: document.extras(&animation.extras, || place.clone())?,
            channels,
            curves: Vec::new(),
        };
        let whole = curves.map(|curves| Animation { curves, ..animation }).and_then(|whole| {
            let checked = whole.check(hierarchy);
            checked.map_err(|f| fault(format!("{place} {}", f.place), f.rule)).map(|()| whole)
        });
        match whole {
            Ok(whole) => out.push(whole),
            // Limits hold for the file as a whole.
            Err(f) if total > document.limits.vertices as u64 => return Err(f),
            Err(f) => warnings.push(format!("{}: {}: the animation is left out", f.place, f.rule)),
        }
    }
    Ok(out)
}

fn curve(
    document: &Document<'_>,
    sampler: &json::Sampler,
    place: &str,
    total: &mut u64,
) -> Result<Curve, Fault> {
    let interpolation = match sampler.interpolation {
        Checked::Valid(json::Interpolation::Step) => Interpolation::Step,
        Checked::Valid(json::Interpolation::Linear) => Interpolation::Linear,
        Checked::Valid(json::Interpolation::CubicSpline) => Interpolation::CubicSpline,
        Checked::Invalid => {
            return Err(fault(place, "has an unknown interpolation; it must be LINEAR, STEP or CUBICSPLINE"));
        }
    };
    let (input, output) = (sampler.input.value(), sampler.output.value());
    let what = |name: &str| format!("{place} {name}");
    let components = document.components(output, &what("output"))?;
    let numbers = document.count(output, &what("output"))?.saturating_mul(components as u64);
    let keys = document.count(input, &what("input"))?;
    *total = total.saturating_add(numbers).saturating_add(keys);
    let most = document.limits.vertices as u64;
    if *total > most {
        return Err(fault(place, format!("animations have {total} numbers up to here; there may be {most}")));
    }
    let times = bytemuck::cast_vec(document.floats::<1>(input, &what("input"), Need::All)?);
    let output = (output, what("output"));
    let values = match components {
        1 => bytemuck::cast_vec(document.floats::<1>(output.0, &output.1, Need::All)?),
        3 => document.floats::<3>(output.0, &output.1, Need::All)?.into_flattened(),
        4 => document.floats::<4>(output.0, &output.1, Need::All)?.into_flattened(),
        other => {
            let rule = format!("output has {other} components; it must have 1, 3 or 4");
            return Err(fault(place, rule));
        }
    };
    Ok(Curve { times, values, interpolation })
}
