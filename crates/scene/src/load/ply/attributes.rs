//! Further properties of vertices and faces: `weight_0`, `color_0`, `color_1`, `color_2`.

use super::body::Body;
use super::header::{Element, Header, Property};
use super::{Target, target};
use crate::error::Fault;
use photofit_scalar::Vec3f;
use std::collections::HashMap;

/// Attributes of one to three numbers by name, `vertex_` or `face_` before it.
#[derive(Debug, Default)]
pub(crate) struct Attributes {
    pub(crate) vertices: HashMap<String, Vec<Vec3f>>,
    /// One value per triangle.
    pub(crate) faces: HashMap<String, Vec<Vec3f>>,
}

/// The attribute and the channel that a property belongs to.
fn place(property: &Property) -> Option<(String, usize)> {
    if property.list.is_some() {
        return None;
    }
    match property.name.as_str() {
        "r" => return Some(("color".into(), 0)),
        "g" => return Some(("color".into(), 1)),
        "b" => return Some(("color".into(), 2)),
        _ => {}
    }
    let (name, channel) = property.name.rsplit_once('_')?;
    let channel = channel.parse().ok().filter(|c| *c < 3)?;
    (target(&property.name) == Target::Nothing && !name.is_empty()).then(|| (name.to_owned(), channel))
}

/// Reads the attributes of a file whose geometry has been read before.
pub(crate) fn parse_attributes(bytes: &[u8]) -> Result<Attributes, Fault> {
    let header = Header::parse(bytes)?;
    let mut out = Attributes::default();
    let mut body = Body::new(bytes, &header);
    for element in &header.elements {
        body.check_count(element)?;
        match element.name.as_str() {
            "vertex" => read(element, &mut body, "vertex_", &mut out.vertices)?,
            "face" => read(element, &mut body, "face_", &mut out.faces)?,
            _ => body.skip(element)?,
        }
    }
    Ok(out)
}

fn read(
    element: &Element,
    body: &mut Body<'_>,
    prefix: &str,
    out: &mut HashMap<String, Vec<Vec3f>>,
) -> Result<(), Fault> {
    let places: Vec<Option<(String, usize)>> = element.properties.iter().map(place).collect();
    let mut names: Vec<&str> = places.iter().flatten().map(|p| p.0.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    // Single numbers stand in all channels.
    let single: Vec<bool> =
        names.iter().map(|n| places.iter().flatten().filter(|p| p.0 == *n).count() == 1).collect();
    let slots: Vec<Option<(usize, usize)>> = places
        .iter()
        .map(|p| p.as_ref().and_then(|(n, c)| Some((names.binary_search(&n.as_str()).ok()?, *c))))
        .collect();
    let mut columns = vec![Vec::new(); names.len()];
    let mut list = Vec::new();
    for record in 0..element.count as usize {
        let mut values = vec![[0.0_f32; 3]; names.len()];
        let mut triangles = 1;
        for (property, slot) in element.properties.iter().zip(&slots) {
            if property.list.is_some() {
                body.list(element, property, record, &mut list)?;
                if matches!(property.name.as_str(), "vertex_indices" | "vertex_index") {
                    triangles = list.len().saturating_sub(2);
                }
                continue;
            }
            let x = body.number(element, property.kind, record)?;
            if let Some((attribute, channel)) = *slot {
                let x = if x.is_finite() { x as f32 } else { 0.0 };
                values[attribute][channel] = x;
                if single[attribute] {
                    values[attribute] = [x; 3];
                }
            }
        }
        for (column, value) in columns.iter_mut().zip(&values) {
            column.extend(std::iter::repeat_n(Vec3f::from_array(*value), triangles));
        }
    }
    for (name, column) in names.into_iter().zip(columns) {
        out.insert(format!("{prefix}{name}"), column);
    }
    Ok(())
}
