//! `integrator` elements: what bounds paths.

use super::Importer;
use crate::error::{Fault, fault};

/// How light is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MitsubaIntegrator {
    /// Most scattering events of a path; 0 shows emission alone.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path, if the scene says so.
    pub roulette_depth: Option<u32>,
    /// The camera sees neither the environment nor surfaces that emit, but what lies behind them.
    pub hide_emitters: bool,
}

/// Events that stand for "without bound".
const UNBOUNDED: u32 = 1 << 20;

impl Default for MitsubaIntegrator {
    /// Paths without a bound.
    fn default() -> Self {
        Self { max_depth: UNBOUNDED, roulette_depth: None, hide_emitters: false }
    }
}

impl Importer {
    pub(super) fn integrator(&mut self, element: usize) -> Result<MitsubaIntegrator, Fault> {
        let mut element = element;
        // They wrap the one that matters.
        for _ in 0..4 {
            if !matches!(self.reader.kind(element), "moment" | "aov") {
                break;
            }
            let nested = self.reader.nested(element, "integrator")?;
            let [(_, inner)] = nested[..] else {
                return Err(fault(
                    self.reader.place(element),
                    "has no integrator inside or several; it must have one",
                ));
            };
            self.reader.ignore(element, &["aovs"]);
            self.reader.finish(element);
            element = inner;
        }
        let hide_emitters = self.reader.boolean(element, "hide_emitters", false)?;
        let mut out = MitsubaIntegrator { hide_emitters, ..MitsubaIntegrator::default() };
        match self.reader.kind(element) {
            "direct" => {
                out.max_depth = 1;
                self.reader.ignore(element, &["emitter_samples", "bsdf_samples", "shading_samples"]);
            }
            "path" | "volpath" | "volpathmis" | "prb" | "prbvolpath" | "prb_basic" | "ptracer" => {
                let depth = self.reader.integer(element, "max_depth")?.unwrap_or(-1);
                if depth < -1 || depth > i64::from(UNBOUNDED) {
                    return Err(fault(
                        self.reader.place(element),
                        "max_depth is below -1; it must be -1 or not negative",
                    ));
                }
                // Mitsuba counts segments: 1 shows emission.
                if depth == 0 {
                    self.reader.unsupported(element, "max_depth 0 (a black picture)");
                }
                if depth > 0 {
                    out.max_depth = depth as u32 - 1;
                }
                let roulette = self.reader.integer(element, "rr_depth")?;
                if roulette.is_some_and(|r| r < 1) {
                    return Err(fault(
                        self.reader.place(element),
                        "rr_depth is below 1; it must be at least 1",
                    ));
                }
                out.roulette_depth = roulette.map(|r| u32::try_from(r).unwrap_or(u32::MAX));
                self.reader.ignore(element, &["samples_per_pass", "block_size", "timeout"]);
            }
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
            }
        }
        self.reader.finish(element);
        Ok(out)
    }
}
