//! Triangle streams: triangles as edges and vertices that were seen lately.
//!
//! Triangles keep their order and their orientation; they may begin at another corner.

use super::reader::{Reader, write_varint};
use super::{unzigzag, zigzag};
use std::collections::BTreeMap;

/// The byte that a stream begins with: version 1.
const HEADER: u8 = 0xe1;
/// Bytes of the table of frequent pairs at the end of a stream; the last two are not used.
const TABLE: usize = 16;
const TABLE_USED: usize = 14;

/// What encoder and decoder remember, alike.
#[derive(Debug)]
struct Recent {
    edges: [[u32; 2]; 16],
    edge: usize,
    vertices: [u32; 16],
    vertex: usize,
    /// The lowest index that has not been used.
    next: u32,
    /// The last index that was stored as a difference.
    last: u32,
}

impl Recent {
    fn new() -> Self {
        Self { edges: [[u32::MAX; 2]; 16], edge: 0, vertices: [u32::MAX; 16], vertex: 0, next: 0, last: 0 }
    }

    /// The edge that was pushed `n` edges before the last one.
    fn edge(&self, n: u8) -> [u32; 2] {
        self.edges[self.edge.wrapping_sub(1 + usize::from(n)) & 15]
    }

    fn vertex(&self, n: u8) -> u32 {
        self.vertices[self.vertex.wrapping_sub(1 + usize::from(n)) & 15]
    }

    fn find_vertex(&self, v: u32, among: std::ops::Range<u8>) -> Option<u8> {
        among.into_iter().find(|n| self.vertex(*n) == v)
    }

    fn push_edge(&mut self, a: u32, b: u32) {
        self.edges[self.edge] = [a, b];
        self.edge = (self.edge + 1) & 15;
    }

    fn push_vertex(&mut self, v: u32) {
        self.vertices[self.vertex] = v;
        self.vertex = (self.vertex + 1) & 15;
    }

    fn take_next(&mut self) -> u32 {
        let v = self.next;
        self.next = v.wrapping_add(1);
        v
    }

    fn read_index(&mut self, reader: &mut Reader<'_>) -> Result<u32, String> {
        self.last = self.last.wrapping_add(unzigzag(reader.varint()?));
        Ok(self.last)
    }

    fn write_index(&mut self, v: u32, out: &mut Vec<u8>) {
        write_varint(zigzag(v.wrapping_sub(self.last)), out);
        self.last = v;
    }

    /// A triangle `a, b, c` on the known edge `a, b`.
    fn push_on_edge(&mut self, [a, b, c]: [u32; 3]) {
        self.push_edge(c, b);
        self.push_edge(a, c);
    }

    /// A triangle without a known edge; the codes of `b` and `c` say whether they were known.
    fn push_alone(&mut self, [a, b, c]: [u32; 3], code_b: u8, code_c: u8) {
        self.push_vertex(a);
        for (v, code) in [(b, code_b), (c, code_c)] {
            if code == 0 || code == 15 {
                self.push_vertex(v);
            }
        }
        self.push_edge(b, a);
        self.push_edge(c, b);
        self.push_edge(a, c);
    }
}

/// The `count` indices of a stream.
pub(super) fn decode(stream: &[u8], count: usize) -> Result<Vec<u32>, String> {
    if stream.first() != Some(&HEADER) {
        return Err("does not begin with the byte 0xe1; a stream of TRIANGLES must".into());
    }
    if !count.is_multiple_of(3) {
        return Err(format!("claims {count} indices; triangles must have a multiple of 3"));
    }
    let body = stream.len().checked_sub(TABLE).filter(|end| *end >= 1).ok_or("the stream is truncated")?;
    let (body, table) = stream[1..].split_at(body - 1);
    let Some((codes, data)) = body.split_at_checked(count / 3) else {
        return Err(format!(
            "claims {} triangles in {} bytes; each takes at least one byte",
            count / 3,
            body.len()
        ));
    };
    let mut reader = Reader::new(data);
    let mut recent = Recent::new();
    let mut out = Vec::with_capacity(count);
    for code in codes {
        out.extend(read_triangle(code >> 4, code & 15, &mut recent, &mut reader, table)?);
    }
    reader.finish()?;
    Ok(out)
}

fn read_triangle(
    high: u8,
    low: u8,
    recent: &mut Recent,
    reader: &mut Reader<'_>,
    table: &[u8],
) -> Result<[u32; 3], String> {
    if high < 15 {
        let [a, b] = recent.edge(high);
        let c = match low {
            0 => recent.take_next(),
            1..=12 => recent.vertex(low),
            13 | 14 => {
                recent.last =
                    if low == 13 { recent.last.wrapping_sub(1) } else { recent.last.wrapping_add(1) };
                recent.last
            }
            _ => recent.read_index(reader)?,
        };
        if !(1..=12).contains(&low) {
            recent.push_vertex(c);
        }
        recent.push_on_edge([a, b, c]);
        return Ok([a, b, c]);
    }
    let pair = if low < 14 { table[usize::from(low)] } else { reader.byte()? };
    if low >= 14 && pair == 0 {
        recent.next = 0;
    }
    let a = if low < 15 { recent.take_next() } else { recent.read_index(reader)? };
    let (code_b, code_c) = (pair >> 4, pair & 15);
    let mut other = |code: u8| match code {
        0 => Ok(recent.take_next()),
        // The table of a stream that follows the rules has none of these.
        15 if low < 14 => Err("the table of pairs has an index code of 15; it must not".to_owned()),
        15 => recent.read_index(reader),
        n => Ok(recent.vertex(n - 1)),
    };
    let (b, c) = (other(code_b)?, other(code_c)?);
    recent.push_alone([a, b, c], code_b, code_c);
    Ok([a, b, c])
}

/// A triangle before the table of pairs is known.
#[derive(Debug)]
enum Coded {
    OnEdge { code: u8, index: Vec<u8> },
    Alone { first_is_next: bool, pair: u8, indices: Vec<u8> },
}

/// A stream of triangles. It is short where neighbouring triangles share edges and vertices are numbered as they are used.
pub(crate) fn encode(triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut recent = Recent::new();
    let coded: Vec<Coded> = triangles.iter().map(|t| code_triangle(*t, &mut recent)).collect();
    let table = frequent_pairs(&coded);
    let mut out = vec![HEADER];
    let mut data = Vec::new();
    for coded in &coded {
        match coded {
            Coded::OnEdge { code, index } => {
                out.push(*code);
                data.extend(index);
            }
            Coded::Alone { first_is_next, pair, indices } => {
                let known = table[..TABLE_USED].iter().position(|p| p == pair);
                if let (true, Some(i)) = (*first_is_next, known) {
                    out.push(0xf0 | i as u8);
                } else {
                    out.push(if *first_is_next { 0xfe } else { 0xff });
                    data.push(*pair);
                }
                data.extend(indices);
            }
        }
    }
    out.extend(data);
    out.extend(table);
    out
}

fn rotations([a, b, c]: [u32; 3]) -> [[u32; 3]; 3] {
    [[a, b, c], [b, c, a], [c, a, b]]
}

fn code_triangle(triangle: [u32; 3], recent: &mut Recent) -> Coded {
    let rotations = rotations(triangle);
    let known = (0..15).find_map(|n| {
        let edge = recent.edge(n);
        rotations.iter().find(|t| t[..2] == edge).map(|t| (n, *t))
    });
    if let Some((n, t)) = known {
        let c = t[2];
        let mut index = Vec::new();
        let low = if c == recent.next {
            recent.take_next();
            0
        } else if let Some(k) = recent.find_vertex(c, 1..13) {
            k
        } else if c == recent.last.wrapping_sub(1) || c == recent.last.wrapping_add(1) {
            let code = if c < recent.last { 13 } else { 14 };
            recent.last = c;
            code
        } else {
            recent.write_index(c, &mut index);
            15
        };
        if !(1..=12).contains(&low) {
            recent.push_vertex(c);
        }
        recent.push_on_edge(t);
        return Coded::OnEdge { code: n << 4 | low, index };
    }
    // A new vertex goes first: then a pair of codes is never 0 without one, which would restart the numbering.
    let t = rotations.into_iter().find(|t| t[0] == recent.next).unwrap_or(triangle);
    let first_is_next = t[0] == recent.next;
    let mut indices = Vec::new();
    if first_is_next {
        recent.take_next();
    } else {
        recent.write_index(t[0], &mut indices);
    }
    let [b, c] = [t[1], t[2]].map(|v| {
        if v == recent.next {
            recent.take_next();
            0
        } else if let Some(k) = recent.find_vertex(v, 0..14) {
            k + 1
        } else {
            recent.write_index(v, &mut indices);
            15
        }
    });
    recent.push_alone(t, b, c);
    Coded::Alone { first_is_next, pair: b << 4 | c, indices }
}

/// The pairs that are stored most often, 0 first; none names an index that is stored beside it.
fn frequent_pairs(coded: &[Coded]) -> [u8; TABLE] {
    let mut uses: BTreeMap<u8, usize> = BTreeMap::new();
    for coded in coded {
        if let Coded::Alone { first_is_next: true, pair, .. } = coded {
            *uses.entry(*pair).or_default() += 1;
        }
    }
    let mut pairs: Vec<(usize, u8)> = uses.into_iter().map(|(pair, n)| (n, pair)).collect();
    pairs.retain(|(_, pair)| *pair != 0 && pair >> 4 != 15 && pair & 15 != 15);
    pairs.sort_by_key(|(n, pair)| (std::cmp::Reverse(*n), *pair));
    let mut table = [0; TABLE];
    for (slot, (_, pair)) in table[1..TABLE_USED].iter_mut().zip(pairs) {
        *slot = pair;
    }
    table
}
