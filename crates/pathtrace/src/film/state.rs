//! The film as bytes: what a render goes on from.

use super::{Film, Tile};
use crate::PathtraceError;

const MAGIC: &[u8; 8] = b"PFPATH04";

impl Film {
    /// All sums and counts; `keys` name what is rendered, part by part.
    pub(crate) fn to_bytes(&self, keys: &[Key]) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.state_bytes(keys.len()));
        out.extend_from_slice(MAGIC);
        let shape = [self.width, self.height, self.stride, self.tiles.len()].map(|n| n as u64);
        for n in keys.iter().map(|k| k.sum).chain(shape) {
            out.extend_from_slice(&n.to_le_bytes());
        }
        for tile in &self.tiles {
            out.extend_from_slice(&tile.count.to_le_bytes());
            out.extend_from_slice(&u32::from(tile.active).to_le_bytes());
            out.extend_from_slice(&tile.not_finite.to_le_bytes());
            tile.sums.iter().for_each(|s| out.extend_from_slice(&s.to_le_bytes()));
            tile.ids.iter().for_each(|i| out.extend_from_slice(&i.to_le_bytes()));
        }
        let sum = checksum(&out);
        out.extend_from_slice(&sum.to_le_bytes());
        out
    }

    /// Bytes that [`Self::to_bytes`] writes with so many keys.
    pub(crate) fn state_bytes(&self, keys: usize) -> usize {
        let tile = |t: &Tile| 16 + 8 * t.sums.len() + 4 * t.ids.len();
        MAGIC.len() + 8 * (keys + 4) + self.tiles.iter().map(tile).sum::<usize>() + 8
    }

    /// Takes over what [`Self::to_bytes`] wrote for the same shape, the same keys and one of `last`; gives the index of that.
    pub(crate) fn restore(
        &mut self,
        bytes: &[u8],
        keys: &[Key],
        last: &[Key],
    ) -> Result<usize, PathtraceError> {
        let fail = |why: &str| Err(PathtraceError::State(why.into()));
        let Some((body, sum)) = bytes.split_last_chunk::<8>() else { return fail("it is too short") };
        if body.get(..8) != Some(MAGIC) {
            return fail("it is no state of this version");
        }
        if checksum(body) != u64::from_le_bytes(*sum) {
            return fail("it is damaged");
        }
        let mut reader = Reader(&body[8..]);
        let mut others: Vec<&str> =
            keys.iter().filter(|k| reader.u64() != Some(k.sum)).map(|k| k.name).collect();
        let sum = reader.u64();
        let found = last.iter().position(|k| sum == Some(k.sum));
        others.extend(last.first().filter(|_| found.is_none()).map(|k| k.name));
        let Some(found) = found.filter(|_| others.is_empty()) else {
            return fail(&format!("it was made with another {}; it must be the same", others.join(", ")));
        };
        let shape = [self.width, self.height, self.stride, self.tiles.len()];
        if shape.iter().any(|n| reader.u64() != Some(*n as u64)) {
            return fail("it belongs to another size or other auxiliary images");
        }
        let mut tiles = self.tiles.clone();
        if tiles.iter_mut().any(|tile| reader.tile(tile).is_none()) || !reader.0.is_empty() {
            return fail("its length is not that of the picture");
        }
        self.tiles = tiles;
        Ok(found)
    }
}

/// A part of what a picture depends on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Key {
    /// What it is, for people.
    pub(crate) name: &'static str,
    /// A checksum that changes with it.
    pub(crate) sum: u64,
}

impl Key {
    pub(crate) fn new(name: &'static str, text: &str) -> Self {
        Self { name, sum: checksum(text.as_bytes()) }
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn tile(&mut self, tile: &mut Tile) -> Option<()> {
        tile.count = u32::from_le_bytes(self.take()?);
        tile.active = u32::from_le_bytes(self.take()?) != 0;
        tile.not_finite = u64::from_le_bytes(self.take()?);
        for s in &mut tile.sums {
            *s = f64::from_le_bytes(self.take()?);
        }
        for i in &mut tile.ids {
            *i = u32::from_le_bytes(self.take()?);
        }
        Some(())
    }
}

/// Fowler, Noll and Vo's hash over words: finds damage, not malice.
fn checksum(bytes: &[u8]) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325_u64;
    let mut step = |word: u64| h = (h ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(29);
    let (words, rest) = bytes.as_chunks::<8>();
    words.iter().for_each(|w| step(u64::from_le_bytes(*w)));
    rest.iter().for_each(|b| step(u64::from(*b)));
    h ^ bytes.len() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Aov, Film};
    use photofit_mutants::{Packing, Shape, Target};

    /// A state whose checksum is right.
    static PACKING: Packing = Packing {
        unpack: |bytes| Some(vec![bytes.split_last_chunk::<8>()?.0.to_vec()]),
        pack: |parts| [&parts[0][..], &checksum(&parts[0]).to_le_bytes()].concat(),
        shapes: &[Shape::Bytes],
    };

    #[test]
    fn mutants_are_read_or_refused() {
        let keys = [Key { name: "camera", sum: 7 }, Key { name: "seed", sum: 8 }];
        let empty = Film::new(6, 5, &[Aov::Albedo, Aov::Instance]);
        let seeds = [empty.to_bytes(&keys)];
        assert_eq!(seeds[0].len(), empty.state_bytes(keys.len()));
        let seen = Target { name: "render-state", shape: Shape::Packed(&PACKING), seeds: &seeds }.run(
            |n| n == 2000,
            |bytes| {
                let mut film = empty.clone();
                film.restore(bytes, &keys[..1], &keys[1..]).map(drop).map_err(|e| e.to_string())
            },
        );
        seen.assert_deep("render-state", 5);
    }
}
