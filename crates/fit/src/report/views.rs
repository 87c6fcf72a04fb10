//! The views of the judgement: pictures, sliders and heat maps.

use super::{page, pictures};
use crate::FitError;
use crate::simplify::{Outcome, ReportView, ViewQuality};
use photofit_image::heatmap;
use rayon::prelude::*;

/// Sides of the pictures that are tried in turn until the page stays below [`MOST_BYTES`].
const SIDES: [usize; 4] = [448, 352, 256, 160];
/// Bytes of all view pictures as text.
const MOST_BYTES: usize = 11_000_000;
/// FLIP that is shown as the brightest colour.
const HEAT: f32 = 0.5;

/// The section of all views.
pub(super) fn section(o: &Outcome) -> Result<String, FitError> {
    if o.views.is_empty() {
        return Ok(String::new());
    }
    let names: Vec<&str> = o.stages.iter().map(|s| s.0).collect();
    let mut cards = Vec::new();
    for side in SIDES {
        // One view of many tells whether a size will do.
        let first = card(0, &o.views[0], &names, side)?;
        if first.len() * o.views.len() > MOST_BYTES && side != SIDES[SIDES.len() - 1] {
            continue;
        }
        cards = o
            .views
            .par_iter()
            .enumerate()
            .map(|(i, v)| card(i, v, &names, side))
            .collect::<Result<_, _>>()?;
        if cards.iter().map(String::len).sum::<usize>() <= MOST_BYTES {
            break;
        }
    }
    Ok(format!("<h2>Views</h2>\n{}", cards.concat()))
}

fn card(index: usize, view: &ReportView, names: &[&str], side: usize) -> Result<String, FitError> {
    let mut strip = page::figure(&pictures::display(&view.reference, side)?, "reference", "reference");
    for (name, v) in names.iter().zip(&view.quality) {
        let q = &v.quality;
        let caption = format!("{name}<br>{:.2} dB, SSIM {:.3}", q.psnr, q.ssim);
        strip += &page::figure(&pictures::display(&v.picture, side)?, name, &caption);
    }
    strip += &format!("<div class=legend><i></i>FLIP, from 0 to {HEAT} and more</div>\n");
    for (name, v) in names.iter().zip(&view.quality) {
        strip += &heat(name, v, side)?;
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
         <div class=bar></div></div>\n<div class=choose>{}{}</div>\n</div>\n<div class=strip>\n{strip}</div>\n\
         </section>\n",
        index + 1,
        choose("reference"),
        choose("fitted"),
    ))
}

fn heat(name: &str, v: &ViewQuality, side: usize) -> Result<String, FitError> {
    let picture = pictures::linear(&heatmap(&v.flip, HEAT), side / 2)?;
    Ok(page::figure(&picture, &format!("FLIP of {name}"), &format!("FLIP {:.4}", v.quality.flip)))
}
