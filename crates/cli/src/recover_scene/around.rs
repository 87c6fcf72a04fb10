//! Cameras around what a camera looks at.

use glam::{DQuat, DVec3};
use photofit_pathtrace::{View, World};
use std::f64::consts::TAU;

/// `count` views on a circle through `view`, which is the first: turned about the world's axis that is nearest to its up,
/// through the point of its optical axis that is nearest to the middle of the world.
pub(super) fn views(view: &View, world: &World, count: usize) -> Vec<View> {
    let up = view.axes[1].as_dvec3();
    let k = (0..3).max_by(|a, b| up[*a].abs().total_cmp(&up[*b].abs())).unwrap_or(1);
    let axis = DVec3::AXES[k] * up[k].signum();
    let forward = -view.axes[2].as_dvec3();
    let middle = view.eye + forward * (world.middle() - view.eye).dot(forward).max(0.0);
    let turned = |i: usize| {
        let turn = DQuat::from_axis_angle(axis, TAU * i as f64 / count as f64);
        let axes = view.axes.map(|a| (turn * a.as_dvec3()).as_vec3());
        View { eye: middle + turn * (view.eye - middle), axes, ..*view }
    };
    std::iter::once(*view).chain((1..count).map(turned)).collect()
}
