//! Reading accessors: any component type, interleaved, sparse; everything checked before memory is taken.

use super::document::Document;
use crate::error::{Fault, fault};
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

/// The layout of an accessor.
#[derive(Clone, Copy, Debug)]
struct Layout {
    component: ComponentType,
    components: usize,
    normalized: bool,
    count: usize,
}

impl Layout {
    fn element(&self) -> usize {
        self.component.size() * self.components
    }
}

/// The elements of an accessor that is compressed, one after the other, in its component type.
pub(super) struct Packed {
    pub(super) count: usize,
    pub(super) bytes: Vec<u8>,
}

/// How many elements a user of an accessor needs.
#[derive(Clone, Copy, Debug)]
pub(super) enum Need {
    /// All that there are.
    All,
    /// As many as there are positions, no more and no less.
    Exactly(usize),
    /// The first ones; there may be more.
    First(usize),
}

impl Need {
    fn check(self, layout: &mut Layout, place: &dyn Fn() -> String) -> Result<(), Fault> {
        match self {
            Self::Exactly(n) if n != layout.count => Err(fault(
                place(),
                format!("has count {}; it must have count {n} as the positions", layout.count),
            )),
            Self::First(n) if n > layout.count => {
                Err(fault(place(), format!("has count {}; count must be at least {n}", layout.count)))
            }
            Self::First(n) => {
                layout.count = n;
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl Document<'_> {
    fn accessor(&self, i: usize, user: &str) -> Result<(&Accessor, Layout), Fault> {
        let count = self.root.accessors.len();
        let accessor = self
            .root
            .accessors
            .get(i)
            .ok_or_else(|| fault(user, format!("names accessor {i}; there are {count} accessors")))?;
        let place = || format!("accessor {i} ({user})");
        let Checked::Valid(component) = accessor.component_type else {
            return Err(fault(
                place(),
                "has an unknown componentType; it must be 5120, 5121, 5122, 5123, 5125 or 5126",
            ));
        };
        let Checked::Valid(kind) = accessor.type_ else {
            return Err(fault(
                place(),
                "has another type than it may; type must be SCALAR, VEC2, VEC3, VEC4 or MAT4",
            ));
        };
        if matches!(kind, Type::Mat2 | Type::Mat3) {
            return Err(fault(
                place(),
                "has another type than it may; type must be SCALAR, VEC2, VEC3, VEC4 or MAT4",
            ));
        }
        let layout = Layout {
            component: component.0,
            components: kind.multiplicity(),
            normalized: accessor.normalized,
            count: usize::try_from(accessor.count.0).unwrap_or(usize::MAX),
        };
        Ok((accessor, layout))
    }

    /// Number of elements that an accessor claims, not yet checked against its data.
    pub(super) fn count(&self, i: usize, user: &str) -> Result<u64, Fault> {
        Ok(self.accessor(i, user)?.0.count.0)
    }

    /// Number of components per element: 1 to 4, or 16.
    pub(super) fn components(&self, i: usize, user: &str) -> Result<usize, Fault> {
        Ok(self.accessor(i, user)?.1.components)
    }

    /// Type of its components.
    pub(super) fn component(&self, i: usize, user: &str) -> Result<ComponentType, Fault> {
        Ok(self.accessor(i, user)?.1.component)
    }

    /// An accessor of `N` components per element.
    fn accessor_of<const N: usize>(&self, i: usize, user: &str) -> Result<(&Accessor, Layout), Fault> {
        let (accessor, layout) = self.accessor(i, user)?;
        if layout.components != N {
            return Err(fault(
                format!("accessor {i} ({user})"),
                format!("has {} components per element; it must have {N} components", layout.components),
            ));
        }
        Ok((accessor, layout))
    }

    /// Elements of `N` floats; normalized integers become fractions.
    pub(super) fn floats<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
    ) -> Result<Vec<[f32; N]>, Fault> {
        let (accessor, mut layout) = self.accessor_of::<N>(i, user)?;
        let place = || format!("accessor {i} ({user})");
        need.check(&mut layout, &place)?;
        self.check_count(accessor, &layout, &place)?;
        let mut out = vec![[0.0; N]; layout.count];
        if let Some((data, stride)) = self.data(accessor, &layout, &place)? {
            read_floats(data, stride, &layout, out.iter_mut());
        }
        if let Some(sparse) = self.sparse(accessor, &layout, &place)? {
            for (k, &at) in sparse.indices.iter().enumerate().take_while(|i| *i.1 < layout.count) {
                let from = &sparse.values[k * layout.element()..];
                read_floats(from, layout.element(), &layout, std::iter::once(&mut out[at]));
            }
        }
        Ok(out)
    }

    /// Elements of `N` unsigned integers.
    pub(super) fn integers<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
    ) -> Result<Vec<[u32; N]>, Fault> {
        let (accessor, mut layout) = self.accessor_of::<N>(i, user)?;
        let place = || format!("accessor {i} ({user})");
        check_unsigned(&layout, &place)?;
        need.check(&mut layout, &place)?;
        self.check_count(accessor, &layout, &place)?;
        let mut out = vec![[0; N]; layout.count];
        if let Some((data, stride)) = self.data(accessor, &layout, &place)? {
            read_integers(data, stride, layout.component, out.iter_mut());
        }
        if let Some(sparse) = self.sparse(accessor, &layout, &place)? {
            for (k, &at) in sparse.indices.iter().enumerate().take_while(|i| *i.1 < layout.count) {
                let from = &sparse.values[k * layout.element()..];
                read_integers(from, layout.element(), layout.component, std::iter::once(&mut out[at]));
            }
        }
        Ok(out)
    }

    /// As [`Self::floats`], of elements that were compressed.
    pub(super) fn packed_floats<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
        packed: &Packed,
    ) -> Result<Vec<[f32; N]>, Fault> {
        let layout = self.packed_layout::<N>(i, user, need, packed)?;
        let mut out = vec![[0.0; N]; layout.count];
        read_floats(&packed.bytes, layout.element(), &layout, out.iter_mut());
        Ok(out)
    }

    /// As [`Self::integers`], of elements that were compressed.
    pub(super) fn packed_integers<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
        packed: &Packed,
    ) -> Result<Vec<[u32; N]>, Fault> {
        let layout = self.packed_layout::<N>(i, user, need, packed)?;
        check_unsigned(&layout, &|| format!("accessor {i} ({user})"))?;
        let mut out = vec![[0; N]; layout.count];
        read_integers(&packed.bytes, layout.element(), layout.component, out.iter_mut());
        Ok(out)
    }

    fn packed_layout<const N: usize>(
        &self,
        i: usize,
        user: &str,
        need: Need,
        packed: &Packed,
    ) -> Result<Layout, Fault> {
        let (accessor, mut layout) = self.accessor_of::<N>(i, user)?;
        let place = || format!("accessor {i} ({user})");
        if accessor.sparse.is_some() {
            return Err(fault(place(), "has sparse values and compressed ones; it must have one of them"));
        }
        layout.count = packed.count;
        need.check(&mut layout, &place)?;
        Ok(layout)
    }

    /// Bounds accessors without data of their own, whose count nothing else limits.
    fn check_count(
        &self,
        accessor: &Accessor,
        layout: &Layout,
        place: &dyn Fn() -> String,
    ) -> Result<(), Fault> {
        let most = self.limits.vertices.max(self.limits.triangles.saturating_mul(3));
        if accessor.buffer_view.is_none() && layout.count > most {
            return Err(fault(place(), format!("has count {}; count must be at most {most}", layout.count)));
        }
        Ok(())
    }

    /// The bytes from the first element on, and the stride.
    fn data(
        &self,
        accessor: &Accessor,
        layout: &Layout,
        place: &dyn Fn() -> String,
    ) -> Result<Option<(&[u8], usize)>, Fault> {
        let Some(view) = accessor.buffer_view.map(|v| v.value()) else { return Ok(None) };
        let bytes = self.view(view, &place())?;
        let stride = self.root.buffer_views[view].byte_stride.map_or(0, |s| s.0);
        let stride = if stride == 0 { layout.element() } else { stride };
        if stride < layout.element() {
            let rule = format!(
                "byteStride {stride} of bufferView {view} is too small; it must be at least {}",
                layout.element()
            );
            return Err(fault(place(), rule));
        }
        let offset = accessor.byte_offset.map_or(0, |o| o.0);
        let needed = match layout.count {
            0 => Some(0),
            n => {
                (n as u64 - 1).checked_mul(stride as u64).and_then(|b| b.checked_add(layout.element() as u64))
            }
        };
        match needed.and_then(|n| n.checked_add(offset)) {
            Some(end) if end <= bytes.len() as u64 => Ok(Some((&bytes[offset as usize..], stride))),
            _ => Err(fault(
                place(),
                format!(
                    "{} elements at byteOffset {offset} do not fit into the {} bytes of bufferView {view}; they must",
                    layout.count,
                    bytes.len()
                ),
            )),
        }
    }

    fn sparse(
        &self,
        accessor: &Accessor,
        layout: &Layout,
        place: &dyn Fn() -> String,
    ) -> Result<Option<Sparse<'_>>, Fault> {
        let Some(sparse) = &accessor.sparse else { return Ok(None) };
        let elements = accessor.count.0;
        if sparse.count.0 > elements {
            let rule =
                format!("sparse.count {} is too large; it must be at most count {elements}", sparse.count.0);
            return Err(fault(place(), rule));
        }
        let count = sparse.count.0 as usize;
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(fault(
                place(),
                "sparse.indices.componentType is unknown; it must be 5121, 5123 or 5125",
            ));
        };
        let part = |view: usize, offset: u64, size: usize, what: &str| {
            let bytes = self.view(view, &place())?;
            // Cannot overflow: count is at most the count of an accessor whose data fits, or the limit.
            let end = (count as u64 * size as u64).checked_add(offset);
            match end {
                Some(end) if end <= bytes.len() as u64 => Ok(&bytes[offset as usize..end as usize]),
                _ => Err(fault(
                    place(),
                    format!(
                        "{count} sparse {what} do not fit into the {} bytes of bufferView {view}; they must",
                        bytes.len()
                    ),
                )),
            }
        };
        let values =
            part(sparse.values.buffer_view.value(), sparse.values.byte_offset.0, layout.element(), "values")?;
        let size = component.0.size();
        let raw = part(sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0, size, "indices")?;
        let mut indices = vec![[0_u32; 1]; count];
        read_integers(raw, size, component.0, indices.iter_mut());
        let indices: Vec<usize> = indices.into_iter().map(|[i]| i as usize).collect();
        let rising = indices.windows(2).all(|w| w[0] < w[1]);
        if !rising || indices.last().is_some_and(|&i| i as u64 >= elements) {
            let rule = format!(
                "sparse indices do not rise; they must rise strictly and stay below count {elements}"
            );
            return Err(fault(place(), rule));
        }
        Ok(Some(Sparse { indices, values }))
    }
}

/// Integers that count or name something have no sign.
fn check_unsigned(layout: &Layout, place: &dyn Fn() -> String) -> Result<(), Fault> {
    if matches!(layout.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
        return Ok(());
    }
    Err(fault(place(), "has signed or floating components; it must have unsigned integer components"))
}

struct Sparse<'a> {
    indices: Vec<usize>,
    values: &'a [u8],
}

fn read_floats<'o, const N: usize>(
    data: &[u8],
    stride: usize,
    layout: &Layout,
    out: impl Iterator<Item = &'o mut [f32; N]>,
) {
    fn run<'o, const N: usize, const S: usize>(
        data: &[u8],
        stride: usize,
        out: impl Iterator<Item = &'o mut [f32; N]>,
        convert: impl Fn([u8; S]) -> f32,
    ) {
        for (i, element) in out.enumerate() {
            let from = &data[i * stride..i * stride + N * S];
            for (value, bytes) in element.iter_mut().zip(from.as_chunks::<S>().0) {
                *value = convert(*bytes);
            }
        }
    }
    let n = layout.normalized;
    match layout.component {
        ComponentType::F32 => run(data, stride, out, f32::from_le_bytes),
        ComponentType::U8 => run(data, stride, out, |[b]| f32::from(b) / if n { 255.0 } else { 1.0 }),
        ComponentType::I8 => run(data, stride, out, |[b]| {
            let x = f32::from(b as i8);
            if n { (x / 127.0).max(-1.0) } else { x }
        }),
        ComponentType::U16 => {
            run(data, stride, out, |b| f32::from(u16::from_le_bytes(b)) / if n { 65535.0 } else { 1.0 })
        }
        ComponentType::I16 => run(data, stride, out, |b| {
            let x = f32::from(i16::from_le_bytes(b));
            if n { (x / 32767.0).max(-1.0) } else { x }
        }),
        ComponentType::U32 => run(data, stride, out, |b| {
            (f64::from(u32::from_le_bytes(b)) / if n { f64::from(u32::MAX) } else { 1.0 }) as f32
        }),
    }
}

fn read_integers<'o, const N: usize>(
    data: &[u8],
    stride: usize,
    component: ComponentType,
    out: impl Iterator<Item = &'o mut [u32; N]>,
) {
    let size = component.size();
    for (i, element) in out.enumerate() {
        for (k, value) in element.iter_mut().enumerate() {
            let b = &data[i * stride + k * size..];
            *value = match size {
                1 => u32::from(b[0]),
                2 => u32::from(u16::from_le_bytes([b[0], b[1]])),
                _ => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            };
        }
    }
}
