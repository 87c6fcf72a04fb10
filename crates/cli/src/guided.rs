//! How the guide of a path traced picture is trained, now and by the render that left a state.

use crate::args::{Render, RenderGuiding};
use crate::path_render::{SPP, SPP_MAX};
use photofit_fit::guiding::{Guiding, GuidingOptions, GuidingReport};
use photofit_pathtrace::RenderOptions;
use serde_json::{Value, json};

/// Share of the time limit that a guide may train.
pub(crate) const TRAINING_SHARE: f64 = 0.3;

/// What learns where light comes from.
pub(crate) fn guiding(a: &Render) -> Guiding {
    a.path.guiding.unwrap_or_default().into()
}

impl From<RenderGuiding> for Guiding {
    fn from(given: RenderGuiding) -> Self {
        match given {
            RenderGuiding::Off => Self::Off,
            RenderGuiding::Flow => Self::Flow,
            RenderGuiding::Lobes => Self::Lobes,
        }
    }
}

/// How a guide is trained for this picture, if it does not go on.
pub(crate) fn training(a: &Render, picture: &RenderOptions) -> GuidingOptions {
    let spp = match a.path.noise.is_some() && a.path.time_limit.is_none() {
        // Nobody knows how many samples it takes.
        true => picture.spp.min(SPP),
        false => picture.spp,
    };
    let own = GuidingOptions::for_picture(guiding(a), &RenderOptions { spp, ..picture.clone() });
    let limit = a.path.time_limit.map(|limit| limit.mul_f64(TRAINING_SHARE));
    GuidingOptions { limit, least_gain: a.path.least_gain.unwrap_or(own.least_gain), ..own }
}

/// How a guide may have been trained for a state of this picture, by a render that ended otherwise; `None`: not at all, or it was
/// given up.
pub(crate) fn trainings(a: &Render, picture: &RenderOptions) -> Vec<Option<GuidingOptions>> {
    let own = training(a, picture);
    if own.guiding == Guiding::Off {
        return vec![None];
    }
    let of_samples =
        |spp| GuidingOptions::for_picture(own.guiding, &RenderOptions { spp, ..picture.clone() }).records;
    let mut records = [picture.spp, SPP, SPP_MAX].map(of_samples).to_vec();
    records.sort_unstable();
    records.dedup();
    let trained = records.into_iter().flat_map(|records| {
        GuidingOptions::stages().map(move |(side, rounds)| GuidingOptions {
            records,
            side,
            ..own.with_rounds(rounds)
        })
    });
    trained.map(Some).chain([None]).collect()
}

/// What training came to, as JSON.
pub(crate) fn figures(report: &GuidingReport) -> Value {
    let finite = |v: f64| v.is_finite().then_some(v);
    json!({
        "used": report.used,
        "found_light": report.found,
        "gain": finite(report.gain),
        "least_gain": report.least_gain,
        "variance_ratio": finite(report.variance_ratio),
        "work_ratio": finite(report.work_ratio),
        "side": report.side,
        "rounds": report.rounds,
        "paths": report.paths,
        "records": report.records,
        "told": report.sentence(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Cli, Command};
    use crate::path_render::options;
    use clap::Parser as _;

    #[test]
    fn states_of_renders_that_end_otherwise_go_on() {
        let render = |more: &[&str]| {
            let line = ["photofit", "render", "a.glb", "-o", "a.png", "--integrator", "path"];
            let size = ["--width", "200", "--height", "100"];
            let line = [&line[..], &size, more].concat();
            let Command::Render(render) = Cli::try_parse_from(line).unwrap().command else {
                panic!("a render")
            };
            render
        };
        let ends: [&[&str]; 6] = [
            &[],
            &["--spp", "64", "--time-limit", "5"],
            &["--time-limit", "5"],
            &["--noise", "0.1"],
            &["--noise", "0.1", "--time-limit", "5"],
            &["--noise", "0.1", "--spp", "4096"],
        ];
        for guide in ["lobes", "flow"] {
            let one = |end: &[&str]| render(&[&["--guiding", guide], end].concat());
            for (before, after) in ends.iter().flat_map(|b| ends.iter().map(move |a| (b, a))) {
                let (before, after) = (one(before), one(after));
                let first = training(&before, &options(&before, Vec::new()));
                let known = trainings(&after, &options(&after, Vec::new()));
                let reached = |s: &(usize, u32)| s.0 <= first.side && s.1 <= first.rounds;
                for (side, rounds) in GuidingOptions::stages().filter(reached) {
                    let saved = GuidingOptions { side, ..first.with_rounds(rounds) };
                    assert!(known.contains(&Some(saved)), "{guide}: {before:?} {after:?}");
                }
                assert!(known.contains(&None));
            }
            let sized = |end: &[&str]| training(&one(end), &options(&one(end), Vec::new()));
            assert_eq!(sized(&["--noise", "0.1"]), sized(&[]), "{guide}: of unknown length");
            assert_ne!(sized(&["--noise", "0.1"]), sized(&["--spp", "4096"]));
            let other = one(&["--least-gain", "2"]);
            let own = training(&one(&[]), &options(&one(&[]), Vec::new()));
            assert!(!trainings(&other, &options(&other, Vec::new())).contains(&Some(own)), "another gain");
        }
        let off = render(&[]);
        assert_eq!(trainings(&off, &options(&off, Vec::new())), [None]);
    }
}
