//! The vertices of a PLY file as a point cloud, in double precision.

use super::body::Body;
use super::header::{Element, Header};
use super::{Target, color, target};
use crate::error::{Fault, fault};
use crate::load::points::RawPoints;
use crate::load::{Budget, Limits};
use photofit_scalar::{Vec3f, vec3};

/// Reads the vertices; what else the file holds is passed over.
pub(crate) fn parse_points(bytes: &[u8], limits: &Limits) -> Result<RawPoints, Fault> {
    let header = Header::parse(bytes)?;
    let mut budget = Budget::new(limits);
    let mut body = Body::new(bytes, &header);
    let mut cloud = RawPoints::default();
    let mut found = false;
    for element in &header.elements {
        body.check_count(element)?;
        if element.name != "vertex" {
            // Faces commonly follow; after the vertices nothing needs to be read.
            if found {
                break;
            }
            body.skip(element)?;
            continue;
        }
        found = true;
        budget.vertices(element.count, || "element vertex".into())?;
        vertices(element, &mut body, &mut cloud)?;
    }
    if !found {
        return Err(fault("header", "has no element `vertex`; it must have one"));
    }
    Ok(cloud)
}

fn vertices(element: &Element, body: &mut Body<'_>, cloud: &mut RawPoints) -> Result<(), Fault> {
    let mut targets = Vec::new();
    for p in &element.properties {
        targets.push(if p.list.is_some() { Target::Nothing } else { target(&p.name) });
    }
    let has = |t: fn(usize) -> Target| (0..3).all(|k| targets.contains(&t(k)));
    if !has(Target::Position) {
        return Err(fault(
            "element vertex",
            "lacks one of x, y and z; it must have the properties x, y and z",
        ));
    }
    let (normals, colors) = (has(Target::Normal), has(Target::Color));
    for v in 0..element.count as usize {
        let (mut p, mut n, mut c) = ([0.0; 3], [0.0; 3], [0.0_f32; 3]);
        for (property, &to) in element.properties.iter().zip(&targets) {
            if property.list.is_some() {
                body.skip_property(element, property, v)?;
                continue;
            }
            let x = body.number(element, property.kind, v)?;
            match to {
                Target::Position(k) => p[k] = x,
                Target::Normal(k) => n[k] = x,
                Target::Color(k) if k < 3 => c[k] = color(x, property.kind, false),
                _ => {}
            }
        }
        let rgb: Vec3f = vec3(c[0], c[1], c[2]);
        cloud.push(p, normals.then_some(n), colors.then_some(rgb));
    }
    Ok(())
}
