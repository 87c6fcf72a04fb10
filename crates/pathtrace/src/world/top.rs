//! The upper level of the hierarchy: which structures a ray passes.

use super::instance::Inward;
use super::shape::{Kind, Stored};
use crate::PathtraceError;
use crate::world::instance::Placed;
use glam::{DAffine3, DVec3};
use photofit_rays::{Accel, BoxTree};
use photofit_scalar::Vec3f;
use std::sync::Arc;

/// Shapes placed once, or with no more triangles than this over all placements, are put into one structure.
const MERGED_TRIANGLES: usize = 4096;

/// Something that rays can meet.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) inward: Inward,
    pub(crate) kind: EntryKind,
}

/// What an entry holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EntryKind {
    /// Triangles of many instances in the render frame; [`Hierarchy::merged`] says whose.
    Merged,
    /// An instance of a structure.
    Mesh { accel: u32, instance: u32 },
    /// An instance of a sphere; the frame of the entry is that of the unit sphere.
    Sphere { instance: u32 },
    /// An instance of a grid of distances; the frame of the entry is that of its samples.
    DistanceGrid { instance: u32 },
}

/// All that rays can meet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Hierarchy {
    pub(crate) accels: Vec<Arc<Accel>>,
    pub(crate) entries: Vec<Entry>,
    /// Tree over the entries.
    pub(crate) tree: BoxTree,
    /// Instance and triangle of every triangle of the merged structure, which is the first one.
    pub(crate) merged: Vec<[u32; 2]>,
    /// The structure of each shape that has one of its own.
    accel_of: Vec<Option<u32>>,
    /// Structures that the last change built, without the tree over the entries.
    pub(crate) built: usize,
}

/// What an earlier hierarchy gives to a new one of the same instances.
pub(crate) struct Earlier<'a> {
    pub(crate) hierarchy: &'a Hierarchy,
    pub(crate) placed: &'a [Placed],
    /// Shapes that are others now.
    pub(crate) changed: &'a [usize],
}

impl Hierarchy {
    /// Builds all levels; `merge` puts shapes that are placed once into one structure. What an `earlier` hierarchy has that
    /// did not change is taken from it.
    pub(crate) fn build(
        shapes: &[Stored],
        placed: &[Placed],
        transforms: &[DAffine3],
        merge: bool,
        earlier: Option<&Earlier<'_>>,
    ) -> Result<Self, PathtraceError> {
        let mut uses = vec![0_usize; shapes.len()];
        placed.iter().for_each(|p| uses[p.shape as usize] += 1);
        let merged = |shape: usize| {
            let few = uses[shape].saturating_mul(shapes[shape].pieces()) <= MERGED_TRIANGLES;
            merge && (uses[shape] == 1 || few)
        };
        let mut out = Self { accel_of: vec![None; shapes.len()], ..Self::default() };
        let mut boxes = Vec::new();
        out.merge(shapes, placed, &merged, earlier, &mut boxes)?;
        for (i, (instance, transform)) in placed.iter().zip(transforms).enumerate() {
            let shape = &shapes[instance.shape as usize];
            match &shape.kind {
                Kind::Sphere { radius } => {
                    let unit = *transform * DAffine3::from_scale(DVec3::splat(f64::from(*radius)));
                    let kind = EntryKind::Sphere { instance: i as u32 };
                    out.entries.push(Entry { inward: Inward::new(&unit.inverse()), kind });
                }
                Kind::DistanceGrid { cells, .. } => {
                    let frame = DAffine3::from_scale(*cells) * transform.inverse();
                    let kind = EntryKind::DistanceGrid { instance: i as u32 };
                    out.entries.push(Entry { inward: Inward::new(&frame), kind });
                }
                Kind::Mesh(mesh) => {
                    if mesh.triangles.is_empty() || merged(instance.shape as usize) {
                        continue;
                    }
                    let shape = instance.shape as usize;
                    let accel = match out.accel_of[shape] {
                        Some(known) => known,
                        None => {
                            let accel = match earlier.and_then(|e| e.accel(shape)) {
                                Some(kept) => kept.clone(),
                                None => {
                                    out.built += 1;
                                    let built = Accel::build(&mesh.positions, &mesh.triangles);
                                    Arc::new(built.map_err(|cause| PathtraceError::Accel { shape, cause })?)
                                }
                            };
                            out.accels.push(accel);
                            *out.accel_of[shape].insert(out.accels.len() as u32 - 1)
                        }
                    };
                    let frame = out.accels[accel as usize].frame() * transform.inverse();
                    let kind = EntryKind::Mesh { accel, instance: i as u32 };
                    out.entries.push(Entry { inward: Inward::new(&frame), kind });
                }
            }
            boxes.push(moved_box(shape.bounds, transform));
        }
        out.tree = BoxTree::build(&boxes);
        Ok(out)
    }

    fn merge(
        &mut self,
        shapes: &[Stored],
        placed: &[Placed],
        merged: &impl Fn(usize) -> bool,
        earlier: Option<&Earlier<'_>>,
        boxes: &mut Vec<[DVec3; 2]>,
    ) -> Result<(), PathtraceError> {
        let meshes = || {
            placed.iter().enumerate().filter_map(|(i, instance)| {
                match &shapes[instance.shape as usize].kind {
                    Kind::Mesh(mesh) if merged(instance.shape as usize) => Some((i, instance, mesh)),
                    _ => None,
                }
            })
        };
        self.merged = meshes()
            .flat_map(|(i, _, mesh)| (0..mesh.triangles.len()).map(move |t| [i as u32, t as u32]))
            .collect();
        if self.merged.is_empty() {
            return Ok(());
        }
        let accel = match earlier.filter(|e| e.keeps_merged(placed, &self.merged)) {
            Some(earlier) => earlier.hierarchy.accels[0].clone(),
            None => {
                let (mut positions, mut triangles): (Vec<Vec3f>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
                for (_, instance, mesh) in meshes() {
                    let base = positions.len() as u32;
                    positions.extend(mesh.positions.iter().map(|&p| instance.point(p)));
                    triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|c| c + base)));
                }
                self.built += 1;
                let built = Accel::build(&positions, &triangles);
                Arc::new(built.map_err(|cause| PathtraceError::Accel { shape: 0, cause })?)
            }
        };
        let inward = Inward::new(&accel.frame());
        let (lo, hi) = accel.bounds();
        boxes.push([lo, hi]);
        self.accels.push(accel);
        self.entries.push(Entry { inward, kind: EntryKind::Merged });
        Ok(())
    }

    /// Bytes of the structures.
    pub(crate) fn bytes(&self) -> usize {
        self.accels.iter().map(|a| a.bytes()).sum::<usize>()
            + self.entries.len() * size_of::<Entry>()
            + self.tree.bytes()
            + size_of_val(self.merged.as_slice())
    }
}

impl Earlier<'_> {
    /// The structure of a shape, where it has one of its own and is what it was.
    fn accel(&self, shape: usize) -> Option<&Arc<Accel>> {
        let known = self.hierarchy.accel_of[shape].filter(|_| !self.changed.contains(&shape))?;
        Some(&self.hierarchy.accels[known as usize])
    }

    /// Whether the merged structure would be of these instances and triangles, and all of them are what and where they
    /// were.
    fn keeps_merged(&self, placed: &[Placed], merged: &[[u32; 2]]) -> bool {
        let same = |instance: usize| {
            let (now, before) = (&placed[instance], &self.placed[instance]);
            now.to_render == before.to_render && !self.changed.contains(&(now.shape as usize))
        };
        // Each instance begins with its first triangle.
        let mut instances = merged.iter().filter(|m| m[1] == 0).map(|m| m[0] as usize);
        self.hierarchy.merged == merged && instances.all(same)
    }
}

/// The box around a box under a transform.
pub(crate) fn moved_box([lo, hi]: [DVec3; 2], transform: &DAffine3) -> [DVec3; 2] {
    let mut out = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for corner in 0..8 {
        let pick = |k: usize| if corner >> k & 1 == 0 { lo[k] } else { hi[k] };
        let p = transform.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
        out = [out[0].min(p), out[1].max(p)];
    }
    out
}
