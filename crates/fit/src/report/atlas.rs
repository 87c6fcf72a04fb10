//! The maps of the light asset and the layout of its charts.

use super::{page, pictures, wireframe};
use crate::FitError;
use crate::candidate::Candidate;
use photofit_image::Image;
use photofit_raster::{CHANNELS, channel};
use photofit_scalar::{Vec4f, vec4};

/// Largest side of a map in the report.
const SIDE: usize = 512;

/// The section of the maps that are in use, with how the file stores them.
pub(super) fn section(candidate: &Candidate, stored: &str) -> Result<String, FitError> {
    let base = &candidate.maps.levels[0];
    let pick = |f: &dyn Fn(&[f32; CHANNELS]) -> [f32; 3]| {
        let data: Vec<[f32; 3]> = base.texels.iter().map(f).collect();
        Image::from_data(base.width, base.height, 3, data.into_flattened())
    };
    let grey = |c: usize| pick(&|t| [t[c]; 3]);
    let three = |c: usize| pick(&|t| [t[c], t[c + 1], t[c + 2]]);
    let mut figures = String::new();
    let mut add = |picture: Result<String, FitError>, name: &str| {
        figures += &page::figure(&picture?, name, name);
        Ok::<(), FitError>(())
    };
    add(pictures::linear(&three(channel::BASE_COLOR), SIDE), "base colour")?;
    add(pictures::display(&three(channel::NORMAL).map(|n| 0.5 * n + 0.5), SIDE), "normal")?;
    add(pictures::display(&grey(channel::ROUGHNESS), SIDE), "roughness")?;
    if used(&base.texels, channel::METALLIC, 0.0) {
        add(pictures::display(&grey(channel::METALLIC), SIDE), "metalness")?;
    }
    if (0..3).any(|k| used(&base.texels, channel::EMISSIVE + k, 0.0)) {
        add(pictures::linear(&three(channel::EMISSIVE), SIDE), "emission")?;
    }
    if candidate.is_transparent() && used(&base.texels, channel::ALPHA, 1.0) {
        add(pictures::display(&grey(channel::ALPHA), SIDE), "alpha")?;
    }
    let (layout, charts) = layout(candidate);
    let caption = format!("texture layout: {} charts", page::count(charts));
    figures += &page::figure(&pictures::display(&layout, usize::MAX)?, "texture layout", &caption);
    Ok(format!(
        "<h2>Textures, {} x {} texels</h2>\n<p class=note>{}.</p>\n<div class=maps>\n{figures}</div>\n",
        base.width,
        base.height,
        page::escape(stored)
    ))
}

/// Whether a sample differs from its neutral value somewhere, by more than one step of 8 bits.
fn used(texels: &[[f32; CHANNELS]], c: usize, neutral: f32) -> bool {
    texels.iter().any(|t| (t[c] - neutral).abs() > 1.0 / 255.0)
}

/// The triangles in texture space, each chart in a tint of its own, and the number of charts.
fn layout(candidate: &Candidate) -> (Image, usize) {
    let clip: Vec<Vec4f> =
        candidate.uvs.iter().map(|uv| vec4(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 0.5, 1.0)).collect();
    let (chart, charts) = charts(&candidate.triangles, candidate.uvs.len());
    let picture = wireframe::draw(&clip, &candidate.triangles, |t| tint(chart[t]));
    (picture, charts)
}

/// Number of the chart of each triangle, and how many there are. Vertices are split between charts, so that charts are
/// the parts that share no vertex.
fn charts(triangles: &[[u32; 3]], vertices: usize) -> (Vec<usize>, usize) {
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    for [first, rest @ ..] in triangles {
        for other in rest {
            let (a, b) = (root(&mut parent, *first), root(&mut parent, *other));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut number = vec![usize::MAX; vertices];
    let mut charts = 0;
    let of = triangles
        .iter()
        .map(|t| {
            let slot = &mut number[root(&mut parent, t[0]) as usize];
            if *slot == usize::MAX {
                (*slot, charts) = (charts, charts + 1);
            }
            *slot
        })
        .collect();
    (of, charts)
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        // Halves the path.
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}

/// A pale colour that differs from those of the numbers nearby: hues a golden angle apart.
fn tint(chart: usize) -> [f32; 3] {
    let hue = (chart as f32 * 0.618_034).fract() * std::f32::consts::TAU;
    std::array::from_fn(|k| 0.83 + 0.12 * (hue + k as f32 * std::f32::consts::TAU / 3.0).cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_are_the_connected_parts() {
        let triangles = [[0, 1, 2], [5, 6, 7], [2, 1, 3], [7, 8, 9], [4, 3, 1]];
        assert_eq!(charts(&triangles, 10), (vec![0, 1, 0, 1, 0], 2));
        assert_eq!(charts(&[], 0), (vec![], 0));
    }
}
