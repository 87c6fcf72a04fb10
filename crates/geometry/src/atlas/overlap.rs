//! Global injectivity of a chart whose triangles all have positive area.
//!
//! The number of times such a map covers a point is the sum of the winding numbers of its boundary loops. Where no two
//! boundary edges meet and exactly one loop turns counter-clockwise, that number is 0 or 1 everywhere.

use super::chart::{Chart, bounds};
use super::topology::{NONE, cross2, positive};
use photofit_scalar::{Vec2, vec2};

/// True when the boundary loops are simple and disjoint and exactly one encloses area positively.
pub(super) fn is_injective(chart: &Chart) -> bool {
    if chart.triangles.len() == 1 {
        return true;
    }
    positive_loops(chart) == Some(1) && !edges_meet(chart)
}

fn positive_loops(chart: &Chart) -> Option<usize> {
    let mut next = vec![NONE; chart.uv.len()];
    for b in &chart.border {
        if next[b.from as usize] != NONE {
            return None;
        }
        next[b.from as usize] = b.to;
    }
    let mut positive = 0;
    for b in &chart.border {
        let mut area = 0.0;
        let origin = chart.uv[b.from as usize];
        let mut at = b.from;
        while next[at as usize] != NONE {
            let to = std::mem::replace(&mut next[at as usize], NONE);
            area += cross2(origin, chart.uv[at as usize], chart.uv[to as usize]);
            at = to;
        }
        positive += usize::from(area > 0.0);
    }
    Some(positive)
}

/// Calls `visit(row, x_low, x_high)` for each unit row that the segment touches, with its extent there.
#[inline]
pub(super) fn rows_of(a: Vec2<f64>, b: Vec2<f64>, mut visit: impl FnMut(i64, f64, f64)) {
    let (a, b) = if a.y <= b.y { (a, b) } else { (b, a) };
    let (first, last) = (a.y.floor() as i64, b.y.floor() as i64);
    if first == last {
        visit(first, a.x.min(b.x), a.x.max(b.x));
        return;
    }
    let slope = (b.x - a.x) / (b.y - a.y);
    let (lo, hi) = (a.x.min(b.x), a.x.max(b.x));
    let mut x0 = a.x;
    for row in first..=last {
        let x1 = if row == last { b.x } else { (a.x + slope * ((row + 1) as f64 - a.y)).clamp(lo, hi) };
        visit(row, x0.min(x1), x0.max(x1));
        x0 = x1;
    }
}

/// True when two boundary edges without a common vertex touch.
fn edges_meet(chart: &Chart) -> bool {
    let n = chart.border.len();
    let (lo, hi) = bounds(&chart.uv);
    let length: f64 =
        chart.border.iter().map(|b| (chart.uv[b.to as usize] - chart.uv[b.from as usize]).length()).sum();
    let size = hi - lo;
    // Cells about one edge long, at most four per edge.
    let cell = (1.5 * length / n as f64).max((size.x * size.y / (4 * n) as f64).sqrt());
    if !positive(cell) {
        return true;
    }
    let (w, h) = ((size.x / cell) as usize + 1, (size.y / cell) as usize + 1);
    if w.saturating_mul(h) > 16 * n + 64 {
        return true;
    }
    let place = |v: u32| {
        let p = (chart.uv[v as usize] - lo) * (1.0 / cell);
        vec2(p.x, p.y)
    };
    let mut cells: Vec<(u32, u32)> = Vec::with_capacity(4 * n);
    for (i, b) in chart.border.iter().enumerate() {
        rows_of(place(b.from), place(b.to), |row, x0, x1| {
            let row = (row.max(0) as usize).min(h - 1);
            for x in (x0 as usize).min(w - 1)..=(x1 as usize).min(w - 1) {
                cells.push(((row * w + x) as u32, i as u32));
            }
        });
    }
    cells.sort_unstable();
    cells
        .chunk_by(|a, b| a.0 == b.0)
        .any(|run| run.iter().enumerate().any(|(k, i)| run[k + 1..].iter().any(|j| meet(chart, i.1, j.1))))
}

fn meet(chart: &Chart, i: u32, j: u32) -> bool {
    let (a, b) = (chart.border[i as usize], chart.border[j as usize]);
    if [b.from, b.to].contains(&a.from) || [b.from, b.to].contains(&a.to) {
        return false;
    }
    let at = |v: u32| chart.uv[v as usize];
    let (p, q, r, s) = (at(a.from), at(a.to), at(b.from), at(b.to));
    if p.x.max(q.x) < r.x.min(s.x)
        || r.x.max(s.x) < p.x.min(q.x)
        || p.y.max(q.y) < r.y.min(s.y)
        || r.y.max(s.y) < p.y.min(q.y)
    {
        return false;
    }
    cross2(p, q, r) * cross2(p, q, s) <= 0.0 && cross2(r, s, p) * cross2(r, s, q) <= 0.0
}
