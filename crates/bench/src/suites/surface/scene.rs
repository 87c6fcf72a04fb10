//! The scene of the steps with its outline told apart.

use photofit_denoise::surface::synthetic::{SIDE, Scene, sphere_over_background};

/// Pixels around the outline that count as edge.
const EDGE: isize = 3;

/// What a pixel belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The sphere.
    Front,
    /// The wall.
    Back,
    /// Either, near the outline.
    Edge,
}

/// A sphere before a wall, and what each pixel belongs to.
pub(super) struct Outlined {
    pub(super) scene: Scene,
    part: Vec<Part>,
}

impl Outlined {
    pub(super) fn new() -> Self {
        let scene = sphere_over_background();
        let n = SIDE as isize;
        let near = |i: usize| {
            let (x, y) = ((i % SIDE) as isize, (i / SIDE) as isize);
            let window = (-EDGE..=EDGE).flat_map(|v| (-EDGE..=EDGE).map(move |u| (x + u, y + v)));
            let mut inside = window.filter(|(u, v)| (0..n).contains(u) && (0..n).contains(v));
            inside.any(|(u, v)| scene.front[(v * n + u) as usize] != scene.front[i])
        };
        let part = |i: usize| match (near(i), scene.front[i]) {
            (true, _) => Part::Edge,
            (false, true) => Part::Front,
            (false, false) => Part::Back,
        };
        let part = (0..SIDE * SIDE).map(part).collect();
        Self { scene, part }
    }

    /// Relative rms error of depth, given as ln z, over the pixels that are `of` it: their part, and whether they show
    /// the sphere.
    pub(super) fn error(&self, ln_z: &[f32], of: impl Fn(Part, bool) -> bool) -> f64 {
        self.scene.error(ln_z, |i| of(self.part[i], self.scene.front[i]))
    }
}
