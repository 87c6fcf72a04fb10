//! The rows of a plan: what runs, what is skipped, and why. Every task tells its plan in them.

use crate::engine::loss::{PictureLoss, Weights};
use crate::engine::surface::COARSE_RATE;
use crate::engine::trainer::{Measure, Phase};
use crate::report::grouped;
use photofit_raster::deferred::Passes;
use photofit_raster::loss::Loss;
use photofit_raster::{CHANNELS, channel};
use photofit_scene::Compression;
use std::fmt;

/// Whether a pass runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runs {
    /// It runs.
    Yes,
    /// It is skipped.
    No,
    /// What decides is not known yet.
    Open,
    /// Nothing runs: it is a fact.
    Note,
}

impl From<bool> for Runs {
    fn from(runs: bool) -> Self {
        if runs { Self::Yes } else { Self::No }
    }
}

/// One pass or piece of data.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// What it is.
    pub what: &'static str,
    /// Whether it runs.
    pub runs: Runs,
    /// Why.
    pub why: String,
}

impl Item {
    /// A pass that runs or not, with the reason for either.
    pub fn of(what: &'static str, runs: bool, why: impl Into<String>, why_not: impl Into<String>) -> Self {
        Self { what, runs: runs.into(), why: if runs { why.into() } else { why_not.into() } }
    }

    /// A fact.
    pub fn note(what: &'static str, why: impl Into<String>) -> Self {
        Self { what, runs: Runs::Note, why: why.into() }
    }
}

/// What a task runs and skips; printable and comparable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanRows {
    /// Passes and data.
    pub items: Vec<Item>,
    /// Stretches of the fit.
    pub phases: Vec<PhaseRow>,
}

/// A stretch of a fit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhaseRow {
    /// The step that it begins with.
    pub first: u64,
    /// What it does, in one line.
    pub text: String,
}

impl PhaseRow {
    /// The same as a stretch of one of several fits.
    pub(crate) fn of_part(&self, part: &str) -> Self {
        Self { text: format!("{part}: {}", self.text), ..*self }
    }
}

impl PlanRows {
    /// These items, and phases of a fit.
    pub fn new<M>(items: Vec<Item>, phases: &[Phase<'_, M>]) -> Self {
        Self { items, phases: self::phases(phases) }
    }

    /// The same of a fit that came as far as this step: without the phases that it did not begin.
    pub(crate) fn ended(mut self, reached: u64) -> Self {
        self.phases.retain(|p| p.first < reached);
        self
    }

    /// Adds where the fit runs and why; nothing is told without it.
    pub(crate) fn with_device(mut self, told: Option<String>) -> Self {
        self.items.extend(told.map(device));
        self
    }

    /// Whether what goes by this name runs; `None` where the plan does not speak of it.
    pub fn runs(&self, what: &str) -> Option<Runs> {
        self.items.iter().find(|i| i.what == what).map(|i| i.runs)
    }
}

impl fmt::Display for PlanRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = self.items.iter().map(|Item { what, runs, why }| {
            let runs = match runs {
                Runs::Yes => "run ",
                Runs::No => "skip",
                Runs::Open => "open",
                Runs::Note => "note",
            };
            format!("  {runs} {what:<22} {why}")
        });
        let phases = self.phases.iter().map(|p| format!("  {}", p.text));
        f.write_str(&lines.chain(phases).collect::<Vec<_>>().join("\n"))
    }
}

/// The row of the loss, with the noise of the pictures where it is known, of a fit that makes steps or none.
pub(crate) fn loss(loss: PictureLoss, noise: Option<f64>, steps: bool) -> Item {
    let why = match loss.loss {
        _ if !steps => NO_STEPS.into(),
        Loss::Mse if loss.weights == Weights::Relative => {
            "squares relative to the reference around a pixel: little biased by noise, and of wide range"
                .into()
        }
        unbiased => match (unbiased, noise) {
            (Loss::Mse, Some(noise)) => {
                format!("the pictures have relative noise {noise:.3}: unbiased squares")
            }
            (Loss::Mse, None) => "how noisy the pictures are is not known: unbiased squares".into(),
            (_, Some(noise)) if noise > 0.0 => {
                format!("relative noise {noise:.3} is low enough for logarithms")
            }
            (_, Some(_)) => "the pictures have no noise".into(),
            (_, None) => "the pictures are taken for clean".into(),
        },
    };
    Item { what: "logarithmic loss", runs: (steps && loss.loss != Loss::Mse).into(), why }
}

/// The row of where a fit runs, and why there.
pub(crate) fn device(why: String) -> Item {
    Item::note("device", why)
}

/// The row of mip levels with texels of their own, and the sizes of the pictures that they are fitted to, by a fit that makes
/// steps or none.
pub(crate) fn free_mips([least, most]: [usize; 2], steps: bool) -> Item {
    let why = format!(
        "each level has texels of its own, fitted to pictures of {least} to {most} pixels, coarse ones at {COARSE_RATE} times the \
         rate of maps"
    );
    Item::of(FREE_MIPS, steps, why, NO_STEPS)
}

/// Share of pixels below which no figure is told.
const LEAST_TOLD: f64 = 1e-4;

/// The row of views that show the backs of single-sided surfaces: the share of the asset's pixels that these change, and of the
/// views.
pub(crate) fn backs(seen: f64, share: f32) -> Item {
    let percent = 100.0 * seen;
    let shown = format!(
        "renderers that know no sides show them in {percent:.1}% of the asset's pixels, as do {:.0}% of the views of the fit",
        100.0 * share
    );
    let why_not = match seen {
        seen if seen <= 0.0 => "none is seen".to_owned(),
        seen if seen < LEAST_TOLD => {
            format!("they are seen in less than {}% of the asset's pixels", 100.0 * LEAST_TOLD)
        }
        _ => format!("they are seen in {percent:.2}% of the asset's pixels alone"),
    };
    Item::of("single-sided backs", share > 0.0, shown, why_not)
}

/// The row of a loss that the options ask for.
pub(crate) fn asked_loss(loss: PictureLoss, steps: bool) -> Item {
    Item::of("loss", steps, format!("{} is asked for: {}", loss.name(), loss.about()), NO_STEPS)
}

/// The row of a loss that a task has, whatever its pictures are.
pub(crate) fn own_loss(loss: PictureLoss, steps: bool) -> Item {
    let why = format!("{}, the only one of this task: {}", loss.name(), loss.about());
    Item::of("loss", steps, why, NO_STEPS)
}

/// Why nothing is fitted where no steps are made: none are asked for, nothing asks for one, or the work ended before the first.
pub(crate) const NO_STEPS: &str = "no steps are made";

const FREE_MIPS: &str = "free mip levels";

/// The row of mip levels where the asset's own textures are written.
pub(crate) fn own_mips() -> Item {
    let why = "the asset's own textures are written, whose levels follow from their bases".into();
    Item { what: FREE_MIPS, runs: Runs::No, why }
}

/// Why only one layer is drawn.
pub(crate) fn opaque() -> String {
    format!("every surface is opaque: one layer in place of {}, no blending", Passes::default().max_layers)
}

/// The row of a budget of bytes; once the file is written with its bytes, and how textures and geometry are stored.
pub(crate) fn bytes(most: u64, file: Option<(u64, &str, Compression)>) -> Item {
    let most_told = grouped(most);
    let why = match file {
        None => format!(
            "at most {most_told}: textures, and where it is compressed geometry, are stored smaller as far as it needs"
        ),
        Some((bytes, textures, geometry)) => {
            let found = if bytes > most { ", the fewest that were found," } else { "" };
            let geometry = match geometry {
                Compression::None => String::new(),
                compressed => format!("geometry {}, ", compressed.name()),
            };
            format!("{}{found} of at most {most_told}: {geometry}textures {textures}", grouped(bytes))
        }
    };
    Item { what: "bytes of the file", runs: Runs::Yes, why }
}

/// The row of the steps that were made, of those that were to be made at most, and by how many dB the fit was behind the asset's own
/// materials where it ended early for that.
pub(crate) fn steps(made: u64, most: u64, behind: Option<f64>) -> Item {
    let behind = behind.map_or(String::new(), |b| {
        format!(
            ": the asset's own materials look {b:.1} dB better, which no step could be expected to make up for"
        )
    });
    Item::of(
        "steps",
        made > 0,
        format!("{made} of at most {most}{behind}"),
        format!("none of at most {most}"),
    )
}

/// Triangles of an asset that nobody sees; those without area do not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unseen {
    /// Left out of the decimation.
    pub(crate) dropped: usize,
    /// All that nobody sees.
    pub(crate) unseen: usize,
    /// All.
    pub(crate) all: usize,
}

/// The row of triangles of the asset that nobody sees, where the start is decimated from it.
pub(crate) fn unseen(Unseen { dropped, unseen, all }: Unseen) -> Item {
    const ROW: &str = "unseen triangles";
    match (dropped, unseen) {
        (0, 0) => Item::note(ROW, format!("none of {all}")),
        (0, _) => Item::note(ROW, format!("{unseen} of {all}: none of them is left out for that")),
        _ => {
            let why = format!("{dropped} of {all}: left out of the decimation, of {unseen} that nobody sees");
            Item { what: ROW, runs: Runs::No, why }
        }
    }
}

/// What a fit does with a surface: all that its rows are told from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Work {
    /// Passes of the renderer.
    pub(crate) passes: Passes,
    /// Relative rates of the samples of a texel.
    pub(crate) rates: [f32; CHANNELS],
    /// The same in coarse mip levels that have texels of their own, where there are some.
    pub(crate) coarse: Option<[f32; CHANNELS]>,
    /// Whether each sample varies and stays as it is.
    pub(crate) held: [bool; CHANNELS],
    /// Whether positions may move.
    pub(crate) moves: bool,
    /// Whether steps are made.
    pub(crate) steps: bool,
}

/// Samples of a texel that are drawn: what they are for people, the first, and how many.
const SAMPLES: [(&str, usize, usize); 7] = [
    ("base colour", channel::BASE_COLOR, 3),
    ("alpha", channel::ALPHA, 1),
    ("specular suppression", channel::SPECULAR_SUPPRESSION, 1),
    ("roughness", channel::ROUGHNESS, 1),
    ("metalness", channel::METALLIC, 1),
    ("normals", channel::NORMAL, 3),
    ("emission", channel::EMISSIVE, 3),
];

/// What becomes of the samples that are not fitted, where `fitted` are: empty where all are.
fn others(fitted: usize, held: &[bool; CHANNELS]) -> String {
    let is_held = |(_, first, count): &&(&str, usize, usize)| held[*first..first + count].contains(&true);
    let names: Vec<&str> = SAMPLES.iter().filter(is_held).map(|s| s.0).collect();
    let mut out = String::new();
    if !names.is_empty() {
        out += &format!("; held as they are: {}", names.join(", "));
    }
    if fitted + held[..channel::USED].iter().filter(|h| **h).count() < channel::USED {
        out += "; the others are constant";
    }
    if held[channel::OCCLUSION] {
        out += "; occlusion is carried along, not drawn";
    }
    out
}

/// The rows of a surface, as its passes and rates say.
pub(crate) fn surface(work: &Work) -> Vec<Item> {
    let Work { passes: p, rates, coarse, held, moves, steps } = work;
    let not = |why: &str| if *steps { why.to_owned() } else { NO_STEPS.to_owned() };
    let positions = *steps && *moves && p.position_gradients;
    let layers = format!("until nothing shows through, at most {} layers", p.max_layers);
    let mut items = vec![
        Item::of("position gradients", positions, "the shape is fitted", not("the shape stays")),
        Item::of(
            "silhouette gradients",
            *steps && p.antialias,
            "where neighbouring samples show different triangles",
            not("positions are frozen"),
        ),
        Item::of("transparent layers", p.max_layers > 1, layers, opaque()),
        Item::of("normal map", p.normal_map, "new maps have one, which is drawn", "that of new maps is flat"),
        Item::of("emission", p.emissive, "it is drawn", "nothing emits"),
    ];
    let of = |rates: &[f32; CHANNELS]| rates.iter().filter(|r| **r > 0.0).count();
    let fitted = if *steps && p.map_gradients { of(rates) } else { 0 };
    let in_coarse = coarse.as_ref().map(of).filter(|n| fitted > 0 && *n > fitted);
    let more = in_coarse.map_or_else(String::new, |n| format!(" and {n} in coarse mip levels"));
    let others = others(in_coarse.unwrap_or(fitted), held);
    items.push(Item::of(
        "map gradients",
        fitted > 0,
        format!("{fitted} of {} samples of a texel{more}{others}", channel::USED),
        not(&format!("no sample of a texel is fitted{others}")),
    ));
    let gradients = [
        ("base colour gradients", channel::BASE_COLOR, true),
        ("alpha gradients", channel::ALPHA, p.alpha_gradients),
        ("roughness gradients", channel::ROUGHNESS, true),
        ("metalness gradients", channel::METALLIC, true),
        ("normal gradients", channel::NORMAL, p.normal_map),
        ("emission gradients", channel::EMISSIVE, p.emissive),
    ];
    for (what, channel, drawn) in gradients {
        let rate = rates[channel];
        let in_coarse = coarse.is_some_and(|rates| rates[channel] > 0.0);
        let flows = fitted > 0 && drawn && (rate > 0.0 || in_coarse);
        let why = match rate {
            r if r <= 0.0 => "fitted in coarse mip levels alone, which lose normals".into(),
            r if r < 1.0 => format!("at {r:.1} of the rate of maps"),
            _ => "fitted".into(),
        };
        let stays = if held[channel] { "held as it is" } else { "constant" };
        items.push(Item::of(what, flows, why, not(stays)));
    }
    items
}

/// The row of the evaluations: whether pictures are clamped to what a screen shows before they are compared.
pub(crate) fn evaluation(measure: Measure, why: &str) -> Item {
    let clamped = measure != Measure::Relative;
    let how = if clamped { "PSNR of sRGB in [0, 1]" } else { "relative squared error of linear light" };
    Item { what: "clamped evaluation", runs: clamped.into(), why: format!("{how}: {why}") }
}

/// One row for each phase that has steps.
pub(crate) fn phases<M>(phases: &[Phase<'_, M>]) -> Vec<PhaseRow> {
    let mut groups: Vec<&str> = Vec::new();
    for (name, _) in phases.iter().flat_map(|p| &p.rates) {
        if !groups.contains(&&**name) {
            groups.push(name);
        }
    }
    let peak = |name: &str| phases.iter().map(|p| p.rate(name)).fold(0.0, f64::max);
    let line = |p: &Phase<'_, M>| {
        let moves: Vec<String> = groups
            .iter()
            .map(|name| match p.rate(name) / peak(name) {
                share if share.is_nan() || share <= 0.0 => format!("{name} frozen"),
                share if share < 0.999 => format!("{name} at {share:.1} of their rate"),
                _ => format!("{name} at their full rate"),
            })
            .collect();
        let size = match p.shrink {
            1 => String::new(),
            n => format!(", pictures 1/{n} as wide"),
        };
        let fade = if p.fade.is_some() { ", masks fade" } else { "" };
        let text = format!("{}: {} steps at most, {}{size}{fade}", p.name, p.steps, moves.join(", "));
        PhaseRow { first: p.first, text }
    };
    phases.iter().filter(|p| p.steps > 0).map(line).collect()
}
