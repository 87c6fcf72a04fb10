//! Skins.

use super::accessor::Need;
use super::document::Document;
use crate::error::Fault;
use crate::skin::Skin;
use glam::{Affine3A, Mat4};

/// Skin `s` of the document.
pub(super) fn read(document: &Document<'_>, s: usize) -> Result<Skin, Fault> {
    let skin = &document.root.skins[s];
    let place = format!("skin {s}");
    let inverse_binds = match skin.inverse_bind_matrices {
        Some(a) => {
            let matrices = document.floats::<16>(a.value(), &place, Need::First(skin.joints.len()))?;
            matrices.iter().map(|m| Affine3A::from_mat4(Mat4::from_cols_array(m))).collect()
        }
        None => vec![Affine3A::IDENTITY; skin.joints.len()],
    };
    Ok(Skin {
        name: skin.name.clone().unwrap_or_default(),
        extras: document.extras(&skin.extras, || place)?,
        joints: skin.joints.iter().map(|j| j.value()).collect(),
        inverse_binds,
        skeleton: skin.skeleton.map(|n| n.value()),
    })
}
