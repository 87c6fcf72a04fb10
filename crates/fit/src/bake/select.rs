//! Which place of the reference a point of the target stands for.

use super::BakeClass;
use super::reference::{ReferenceSurface, SurfacePoint};
use super::target::Point;
use crate::visibility::Visibility;
use photofit_rays::{NearestPoint, Ray};
use photofit_shading::Sides;

/// Cosine between the normals of target and reference below which the closest point is not taken.
const LEAST_COSINE: f32 = 0.1;

/// Chooses among the surfaces near a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Selector<'a> {
    pub(super) reference: &'a ReferenceSurface<'a>,
    pub(super) visibility: &'a Visibility,
    /// Largest distance to look, in the asset's units.
    pub(super) limit: f32,
}

/// How a place was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Ray,
    FarRay,
    ClosestPoint,
    Hidden,
}

/// A chosen place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pick {
    pub(super) place: SurfacePoint,
    /// The counter-clockwise side faces the target's normal.
    pub(super) front: bool,
    /// Distance from the point, in the asset's units.
    pub(super) distance: f32,
    pub(super) found: Found,
}

/// Answer of [`Selector::choose`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Choice {
    Surface(Pick),
    /// Only cut-out parts of alpha masks lie there.
    Cut,
    Nothing,
}

/// The best candidates along a line.
#[derive(Clone, Copy, Debug, Default)]
struct Along {
    visible: Option<(f32, SurfacePoint, bool)>,
    hidden: Option<(f32, SurfacePoint, bool)>,
    cut: bool,
}

impl Selector<'_> {
    /// The place for `point`, first looked for within `cage`.
    pub(super) fn choose(&self, point: &Point, cage: f32, class: Option<BakeClass>) -> Choice {
        let near = self.along(point, cage.min(self.limit), class);
        if let Some(pick) = near.visible {
            return surface(pick, Found::Ray);
        }
        let far = if cage < self.limit { self.along(point, self.limit, class) } else { near };
        // A hole of a mask nearby counts more than some other surface far away.
        if near.cut || (far.cut && far.visible.is_none()) {
            return Choice::Cut;
        }
        let nearest = self.reference.accel().closest_point_where(point.position, self.limit, |candidate| {
            self.suits(point, candidate, class, LEAST_COSINE)
        });
        match (far.visible, nearest) {
            // Past a silhouette the line may go on to another layer: the closest point is then much nearer.
            (Some(pick), n) if n.is_none_or(|n| pick.0 <= 2.0 * n.distance) => surface(pick, Found::FarRay),
            (_, Some(n)) => {
                let front = self.reference.area_normal(n.triangle).dot(point.normal) > 0.0;
                surface((n.distance, n.into(), front), Found::ClosestPoint)
            }
            _ => far.hidden.map_or(Choice::Nothing, |pick| surface(pick, Found::Hidden)),
        }
    }

    /// Distance from `point` to the nearest visible surface that faces the same way.
    pub(super) fn distance(&self, point: &Point) -> Option<f32> {
        let suits = |c: &NearestPoint| self.suits(point, c, None, 0.5);
        self.reference.accel().closest_point_where(point.position, self.limit, suits).map(|n| n.distance)
    }

    /// The nearest candidates on the line through `point` along its normal, up to `reach` on either side.
    fn along(&self, point: &Point, reach: f32, class: Option<BakeClass>) -> Along {
        let mut along = Along::default();
        let ray = Ray::new(point.position + point.normal * reach, -point.normal).within(0.0, 2.0 * reach);
        self.reference.accel().for_each_hit(&ray, |hit| {
            let place = SurfacePoint::from(&hit);
            if !self.drawn(hit.triangle, hit.front) || !self.in_class(hit.triangle, class) {
                return;
            }
            let distance = (reach - hit.t).abs();
            let visible = self.visibility.is_side_visible(hit.triangle as usize, hit.front);
            let slot = if visible { along.visible } else { along.hidden };
            // Equal distances: the lower triangle, so that the order of the hits does not matter.
            let better =
                slot.is_none_or(|(d, p, _)| distance < d || (distance <= d && place.triangle < p.triangle));
            if self.reference.is_cut(&place) {
                along.cut = true;
            } else if better {
                let slot = if visible { &mut along.visible } else { &mut along.hidden };
                *slot = Some((distance, place, hit.front));
            }
        });
        along
    }

    fn suits(&self, point: &Point, c: &NearestPoint, class: Option<BakeClass>, least_cosine: f32) -> bool {
        let normal = self.reference.area_normal(c.triangle);
        let cosine = normal.dot(point.normal);
        let front = cosine > 0.0;
        cosine.abs() > least_cosine * normal.length()
            && self.drawn(c.triangle, front)
            && self.visibility.is_side_visible(c.triangle as usize, front)
            && self.in_class(c.triangle, class)
            && !self.reference.is_cut(&(*c).into())
    }

    /// True when the given side of a triangle is drawn.
    fn drawn(&self, triangle: u32, front: bool) -> bool {
        Sides::of(self.reference.material(triangle).double_sided).shows(front)
    }

    fn in_class(&self, triangle: u32, class: Option<BakeClass>) -> bool {
        class.is_none_or(|c| c == self.reference.class(triangle))
    }
}

impl From<NearestPoint> for SurfacePoint {
    fn from(n: NearestPoint) -> Self {
        Self { triangle: n.triangle, u: n.u, v: n.v }
    }
}

fn surface((distance, place, front): (f32, SurfacePoint, bool), found: Found) -> Choice {
    Choice::Surface(Pick { place, front, distance, found })
}
