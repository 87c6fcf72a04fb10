//! The collapse loop: a heap of priced edges and component removals, in stages of weaker rules.

use super::check::Rules;
use super::engine::{Engine, Place, Priced};
use super::queue::{Entry, Queue};
use super::topology::NONE;
use super::{DecimateError, Options, Stats, Target};
use std::ops::ControlFlow;

/// Components with at most this many triangles left may be dropped as a whole.
const REMOVABLE: usize = 64;

/// Entries looked at between two reports.
const REPORT_EVERY: u32 = 1 << 14;

/// Least part of its share of a budget that what is not locked keeps.
const LEAST_SHARE: f64 = 0.5;

/// Set in the flags of an entry whose cost contains the factor on pinching.
const PINCH: u32 = 4;

/// Number of triangles and error to stop at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    pub(super) triangles: usize,
    pub(super) error2: f64,
    /// Whether the number of triangles must be reached.
    pub(super) forced: bool,
}

impl Goal {
    pub(super) fn new(options: &Options, input: usize) -> Self {
        let square = |e: f64| e * e;
        let limit = options.max_error.map_or(f64::INFINITY, square);
        match options.target {
            Target::Triangles(n) => Self { triangles: n.max(1), error2: limit, forced: true },
            Target::Ratio(r) => {
                Self { triangles: ((input as f64 * r) as usize).max(1), error2: limit, forced: true }
            }
            Target::Error(e) => Self { triangles: 1, error2: square(e).min(limit), forced: false },
            Target::ScreenSize(px) => {
                Self { triangles: 1, error2: square(0.5 / px).min(limit), forced: false }
            }
        }
    }

    /// The same, with more triangles where locked vertices would leave too few for everything else.
    pub(super) fn beside_locked(self, engine: &Engine<'_>) -> Self {
        if !self.forced || !engine.any_fixed {
            return self;
        }
        let fixed = |v: &u32| engine.fixed[*v as usize];
        let between = engine.topology.triangles.iter().filter(|t| t.iter().all(fixed)).count();
        // A part whose n vertices are all locked, on its border or in a closed strip, has n - 2 triangles at least.
        let vertices = engine.fixed.iter().filter(|f| **f).count();
        let parts = engine.parts.iter().filter(|p| p.held).count();
        let live = engine.topology.live;
        let locked = between.max(vertices.saturating_sub(2 * parts)).min(live);
        let share = LEAST_SHARE * self.triangles.min(live) as f64 / live as f64;
        let least = locked + ((live - locked) as f64 * share).ceil() as usize;
        Self { triangles: self.triangles.max(least), ..self }
    }
}

/// Collapses until the goal is reached; `report` hears the finished share.
pub(super) fn run(
    engine: &mut Engine<'_>,
    goal: &Goal,
    stats: &mut Stats,
    report: &dyn Fn(f32) -> ControlFlow<()>,
) -> Result<(), DecimateError> {
    let first = engine.topology.live;
    let all = first.saturating_sub(goal.triangles).max(1) as f32;
    let report = |live: usize| report((first - live) as f32 / all);
    let o = engine.options;
    let full = Rules {
        min_cosine: o.min_normal_cosine,
        min_compactness: o.min_compactness,
        keep_manifold: o.keep_manifold,
        keep_border: o.keep_border || o.lock_border,
        max_error2: goal.error2,
    };
    stage(engine, goal, &full, stats, &report)?;
    stats.after_checked = engine.topology.live;
    let relaxed = Rules {
        min_cosine: full.min_cosine.min(-0.2),
        min_compactness: 0.0,
        keep_manifold: false,
        keep_border: o.lock_border,
        max_error2: f64::INFINITY,
    };
    if goal.forced {
        stage(engine, goal, &relaxed, stats, &report)?;
    }
    stats.after_relaxed = engine.topology.live;
    if goal.forced {
        stage(engine, goal, &Rules { min_cosine: -2.0, ..relaxed }, stats, &report)?;
        // Triangles that are taken out leave holes, which a locked part must not have.
        if !engine.any_fixed {
            truncate(engine, goal.triangles, stats);
        }
    }
    stats.after_forced = engine.topology.live;
    Ok(())
}

/// Runs the heap dry under one set of rules, refilling it while that helps.
fn stage(
    engine: &mut Engine<'_>,
    goal: &Goal,
    rules: &Rules,
    stats: &mut Stats,
    report: &dyn Fn(usize) -> ControlFlow<()>,
) -> Result<(), DecimateError> {
    while engine.topology.live > goal.triangles {
        let before = engine.topology.live;
        // A refill at every halving brings back candidates that were refused in an older neighbourhood.
        let pause = (before / 2).max(goal.triangles);
        let mut heap = fill(engine, rules);
        drain(engine, &mut heap, [pause, goal.triangles], rules, stats, report)?;
        if (before - engine.topology.live) * 200 < before {
            break;
        }
    }
    Ok(())
}

/// Prices all edges and all removable components.
fn fill(engine: &mut Engine<'_>, rules: &Rules) -> Queue {
    let mut keys: Vec<u64> = engine.topology.edges().into_iter().map(|e| e.0).collect();
    keys.dedup();
    let mut entries = Vec::with_capacity(keys.len());
    let mut loaded = NONE;
    for key in keys {
        let (u, v) = ((key >> 32) as u32, key as u32);
        if loaded == u {
            engine.load_second(u, v);
        } else {
            engine.load(u, v);
            loaded = u;
        }
        entries.extend(price_loaded(engine, u, v, rules));
    }
    for c in 0..engine.parts.len() {
        engine.parts[c].queued = false;
        entries.extend(removal(engine, c as u32));
    }
    Queue::fill(entries)
}

/// Entry for the loaded edge; none where the rules refuse it whatever happens.
fn price_loaded(engine: &mut Engine<'_>, u: u32, v: u32, rules: &Rules) -> Option<(f64, Entry)> {
    if engine.is_pinned(u, rules.keep_border) && engine.is_pinned(v, rules.keep_border) {
        return None;
    }
    let priced = engine.price(u, v, Place::Best, rules.keep_border);
    Some((priced.cost, entry(engine, u, v, 0)))
}

fn entry(engine: &Engine<'_>, u: u32, v: u32, flags: u32) -> Entry {
    let stamp = engine.version[u as usize].wrapping_add(engine.version[v as usize]);
    Entry { u, v, stamp, flags }
}

/// Entry for the removal of a component that is small enough and not in the heap yet.
fn removal(engine: &mut Engine<'_>, c: u32) -> Option<(f64, Entry)> {
    let part = &mut engine.parts[c as usize];
    if part.queued || part.held || part.live == 0 || part.live > REMOVABLE {
        return None;
    }
    part.queued = true;
    Some((removal_cost(engine, c), Entry { u: c, v: NONE, stamp: 0, flags: 0 }))
}

/// Cost of dropping a component, per two triangles, so that it compares with a collapse.
fn removal_cost(engine: &Engine<'_>, c: u32) -> f64 {
    let part = &engine.parts[c as usize];
    let cost = engine.options.removal_weight * part.area * part.extent2 * 2.0 / part.live.max(1) as f64;
    if cost.is_finite() { cost } else { f64::MAX }
}

/// Works off the heap down to `pause` triangles, and never below `goal`.
fn drain(
    engine: &mut Engine<'_>,
    heap: &mut Queue,
    [pause, goal]: [usize; 2],
    rules: &Rules,
    stats: &mut Stats,
    report: &dyn Fn(usize) -> ControlFlow<()>,
) -> Result<(), DecimateError> {
    let mut popped = 0_u32;
    while engine.topology.live > pause {
        if popped.is_multiple_of(REPORT_EVERY) && report(engine.topology.live).is_break() {
            return Err(DecimateError::Stopped);
        }
        popped = popped.wrapping_add(1);
        let Some((cost, top)) = heap.pop() else { break };
        if top.v == NONE {
            remove(engine, heap, cost, top, goal, rules, stats);
            continue;
        }
        if top.stamp != engine.version[top.u as usize].wrapping_add(engine.version[top.v as usize]) {
            continue;
        }
        engine.load(top.u, top.v);
        match decide(engine, cost, top, rules) {
            Verdict::Later(cost, e) => heap.push(cost, e),
            Verdict::Never => {}
            Verdict::Now(priced) => {
                engine.collapse(top.u, top.v, &priced);
                stats.collapses += 1;
                requeue(engine, heap, top.u, rules);
            }
        }
    }
    Ok(())
}

/// What to do with the cheapest entry.
enum Verdict {
    Now(Priced),
    Later(f64, Entry),
    Never,
}

fn decide(engine: &mut Engine<'_>, priced_at: f64, top: Entry, rules: &Rules) -> Verdict {
    let (u, v) = (top.u, top.v);
    if engine.scratch.first.is_empty() || engine.scratch.second.is_empty() || engine.vanishes(v) {
        return Verdict::Never;
    }
    if engine.any_fixed && engine.strands_fixed(u, v) {
        return Verdict::Never;
    }
    let pinches = engine.pinches(u, v);
    // Pinched triangles fall together, and what is locked with them.
    if pinches && (rules.keep_manifold || (engine.any_fixed && engine.is_near_fixed())) {
        return Verdict::Never;
    }
    let factor = if pinches { engine.options.pinch_weight.max(1.0) } else { 1.0 };
    let flags = if pinches { PINCH } else { 0 };
    let place = Place::ALL[(top.flags & 3) as usize];
    let mut found = engine.price(u, v, place, rules.keep_border);
    let mut chosen = place;
    if !engine.is_shapely(u, v, found.at, rules) {
        let mut other: Option<(Place, Priced)> = None;
        for p in Place::ALL {
            let priced = engine.price(u, v, p, rules.keep_border);
            if other.as_ref().is_none_or(|o| priced.cost < o.1.cost)
                && engine.is_shapely(u, v, priced.at, rules)
            {
                other = Some((p, priced));
            }
        }
        let Some((p, priced)) = other else { return Verdict::Never };
        (chosen, found) = (p, priced);
    }
    if found.error2 > rules.max_error2 {
        return Verdict::Never;
    }
    let cost = (found.cost * factor).min(f64::MAX);
    // The neighbourhood may have changed since the entry was priced.
    if cost > priced_at * 1.01 {
        return Verdict::Later(cost, entry(engine, u, v, chosen as u32 | flags));
    }
    Verdict::Now(found)
}

/// Prices the edges of a merged vertex again, and its component once it is small.
fn requeue(engine: &mut Engine<'_>, heap: &mut Queue, u: u32, rules: &Rules) {
    let mut first = std::mem::take(&mut engine.scratch.first);
    engine.topology.corners(u, &mut first);
    engine.scratch.first = first;
    let mut near = std::mem::take(&mut engine.scratch.near);
    near.clear();
    for &c in &engine.scratch.first {
        let (a, b) = engine.topology.others(c);
        near.extend([a, b]);
    }
    near.sort_unstable();
    near.dedup();
    for &w in &near {
        engine.load_second(u, w);
        if let Some((cost, entry)) = price_loaded(engine, u, w, rules) {
            heap.push(cost, entry);
        }
    }
    engine.scratch.near = near;
    if let Some(&c) = engine.scratch.first.first() {
        let part = engine.part[c as usize / 3];
        if let Some((cost, entry)) = removal(engine, part) {
            heap.push(cost, entry);
        }
    }
}

/// Drops a component if its price still holds and that leaves `goal` triangles: collapses reach a budget exactly, or but for
/// one triangle, where dropping a component of up to [`REMOVABLE`] would waste as many.
fn remove(
    engine: &mut Engine<'_>,
    heap: &mut Queue,
    priced_at: f64,
    top: Entry,
    goal: usize,
    rules: &Rules,
    stats: &mut Stats,
) {
    let part = engine.parts[top.u as usize];
    // The last component stays.
    if part.live == 0 || part.live == engine.topology.live || part.extent2 > rules.max_error2 {
        return;
    }
    if engine.topology.live - part.live < goal {
        // It comes back once a collapse has made it smaller.
        engine.parts[top.u as usize].queued = false;
        return;
    }
    let cost = removal_cost(engine, top.u);
    if cost > priced_at * 1.01 {
        heap.push(cost, top);
        return;
    }
    drop_part(engine, top.u);
    stats.removed_components += 1;
}

fn drop_part(engine: &mut Engine<'_>, c: u32) {
    for &t in engine.members.of(c) {
        if engine.topology.is_live(t) {
            engine.topology.kill(t);
        }
    }
    engine.parts[c as usize].live = 0;
}

/// Last resort: keeps the most important components and triangles only.
fn truncate(engine: &mut Engine<'_>, goal: usize, stats: &mut Stats) {
    if engine.topology.live <= goal {
        return;
    }
    let mut order: Vec<u32> =
        (0..engine.parts.len() as u32).filter(|&c| engine.parts[c as usize].live > 0).collect();
    order.sort_by(|&a, &b| removal_cost(engine, a).total_cmp(&removal_cost(engine, b)).then(a.cmp(&b)));
    order.pop();
    for c in order {
        if engine.topology.live <= goal {
            return;
        }
        drop_part(engine, c);
        stats.removed_components += 1;
    }
    let area = |t: u32| {
        let p = engine.topology.triangles[t as usize].map(|i| engine.positions[i as usize]);
        (p[1] - p[0]).cross(p[2] - p[0]).length()
    };
    let mut live: Vec<(f64, u32)> = (0..engine.topology.triangles.len() as u32)
        .filter(|&t| engine.topology.is_live(t))
        .map(|t| (area(t), t))
        .collect();
    live.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, t) in live {
        if engine.topology.live <= goal {
            break;
        }
        engine.kill(t);
    }
}
