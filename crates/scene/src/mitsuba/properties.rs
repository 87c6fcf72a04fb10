//! Typed access to the properties of a plugin, and the list of what is not supported.

use super::document::Document;
use crate::error::{Fault, fault};
use crate::load::clip;
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};
use std::collections::HashSet;

/// Reads elements, and remembers which ones it has read.
#[derive(Debug)]
pub(super) struct Reader {
    pub(super) document: Document,
    used: HashSet<usize>,
    unsupported: Vec<String>,
    /// Those listed so far.
    listed: HashSet<String>,
}

/// Most entries of the list of what is not supported.
const LISTED: usize = 64;

impl Reader {
    pub(super) fn new(document: Document) -> Self {
        Self { document, used: HashSet::new(), unsupported: Vec::new(), listed: HashSet::new() }
    }

    /// The place of an element in words.
    pub(super) fn place(&self, element: usize) -> String {
        self.document.place(self.document.elements[element].line)
    }

    /// Notes something that cannot be rendered.
    pub(super) fn unsupported(&mut self, element: usize, what: impl Into<String>) {
        let text = format!("{}: {}", self.place(element), what.into());
        if self.listed.insert(text.clone()) {
            self.unsupported.push(text);
        }
    }

    /// Everything that cannot be rendered, in order of discovery.
    pub(super) fn take_unsupported(&mut self) -> Vec<String> {
        let mut list = std::mem::take(&mut self.unsupported);
        if list.len() > LISTED {
            let more = list.len() - LISTED;
            list.truncate(LISTED);
            list.push(format!("and {more} more"));
        }
        list
    }

    pub(super) fn tag(&self, element: usize) -> &str {
        &self.document.elements[element].tag
    }

    pub(super) fn kind(&self, element: usize) -> &str {
        &self.document.elements[element].kind
    }

    /// Tag and plugin, for messages.
    pub(super) fn title(&self, element: usize) -> String {
        let e = &self.document.elements[element];
        if e.kind.is_empty() {
            format!("<{}>", clip(&e.tag))
        } else {
            format!("{} `{}`", clip(&e.tag), clip(&e.kind))
        }
    }

    /// Children of a plugin, references followed: name of the property, and the element.
    pub(super) fn children(&self, plugin: usize) -> Result<Vec<(String, usize, usize)>, Fault> {
        let mut out = Vec::new();
        for &child in &self.document.elements[plugin].children {
            let e = &self.document.elements[child];
            if e.tag != "ref" {
                out.push((e.name.clone(), child, child));
                continue;
            }
            let found = self.document.find(&e.id).ok_or_else(|| {
                fault(
                    self.place(child),
                    format!(
                        "the reference `{}` names nothing; there must be an element with that id",
                        clip(&e.id)
                    ),
                )
            })?;
            out.push((e.name.clone(), child, found));
        }
        Ok(out)
    }

    /// Whether there is a child with a name.
    pub(super) fn has(&self, plugin: usize, name: &str) -> bool {
        self.document.elements[plugin].children.iter().any(|c| self.document.elements[*c].name == name)
    }

    /// The child with a name whose element (references followed) has one of the tags; marked as read.
    pub(super) fn property(&mut self, plugin: usize, name: &str, tags: &[&str]) -> Option<usize> {
        let mut found = None;
        for &child in &self.document.elements[plugin].children {
            let e = &self.document.elements[child];
            if e.name != name {
                continue;
            }
            let target = if e.tag == "ref" { self.document.find(&e.id) } else { Some(child) };
            if let Some(t) = target.filter(|t| tags.contains(&self.tag(*t))) {
                found = Some((child, t));
            }
        }
        let (child, target) = found?;
        self.used.insert(child);
        Some(target)
    }

    /// The children (references followed) with one of the tags, whatever their names; marked as read.
    pub(super) fn nested(&mut self, plugin: usize, tag: &str) -> Result<Vec<(String, usize)>, Fault> {
        let all = self.children(plugin)?;
        let mut out = Vec::new();
        for (name, child, target) in all {
            if self.tag(target) == tag {
                self.used.insert(child);
                out.push((name, target));
            }
        }
        Ok(out)
    }

    /// Marks all children as read.
    pub(super) fn mark_all(&mut self, plugin: usize) {
        self.used.extend(self.document.elements[plugin].children.iter().copied());
    }

    /// Notes all children of a plugin that nothing has read.
    pub(super) fn finish(&mut self, plugin: usize) {
        let unread: Vec<usize> = self.document.elements[plugin]
            .children
            .iter()
            .copied()
            .filter(|c| !self.used.contains(c))
            .collect();
        for child in unread {
            let e = &self.document.elements[child];
            let read = |c: &usize| self.used.contains(c) && self.document.elements[*c].name == e.name;
            let what = if e.name.is_empty() {
                format!("{} in {}", self.title(child), self.title(plugin))
            } else if self.document.elements[plugin].children.iter().any(read) {
                format!("a second `{}` of {}", clip(&e.name), self.title(plugin))
            } else {
                format!("the property `{}` of {}", clip(&e.name), self.title(plugin))
            };
            self.unsupported(child, what);
        }
    }

    /// Marks properties that do not change the picture.
    pub(super) fn ignore(&mut self, plugin: usize, names: &[&str]) {
        for &child in &self.document.elements[plugin].children {
            if names.contains(&self.document.elements[child].name.as_str()) {
                self.used.insert(child);
            }
        }
    }

    /// A number.
    pub(super) fn float(&mut self, plugin: usize, name: &str) -> Result<Option<f64>, Fault> {
        match self.property(plugin, name, &["float", "integer"]) {
            Some(e) => self.attribute_number(e, "value").map(Some),
            None => Ok(None),
        }
    }

    /// A whole number.
    pub(super) fn integer(&mut self, plugin: usize, name: &str) -> Result<Option<i64>, Fault> {
        let Some(e) = self.property(plugin, name, &["integer"]) else { return Ok(None) };
        let text = self.attribute(e, "value")?;
        match text.trim().parse() {
            Ok(n) => Ok(Some(n)),
            Err(cause) => {
                let cause: std::num::ParseIntError = cause;
                Err(fault(self.place(e), format!("`{}` is no whole number: {cause}", clip(text))))
            }
        }
    }

    /// A text.
    pub(super) fn string(&mut self, plugin: usize, name: &str) -> Result<Option<String>, Fault> {
        match self.property(plugin, name, &["string"]) {
            Some(e) => self.attribute(e, "value").map(|s| Some(s.to_owned())),
            None => Ok(None),
        }
    }

    /// A truth value.
    pub(super) fn boolean(&mut self, plugin: usize, name: &str, default: bool) -> Result<bool, Fault> {
        let Some(e) = self.property(plugin, name, &["boolean"]) else { return Ok(default) };
        match self.attribute(e, "value")?.trim().to_ascii_lowercase().as_str() {
            "true" => Ok(true),
            "false" => Ok(false),
            other => {
                Err(fault(self.place(e), format!("the value is `{}`; it must be true or false", clip(other))))
            }
        }
    }

    /// A point or vector.
    pub(super) fn point(&mut self, plugin: usize, name: &str) -> Result<Option<DVec3>, Fault> {
        match self.property(plugin, name, &["point", "vector"]) {
            Some(e) => self.vector(e, DVec3::ZERO).map(Some),
            None => Ok(None),
        }
    }

    fn attribute(&self, element: usize, name: &str) -> Result<&str, Fault> {
        let e = &self.document.elements[element];
        e.attribute(name).ok_or_else(|| {
            fault(
                self.place(element),
                format!("<{}> has no attribute {name}; it must have one", clip(&e.tag)),
            )
        })
    }

    /// A number in an attribute.
    pub(super) fn attribute_number(&self, element: usize, name: &str) -> Result<f64, Fault> {
        let text = self.attribute(element, name)?;
        number(text).ok_or_else(|| {
            fault(self.place(element), format!("`{}` is not a finite number; it must be", clip(text)))
        })
    }

    /// Numbers in an attribute, between commas or spaces.
    pub(super) fn attribute_numbers(&self, element: usize, name: &str) -> Result<Vec<f64>, Fault> {
        let text = self.attribute(element, name)?;
        let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty());
        words
            .map(|w| {
                number(w).ok_or_else(|| {
                    fault(self.place(element), format!("`{}` is not a finite number; it must be", clip(w)))
                })
            })
            .collect()
    }

    /// Three numbers in an attribute.
    pub(super) fn attribute_vector(&self, element: usize, name: &str) -> Result<DVec3, Fault> {
        match self.attribute_numbers(element, name)?[..] {
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            ref other => Err(fault(
                self.place(element),
                format!("{name} has {} numbers; it must have 3 numbers", other.len()),
            )),
        }
    }

    /// `value` with one or three numbers, or any of `x`, `y` and `z`.
    pub(super) fn vector(&self, element: usize, default: DVec3) -> Result<DVec3, Fault> {
        let e = &self.document.elements[element];
        if e.attribute("value").is_some() {
            return match self.attribute_numbers(element, "value")?[..] {
                [x] => Ok(DVec3::splat(x)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                ref other => {
                    let rule = format!("has {} numbers; it must have 1 or 3 numbers", other.len());
                    Err(fault(self.place(element), rule))
                }
            };
        }
        let mut out = default;
        for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
            if e.attribute(name).is_some() {
                out[k] = self.attribute_number(element, name)?;
            }
        }
        Ok(out)
    }

    /// The value of an `rgb` element; hexadecimal digits are linear light in bytes, as in versions before 1 of the format.
    pub(super) fn rgb(&self, element: usize) -> Result<Vec3f, Fault> {
        if let Some(hex) = self.attribute(element, "value")?.trim().strip_prefix('#') {
            let bytes = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6 && !hex.starts_with('+'));
            let [_, r, g, b] = bytes.map(u32::to_be_bytes).ok_or_else(|| {
                let rule = format!("the colour is `#{}`; it must have six hexadecimal digits", clip(hex));
                fault(self.place(element), rule)
            })?;
            return Ok(Vec3f::from_array([r, g, b].map(|x| f32::from(x) / 255.0)));
        }
        match self.attribute_numbers(element, "value")?[..] {
            [x] => Ok(Vec3f::splat(x as f32)),
            [r, g, b] => Ok(vec3(r as f32, g as f32, b as f32)),
            ref other => {
                let rule = format!("the colour has {} numbers; it must have 1 or 3 numbers", other.len());
                Err(fault(self.place(element), rule))
            }
        }
    }
}

/// A finite number that single precision can hold.
fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite() && x.abs() <= f64::from(f32::MAX))
}
