//! Mutations that keep most of a file's structure.

use crate::Rng;
use serde_json::Value;

/// Numbers at the edges of what formats allow.
const NUMBERS: [&str; 22] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "127",
    "255",
    "65535",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "9007199254740993",
    "1e38",
    "-1e39",
    "1e308",
    "1e-45",
    "0.5",
    "1e15",
    "1e999",
];
const STRINGS: [&str; 12] = [
    "",
    "a",
    "../m",
    "/etc/passwd",
    "data:,",
    "data:application/octet-stream;base64,AAAA",
    "SCALAR",
    "VEC4",
    "MAT4",
    "MASK",
    "nan",
    "\u{fffd}\u{0}",
];

/// How a file is built.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// JSON.
    Json,
    /// A .glb file.
    Glb,
    /// A .glb file whose binary part matters most.
    GlbBinary,
    /// What another format holds: compressed, with a checksum or with lengths.
    Packed(&'static Packing),
    /// Lines of words.
    Text,
    /// XML.
    Xml,
    /// Words of four bytes.
    Bytes,
}

/// A file around another one.
#[derive(Debug)]
pub struct Packing {
    /// Parts of a file; `None` where it is broken.
    pub unpack: fn(&[u8]) -> Option<Vec<Vec<u8>>>,
    /// The file of parts.
    pub pack: fn(&[Vec<u8>]) -> Vec<u8>,
    /// How each part is built; a part beyond the last is never mutated.
    pub shapes: &'static [Shape],
}

impl Shape {
    /// A mutant of a file, which may be a mutant itself.
    pub fn mutate(self, bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
        // Now and then what a broken disk does.
        if rng.below(12) == 0 {
            return mutate_bytes(bytes, rng);
        }
        match self {
            Self::Json => mutate_json_bytes(bytes, rng),
            Self::Glb => mutate_glb(bytes, 1, rng),
            Self::GlbBinary => mutate_glb(bytes, 3, rng),
            Self::Packed(packing) => mutate_packed(bytes, packing, rng),
            Self::Text => mutate_text(bytes, rng),
            Self::Xml => mutate_xml(bytes, rng),
            Self::Bytes => mutate_bytes(bytes, rng),
        }
    }
}

/// Mutates one part, and packs all of them again.
fn mutate_packed(bytes: &[u8], packing: &Packing, rng: &mut Rng) -> Vec<u8> {
    let Some(mut parts) = (packing.unpack)(bytes) else { return mutate_bytes(bytes, rng) };
    let k = rng.below(packing.shapes.len());
    if let Some(part) = parts.get_mut(k) {
        *part = packing.shapes[k].mutate(part, rng);
    }
    (packing.pack)(&parts)
}

fn mutate_json_bytes(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let Ok(mut value) = serde_json::from_slice(bytes) else { return mutate_bytes(bytes, rng) };
    mutate_json(&mut value, rng);
    serde_json::to_vec(&value).expect("JSON is written")
}

/// Number of values below and with this one.
fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(a) => a.iter().map(count).sum(),
        Value::Object(o) => o.values().map(count).sum(),
        _ => 0,
    }
}

/// Value number `at` in depth-first order.
fn nth<'a>(value: &'a mut Value, at: &mut usize) -> Option<&'a mut Value> {
    if *at == 0 {
        return Some(value);
    }
    *at -= 1;
    let children: Vec<&mut Value> = match value {
        Value::Array(a) => a.iter_mut().collect(),
        Value::Object(o) => o.values_mut().collect(),
        _ => Vec::new(),
    };
    for child in children {
        let size = count(child);
        if *at < size {
            return nth(child, at);
        }
        *at -= size;
    }
    None
}

fn mutate_json(root: &mut Value, rng: &mut Rng) {
    let total = count(root);
    let mut other = rng.below(total);
    let elsewhere = nth(root, &mut other).map(|v| v.clone()).unwrap_or_default();
    let mut at = rng.below(total);
    let Some(value) = nth(root, &mut at) else { return };
    match (rng.below(8), &mut *value) {
        (0, v) => *v = elsewhere,
        (1, v) => *v = Value::Null,
        (2, Value::Object(o)) if !o.is_empty() => {
            let key = rng.pick(&o.keys().cloned().collect::<Vec<_>>()).clone();
            o.remove(&key);
        }
        (3, Value::Array(a)) if !a.is_empty() => {
            let (i, n) = (rng.below(a.len()), rng.below(40));
            let copies = vec![a[i].clone(); n];
            a.extend(copies);
        }
        (4, Value::Array(a)) if !a.is_empty() => {
            a.remove(rng.below(a.len()));
        }
        (_, Value::Object(o)) if rng.below(2) == 0 => {
            let Some(key) = o.keys().nth(rng.below(o.len().max(1))).cloned() else { return };
            o.insert(key, elsewhere);
        }
        (_, Value::String(s)) => *s = (*rng.pick(&STRINGS)).into(),
        (_, v) => {
            *v = serde_json::from_str(rng.pick::<&str>(&NUMBERS)).unwrap_or(Value::Bool(true));
        }
    }
}

/// Mutates the JSON or, `share` times of four, the binary part, and keeps the lengths right.
fn mutate_glb(bytes: &[u8], share: usize, rng: &mut Rng) -> Vec<u8> {
    let word =
        |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let json = word(12).and_then(|n| bytes.get(20..20 + n));
    let Some((json, rest)) = json.map(|j| (j, bytes.get(28 + j.len()..).unwrap_or_default())) else {
        return mutate_bytes(bytes, rng);
    };
    let (json, binary) = if rng.below(4) < share {
        (json.to_vec(), mutate_bytes(rest, rng))
    } else {
        (mutate_json_bytes(json, rng), rest.to_vec())
    };
    glb(&json, &binary)
}

/// The container of a .glb file of a JSON part and a binary part.
pub fn glb(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut out = bytes.to_vec();
        out.resize(out.len().next_multiple_of(4), with);
        out
    };
    let (json, binary) = (padded(json, b' '), padded(binary, 0));
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, part) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        out.extend((part.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(part);
    }
    out
}

/// Lines and words.
fn mutate_text(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines: Vec<String> = text.lines().map(Into::into).collect();
    if lines.is_empty() {
        return mutate_bytes(bytes, rng);
    }
    let (i, j) = (rng.below(lines.len()), rng.below(lines.len()));
    match rng.below(7) {
        0 => {
            lines.remove(i);
        }
        1 => lines.swap(i, j),
        2 => {
            let copies = vec![lines[i].clone(); rng.below(50)];
            lines.splice(j..j, copies);
        }
        _ => {
            let mut words: Vec<String> = lines[i].split(' ').map(Into::into).collect();
            let k = rng.below(words.len());
            words[k] = match rng.below(4) {
                0 => words[rng.below(words.len())].clone(),
                1 => format!("{}/{}/{}", rng.pick(&NUMBERS), rng.pick(&NUMBERS), rng.below(5)),
                _ => (*rng.pick(&NUMBERS)).into(),
            };
            lines[i] = words.join(" ");
        }
    }
    (lines.join("\n") + "\n").into_bytes()
}

/// Values of attributes, and whole lines.
fn mutate_xml(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let quotes: Vec<usize> = text.match_indices('"').map(|(i, _)| i).collect();
    if quotes.len() < 2 || rng.below(4) == 0 {
        return mutate_text(bytes, rng);
    }
    let pair = rng.below(quotes.len() / 2);
    let (from, to) = (quotes[2 * pair] + 1, quotes[2 * pair + 1]);
    let other = rng.below(quotes.len() / 2);
    let value = match rng.below(3) {
        0 => text[quotes[2 * other] + 1..quotes[2 * other + 1]].to_owned(),
        1 => (*rng.pick(&STRINGS)).replace('\0', ""),
        _ => (*rng.pick(&NUMBERS)).into(),
    };
    format!("{}{}{}", &text[..from], value, &text[to..]).into_bytes()
}

/// Bytes, words, and pieces.
fn mutate_bytes(bytes: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    if out.is_empty() {
        return out;
    }
    let at = rng.below(out.len());
    match rng.below(6) {
        0 => out.truncate(at),
        1 => out[at] ^= 1 << rng.below(8),
        2 => {
            let words =
                [0_u32, 1, 0xffff, 0x7fff_ffff, 0x8000_0000, u32::MAX, 0x7f80_0000, 0x7fc0_0000, 0x0100_0000];
            for (b, w) in out[at..].iter_mut().zip(rng.pick(&words).to_le_bytes()) {
                *b = w;
            }
        }
        3 => {
            let piece = out[at..(at + 1 + rng.below(64)).min(out.len())].to_vec();
            let to = rng.below(out.len());
            out.splice(to..to, piece);
        }
        4 => {
            let end = (at + 1 + rng.below(16)).min(out.len());
            out.drain(at..end);
        }
        _ => out[at] = rng.below(256) as u8,
    }
    out
}
