//! Pictures that tell a fit nothing: black ones, the same one for all frames, one camera for all frames.

use crate::engine::checkpoint::Digest;
use crate::engine::given::GivenPicture;
use std::collections::BTreeSet;

/// Linear light below which a pixel is black: one step of 8 bits.
const BLACK: f32 = 1.0 / 255.0 / 12.92;
/// Most frames that are listed.
const LISTED: usize = 8;

/// What is wrong with pictures as a whole, one line each.
pub(super) fn of(photos: &[GivenPicture]) -> Vec<String> {
    let n = photos.len();
    let is_black = |p: &GivenPicture| p.image.data.chunks_exact(4).all(|p| p[..3].iter().all(|x| *x < BLACK));
    let black: Vec<usize> = (0..n).filter(|i| is_black(&photos[*i])).collect();
    let distinct = |digest: &dyn Fn(&GivenPicture) -> Digest| {
        photos.iter().map(|p| digest(p).value()).collect::<BTreeSet<u64>>().len()
    };
    let pictures = distinct(&|p| {
        let mut d = Digest::new();
        d.add(&p.image.data);
        d
    });
    let cameras = distinct(&|p| {
        let mut d = Digest::new();
        d.add_bytes(format!("{:?}", p.camera).as_bytes());
        d
    });
    let mut out = Vec::new();
    if black.len() == n {
        out.push(format!("all {n} pictures are black, or empty: the colours will be black"));
    } else if !black.is_empty() {
        let more = if black.len() > LISTED { " and more" } else { "" };
        let first = &black[..black.len().min(LISTED)];
        out.push(format!("{} of {n} pictures are black, or empty: frames {first:?}{more}", black.len()));
    }
    let others = n - black.len();
    if others > 1 && 2 * pictures <= others {
        out.push(format!("the pictures of {n} frames are only {pictures} different ones"));
    }
    if n > 1 && 2 * cameras <= n {
        out.push(format!(
            "the cameras of {n} frames are only {cameras} different ones: what they do not see stays grey"
        ));
    }
    out
}
