//! The header of a PLY file.

use crate::error::{Fault, fault};
use crate::load::file::clip;

/// Longest header, bytes.
const MOST_BYTES: usize = 1 << 20;

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A property of an element.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The type of the list's length, for a list.
    pub(super) list: Option<Kind>,
}

/// A block of equal records.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

/// How numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// What the body holds.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// From a `comment TextureFile` line.
    pub(super) texture: Option<String>,
    /// First byte of the body.
    pub(super) end: usize,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut header = Self { encoding: Encoding::Ascii, elements: Vec::new(), texture: None, end: 0 };
        let mut encoding = None;
        for number in 1.. {
            let place = || format!("header line {number}");
            let rest = &bytes[header.end..bytes.len().min(MOST_BYTES)];
            let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').ok_or_else(|| {
                fault(
                    place(),
                    format!("the header has no end; it must end with `end_header` within {MOST_BYTES} bytes"),
                )
            })?;
            let line = std::str::from_utf8(&rest[..length])
                .map_err(|e| fault(place(), format!("is no text: {e}")))?
                .trim();
            header.end += length + 1;
            // A line may end with carriage return and line feed.
            if rest[length] == b'\r' && bytes.get(header.end) == Some(&b'\n') {
                header.end += 1;
            }
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header"] => break,
                ["ply"] if number == 1 => {}
                ["format", name, _] => {
                    encoding = Some(match *name {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Little,
                        "binary_big_endian" => Encoding::Big,
                        other => {
                            return Err(fault(
                                place(),
                                format!(
                                    "`{}` is no PLY format; it must be ascii, binary_little_endian or binary_big_endian",
                                    clip(other)
                                ),
                            ));
                        }
                    });
                }
                ["comment", "TextureFile", ..] => {
                    header.texture = line.split_once("TextureFile").map(|(_, f)| f.trim().to_owned());
                }
                ["comment" | "obj_info", ..] | [] => {}
                words => header.declare(words).map_err(|rule| fault(place(), rule))?,
            }
        }
        header.encoding =
            encoding.ok_or_else(|| fault("header", "has no `format` line; it must have one"))?;
        if let Some(e) = header.elements.iter().find(|e| e.properties.is_empty() && e.count > 0) {
            return Err(fault(format!("element {}", e.name), "has no properties; it must have some"));
        }
        Ok(header)
    }

    fn declare(&mut self, words: &[&str]) -> Result<(), String> {
        let kind = |name: &str| {
            Kind::parse(name).ok_or_else(|| {
                format!("`{}` is no PLY type; it must be one such as float or uchar", clip(name))
            })
        };
        match *words {
            ["element", name, count] => {
                let count = count.parse().map_err(|e| format!("`{}` is no count: {e}", clip(count)))?;
                self.elements.push(Element { name: clip(name), count, properties: Vec::new() });
                return Ok(());
            }
            ["property", "list", length, item, name] => {
                let (length, item) = (kind(length)?, kind(item)?);
                if matches!(length, Kind::F32 | Kind::F64) {
                    return Err("the length of the list is a float; it must be an integer".into());
                }
                if let Some(e) = self.elements.last_mut() {
                    e.properties.push(Property { name: name.into(), kind: item, list: Some(length) });
                    return Ok(());
                }
            }
            ["property", item, name] => {
                let kind = kind(item)?;
                if let Some(e) = self.elements.last_mut() {
                    e.properties.push(Property { name: name.into(), kind, list: None });
                    return Ok(());
                }
            }
            _ => {
                return Err(format!(
                    "`{}` is no header line; it must be an element, a property or a comment",
                    clip(&words.join(" "))
                ));
            }
        }
        Err("the property follows no element; it must follow one".into())
    }
}
