//! Validation, normalisation, welding and removal of degenerate and duplicate triangles.

use super::{DecimateError, Options, Target};
use crate::Mesh;
use crate::weld::weld_within;
use glam::DVec3;
use photofit_scalar::Vec3f;

/// Most vertices and triangles, so that corners and flags fit 32 bits.
const LIMIT: usize = 1 << 29;

/// Most triangles around a vertex: far above the poles and caps of real meshes.
const HUB: u32 = 1024;
/// The same where each of them may have attributes of its own.
const HUB_WITH_ATTRIBUTES: u32 = 128;

/// A cleaned triangle soup in a unit frame.
#[derive(Debug)]
pub(super) struct Soup {
    /// Centre of the bounds, in the asset's units.
    pub(super) centre: DVec3,
    /// Length of the bounding diagonal, in the asset's units.
    pub(super) diagonal: f64,
    /// Distinct positions, centred and divided by the diagonal.
    pub(super) positions: Vec<DVec3>,
    /// An input vertex at each distinct position.
    pub(super) origin: Vec<u32>,
    /// Positions that stay, see [`Options::locked`].
    pub(super) locked: Vec<bool>,
    /// Triangles over the distinct positions.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Input triangle of each triangle.
    pub(super) source: Vec<u32>,
    /// Input triangles that were degenerate or duplicates.
    pub(super) cleaned: usize,
}

fn lengths(mesh: &Mesh, group: &[u32], importance: &[f32], options: &Options) -> Result<(), DecimateError> {
    let (v, t) = (mesh.positions.len(), mesh.triangles.len());
    if v > LIMIT || t > LIMIT {
        return Err(DecimateError::TooLarge);
    }
    if let Some((name, found)) = mesh.misfit() {
        return Err(DecimateError::Length { name, found, expected: v });
    }
    let arrays =
        [("locked", options.locked.len(), v), ("group", group.len(), t), ("importance", importance.len(), t)];
    for (name, found, expected) in arrays {
        if found != 0 && found != expected {
            return Err(DecimateError::Length { name, found, expected });
        }
    }
    Ok(())
}

fn numbers(options: &Options) -> Result<(), DecimateError> {
    let ok = |x: f64, name| if x.is_finite() && x >= 0.0 { Ok(()) } else { Err(DecimateError::Option(name)) };
    ok(options.normal_weight, "normal_weight")?;
    ok(options.uv_weight, "uv_weight")?;
    ok(options.border_weight, "border_weight")?;
    ok(options.seam_weight, "seam_weight")?;
    ok(options.group_weight, "group_weight")?;
    ok(options.area_weight, "area_weight")?;
    ok(options.regularity, "regularity")?;
    ok(options.pinch_weight, "pinch_weight")?;
    ok(options.removal_weight, "removal_weight")?;
    ok(options.thin_power, "thin_power")?;
    ok(options.min_compactness, "min_compactness")?;
    ok(options.merge_tolerance, "merge_tolerance")?;
    ok(options.max_error.unwrap_or(0.0), "max_error")?;
    if !(options.min_normal_cosine >= -1.0 && options.min_normal_cosine <= 1.0) {
        return Err(DecimateError::Option("min_normal_cosine"));
    }
    if options.merge_tolerance > 0.1 {
        return Err(DecimateError::Option("merge_tolerance"));
    }
    match options.target {
        Target::Triangles(0) => Err(DecimateError::ZeroBudget),
        Target::Triangles(_) => Ok(()),
        Target::Ratio(r) if r > 0.0 && r <= 1.0 => Ok(()),
        Target::Error(e) if e >= 0.0 && e.is_finite() => Ok(()),
        Target::ScreenSize(px) if px > 0.0 && px.is_finite() => Ok(()),
        _ => Err(DecimateError::Option("target")),
    }
}

/// Checks everything that the rest relies on.
pub(super) fn validate(
    mesh: &Mesh,
    group: &[u32],
    importance: &[f32],
    options: &Options,
) -> Result<(), DecimateError> {
    numbers(options)?;
    lengths(mesh, group, importance, options)?;
    if mesh.triangles.is_empty() {
        return Err(DecimateError::Empty);
    }
    if let Some(i) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(DecimateError::Position(i));
    }
    if options.keep_uvs {
        let bad = |name, i: Option<usize>| i.map_or(Ok(()), |i| Err(DecimateError::Attribute(name, i)));
        bad("normal", mesh.normals.iter().position(|p| !p.is_finite()))?;
        bad("uv", mesh.uvs.iter().position(|p| !p.is_finite()))?;
        bad("uv1", mesh.uvs1.iter().position(|p| !p.is_finite()))?;
        bad("color", mesh.colors.iter().position(|p| !p.is_finite()))?;
    }
    if let Some(i) = importance.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
        return Err(DecimateError::Importance(i));
    }
    let vertices = mesh.positions.len();
    for (triangle, t) in mesh.triangles.iter().enumerate() {
        if let Some(&vertex) = t.iter().find(|&&i| i as usize >= vertices) {
            return Err(DecimateError::Index { triangle, vertex, vertices });
        }
    }
    Ok(())
}

/// Welds and cleans; the mesh is valid.
pub(super) fn clean(mesh: &Mesh, group: &[u32], options: &Options) -> Result<Soup, DecimateError> {
    let point = |i: u32| {
        let p = mesh.positions[i as usize];
        DVec3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z))
    };
    let mut used = vec![u32::MAX; mesh.positions.len()];
    let mut origin = Vec::new();
    for &i in mesh.triangles.iter().flatten() {
        if used[i as usize] == u32::MAX {
            used[i as usize] = 0;
        }
    }
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for i in 0..used.len() as u32 {
        if used[i as usize] == 0 {
            used[i as usize] = origin.len() as u32;
            origin.push(i);
            (lo, hi) = (lo.min(point(i)), hi.max(point(i)));
        }
    }
    let (centre, diagonal) = ((lo + hi) * 0.5, (hi - lo).length());
    if diagonal <= 0.0 {
        return Err(DecimateError::Empty);
    }
    // The tolerance is capped where the diagonal is near the end of the number range.
    let tolerance = (options.merge_tolerance * diagonal).min(f64::from(f32::MAX)) as f32;
    let used_positions: Vec<Vec3f> = origin.iter().map(|&i| mesh.positions[i as usize]).collect();
    let map = weld_within(&used_positions, tolerance);
    let is_locked = |i: u32| options.locked.get(i as usize).copied().unwrap_or(false);
    let mut locked = vec![false; map.count()];
    let mut picked = map.pick(&origin);
    for (group, &i) in map.ids.iter().zip(&origin) {
        // A locked vertex stands for all that are welded to it.
        if is_locked(i) && !std::mem::replace(&mut locked[*group as usize], true) {
            picked[*group as usize] = i;
        }
    }
    let origin = picked;
    let positions = origin.iter().map(|&i| (point(i) - centre) / diagonal).collect();
    let double = |t: usize| {
        let g = group.get(t).copied().unwrap_or(0) as usize;
        options.double_sided.get(g).copied().unwrap_or(false)
    };
    let mut triangles: Vec<[u32; 3]> = mesh.triangles.clone();
    triangles.as_flattened_mut().iter_mut().for_each(|i| *i = map.ids[used[*i as usize] as usize]);
    let source = cleaned(&triangles, double);
    let triangles: Vec<[u32; 3]> = source.iter().map(|t| triangles[*t as usize]).collect();
    if triangles.is_empty() {
        return Err(DecimateError::Empty);
    }
    let cleaned = mesh.triangles.len() - triangles.len();
    let mut soup = Soup { centre, diagonal, positions, origin, locked, triangles, source, cleaned };
    split_hubs(&mut soup, if options.keep_uvs { HUB_WITH_ATTRIBUTES } else { HUB });
    Ok(soup)
}

/// Gives vertices with more than `most` triangles several copies, so that no step is slower than a constant.
fn split_hubs(soup: &mut Soup, most: u32) {
    let mut count = vec![0_u32; soup.positions.len()];
    let mut copy: Vec<u32> = (0..count.len() as u32).collect();
    for v in soup.triangles.iter_mut().flatten() {
        let hub = *v as usize;
        count[hub] += 1;
        if count[hub] > most {
            count[hub] = 1;
            copy[hub] = soup.positions.len() as u32;
            soup.positions.push(soup.positions[hub]);
            soup.origin.push(soup.origin[hub]);
            soup.locked.push(soup.locked[hub]);
        }
        *v = copy[hub];
    }
}

/// Sorted corners and whether the order is an odd permutation.
fn canonical(t: [u32; 3]) -> ([u32; 3], bool) {
    let mut s = t;
    s.sort_unstable();
    let even = s == t || s == [t[1], t[2], t[0]] || s == [t[2], t[0], t[1]];
    (s, !even)
}

/// The triangles over welded vertices that [`super::decimate`] takes, in their order: those of three corners that repeat no earlier
/// one of the same orientation, of any where they are seen from both sides (`double`, of an index).
///
/// ```
/// use photofit_geometry::decimate::cleaned;
/// let triangles = [[0, 1, 2], [2, 0, 1], [2, 1, 0], [0, 0, 1], [0, 2, 3]];
/// assert_eq!(cleaned(&triangles, |_| false), [0, 2, 4]);
/// assert_eq!(cleaned(&triangles, |_| true), [0, 4]);
/// ```
pub fn cleaned(triangles: &[[u32; 3]], double: impl Fn(usize) -> bool) -> Vec<u32> {
    let mut order: Vec<([u32; 3], bool, u32)> = triangles
        .iter()
        .enumerate()
        .filter(|(_, [a, b, c])| a != b && b != c && c != a)
        .map(|(k, &t)| {
            let (s, odd) = canonical(t);
            (s, odd && !double(k), k as u32)
        })
        .collect();
    order.sort_unstable();
    order.dedup_by_key(|(corners, odd, _)| (*corners, *odd));
    let mut kept: Vec<u32> = order.into_iter().map(|(.., k)| k).collect();
    kept.sort_unstable();
    kept
}
