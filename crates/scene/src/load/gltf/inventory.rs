//! What all objects of a document have: names of extensions, and application data.

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::collections::BTreeSet;
use std::fmt;

/// What the objects of a document have, wherever they stand; what stands in application data does not count.
#[derive(Debug, Default)]
pub(super) struct Inventory {
    /// Keys of every `extensions`.
    pub(super) extensions: BTreeSet<String>,
    /// Objects with `extras`.
    pub(super) extras: usize,
}

/// Values so deep within others are passed over.
const DEEPEST: u32 = 64;

impl Inventory {
    /// That of a JSON text; nothing but what is found is kept in memory.
    pub(super) fn of(text: &[u8]) -> Result<Self, serde_json::Error> {
        let mut out = Self::default();
        let mut json = serde_json::Deserializer::from_slice(text);
        Values { found: &mut out, names: false, depth: 0 }.deserialize(&mut json)?;
        Ok(out)
    }
}

/// Walks values; the keys of an object are `names` of extensions, or its own.
struct Values<'a> {
    found: &'a mut Inventory,
    names: bool,
    depth: u32,
}

impl<'de> DeserializeSeed<'de> for Values<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        if self.depth > DEEPEST { from.deserialize_ignored_any(self) } else { from.deserialize_any(self) }
    }
}

impl<'de> Visitor<'de> for Values<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any JSON")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "extras" if !self.names => {
                    self.found.extras += usize::from(map.next_value::<Option<IgnoredAny>>()?.is_some());
                }
                of => {
                    let names = !self.names && of == "extensions";
                    map.next_value_seed(Values { found: self.found, names, depth: self.depth + 1 })?;
                    if self.names {
                        self.found.extensions.insert(key);
                    }
                }
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let depth = self.depth + 1;
        while list.next_element_seed(Values { found: self.found, names: false, depth })?.is_some() {}
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }
}
