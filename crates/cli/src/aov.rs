//! Which layer of a file holds the colour, the albedo, the normals and so on.

use anyhow::{Result, bail};
use photofit_image::{ExrLayer, Image, read, read_exr_planes, srgb_encode};
use std::fmt;
use std::path::Path;
use std::sync::Arc;

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
    const ALL: [Self; 6] =
        [Self::Color, Self::Albedo, Self::Normal, Self::Depth, Self::Position, Self::Variance];

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

/// Some planes of a file's layer.
#[derive(Clone, Debug)]
pub(crate) struct Planes {
    pub(crate) width: usize,
    pub(crate) height: usize,
    all: Arc<Vec<f32>>,
    /// The first plane, and how many there are.
    first: usize,
    pub(crate) count: usize,
}

impl Planes {
    /// The samples, plane by plane.
    pub(crate) fn samples(&self) -> &[f32] {
        self.first_planes(self.count)
    }

    /// Those of the first planes.
    pub(crate) fn first_planes(&self, count: usize) -> &[f32] {
        let n = self.width * self.height;
        &self.all[self.first * n..(self.first + count) * n]
    }

    /// Those of the last plane, where there are more than three: alpha.
    pub(crate) fn alpha(&self) -> Option<&[f32]> {
        self.samples().chunks(self.width * self.height).nth(3)
    }

    /// Others in their place, as many.
    #[must_use]
    pub(crate) fn with(&self, samples: Vec<f32>) -> Self {
        Self { all: Arc::new(samples), first: 0, ..*self }
    }

    /// As an image of the first three.
    pub(crate) fn to_rgb(&self) -> Image {
        Image::from_planes(self.width, self.height, self.first_planes(3))
    }
}

/// A layer, its planes apart.
struct Layer {
    head: ExrLayer,
    planes: Arc<Vec<f32>>,
}

impl From<ExrLayer> for Layer {
    fn from(mut head: ExrLayer) -> Self {
        let planes = Arc::new(std::mem::take(&mut head.planes));
        Self { head, planes }
    }
}

impl Layer {
    fn planes(&self, first: usize, count: usize) -> Planes {
        let ExrLayer { width, height, .. } = self.head;
        Planes { width, height, all: self.planes.clone(), first, count }
    }
}

/// The layers of one file, in linear light.
pub(crate) struct Layers {
    file: String,
    encoded: bool,
    layers: Vec<Layer>,
}

impl Layers {
    /// Reads all layers of an `OpenEXR` file, or the one picture of another format.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        Self::read_wanted(path, |layers| vec![true; layers.len()])
    }

    /// The same without the samples of layers whose names say that they are of no kind.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn read_known(path: &Path) -> Result<Self> {
        let named = |layer: &ExrLayer| {
            let names = Kind::ALL.iter().flat_map(|kind| kind.names());
            layer.name.is_empty() || names.into_iter().any(|wanted| matches(&layer.name, wanted))
        };
        // A single layer is the picture, whatever its name.
        Self::read_wanted(path, |layers| layers.iter().map(|l| layers.len() == 1 || named(l)).collect())
    }

    fn read_wanted(path: &Path, wanted: impl FnOnce(&[ExrLayer]) -> Vec<bool>) -> Result<Self> {
        let exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let encoded = path.extension().is_some_and(|e| !exr && !e.eq_ignore_ascii_case("hdr"));
        let layers = match exr {
            true => read_exr_planes(path, wanted)?,
            false => {
                let image = read(path)?;
                let names = ["R", "G", "B", "A"][..image.channels.min(4)].iter().map(ToString::to_string);
                vec![ExrLayer::of_image(String::new(), &image, names.collect())]
            }
        };
        let layers = layers.into_iter().map(Layer::from).collect();
        Ok(Self { file: path.display().to_string(), encoded, layers })
    }

    /// The layer of a kind: its name, and its channels in order (3, or 1 for a depth; 4 for a colour with alpha).
    /// A plain `Z` beside R, G, B is a depth.
    pub(crate) fn find(&self, kind: Kind) -> Option<(String, Planes)> {
        for wanted in kind.names() {
            for layer in &self.layers {
                let ExrLayer { name, channels, .. } = &layer.head;
                if matches(name, wanted) && channels.len() >= kind.channels() && !only_alpha(channels) {
                    return Some((name.clone(), self.take(kind, layer)));
                }
            }
        }
        let plain = self.layers.iter().find(|l| l.head.name.is_empty())?;
        let channels = &plain.head.channels;
        match kind {
            Kind::Color if channels.len() >= 3 => Some((String::new(), self.take(kind, plain))),
            Kind::Depth if channels.len() > 1 => {
                let z = channels.iter().position(|c| c == "Z")?;
                (channels[0] == "R").then(|| ("Z".to_owned(), plain.planes(z, 1)))
            }
            _ => None,
        }
    }

    /// The layer of a kind in a file that was given for it: by its name, or the first that has the channels.
    ///
    /// # Errors
    /// If none has.
    pub(crate) fn guide(&self, kind: Kind) -> Result<(String, Planes)> {
        let first = || self.layers.iter().find(|l| l.head.channels.len() >= kind.channels());
        match self.find(kind).or_else(|| first().map(|l| (l.head.name.clone(), self.take(kind, l)))) {
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
    pub(crate) fn color(&self) -> Result<(String, Planes)> {
        if let Some(found) = self.find(Kind::Color) {
            return Ok(found);
        }
        // One layer of an unknown name is the picture unless its name says that it is a guide.
        if let [layer] = &self.layers[..]
            && layer.head.channels.len() >= 3
            && Kind::GUIDES.iter().all(|k| self.find(*k).is_none())
        {
            return Ok((layer.head.name.clone(), self.take(Kind::Color, layer)));
        }
        bail!(
            "{}: no layer with a colour (R, G, B; or a name such as color, beauty, Combined), found {}",
            self.file,
            self.list()
        )
    }

    fn take(&self, kind: Kind, layer: &Layer) -> Planes {
        match kind {
            Kind::Depth => layer.planes(0, 1),
            Kind::Color => {
                let alpha = layer.head.channels.get(3).is_some_and(|c| c.eq_ignore_ascii_case("a"));
                layer.planes(0, 3 + usize::from(alpha))
            }
            Kind::Normal => signed(layer.planes(0, 3), self.encoded),
            _ => layer.planes(0, 3),
        }
    }

    fn list(&self) -> String {
        let shown = self.layers.iter().map(|Layer { head: ExrLayer { name, channels, .. }, .. }| {
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
fn signed(planes: Planes, encoded: bool) -> Planes {
    let map =
        |planes: &Planes, f: fn(f32) -> f32| planes.with(planes.samples().iter().map(|v| f(*v)).collect());
    let planes = if encoded { map(&planes, srgb_encode) } else { planes };
    let stored = planes.samples();
    if stored.iter().any(|v| *v < -0.01) {
        return planes;
    }
    // Unit vectors of which no component is negative would have a mean length of 1 as stored.
    let n = stored.len() / 3;
    let length = |map: fn(f32) -> f32| {
        let squares = |i: usize| (0..3).map(|c| map(stored[c * n + i]).powi(2)).sum::<f32>();
        let sum: f64 = (0..n).map(|i| f64::from(squares(i).sqrt())).map(|l| (l - 1.0).abs().min(1.0)).sum();
        sum
    };
    if length(|v| 2.0 * v - 1.0) < length(|v| v) { map(&planes, |v| 2.0 * v - 1.0) } else { planes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_image::write_exr_planes;
    use photofit_mutants::{Shape, Target};

    fn layers(list: &[(&str, &str)]) -> Layers {
        let layer = |(name, channels): &(&str, &str)| {
            let channels: Vec<String> = channels.split(' ').map(str::to_owned).collect();
            let value = name.len() as f32;
            let image = Image::from_fn(2, 2, channels.len(), |_, _, c| value + 100.0 * c as f32);
            ExrLayer::of_image((*name).to_owned(), &image, channels).into()
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
        assert!(layers(&[("", "R G B Z")]).color().unwrap().1.alpha().is_none(), "depth is no alpha");
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
    fn layers_of_no_kind_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = Image::from_fn(4, 3, 4, |x, y, c| (x + 10 * y + 100 * c) as f32);
        let (rgb, rgba) = (image.select(&[0, 1, 2]), ["R", "G", "B", "A"]);
        let direct = ("direct", &rgb, &rgba[..3]);
        let all = [("color", &image, &rgba[..]), ("albedo", &rgb, &rgba[..3]), direct];
        photofit_image::write_exr(&path, &all).unwrap();
        let read = |layers: Layers| {
            let (_, color) = layers.color().unwrap();
            assert_eq!(color.to_rgb(), rgb);
            assert_eq!(color.alpha(), Some(&image.planes()[36..]));
            assert_eq!(layers.find(Kind::Albedo).unwrap().1.to_rgb(), rgb);
            let samples = |l: &Layer| (l.head.name.clone(), l.planes.len());
            layers.layers.iter().map(samples).collect::<Vec<_>>()
        };
        let sizes =
            |direct| [("color", 48), ("albedo", 36), ("direct", direct)].map(|(n, s)| (n.to_owned(), s));
        assert_eq!(read(Layers::read(&path).unwrap()), sizes(36));
        assert_eq!(read(Layers::read_known(&path).unwrap()), sizes(0));
        photofit_image::write_exr(&path, &[direct]).unwrap();
        assert_eq!(Layers::read_known(&path).unwrap().color().unwrap().1.to_rgb(), rgb, "a single layer is");
    }

    #[test]
    fn normals_are_signed_again() {
        let planes = |image: &Image| {
            let names = ["X", "Y", "Z"].map(str::to_owned).to_vec();
            Layer::from(ExrLayer::of_image(String::new(), image, names)).planes(0, 3)
        };
        let stored = Image::from_data(2, 1, 3, vec![0.5, 0.5, 1.0, 1.0, 0.5, 0.5]);
        assert_eq!(signed(planes(&stored), false).to_rgb().data, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let plain = Image::from_data(2, 1, 3, vec![0.0, 0.0, 1.0, 0.6, 0.8, 0.0]);
        assert_eq!(signed(planes(&plain), false).to_rgb(), plain);
    }

    /// Files of several layers, as `denoise` reads them.
    #[test]
    fn mutants_are_read_or_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("layers.exr");
        let layer = |name: &str, channels: &[&str]| {
            let (width, height) = (5, 4);
            let planes = (0..width * height * channels.len()).map(|i| 0.1 * i as f32).collect();
            let channels = channels.iter().map(ToString::to_string).collect();
            ExrLayer { name: name.into(), width, height, channels, planes }
        };
        let files = [
            vec![layer("color", &["R", "G", "B"]), layer("normal", &["X", "Y", "Z"]), layer("depth", &["Z"])],
            vec![layer("", &["R", "G", "B", "A"])],
        ];
        let seeds = files.map(|layers| {
            write_exr_planes(&path, &layers).unwrap();
            std::fs::read(&path).unwrap()
        });
        let seen = Target { name: "layers", shape: Shape::Bytes, seeds: &seeds }.run(
            |n| n == 400,
            |bytes| {
                std::fs::write(&path, bytes).unwrap();
                let layers = Layers::read_known(&path).map_err(|e| format!("{e:#}"))?;
                layers.color().map_err(|e| format!("{e:#}"))?;
                Kind::GUIDES.iter().for_each(|kind| drop(layers.find(*kind)));
                Ok(())
            },
        );
        seen.assert_deep("layers", 10);
    }
}
