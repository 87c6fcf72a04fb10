//! From a coarse arrangement to single texels: shapes slide together, then all grow into the room won.

use super::bitmap::{Board, Mask, probe_order};
use super::pack::{Layout, Place, Shape};
use rayon::prelude::*;

/// Rounds of sliding and growing.
const ROUNDS: usize = 4;

/// A shape on the board: its cells, and the cells that must be free of others (its cells grown by the padding).
struct Piece {
    mask: Mask,
    guard: Mask,
    probe: Vec<u32>,
    hint: u32,
}

/// Improves a layout whose places are valid for single texels; `reach` is how far a shape slides at once.
pub(super) fn settle(shapes: &[Shape], start: Layout, size: u32, reach: u32) -> Layout {
    let mut best = start;
    let mut pieces = cut(shapes, &best, best.scale);
    for _ in 0..ROUNDS {
        let padding = best.padding;
        slide(&mut pieces, &mut best.places, size, padding, reach);
        let (mut right, mut top) = (1, 1);
        for (p, piece) in best.places.iter().zip(&pieces) {
            right = right.max(p.x + piece.mask.width - padding);
            top = top.max(p.y + piece.mask.height - padding);
        }
        let room = f64::from(size - 2 * padding) / f64::from(right.max(top));
        // Rounding may cost a texel per shape in a row, so ask for less where it fails.
        let grown = [1.0, 0.7, 0.4].iter().find_map(|part| {
            let factor = 1.0 + (room - 1.0) * part;
            (factor > 1.0005).then(|| grow(shapes, &best, factor, size, reach)).flatten()
        });
        let Some((layout, next)) = grown else { break };
        (best, pieces) = (layout, next);
    }
    best
}

fn cut(shapes: &[Shape], layout: &Layout, scale: f64) -> Vec<Piece> {
    shapes
        .par_iter()
        .zip(&layout.places)
        .map(|(s, p)| {
            let mask = s.mask(p.turn, scale);
            let guard = mask.grown(layout.padding);
            let probe = probe_order(guard.height);
            Piece { mask, guard, probe, hint: 0 }
        })
        .collect()
}

/// Indices from the lower left to the upper right.
fn upwards(places: &[Place]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by_key(|&i| (places[i as usize].y, places[i as usize].x, i));
    order
}

/// Moves shapes down, then left, one after the other, as far as `reach` and the others allow.
fn slide(pieces: &mut [Piece], places: &mut [Place], size: u32, padding: u32, reach: u32) {
    let mut board = Board::new(size);
    for (piece, p) in pieces.iter().zip(places.iter()) {
        board.set(&piece.mask, p.x, p.y, true);
    }
    for down in [true, false, true, false] {
        let mut order = upwards(places);
        if !down {
            order.sort_by_key(|&i| (places[i as usize].x, places[i as usize].y, i));
        }
        for i in order {
            let (piece, place) = (&mut pieces[i as usize], places[i as usize]);
            board.set(&piece.mask, place.x, place.y, false);
            // The guard's corner; shapes stay `padding` away from the border.
            let (x, y) = (place.x - padding, place.y - padding);
            let (low_x, low_y) = (x.saturating_sub(reach), y.saturating_sub(reach));
            let mut to = (x, y);
            let mut test = |xs, y: u32| board.free_column(&piece.guard, &piece.probe, xs, y, &mut piece.hint);
            if down {
                // A step aside is allowed where it lets the shape sink.
                if let Some((nx, ny)) = (low_y..y).find_map(|ny| test(low_x..=x, ny).map(|nx| (nx, ny))) {
                    to = (nx, ny);
                }
            } else if let Some(nx) = test(low_x..=x, y) {
                to = (nx, y);
            }
            places[i as usize] = Place { x: to.0 + padding, y: to.1 + padding, turn: place.turn };
            board.set(&piece.mask, to.0 + padding, to.1 + padding, true);
        }
    }
}

/// All shapes and their distances grown by `factor`; each is put at the free place nearest below its new one.
fn grow(shapes: &[Shape], from: &Layout, factor: f64, size: u32, reach: u32) -> Option<(Layout, Vec<Piece>)> {
    let mut layout = from.clone();
    layout.scale *= factor;
    let padding = layout.padding;
    let mut pieces = cut(shapes, from, layout.scale);
    let mut board = Board::new(size);
    for i in upwards(&from.places) {
        let (piece, place) = (&mut pieces[i as usize], from.places[i as usize]);
        let at = |x: u32| (f64::from(x - padding) * factor).floor() as u32;
        let (x, y) = (at(place.x), at(place.y));
        let xs = x.saturating_sub(reach)..=x + 2;
        let found = (y.saturating_sub(reach)..=y + 2).find_map(|y| {
            board.free_column(&piece.guard, &piece.probe, xs.clone(), y, &mut piece.hint).map(|x| (x, y))
        });
        let (x, y) = found?;
        layout.places[i as usize] = Place { x: x + padding, y: y + padding, turn: place.turn };
        board.set(&piece.mask, x + padding, y + padding, true);
    }
    Some((layout, pieces))
}
