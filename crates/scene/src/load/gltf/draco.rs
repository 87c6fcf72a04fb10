//! Primitives that are compressed: `KHR_draco_mesh_compression`.

use super::accessor::{Need, Packed};
use super::document::Document;
use crate::error::{Fault, fault};
use crate::load::Budget;
use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, ErrorKind, Mesh, MeshDecoder, PointAttribute, PointIndex,
};
use gltf::json::accessor::ComponentType;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::{BTreeMap, HashMap};

/// What the typed document leaves out of a mesh.
#[derive(Debug, Deserialize)]
pub(super) struct RawMesh {
    #[serde(default)]
    pub(super) primitives: Vec<RawPrimitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct RawPrimitive {
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, usize>,
    /// What each morph target moves.
    pub(super) targets: Option<Vec<BTreeMap<String, IgnoredAny>>>,
    indices: Option<usize>,
    extensions: Option<PrimitiveExtensions>,
}

#[derive(Debug, Deserialize)]
struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    draco: Option<RawStream>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct RawStream {
    buffer_view: usize,
    attributes: BTreeMap<String, u32>,
}

/// The stream of a primitive.
#[derive(Clone, Debug)]
pub(super) struct Stream {
    view: usize,
    /// The accessor of each compressed attribute, and the attribute's id in the stream.
    attributes: Vec<(usize, u32)>,
    indices: Option<usize>,
}

/// The streams of all compressed primitives, by mesh and primitive.
pub(super) fn streams(meshes: &[RawMesh]) -> HashMap<(usize, usize), Stream> {
    let mut out = HashMap::new();
    for (m, mesh) in meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let Some(draco) = primitive.extensions.as_ref().and_then(|e| e.draco.as_ref()) else { continue };
            let of_accessor = |(name, id): (&String, &u32)| Some((*primitive.attributes.get(name)?, *id));
            let attributes = draco.attributes.iter().filter_map(of_accessor).collect();
            let stream = Stream { view: draco.buffer_view, attributes, indices: primitive.indices };
            out.insert((m, p), stream);
        }
    }
    out
}

/// The accessors of one primitive: what its stream holds, and the buffers for the rest.
pub(super) struct Elements<'a> {
    document: &'a Document<'a>,
    decoded: Option<Decoded>,
}

struct Decoded {
    mesh: Mesh,
    attributes: HashMap<usize, u32>,
}

impl<'a> Elements<'a> {
    /// Decodes the stream of primitive `p` of mesh `m` where it has one. Where the extension is not required and all
    /// accessors have bytes of their own, these are read: they are what was compressed.
    pub(super) fn of(
        document: &'a Document<'a>,
        m: usize,
        p: usize,
        place: &str,
        budget: &Budget<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Self, Fault> {
        let stream = document.streams.get(&(m, p));
        let stream = stream.filter(|s| document.draco_required || !s.has_fallback(document));
        let Some(stream) = stream else { return Ok(Self { document, decoded: None }) };
        let place = format!("{place} (Draco)");
        let bytes = document.view(stream.view, &place)?;
        let mesh = decode(bytes, document.limits.file_bytes, budget).map_err(|rule| fault(&*place, rule))?;
        let points = mesh.num_points();
        let mut claims = Vec::with_capacity(stream.attributes.len());
        for &(accessor, _) in &stream.attributes {
            claims.push((accessor, document.count(accessor, &place)?));
        }
        if let Some((accessor, claimed)) = claims.into_iter().find(|c| c.1 != points as u64) {
            warnings.push(format!(
                "{place}: accessor {accessor} has count {claimed}; the {points} vertices of the stream are read"
            ));
        }
        let attributes = stream.attributes.iter().copied().collect();
        Ok(Self { document, decoded: Some(Decoded { mesh, attributes }) })
    }

    /// Number of elements, not yet checked against their data.
    pub(super) fn count(&self, i: usize, user: &str) -> Result<u64, Fault> {
        match &self.decoded {
            Some(d) if d.attributes.contains_key(&i) => Ok(d.mesh.num_points() as u64),
            _ => self.document.count(i, user),
        }
    }

    /// Whether what is decoded holds the positions, whose number the budget is asked for; true where nothing is.
    pub(super) fn holds(&self, positions: usize) -> bool {
        self.decoded.as_ref().is_none_or(|d| d.attributes.contains_key(&positions))
    }

    /// As [`Document::components`].
    pub(super) fn components(&self, i: usize, user: &str) -> Result<usize, Fault> {
        self.document.components(i, user)
    }

    /// As [`Document::floats`].
    pub(super) fn floats<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
    ) -> Result<Vec<[f32; N]>, Fault> {
        match self.packed(i, user)? {
            Some(packed) => self.document.packed_floats(i, user, need, &packed),
            None => self.document.floats(i, user, need),
        }
    }

    /// As [`Document::integers`].
    pub(super) fn integers<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
    ) -> Result<Vec<[u32; N]>, Fault> {
        match self.packed(i, user)? {
            Some(packed) => self.document.packed_integers(i, user, need, &packed),
            None => self.document.integers(i, user, need),
        }
    }

    /// The triangles of the stream, of as many vertices.
    pub(super) fn triangles(&self, vertices: usize, user: &str) -> Result<Option<Vec<[u32; 3]>>, Fault> {
        let Some(decoded) = &self.decoded else { return Ok(None) };
        let triangles: Vec<[u32; 3]> = decoded.mesh.faces().iter().map(|f| f.map(|i| i.0)).collect();
        match triangles.as_flattened().iter().find(|i| **i as usize >= vertices) {
            Some(i) => {
                let rule = format!("the stream names vertex {i}; it must be below the {vertices} vertices");
                Err(fault(user, rule))
            }
            None => Ok(Some(triangles)),
        }
    }

    /// The elements of accessor `i` where they are in the stream.
    fn packed(&self, i: usize, user: &str) -> Result<Option<Packed>, Fault> {
        let Some(decoded) = &self.decoded else { return Ok(None) };
        let Some(&id) = decoded.attributes.get(&i) else { return Ok(None) };
        let place = || format!("accessor {i} ({user}, Draco)");
        let attribute = decoded.mesh.attribute_by_unique_id(id);
        let attribute =
            attribute.ok_or_else(|| fault(place(), format!("the stream has no attribute {id}; it must")))?;
        let (width, component) = (self.document.components(i, user)?, self.document.component(i, user)?);
        if usize::from(attribute.num_components()) != width {
            let rule = format!(
                "the stream has {} components per element; it must have {width} as the accessor",
                attribute.num_components()
            );
            return Err(fault(place(), rule));
        }
        let count = decoded.mesh.num_points();
        let bytes = pack(attribute, count, component).map_err(|rule| fault(place(), rule))?;
        if count > 0 && bytes.is_empty() {
            return Err(fault(place(), "the stream has no bytes for it; it must"));
        }
        Ok(Some(Packed { count, bytes }))
    }
}

impl Stream {
    /// Whether everything that is compressed is there without compression too.
    fn has_fallback(&self, document: &Document<'_>) -> bool {
        let plain = |i: usize| document.root.accessors.get(i).is_some_and(|a| a.buffer_view.is_some());
        self.attributes.iter().map(|a| a.0).chain(self.indices).all(plain)
    }
}

/// The mesh of a stream within what is left of the budget, its attributes within `most` bytes.
fn decode(bytes: &[u8], most: u64, budget: &Budget<'_>) -> Result<Mesh, String> {
    let (vertices, triangles) = budget.left();
    let limits = DecodeLimits::default()
        .with_max_points(vertices as u64)
        .with_max_faces(triangles as u64)
        .with_max_decoded_bytes(most);
    let mut mesh = Mesh::new();
    let decoded = MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh);
    match decoded {
        Ok(()) => Ok(mesh),
        Err(e) if e.kind() == ErrorKind::LimitExceeded => Err(format!(
            "the stream is too large ({}); there may be {vertices} vertices, {triangles} triangles and {most} bytes more",
            e.message()
        )),
        Err(e) => Err(format!("the stream cannot be decoded ({e}); it must be a triangle mesh of Draco 2.2")),
    }
}

/// The values of all points, one after the other, as components of this type.
fn pack(attribute: &PointAttribute, points: usize, component: ComponentType) -> Result<Vec<u8>, String> {
    let kind = attribute.data_type();
    let (size, width) = (kind.byte_length(), usize::from(attribute.num_components()));
    let stride = usize::try_from(attribute.byte_stride()).unwrap_or(usize::MAX);
    let data = attribute.buffer().data();
    let same = matches!(
        (kind, component),
        (DataType::Float32, ComponentType::F32)
            | (DataType::Int8, ComponentType::I8)
            | (DataType::Uint8 | DataType::Bool, ComponentType::U8)
            | (DataType::Int16, ComponentType::I16)
            | (DataType::Uint16, ComponentType::U16)
            | (DataType::Uint32, ComponentType::U32)
    );
    let mut out = Vec::with_capacity(points * width * component.size());
    for p in 0..points {
        let value = attribute.mapped_index(PointIndex(p as u32)).0 as usize;
        let element = value.checked_mul(stride).and_then(|at| data.get(at..)?.get(..size * width));
        let element = element.ok_or_else(|| format!("vertex {p} has no value in the stream; it must"))?;
        if same {
            out.extend_from_slice(element);
            continue;
        }
        for scalar in element.chunks_exact(size.max(1)) {
            let number = number(kind, scalar, attribute.normalized());
            write(number, component, &mut out).map_err(|what| {
                format!("vertex {p} of the stream has {what}; it must fit the accessor's componentType")
            })?;
        }
    }
    Ok(out)
}

/// A component of a stream.
enum Number {
    Integer {
        value: i128,
        /// What stands for 1 in floats.
        one: f64,
    },
    Float(f64),
}

fn number(kind: DataType, bytes: &[u8], normalized: bool) -> Number {
    // The bytes of an integer, extended by its sign.
    let integer = |signed: bool| {
        let negative = signed && bytes.last().is_some_and(|b| b & 0x80 != 0);
        let mut all = [if negative { 0xff } else { 0 }; 16];
        all[..bytes.len()].copy_from_slice(bytes);
        let bits = 8 * bytes.len() as i32 - i32::from(signed);
        let one = if normalized { 2_f64.powi(bits) - 1.0 } else { 1.0 };
        Number::Integer { value: i128::from_le_bytes(all), one }
    };
    match kind {
        DataType::Int8 | DataType::Int16 | DataType::Int32 | DataType::Int64 => integer(true),
        DataType::Float32 => Number::Float(bytes.try_into().map_or(0.0, f32::from_le_bytes).into()),
        DataType::Float64 => Number::Float(bytes.try_into().map_or(0.0, f64::from_le_bytes)),
        _ => integer(false),
    }
}

/// Appends a number; what it is where it does not fit.
fn write(number: Number, component: ComponentType, out: &mut Vec<u8>) -> Result<(), String> {
    let value = match (number, component) {
        (Number::Integer { value, one }, ComponentType::F32) => {
            out.extend(((value as f64 / one) as f32).to_le_bytes());
            return Ok(());
        }
        (Number::Float(x), ComponentType::F32) => {
            out.extend((x as f32).to_le_bytes());
            return Ok(());
        }
        (Number::Float(x), _) => return Err(format!("the number {x}, which is no integer type,")),
        (Number::Integer { value, .. }, _) => value,
    };
    let range = match component {
        ComponentType::I8 => i128::from(i8::MIN)..=i128::from(i8::MAX),
        ComponentType::I16 => i128::from(i16::MIN)..=i128::from(i16::MAX),
        ComponentType::U8 => 0..=i128::from(u8::MAX),
        ComponentType::U16 => 0..=i128::from(u16::MAX),
        ComponentType::U32 | ComponentType::F32 => 0..=i128::from(u32::MAX),
    };
    if !range.contains(&value) {
        return Err(format!("the number {value}"));
    }
    out.extend_from_slice(&value.to_le_bytes()[..component.size()]);
    Ok(())
}
