//! Which sides of a surface are seen: one policy for all renderers.

/// The sides of a surface that a camera sees (glTF `doubleSided`).
///
/// The front is the side from which the corners of a triangle turn counter-clockwise, after the transform of its node: a
/// node whose transform mirrors (negative determinant) has its triangles turned round, so that their fronts stay in front
/// (glTF 2.0, section 3.7.4).
///
/// The policy, the same for the rasterizers, the path tracer, visibility, baking, judging and export:
/// - What a camera sees, it sees of [`Sides::Front`] surfaces from the front alone; from behind it looks through them.
/// - Shadow rays and bounced rays are stopped by both sides: a wall casts its shadow whichever way it faces.
/// - Surfaces of solids that let light through (transmission with a volume of some thickness) are seen by the path tracer
///   from within as well: light refracts there. Transmission without a volume exempts nothing.
/// - Where a side is seen from behind, its shading normal is turned to the viewer.
///
/// Path tracers and viewers that know no sides draw backs all the same. Some views of a fit do so, of the asset and of the
/// light asset alike, where such backs are seen; no other picture does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Sides {
    /// The front alone: glTF's default.
    #[default]
    Front,
    /// Both sides.
    Both,
}

impl Sides {
    /// The sides of a material with glTF's flag `doubleSided`.
    pub fn of(double_sided: bool) -> Self {
        if double_sided { Self::Both } else { Self::Front }
    }

    /// Whether the front (`true`) or the back is seen.
    #[inline(always)]
    pub fn shows(self, front: bool) -> bool {
        front || self == Self::Both
    }
}

#[cfg(test)]
mod tests {
    use super::Sides;

    #[test]
    fn backs_are_seen_of_double_sided_surfaces_alone() {
        let shown = |double_sided| [true, false].map(|front| Sides::of(double_sided).shows(front));
        assert_eq!([shown(false), shown(true)], [[true, false], [true, true]]);
        assert_eq!(Sides::default(), Sides::of(false), "glTF's default");
    }
}
