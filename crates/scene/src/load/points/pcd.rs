//! PCD, the format of the Point Cloud Library: ASCII, binary and compressed binary.

use super::{RawPoints, Sensor, lzf, srgb};
use crate::error::{Fault, fault};
use crate::load::Limits;
use crate::load::file::clip;
use photofit_scalar::{Vec3, Vec3f};

/// Longest header, bytes.
const MOST_BYTES: usize = 1 << 16;

/// Whether the text begins as a PCD file does.
pub(super) fn is_pcd(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(64)];
    head.starts_with(b"# .PCD") || head.starts_with(b"VERSION") || head.starts_with(b"FIELDS")
}

/// How the points are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

#[derive(Clone, Debug)]
struct Field {
    name: String,
    /// Bytes of one number.
    size: usize,
    /// `I` signed, `U` unsigned, `F` floating point.
    kind: u8,
    /// Numbers.
    count: usize,
    /// First byte within a point.
    offset: usize,
}

#[derive(Debug)]
struct Header {
    fields: Vec<Field>,
    width: u64,
    height: u64,
    points: u64,
    viewpoint: Option<[f64; 7]>,
    data: Data,
    /// Bytes of one point.
    stride: usize,
    /// First byte of the points.
    end: usize,
}

/// Reads the words of a header line, one per field.
fn words<T: std::str::FromStr>(line: &[&str], what: &str, fields: usize) -> Result<Vec<T>, String> {
    if line.len() != fields {
        return Err(format!(
            "{what} has {} entries; it must have one entry for each of the {fields} fields",
            line.len()
        ));
    }
    let entry = |w: &&str| w.parse().ok().ok_or_else(|| format!("`{}` is no entry of {what}", clip(w)));
    line.iter().map(entry).collect()
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut lines = HeaderLines { bytes, end: 0, number: 0 };
        let mut names: Vec<String> = Vec::new();
        let (mut sizes, mut kinds, mut counts) = (Vec::<usize>::new(), Vec::<char>::new(), None);
        let (mut width, mut height, mut points, mut viewpoint) = (None, None, None, None);
        let data = loop {
            let (place, line) = lines.next()?;
            let at = |rule: String| fault(place.clone(), rule);
            let number = |w: &[&str]| -> Result<Option<u64>, Fault> {
                match w {
                    [n] => n
                        .parse()
                        .map(Some)
                        .map_err(|e| fault(place.clone(), format!("`{}` is no count: {e}", clip(n)))),
                    _ => Err(fault(place.clone(), "has no count or several; it must have one count")),
                }
            };
            match line.as_slice() {
                [] | ["VERSION", ..] => {}
                ["FIELDS" | "COLUMNS", rest @ ..] => names = rest.iter().map(|n| clip(n)).collect(),
                ["SIZE", rest @ ..] => sizes = words(rest, "SIZE", names.len()).map_err(at)?,
                ["TYPE", rest @ ..] => kinds = words(rest, "TYPE", names.len()).map_err(at)?,
                ["COUNT", rest @ ..] => {
                    counts = Some(words::<usize>(rest, "COUNT", names.len()).map_err(at)?);
                }
                ["WIDTH", rest @ ..] => width = number(rest)?,
                ["HEIGHT", rest @ ..] => height = number(rest)?,
                ["POINTS", rest @ ..] => points = number(rest)?,
                ["VIEWPOINT", rest @ ..] => {
                    let v: Vec<f64> = words(rest, "VIEWPOINT", 7).map_err(at)?;
                    viewpoint = <[f64; 7]>::try_from(v).ok();
                }
                ["DATA", "ascii"] => break Data::Ascii,
                ["DATA", "binary"] => break Data::Binary,
                ["DATA", "binary_compressed"] => break Data::Compressed,
                ["DATA", rest @ ..] => {
                    let found = clip(&rest.join(" "));
                    let rule = format!("DATA is `{found}`; it must be ascii, binary or binary_compressed");
                    return Err(at(rule));
                }
                [other, ..] => {
                    return Err(at(format!(
                        "`{}` begins no PCD header line; the word must be one of the format",
                        clip(other)
                    )));
                }
            }
        };
        let missing = |what: &str| fault("header", format!("has no {what} line; it must have one"));
        if names.is_empty() {
            return Err(missing("FIELDS"));
        }
        if sizes.len() != names.len() || kinds.len() != names.len() {
            return Err(missing(if sizes.len() == names.len() { "TYPE" } else { "SIZE" }));
        }
        let counts = counts.unwrap_or_else(|| vec![1; names.len()]);
        let (fields, stride) = layout(names, &sizes, &kinds, &counts)?;
        let width = width.ok_or_else(|| missing("WIDTH"))?;
        let height = height.unwrap_or(1);
        let points = points.unwrap_or(width.saturating_mul(height));
        if width.saturating_mul(height) != points {
            return Err(fault(
                "header",
                format!(
                    "POINTS is {points} and the size {width} x {height}; POINTS must be WIDTH times HEIGHT"
                ),
            ));
        }
        Ok(Self { fields, width, height, points, viewpoint, data, stride, end: lines.end })
    }

    /// The fields of these names, all single numbers.
    fn triple(&self, names: [&str; 3]) -> Option<[usize; 3]> {
        let find = |n: &str| self.fields.iter().position(|f| f.name == n && f.count == 1);
        Some([find(names[0])?, find(names[1])?, find(names[2])?])
    }
}

/// Places the fields within a point.
fn layout(
    names: Vec<String>,
    sizes: &[usize],
    kinds: &[char],
    counts: &[usize],
) -> Result<(Vec<Field>, usize), Fault> {
    let mut stride = 0_usize;
    let mut fields = Vec::with_capacity(names.len());
    for (i, name) in names.into_iter().enumerate() {
        let (size, kind, count) = (sizes[i], kinds[i], counts[i]);
        let known = match kind {
            'F' => matches!(size, 4 | 8),
            'I' | 'U' => matches!(size, 1 | 2 | 4 | 8),
            _ => false,
        };
        if !known || count > 1 << 16 {
            return Err(fault(
                format!("field {name}"),
                format!(
                    "is {kind}{size} x {count}; it must be I or U of 1, 2, 4 or 8 bytes or F of 4 or 8, at most 65536 times"
                ),
            ));
        }
        fields.push(Field { name, size, kind: kind as u8, count, offset: stride });
        stride += size * count;
    }
    if stride == 0 {
        return Err(fault("header", "a point has no number; it must have at least one number"));
    }
    Ok((fields, stride))
}

struct HeaderLines<'a> {
    bytes: &'a [u8],
    end: usize,
    number: usize,
}

impl<'a> HeaderLines<'a> {
    /// The next line as words, without comments.
    fn next(&mut self) -> Result<(String, Vec<&'a str>), Fault> {
        self.number += 1;
        let place = format!("header line {}", self.number);
        let rest = &self.bytes[self.end.min(self.bytes.len())..self.bytes.len().min(MOST_BYTES)];
        let Some(length) = rest.iter().position(|&b| b == b'\n') else {
            return Err(fault(
                place,
                format!("the header has no end; it must end with a DATA line within {MOST_BYTES} bytes"),
            ));
        };
        self.end += length + 1;
        let line = std::str::from_utf8(&rest[..length])
            .map_err(|e| fault(place.clone(), format!("is no text: {e}")))?;
        let line = line.split('#').next().unwrap_or_default();
        Ok((place, line.split_ascii_whitespace().collect()))
    }
}

/// Reads a PCD file.
pub(super) fn parse(bytes: &[u8], limits: &Limits) -> Result<RawPoints, Fault> {
    let header = Header::parse(bytes)?;
    let body = &bytes[header.end..];
    if header.points > limits.vertices as u64 {
        return Err(fault(
            "POINTS",
            format!("the cloud has {} points; it may have at most {} points", header.points, limits.vertices),
        ));
    }
    let Some(xyz) = header.triple(["x", "y", "z"]) else {
        return Err(fault("FIELDS", "lacks one of x, y and z; it must have the fields x, y and z"));
    };
    let mut cloud = RawPoints { sensor: sensor(&header), ..RawPoints::default() };
    let sink = Sink {
        xyz,
        normal: header.triple(["normal_x", "normal_y", "normal_z"]).or(header.triple(["nx", "ny", "nz"])),
        packed: header
            .fields
            .iter()
            .position(|f| matches!(f.name.as_str(), "rgb" | "rgba") && f.size == 4 && f.count == 1),
        channels: header.triple(["r", "g", "b"]),
    };
    for f in &header.fields {
        let known = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "nx", "ny", "nz", "rgb", "rgba", "_"];
        if !known.contains(&f.name.as_str()) && !["r", "g", "b", "curvature"].contains(&f.name.as_str()) {
            cloud.warnings.push(format!("the field `{}` is ignored", f.name));
        }
    }
    match header.data {
        Data::Ascii => ascii(&header, body, &sink, &mut cloud)?,
        Data::Binary => {
            let claimed = header.points * header.stride as u64;
            if claimed > body.len() as u64 {
                return Err(too_short(&header, body.len()));
            }
            read_records(&header, &sink, &mut cloud, |i, f| &body[i * header.stride + f.offset..]);
        }
        Data::Compressed => {
            let plain = decompress(&header, body)?;
            let points = header.points as usize;
            // Field by field, each for all points.
            read_records(&header, &sink, &mut cloud, |i, f| {
                &plain[f.offset * points + i * f.size * f.count..]
            });
        }
    }
    Ok(cloud)
}

fn too_short(header: &Header, found: usize) -> Fault {
    fault(
        format!("byte {}", header.end),
        format!("{found} bytes follow the header; {} points of {} bytes must", header.points, header.stride),
    )
}

fn decompress(header: &Header, body: &[u8]) -> Result<Vec<u8>, Fault> {
    let place = || format!("byte {}", header.end);
    let Some((sizes, rest)) = body.split_at_checked(8) else {
        return Err(fault(
            place(),
            "the header has nothing after it; the sizes of the compressed data must follow",
        ));
    };
    let size = |k: usize| u64::from(u32::from_le_bytes([sizes[k], sizes[k + 1], sizes[k + 2], sizes[k + 3]]));
    let (packed, plain) = (size(0), size(4));
    if packed > rest.len() as u64 {
        return Err(fault(place(), format!("{} bytes follow; {packed} compressed bytes must", rest.len())));
    }
    if plain != header.points * header.stride as u64 || plain > lzf::most(packed) {
        return Err(fault(
            place(),
            format!(
                "{packed} compressed bytes hold {} points of {} bytes, {plain} are claimed",
                header.points, header.stride
            ),
        ));
    }
    lzf::expand(&rest[..packed as usize], plain as usize)
        .ok_or_else(|| fault(place(), "the compressed data is no valid LZF"))
}

/// Where the numbers of a point go: indices of fields.
struct Sink {
    xyz: [usize; 3],
    normal: Option<[usize; 3]>,
    packed: Option<usize>,
    channels: Option<[usize; 3]>,
}

impl Sink {
    /// Adds a point whose numbers `value` gives by field, and whose packed colour `bits` gives.
    fn push(
        &self,
        header: &Header,
        cloud: &mut RawPoints,
        value: impl Fn(usize) -> f64,
        bits: impl Fn(usize) -> u32,
    ) {
        let channel = |f: usize| -> u8 {
            let unit = if header.fields[f].kind == b'F' { 255.0 } else { 1.0 };
            (value(f) * unit).round().clamp(0.0, 255.0) as u8
        };
        let color: Option<Vec3f> = match (self.packed, self.channels) {
            (Some(f), _) => {
                let [b, g, r, _] = bits(f).to_le_bytes();
                Some(srgb([r, g, b]))
            }
            (None, Some(c)) => Some(srgb(c.map(channel))),
            _ => None,
        };
        cloud.push(self.xyz.map(&value), self.normal.map(|n| n.map(&value)), color);
    }
}

fn read_records<'a>(
    header: &Header,
    sink: &Sink,
    cloud: &mut RawPoints,
    bytes: impl Fn(usize, &Field) -> &'a [u8],
) {
    for i in 0..header.points as usize {
        let value = |f: usize| number(&header.fields[f], bytes(i, &header.fields[f]));
        let bits = |f: usize| {
            let b = bytes(i, &header.fields[f]);
            u32::from_le_bytes([b[0], b[1], b[2], b[3]])
        };
        sink.push(header, cloud, value, bits);
    }
}

/// A little-endian number at the beginning of `bytes`.
fn number(field: &Field, bytes: &[u8]) -> f64 {
    let mut b = [0; 8];
    b[..field.size].copy_from_slice(&bytes[..field.size]);
    let unsigned = u64::from_le_bytes(b);
    match (field.kind, field.size) {
        (b'F', 4) => f64::from(f32::from_bits(unsigned as u32)),
        (b'F', _) => f64::from_bits(unsigned),
        (b'U', _) => unsigned as f64,
        (_, size) => {
            let shift = 64 - 8 * size as u32;
            ((unsigned << shift) as i64 >> shift) as f64
        }
    }
}

fn ascii(header: &Header, body: &[u8], sink: &Sink, cloud: &mut RawPoints) -> Result<(), Fault> {
    let numbers: usize = header.fields.iter().map(|f| f.count).sum();
    // A digit and a separator for every number, the last separator may be missing.
    let least = header.points.saturating_mul(2 * numbers as u64);
    if least > body.len() as u64 + 1 {
        return Err(too_short(header, body.len()));
    }
    let mut lines = body.split(|&b| b == b'\n').filter(|l| !l.iter().all(u8::is_ascii_whitespace));
    let mut values: Vec<&str> = Vec::with_capacity(numbers);
    let mut first: Vec<usize> = Vec::new();
    header.fields.iter().fold(0, |at, f| {
        first.push(at);
        at + f.count
    });
    for i in 0..header.points {
        let place = || format!("point {i}");
        let line = lines.next().ok_or_else(|| {
            fault(place(), format!("the file is truncated: {} points are announced", header.points))
        })?;
        let text = std::str::from_utf8(line).map_err(|e| fault(place(), format!("is no text: {e}")))?;
        values.clear();
        values.extend(text.split_ascii_whitespace());
        if values.len() != numbers {
            return Err(fault(
                place(),
                format!("has {} numbers; it must have {numbers} numbers", values.len()),
            ));
        }
        if let Some(bad) = values.iter().find(|w| w.parse::<f64>().is_err()) {
            return Err(fault(place(), format!("`{}` is no number; it must be one", clip(bad))));
        }
        let value = |f: usize| values[first[f]].parse().unwrap_or(f64::NAN);
        let bits = |f: usize| {
            let word = values[first[f]];
            // Packed as an integer, or as the number whose bits they are.
            let packed = word.parse::<u32>().ok().filter(|_| header.fields[f].kind != b'F');
            packed.or_else(|| word.parse::<f32>().ok().map(f32::to_bits)).unwrap_or(0)
        };
        sink.push(header, cloud, value, bits);
    }
    Ok(())
}

/// The pose of the sensor of an organised cloud.
fn sensor(header: &Header) -> Option<Sensor> {
    let [x, y, z, w, i, j, k] = header.viewpoint?;
    let length = (w * w + i * i + j * j + k * k).sqrt();
    let finite = [x, y, z].iter().all(|c| c.is_finite() && c.abs() < 1e15);
    if header.height < 2 || header.width < 2 || !(length > 1e-6 && length.is_finite() && finite) {
        return None;
    }
    let (w, q) = (w / length, Vec3::from_array([i, j, k]) * (1.0 / length));
    let turn = |v: Vec3<f64>| v + q.cross(q.cross(v) + v * w) * 2.0;
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Some(Sensor { eye: [x, y, z], axes: axes.map(|a| turn(Vec3::from_array(a)).to_array()) })
}
