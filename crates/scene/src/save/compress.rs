//! Compressed geometry: `EXT_meshopt_compression` with `KHR_mesh_quantization`.
//!
//! Positions, texture coordinates, colours and morph targets stay floats, on a grid of a power of two: nodes, skins and
//! animations mean the same as without compression. Normals and tangents become integers. Everything else is kept bit by bit.

use super::{VERTICES, Writer};
use crate::meshopt::{Filter, encode_triangles, encode_vertices, exponential, octahedral};
use photofit_geometry::Mesh;
use serde_json::json;

/// How geometry is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Compression {
    /// As it is, for every reader.
    #[default]
    None,
    /// `EXT_meshopt_compression`, which a reader must know (three.js, Babylon.js, Godot and others do): a fraction of the
    /// bytes.
    Meshopt(Precision),
}

/// How compressed geometry is rounded: positions relative to the size of the smallest part (2^-22 of the largest coordinate at
/// least).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Precision {
    /// Positions and texture coordinates to 2^-15, colours and directions of morph targets to 2^-12, directions to .06 degrees.
    #[default]
    Fine,
    /// Positions to 2^-14, texture coordinates to 2^-12, colours and directions of morph targets to 2^-10, directions to 1.3
    /// degrees (.4 in the middle): about a sixth fewer bytes of positions, normals and indices.
    Medium,
    /// As [`Self::Medium`], but positions to 2^-13: what other tools write unless they are told otherwise lies between both
    /// (`gltfpack -vp 14 -vt 12 -vn 8`).
    Coarse,
}

/// Steps and bits of a precision.
#[derive(Clone, Copy)]
struct Steps {
    /// Steps of a position over the extent of the smallest mesh: at least two to this power.
    position: i32,
    /// Steps of a texture coordinate per unit, and over the extent: at least two to these powers.
    coordinate: [i32; 2],
    /// Steps of a colour, or of a morph target's normal, per unit: two to this power.
    unit: i32,
    /// Significant bits of a component of a projected direction.
    direction: u32,
}

impl Precision {
    fn steps(self) -> Steps {
        match self {
            Self::Fine => Steps { position: 15, coordinate: [15, 15], unit: 12, direction: 12 },
            Self::Medium => Steps { position: 14, coordinate: [12, 11], unit: 10, direction: 8 },
            Self::Coarse => Steps { position: 13, coordinate: [12, 11], unit: 10, direction: 8 },
        }
    }
}

impl Compression {
    /// Its name in options and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Meshopt(Precision::Fine) => "meshopt",
            Self::Meshopt(Precision::Medium) => "meshopt-medium",
            Self::Meshopt(Precision::Coarse) => "meshopt-coarse",
        }
    }

    fn steps(self) -> Option<Steps> {
        match self {
            Self::None => None,
            Self::Meshopt(precision) => Some(precision.steps()),
        }
    }
}

const EXTENSION: &str = "EXT_meshopt_compression";

/// How floats are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rounding {
    /// Positions: on the grid of the whole asset, so that borders that parts share stay shared.
    Position,
    /// Texture coordinates: finer where their extent is small.
    Coordinate,
    /// Relative to one.
    Unit,
}

impl Writer {
    /// An empty file for `meshes`.
    pub(super) fn new<'a>(compression: Compression, meshes: impl Iterator<Item = &'a Mesh> + Clone) -> Self {
        let grid = compression.steps().map_or(0, |steps| position_grid(meshes, steps.position));
        Self { compression, grid, ..Self::default() }
    }

    /// Appends a stream; the index of the view of its `count` elements of `stride` bytes.
    fn stream(
        &mut self,
        stream: &[u8],
        mode: &str,
        filter: Filter,
        (count, stride): (usize, usize),
        target: Option<u32>,
    ) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let bytes = count * stride;
        let mut meshopt = json!({
            "buffer": 0,
            "byteOffset": self.binary.len(),
            "byteLength": stream.len(),
            "byteStride": stride,
            "count": count,
            "mode": mode,
        });
        if filter != Filter::None {
            meshopt["filter"] = json!(filter.name());
        }
        let mut view = json!({
            "buffer": 1,
            "byteOffset": self.decoded,
            "byteLength": bytes,
            "extensions": {EXTENSION: meshopt},
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        // Only vertex attributes may have a stride.
        if target == Some(VERTICES) {
            view["byteStride"] = json!(stride);
        }
        self.decoded += bytes.next_multiple_of(4);
        self.binary.extend_from_slice(stream);
        self.extensions.insert(EXTENSION);
        self.required.insert(EXTENSION);
        self.views.push(view);
        self.views.len() - 1
    }

    /// The view of elements of `stride` bytes, compressed without loss where that takes fewer bytes.
    pub(super) fn lossless(&mut self, bytes: &[u8], stride: usize, target: Option<u32>) -> usize {
        if self.compression != Compression::None && stride.is_multiple_of(4) && !bytes.is_empty() {
            let stream = encode_vertices(bytes, stride);
            if stream.len() < bytes.len() {
                let shape = (bytes.len() / stride, stride);
                return self.stream(&stream, "ATTRIBUTES", Filter::None, shape, target);
            }
        }
        self.view(bytes, target)
    }

    /// The accessor of vertices with `components` floats, and the floats that a reader will see.
    pub(super) fn rounded(
        &mut self,
        values: &[f32],
        components: usize,
        rounding: Rounding,
    ) -> (usize, Vec<f32>) {
        let Some(steps) = self.compression.steps() else {
            return (self.floats(values, components, Some(VERTICES)), values.to_vec());
        };
        let exponent = match rounding {
            Rounding::Position => self.grid,
            Rounding::Coordinate => {
                let [per_unit, over_extent] = steps.coordinate;
                extent_exponent(values, components, over_extent).min(-per_unit)
            }
            Rounding::Unit => -steps.unit,
        };
        let exponent = reachable(exponent, values);
        let (stored, meant) = exponential(values, exponent);
        let (count, stride) = (values.len() / components, 4 * components);
        let stream = encode_vertices(&stored, stride);
        let view = self.stream(&stream, "ATTRIBUTES", Filter::Exponential, (count, stride), Some(VERTICES));
        (self.accessor_of(view, 5126, count, components), meant)
    }

    /// The accessor of unit vectors of three components, or of four, the last of which is 1 or -1.
    pub(super) fn directions(&mut self, vectors: &[[f32; 4]], components: usize) -> usize {
        let Some(steps) = self.compression.steps() else {
            let values: Vec<f32> = vectors.iter().flat_map(|v| v[..components].to_vec()).collect();
            return self.floats(&values, components, Some(VERTICES));
        };
        let (stride, component) = if steps.direction > 8 { (8, 5122) } else { (4, 5120) };
        let stream = encode_vertices(&octahedral(vectors, steps.direction), stride);
        let shape = (vectors.len(), stride);
        let view = self.stream(&stream, "ATTRIBUTES", Filter::Octahedral, shape, Some(VERTICES));
        let accessor = self.accessor_of(view, component, vectors.len(), components);
        self.accessors[accessor]["normalized"] = json!(true);
        self.extensions.insert("KHR_mesh_quantization");
        self.required.insert("KHR_mesh_quantization");
        accessor
    }

    /// The accessor of the indices of triangles, which have `size` bytes each.
    pub(super) fn compressed_indices(
        &mut self,
        triangles: &[[u32; 3]],
        component: u32,
        size: usize,
    ) -> usize {
        let shape = (3 * triangles.len(), size);
        let stream = encode_triangles(triangles);
        let view = self.stream(&stream, "TRIANGLES", Filter::None, shape, Some(super::INDICES));
        self.accessor_of(view, component, shape.0, 1)
    }
}

/// The power of two that is at least |x|, as an exponent; a small one for zero.
fn above(x: f32) -> i32 {
    if x == 0.0 { -90 } else { (x.abs().to_bits() >> 23) as i32 - 126 }
}

/// A grid that the mantissas of 24 bits reach.
fn reachable(exponent: i32, values: &[f32]) -> i32 {
    let largest = values.iter().fold(0.0_f32, |a, x| a.max(x.abs()));
    exponent.max(above(largest) - 22).clamp(-112, 106)
}

/// The grid of the positions of all `meshes`, two to the power of `steps` over the smallest one, as far as the largest coordinate
/// reaches it.
fn position_grid<'a>(meshes: impl Iterator<Item = &'a Mesh> + Clone, steps: i32) -> i32 {
    let positions = meshes.filter(|m| !m.positions.is_empty()).map(|m| bytemuck::cast_slice(&m.positions));
    let finest = positions.clone().map(|p| extent_exponent(p, 3, steps)).min().unwrap_or(-steps);
    positions.fold(finest, reachable)
}

/// The grid of values by their extent, the same for all components; not finer than they reach.
fn extent_exponent(values: &[f32], components: usize, steps: i32) -> i32 {
    let mut extent = 0.0_f32;
    for k in 0..components {
        let column = values.iter().skip(k).step_by(components);
        let (lo, hi) = column.fold((f32::MAX, f32::MIN), |(lo, hi), x| (lo.min(*x), hi.max(*x)));
        extent = extent.max((hi / 2.0 - lo / 2.0).abs());
    }
    // Half the extent is at least 2^(above - 1).
    reachable(above(extent) - steps, values)
}
