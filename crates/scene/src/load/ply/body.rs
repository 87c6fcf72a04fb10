//! The records of a PLY file, one number at a time.

use super::header::{Element, Encoding, Header, Kind, Property};
use crate::error::{Fault, fault};
use crate::load::file::clip;

/// A cursor over the body.
#[derive(Debug)]
pub(super) struct Body<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
}

impl<'a> Body<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header) -> Self {
        Self { bytes, at: header.end.min(bytes.len()), encoding: header.encoding }
    }

    /// The records that an element claims fit into the rest of the file: checked before memory is taken.
    pub(super) fn check_count(&self, element: &Element) -> Result<(), Fault> {
        let record: usize = match self.encoding {
            // A digit and a separator; the last separator may be missing.
            Encoding::Ascii => element.properties.len() * 2,
            _ => element.properties.iter().map(|p| p.list.unwrap_or(p.kind).size()).sum(),
        };
        let left = (self.bytes.len() - self.at) as u64 + 1;
        match element.count.checked_mul(record as u64) {
            Some(needed) if needed <= left => Ok(()),
            _ => Err(fault(
                format!("element {}", element.name),
                format!(
                    "claims {} records of at least {record} bytes; only {} bytes follow byte {}",
                    element.count,
                    left - 1,
                    self.at
                ),
            )),
        }
    }

    /// The next number.
    pub(super) fn number(&mut self, element: &Element, kind: Kind, record: usize) -> Result<f64, Fault> {
        if self.encoding == Encoding::Ascii {
            return self.word(element, record);
        }
        let size = kind.size();
        let Some(raw) = self.bytes.get(self.at..self.at + size) else {
            return Err(self.truncated(element, record));
        };
        self.at += size;
        let mut b = [0; 8];
        b[..size].copy_from_slice(raw);
        // As little-endian from here on.
        if self.encoding == Encoding::Big {
            b[..size].reverse();
        }
        let four = [b[0], b[1], b[2], b[3]];
        Ok(match kind {
            Kind::I8 => f64::from(b[0] as i8),
            Kind::U8 => f64::from(b[0]),
            Kind::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Kind::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Kind::I32 => f64::from(i32::from_le_bytes(four)),
            Kind::U32 => f64::from(u32::from_le_bytes(four)),
            Kind::F32 => f64::from(f32::from_le_bytes(four)),
            Kind::F64 => f64::from_le_bytes(b),
        })
    }

    fn word(&mut self, element: &Element, record: usize) -> Result<f64, Fault> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace());
        let Some(start) = start else {
            self.at = self.bytes.len();
            return Err(self.truncated(element, record));
        };
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        let word = &rest[start..start + length];
        self.at += start + length;
        std::str::from_utf8(word).ok().and_then(|w| w.parse().ok()).ok_or_else(|| {
            fault(
                format!("element {} {record}, byte {}", element.name, self.at - length),
                format!("`{}` is no number; it must be one", clip(&String::from_utf8_lossy(word))),
            )
        })
    }

    fn truncated(&self, element: &Element, record: usize) -> Fault {
        fault(
            format!("element {} {record}, byte {}", element.name, self.at),
            format!("the file is truncated: {} records are announced", element.count),
        )
    }

    fn length(&mut self, element: &Element, property: &Property, record: usize) -> Result<usize, Fault> {
        let Some(kind) = property.list else { return Ok(1) };
        let n = self.number(element, kind, record)?;
        let item = if self.encoding == Encoding::Ascii { 2 } else { property.kind.size() };
        let left = self.bytes.len() - self.at + 1;
        if n >= 0.0 && n.fract() == 0.0 && n * item as f64 <= left as f64 {
            return Ok(n as usize);
        }
        Err(fault(
            format!("element {} {record}, property {}", element.name, clip(&property.name)),
            format!("a list of {n} items does not fit into the {} bytes that follow; it must", left - 1),
        ))
    }

    /// The next list.
    pub(super) fn list(
        &mut self,
        element: &Element,
        property: &Property,
        record: usize,
        out: &mut Vec<f64>,
    ) -> Result<(), Fault> {
        out.clear();
        for _ in 0..self.length(element, property, record)? {
            out.push(self.number(element, property.kind, record)?);
        }
        Ok(())
    }

    /// Passes over a number or a list.
    pub(super) fn skip_property(
        &mut self,
        element: &Element,
        property: &Property,
        record: usize,
    ) -> Result<(), Fault> {
        for _ in 0..self.length(element, property, record)? {
            self.number(element, property.kind, record)?;
        }
        Ok(())
    }

    /// Passes over all records of an element.
    pub(super) fn skip(&mut self, element: &Element) -> Result<(), Fault> {
        for record in 0..element.count as usize {
            for property in &element.properties {
                self.skip_property(element, property, record)?;
            }
        }
        Ok(())
    }
}
