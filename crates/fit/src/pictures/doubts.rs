//! Pictures that tell a fit nothing: black ones, those below 0, the same one for all frames, one camera for all frames.

use crate::engine::checkpoint::Digest;
use crate::report::counted;
use photofit_image::Image;
use std::collections::BTreeSet;

/// Linear light below which a pixel is black, over the brightest of all pictures: one step of 8 bits.
const BLACK: f32 = 1.0 / 255.0 / 12.92;
/// Most frames that are listed.
const LISTED: usize = 8;

/// The values of the first three channels.
fn colours(p: &Image) -> impl Iterator<Item = f32> {
    p.data.chunks_exact(p.channels).flat_map(|p| &p[..p.len().min(3)]).copied()
}

/// What makes pictures useless for a fit as a whole, one line each; none for sound ones.
///
/// `cameras` describes the camera of each picture. Colour is in the first three channels.
pub fn doubts(pictures: &[&Image], cameras: &[String]) -> Vec<String> {
    let n = pictures.len();
    let negative: Vec<usize> =
        (0..n).filter(|i| colours(pictures[*i]).map(f64::from).sum::<f64>() < 0.0).collect();
    let brightest = pictures.iter().flat_map(|p| colours(p)).fold(0.0, f32::max);
    let is_black = |p: &Image| colours(p).all(|x| x <= BLACK * brightest.min(1.0));
    let black: Vec<usize> = (0..n).filter(|i| !negative.contains(i) && is_black(pictures[*i])).collect();
    let mut out = Vec::new();
    let mut some = |which: &[usize], what: &str, all: &str| match which {
        [] => {}
        [_] if n == 1 => out.push(format!("the picture is {what}{all}")),
        _ if which.len() == n => out.push(format!("all {n} pictures are {what}{all}")),
        _ => {
            let more = if which.len() > LISTED { " and more" } else { "" };
            let first = &which[..which.len().min(LISTED)];
            out.push(format!("{} of {n} pictures are {what}: frames {first:?}{more}", which.len()));
        }
    };
    some(&negative, "below 0 on the whole, as light never is", "");
    some(&black, "black, or empty", ": nothing but darkness can be found");
    let distinct = |digests: &mut dyn Iterator<Item = Digest>| {
        digests.map(|d| d.value()).collect::<BTreeSet<u64>>().len()
    };
    let of_picture = |p: &&Image| {
        let mut d = Digest::new();
        d.add(&p.data);
        d
    };
    let different = distinct(&mut pictures.iter().map(of_picture));
    let of_camera = |c: &String| {
        let mut d = Digest::new();
        d.add_bytes(c.as_bytes());
        d
    };
    let seen_from = distinct(&mut cameras.iter().map(of_camera));
    let others = n - black.len();
    if others > 1 && 2 * different <= others {
        out.push(format!("{n} frames have only {}", counted(different, "distinct picture")));
    }
    if n > 1 && 2 * seen_from <= n {
        let cameras = counted(seen_from, "distinct camera");
        out.push(format!("{n} frames have only {cameras}: what they do not see is not found"));
    }
    out
}
