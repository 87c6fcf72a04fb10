//! The views of the judgement: pictures at the size that the asset is for, sliders and heat maps.

use super::{Verdict, page, pictures};
use crate::FitError;
use crate::simplify::{Outcome, ReportView, ViewQuality};
use photofit_image::heatmap;
use rayon::prelude::*;

/// Sides of the pictures that are tried in turn until the page stays below [`MOST_BYTES`].
const SIDES: [usize; 4] = [448, 352, 256, 160];
/// Bytes of all view pictures as text.
const MOST_BYTES: usize = 10_000_000;
/// FLIP that is shown as the brightest colour.
const HEAT: f32 = 0.5;
/// Smallest side of a picture at the size that the asset is for.
const LEAST_SIDE: usize = 16;

/// The worst view and the first other one, one pixel of the picture to one of the screen.
pub(super) fn at_size(o: &Outcome, screen_size: Option<f64>) -> Result<String, FitError> {
    let Some((worst, _)) = Verdict::of(o).worst else { return Ok(String::new()) };
    let Some(shipped) = o.stages.len().checked_sub(1) else { return Ok(String::new()) };
    let side = screen_size.map_or(o.resolution, |s| s.ceil() as usize).max(LEAST_SIDE).min(o.resolution);
    let other = (0..o.views.len()).find(|k| *k != worst);
    let mut figures = String::new();
    for k in [Some(worst), other].into_iter().flatten() {
        let view = &o.views[k];
        let kind = if k == worst { " (worst)" } else { "" };
        for (name, picture) in [("asset", &view.reference), (super::SHIPPED, &view.quality[shipped].picture)]
        {
            let uri = pictures::display(picture, side)?;
            figures += &page::figure(&uri, name, &format!("{name}, view {}{kind}", k + 1));
        }
    }
    let why = match screen_size {
        Some(s) if s > o.resolution as f64 => {
            format!("{side} pixels, the size of the report's pictures; the budget is for {s:.0} pixels")
        }
        Some(_) => format!("{side} pixels, the screen size that the budget is for"),
        None => format!("{side} pixels, the size of the report's pictures"),
    };
    Ok(format!("<h2>At its size</h2>\n<p class=note>{why}.</p>\n<div class=size>\n{figures}</div>\n"))
}

/// The section of all views, with the names of their stages; one of them is `shipped`.
pub(super) fn section(all: &[ReportView], names: &[&str], shipped: &str) -> Result<String, FitError> {
    if all.is_empty() {
        return Ok(String::new());
    }
    let mut cards = Vec::new();
    for side in SIDES {
        // One view of many tells whether a size will do.
        let first = card(0, &all[0], names, shipped, side)?;
        if first.len() * all.len() > MOST_BYTES && side != SIDES[SIDES.len() - 1] {
            continue;
        }
        let each = all.par_iter().enumerate();
        cards = each.map(|(i, v)| card(i, v, names, shipped, side)).collect::<Result<_, _>>()?;
        if cards.iter().map(String::len).sum::<usize>() <= MOST_BYTES {
            break;
        }
    }
    Ok(format!("<h2>Views</h2>\n{}", cards.concat()))
}

/// One view: a slider between two pictures, FLIP of the written file, and the stages before it folded.
fn card(
    index: usize,
    view: &ReportView,
    names: &[&str],
    shipped: &str,
    side: usize,
) -> Result<String, FitError> {
    let mut shown = String::new();
    let mut earlier = page::figure(&pictures::display(&view.reference, side)?, "reference", "reference");
    for (name, v) in names.iter().zip(&view.quality) {
        let q = &v.quality;
        let caption = format!("{name}<br>{} dB, SSIM {:.3}", q.decibels(2), q.ssim);
        earlier += &page::figure(&pictures::display(&v.picture, side)?, name, &caption);
        if *name == shipped {
            shown = format!(
                "<div class=heat>{}<div class=legend><i></i>FLIP, from 0 to {HEAT} and more</div>\n\
                 <p>PSNR {} dB<br>SSIM {:.3}<br>FLIP {:.4}</p></div>\n",
                heat(name, v, side)?,
                q.decibels(2),
                q.ssim,
                q.flip
            );
        } else {
            earlier += &heat(name, v, side)?;
        }
    }
    let choose = |chosen: &str| {
        let options: String = ["reference"]
            .iter()
            .chain(names)
            .map(|n| format!("<option{}>{n}</option>", if *n == chosen { " selected" } else { "" }))
            .collect();
        format!("<select aria-label=\"picture\">{options}</select>")
    };
    Ok(format!(
        "<section class=view>\n<h3>View {}</h3>\n<div>\n<div class=slider><img alt=\"\"><img class=after alt=\"\">\
         <div class=bar></div></div>\n<div class=choose>{}{}</div>\n</div>\n{shown}<details>\n<summary>Every stage</summary>\n\
         <div class=strip>\n{earlier}</div>\n</details>\n</section>\n",
        index + 1,
        choose("reference"),
        choose(shipped),
    ))
}

fn heat(name: &str, v: &ViewQuality, side: usize) -> Result<String, FitError> {
    let picture = pictures::linear(&heatmap(&v.flip, HEAT), side / 2)?;
    Ok(page::figure(&picture, &format!("FLIP of {name}"), &format!("FLIP of {name}: {:.4}", v.quality.flip)))
}
