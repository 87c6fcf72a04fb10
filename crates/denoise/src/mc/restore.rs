//! The stage `detail` of the automatic model: from which samples what the regression left over is brought back.
//!
//! Of a picture, from its own. Of a sequence, from the history first. Its samples were moved between pixels, frame after frame, which
//! blurs what varies from pixel to pixel, and reflections have moved on; none of that shows in their variance. The last frame has
//! samples of its own pixels, and their noise has next to no part in an estimate from the history: what is still missing is judged
//! and brought back by them, as if it were a picture by itself.

use super::black::classes;
use super::detail::{Detail, History, Shares, restore_detail};
use super::prepare::Prepared;

/// Adds to `estimate` what is significant in the samples, and tells the shares. `split` holds the weights of the two classes of pixels where
/// there are black ones.
pub(crate) fn restore(p: &Prepared<'_>, split: Option<&[Vec<f32>; 2]>, estimate: &mut [f32]) -> String {
    let n = p.shape.pixels();
    let features: Vec<(&[f32], f32)> = [(&p.features.normal, 5.5), (&p.features.albedo, 50.0)]
        .into_iter()
        .flat_map(|(f, scale)| f.iter().flat_map(|f| f.chunks(n)).map(move |plane| (plane, scale)))
        .collect();
    // Lamps by themselves: their residual must not reach what is around them.
    let apart = split.map(|[_, own]| own.iter().map(|w| f32::from(*w > 0.0)).collect::<Vec<_>>());
    let picture = Detail {
        width: p.shape.width,
        irradiance: &p.irradiance,
        weight: &p.trust,
        // Two halves tell too little of one pixel; a history tells the noise of those around over their frames.
        variance: p.variance.as_deref().filter(|_| p.halves.is_none()),
        independent: p.last.is_none() && p.halves.is_none(),
        features: &features,
        apart: apart.as_deref().unwrap_or_default(),
        history: None,
    };
    let mut why = by_classes(&picture, split, estimate);
    if let Some(last) = &p.last {
        let own = Detail {
            irradiance: &last.irradiance,
            weight: &last.weight,
            variance: last.variance.as_deref(),
            independent: true,
            history: p.variance.as_deref().map(|variance| History {
                irradiance: &p.irradiance,
                variance,
                frames: &p.weight,
            }),
            ..picture
        };
        let split = split.map(|_| classes(&last.weight, &p.black));
        why += &format!("; of the last frame {}", by_classes(&own, split.as_ref(), estimate));
    }
    why
}

/// Adds what one picture shows. Bilateral means tell the classes of `split` apart; others take them one by one.
fn by_classes(detail: &Detail<'_>, split: Option<&[Vec<f32>; 2]>, estimate: &mut [f32]) -> String {
    let bilateral = detail.independent && detail.variance.is_some();
    match split {
        Some([others, own]) if !bilateral => {
            told([others, own].map(|weight| restore_detail(&Detail { weight, ..*detail }, estimate)))
        }
        _ => told([restore_detail(detail, estimate)]),
    }
}

/// The shares of one or two classes in words.
fn told<const N: usize>(shares: [Shares; N]) -> String {
    let mut gaussian = 0.0;
    for shares in shares {
        match shares {
            Shares::Gaussian(share) => gaussian += share,
            Shares::Bilateral { means, own } => {
                let [wide, narrow] = means.map(|m| 100.0 * m);
                let own = 100.0 * own;
                return format!("{wide:.0}% of wide, {narrow:.0}% of narrow means, {own:.0}% own");
            }
        }
    }
    format!("{:.0}% of the residual as Gaussian means", 100.0 * gaussian)
}
