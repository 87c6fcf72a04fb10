//! Which layer of a file holds the colour, the albedo, the normals and so on.

use anyhow::{Result, bail};
use photofit_image::{Image, read, read_exr_layers, srgb_encode};
use std::fmt;
use std::path::Path;

/// What a layer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Color,
    Albedo,
    Normal,
    Depth,
    Position,
    Variance,
}

impl Kind {
    pub(crate) const GUIDES: [Self; 5] =
        [Self::Albedo, Self::Normal, Self::Depth, Self::Position, Self::Variance];

    fn name(self) -> &'static str {
        match self {
            Self::Color => "colour",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Variance => "variance",
        }
    }

    /// Names of layers, best first: the last part of a dotted name begins with one of them, letters only.
    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Color => &[
                "noisyimage",
                "combined",
                "color",
                "colour",
                "beauty",
                "rgba",
                "rgb",
                "radiance",
                "image",
                "noisy",
            ],
            Self::Albedo => {
                &["denoisingalbedo", "albedo", "diffcol", "diffusecolor", "basecolor", "diffusereflectance"]
            }
            Self::Normal => {
                &["denoisingnormal", "shnormal", "shadingnormal", "normal", "nn", "n", "geonormal"]
            }
            Self::Depth => &["denoisingdepth", "depth", "distance", "ddy", "dd", "z"],
            Self::Position => &["position", "worldposition", "pos", "pp", "p"],
            Self::Variance => &["variance", "colorvariance", "var"],
        }
    }

    fn channels(self) -> usize {
        if self == Self::Depth { 1 } else { 3 }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The layers of one file, in linear light.
pub(crate) struct Layers {
    file: String,
    encoded: bool,
    layers: Vec<(String, Image, Vec<String>)>,
}

impl Layers {
    /// Reads all layers of an `OpenEXR` file, or the one picture of another format.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let encoded = path.extension().is_some_and(|e| !exr && !e.eq_ignore_ascii_case("hdr"));
        let layers = match exr {
            true => read_exr_layers(path)?,
            false => {
                let image = read(path)?;
                let names =
                    ["R", "G", "B", "A"][..image.channels.min(4)].iter().map(ToString::to_string).collect();
                vec![(String::new(), image, names)]
            }
        };
        Ok(Self { file: path.display().to_string(), encoded, layers })
    }

    /// The layer of a kind: its name, and its channels in order (3, or 1 for a depth; 4 for a colour with alpha).
    /// A plain `Z` beside R, G, B is a depth.
    pub(crate) fn find(&self, kind: Kind) -> Option<(String, Image)> {
        for wanted in kind.names() {
            for (name, image, channels) in &self.layers {
                if matches(name, wanted) && image.channels >= kind.channels() && !only_alpha(channels) {
                    return Some((name.clone(), self.take(kind, image)));
                }
            }
        }
        let (_, image, channels) = self.layers.iter().find(|(name, ..)| name.is_empty())?;
        match kind {
            Kind::Color if image.channels >= 3 => Some((String::new(), self.take(kind, image))),
            Kind::Depth if image.channels > 1 => {
                let z = channels.iter().position(|c| c == "Z")?;
                (channels[0] == "R").then(|| ("Z".to_owned(), image.select(&[z])))
            }
            _ => None,
        }
    }

    /// The layer of a kind in a file that was given for it: by its name, or the first that has the channels.
    ///
    /// # Errors
    /// If none has.
    pub(crate) fn guide(&self, kind: Kind) -> Result<(String, Image)> {
        let first = || self.layers.iter().find(|(_, image, _)| image.channels >= kind.channels());
        match self.find(kind).or_else(|| first().map(|(n, i, _)| (n.clone(), self.take(kind, i)))) {
            Some(found) => Ok(found),
            None => bail!(
                "{}: no layer that could be the {kind}: {} channels are needed, found {}",
                self.file,
                kind.channels(),
                self.list()
            ),
        }
    }

    /// The colour.
    ///
    /// # Errors
    /// If there is none; the message lists what there is.
    pub(crate) fn color(&self) -> Result<(String, Image)> {
        if let Some(found) = self.find(Kind::Color) {
            return Ok(found);
        }
        // One layer of an unknown name is the picture unless its name says that it is a guide.
        if let [(name, image, _)] = &self.layers[..]
            && image.channels >= 3
            && Kind::GUIDES.iter().all(|k| self.find(*k).is_none())
        {
            return Ok((name.clone(), self.take(Kind::Color, image)));
        }
        bail!(
            "{}: no layer with a colour (R, G, B; or a name such as color, beauty, Combined), found {}",
            self.file,
            self.list()
        )
    }

    fn take(&self, kind: Kind, image: &Image) -> Image {
        match kind {
            Kind::Depth => image.select(&[0]),
            Kind::Color if image.channels >= 4 => image.select(&[0, 1, 2, 3]),
            Kind::Normal => signed(image.select(&[0, 1, 2]), self.encoded),
            _ => image.select(&[0, 1, 2]),
        }
    }

    fn list(&self) -> String {
        let shown = self.layers.iter().map(|(name, _, channels)| {
            let name = if name.is_empty() { "(no name)" } else { name.as_str() };
            format!("{name}: {}", channels.join(" "))
        });
        shown.collect::<Vec<_>>().join("; ")
    }
}

/// Whether the last parts of a dotted layer name are `wanted`, letters only.
fn matches(name: &str, wanted: &str) -> bool {
    let letters = |s: &str| s.chars().filter(|c| c.is_alphabetic()).collect::<String>().to_ascii_lowercase();
    let parts: Vec<String> = name.split('.').map(letters).filter(|p| !p.is_empty()).collect();
    let last = parts.last().map_or("", String::as_str);
    let last_two = parts[parts.len().saturating_sub(2)..].concat();
    last == wanted || last_two == wanted
}

fn only_alpha(channels: &[String]) -> bool {
    channels.iter().all(|c| c == "A")
}

/// Normals as `2 v - 1` where they are stored as `v` in `[0, 1]`; PNG values are used as stored.
fn signed(image: Image, encoded: bool) -> Image {
    let image = if encoded { image.map(srgb_encode) } else { image };
    let negative = image.data.iter().any(|v| *v < -0.01);
    // Unit vectors of which no component is negative would have a mean length of 1 as stored.
    let length = |map: fn(f32) -> f32| {
        let sum: f64 = image
            .data
            .chunks_exact(3)
            .map(|p| f64::from(p.iter().map(|v| map(*v) * map(*v)).sum::<f32>().sqrt()))
            .map(|l| (l - 1.0).abs().min(1.0))
            .sum();
        sum
    };
    if !negative && length(|v| 2.0 * v - 1.0) < length(|v| v) { image.map(|v| 2.0 * v - 1.0) } else { image }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(list: &[(&str, &str)]) -> Layers {
        let layer = |(name, channels): &(&str, &str)| {
            let channels: Vec<String> = channels.split(' ').map(str::to_owned).collect();
            let value = name.len() as f32;
            (
                (*name).to_owned(),
                Image::from_fn(2, 2, channels.len(), |_, _, c| value + 100.0 * c as f32),
                channels,
            )
        };
        Layers { file: "a.exr".into(), encoded: false, layers: list.iter().map(layer).collect() }
    }

    fn found(list: &[(&str, &str)], kind: Kind) -> Option<String> {
        layers(list).find(kind).map(|(name, _)| name)
    }

    #[test]
    fn layouts_of_renderers_are_known() {
        let own = [
            ("albedo", "R G B"),
            ("color", "R G B A"),
            ("depth", "Z"),
            ("normal", "X Y Z"),
            ("position", "X Y Z"),
        ];
        let mitsuba = [("", "R G B A"), ("albedo", "R G B"), ("dd.y", "T"), ("nn", "X Y Z"), ("pp", "X Y Z")];
        let blender = [
            ("ViewLayer.Combined", "R G B A"),
            ("ViewLayer.Denoising Albedo", "R G B"),
            ("ViewLayer.Denoising Depth", "V"),
            ("ViewLayer.Denoising Normal", "X Y Z"),
            ("ViewLayer.DiffCol", "R G B"),
            ("ViewLayer.Mist", "Z"),
            ("ViewLayer.Noisy Image", "R G B A"),
            ("ViewLayer.Normal", "X Y Z"),
            ("ViewLayer.Position", "X Y Z"),
        ];
        type Names<'a> = &'a [(&'a str, &'a str)];
        let cases: [(Names<'_>, [&str; 5]); 3] = [
            (&own, ["color", "albedo", "normal", "depth", "position"]),
            (&mitsuba, ["", "albedo", "nn", "dd.y", "pp"]),
            (
                &blender,
                [
                    "ViewLayer.Noisy Image",
                    "ViewLayer.Denoising Albedo",
                    "ViewLayer.Denoising Normal",
                    "ViewLayer.Denoising Depth",
                    "ViewLayer.Position",
                ],
            ),
        ];
        for (list, expected) in cases {
            let kinds = [Kind::Color, Kind::Albedo, Kind::Normal, Kind::Depth, Kind::Position];
            for (kind, name) in kinds.into_iter().zip(expected) {
                assert_eq!(found(list, kind).as_deref(), Some(name), "{kind} of {list:?}");
            }
        }
        assert_eq!(found(&[("", "R G B Z")], Kind::Depth).as_deref(), Some("Z"));
        assert_eq!(found(&[("", "R G B")], Kind::Depth), None);
        assert_eq!(found(&blender, Kind::Variance), None);
        assert_eq!(found(&[("", "R G B"), ("animal", "R G B"), ("mist", "Z")], Kind::Normal), None);
    }

    #[test]
    fn what_is_missing_is_said_with_what_there_is() {
        let error = layers(&[("albedo", "R G B"), ("depth", "Z")]).color().err().unwrap().to_string();
        assert!(error.contains("albedo: R G B; depth: Z"), "{error}");
        let error = layers(&[("", "Y")]).guide(Kind::Normal).err().unwrap().to_string();
        assert!(error.contains("normal") && error.contains("(no name): Y"), "{error}");
        assert_eq!(layers(&[("whatever", "R G B")]).color().unwrap().0, "whatever");
    }

    #[test]
    fn normals_are_signed_again() {
        let stored = Image::from_data(2, 1, 3, vec![0.5, 0.5, 1.0, 1.0, 0.5, 0.5]);
        assert_eq!(signed(stored, false).data, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let plain = Image::from_data(2, 1, 3, vec![0.0, 0.0, 1.0, 0.6, 0.8, 0.0]);
        assert_eq!(signed(plain.clone(), false), plain);
    }
}
