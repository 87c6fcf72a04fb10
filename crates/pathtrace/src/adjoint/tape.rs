//! What a walk keeps of a short path, so that its replay needs no second walk.
//!
//! A tape has a fixed size: longer paths are walked again, and memory does not grow with the length of paths.

use super::layout::NONE;
use super::replay::{Replay, Total};
use super::surface::Here;
use crate::integrator::{Contribution, MediaFlight, PathVertex, ShadowFlight, Sink, SurfaceVisit};

/// Reports that are kept of one path: about four for every scattering event, in media six, where these emit light twelve.
pub(super) const LENGTH: usize = 192;

/// A report to a sink, as the replay needs it.
#[derive(Debug)]
enum Report {
    /// A surface: its place among those that are kept, if it has parameters.
    Surface(Option<usize>),
    Absorbed(u32, f32),
    ShadowAbsorbed(u32, f32),
    Flight(MediaFlight),
    ShadowFlight(ShadowFlight),
    Contribution(Contribution),
    Vertex(PathVertex),
    Split,
    NotFinite,
}

/// The reports of one path, in order.
#[derive(Debug, Default)]
pub(super) struct Tape {
    reports: Vec<Report>,
    /// Most reports that are kept.
    length: usize,
    /// The path had more of them.
    cut: bool,
}

impl Tape {
    pub(super) fn new(length: usize) -> Self {
        Self { reports: Vec::with_capacity(length), length, cut: false }
    }

    /// Begins a path.
    #[inline]
    pub(super) fn begin(&mut self) {
        self.reports.clear();
        self.cut = self.length == 0;
    }

    /// Whether the whole path is there.
    pub(super) fn is_whole(&self) -> bool {
        !self.cut
    }

    #[inline(always)]
    fn push(&mut self, report: Report) {
        if self.reports.len() < self.length {
            self.reports.push(report);
        } else {
            self.cut = true;
        }
    }

    /// Tells `replay` the path, as a walk would.
    pub(super) fn play(&self, replay: &mut Replay<'_>) {
        for report in &self.reports {
            match report {
                Report::Surface(place) => replay.here = *place,
                Report::Absorbed(material, length) => replay.absorbed(*material, *length),
                Report::ShadowAbsorbed(material, length) => replay.shadow_absorbed(*material, *length),
                Report::Flight(flight) => replay.flown(flight),
                Report::ShadowFlight(flight) => replay.shadow_flight(flight),
                Report::Contribution(light) => replay.contribution(light),
                Report::Vertex(vertex) => replay.vertex(vertex),
                Report::Split => replay.split(),
                Report::NotFinite => replay.not_finite(),
            }
        }
    }
}

/// The first walk of a path: sums up its light and keeps its reports.
#[derive(Debug)]
pub(super) struct Recorder<'a> {
    pub(super) light: Total<'a>,
    pub(super) tape: &'a mut Tape,
    /// Surfaces that have parameters.
    pub(super) surfaces: &'a mut Vec<Here>,
}

impl Sink for Recorder<'_> {
    const SURFACES: bool = true;
    const SPLITS: bool = true;
    const MEDIA: bool = true;

    #[inline(always)]
    fn flight(&mut self, flight: &MediaFlight) {
        if self.light.layout.media {
            self.tape.push(Report::Flight(*flight));
        }
    }

    #[inline(always)]
    fn shadow_flight(&mut self, flight: &ShadowFlight) {
        if self.light.layout.medium(flight.medium).extinction != NONE {
            self.tape.push(Report::ShadowFlight(*flight));
        }
    }

    #[inline(always)]
    fn splits(&self, first: &SurfaceVisit<'_>) -> u32 {
        self.light.splits(first)
    }

    #[inline(always)]
    fn split(&mut self) {
        self.light.split();
        self.tape.push(Report::Split);
    }

    #[inline(always)]
    fn surface(&mut self, visit: &SurfaceVisit<'_>) {
        if self.tape.cut {
            return;
        }
        let here = Here::new(self.light.world, self.light.layout, visit);
        let place = here.is_some().then_some(self.surfaces.len());
        self.surfaces.extend(here);
        self.tape.push(Report::Surface(place));
    }

    #[inline(always)]
    fn absorbed(&mut self, material: u32, length: f32) {
        self.tape.push(Report::Absorbed(material, length));
    }

    #[inline(always)]
    fn shadow_absorbed(&mut self, material: u32, length: f32) {
        self.tape.push(Report::ShadowAbsorbed(material, length));
    }

    #[inline(always)]
    fn contribution(&mut self, light: &Contribution) {
        self.light.contribution(light);
        self.tape.push(Report::Contribution(*light));
    }

    #[inline(always)]
    fn vertex(&mut self, vertex: &PathVertex) {
        self.tape.push(Report::Vertex(*vertex));
    }

    #[inline(always)]
    fn not_finite(&mut self) {
        self.tape.push(Report::NotFinite);
    }
}
