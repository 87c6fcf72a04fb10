//! One cell of a grid: trilinear interpolation of its eight corners, and where a line crosses its zero level.

use glam::DVec3;

/// Values at the corners of the unit cube; corner `i` lies at (i & 1, i >> 1 & 1, i >> 2).
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell(pub(super) [f64; 8]);

/// Where a line passes from one side of the zero level to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Part of the way from the first point to the second.
    pub(super) s: f64,
    /// From values of 0 and more to values below 0.
    pub(super) inwards: bool,
}

/// Halvings of an interval of length 1 after which it cannot be told from a point.
const HALVINGS: usize = 60;
/// Part of the way below which steps do not count.
const STEP: f64 = 1e-13;

impl Cell {
    /// The interpolant. On a face it is that of the face's four corners, to the last bit: cells that share a face agree.
    #[inline]
    pub(super) fn value(&self, q: DVec3) -> f64 {
        let c = &self.0;
        let x = [0, 2, 4, 6].map(|i| mix(c[i], c[i + 1], q.x));
        mix(mix(x[0], x[1], q.y), mix(x[2], x[3], q.y), q.z)
    }

    /// The gradient of the interpolant.
    #[inline]
    pub(super) fn gradient(&self, q: DVec3) -> DVec3 {
        let c = &self.0;
        let along = |low: [usize; 4], step: usize, u: f64, v: f64| {
            let d = low.map(|i| c[i + step] - c[i]);
            mix(mix(d[0], d[1], u), mix(d[2], d[3], u), v)
        };
        DVec3::new(
            along([0, 2, 4, 6], 1, q.y, q.z),
            along([0, 1, 4, 5], 2, q.x, q.z),
            along([0, 1, 2, 3], 4, q.x, q.y),
        )
    }

    /// Calls `found` with every crossing on the way from `a` to `b`, in order, until it returns false.
    ///
    /// Whether the number of crossings is odd depends on the signs of the values at `a` and `b` alone, so that a line
    /// through several cells loses none at the faces between them.
    pub(super) fn crossings(&self, a: DVec3, b: DVec3, mut found: impl FnMut(Crossing) -> bool) {
        let cubic = self.along(a, b - a);
        let ends = [self.value(a), self.value(b)];
        let [first, second] = cubic.turns();
        let mut from = (0.0, ends[0]);
        let stops = [first, second, Some(1.0)].into_iter().flatten();
        for s in stops {
            let to = (s, if s == 1.0 { ends[1] } else { cubic.value(s) });
            if (from.1 < 0.0) != (to.1 < 0.0) {
                let inwards = to.1 < 0.0;
                if !found(Crossing { s: cubic.root(from.0, s, inwards), inwards }) {
                    return;
                }
            }
            from = to;
        }
    }

    /// The interpolant along a line.
    fn along(&self, a: DVec3, d: DVec3) -> Cubic {
        let c = &self.0;
        let edge = [c[1] - c[0], c[2] - c[0], c[4] - c[0]];
        let (xy, xz) = (c[3] - c[2] - edge[0], c[5] - c[4] - edge[0]);
        let yz = c[6] - c[4] - edge[1];
        let xyz = (c[7] - c[6]) - (c[5] - c[4]) - xy;
        let second = xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z;
        let third = a.x * d.y * d.z + a.y * d.x * d.z + a.z * d.x * d.y;
        Cubic([self.value(a), self.gradient(a).dot(d), second + xyz * third, xyz * d.x * d.y * d.z])
    }
}

/// Exactly `a` at 0 and `b` at 1.
#[inline]
fn mix(a: f64, b: f64, t: f64) -> f64 {
    a * (1.0 - t) + b * t
}

/// A cubic over [0, 1], the constant term first.
struct Cubic([f64; 4]);

impl Cubic {
    fn value(&self, s: f64) -> f64 {
        let c = &self.0;
        ((c[3] * s + c[2]) * s + c[1]) * s + c[0]
    }

    fn slope(&self, s: f64) -> f64 {
        let c = &self.0;
        (3.0 * c[3] * s + 2.0 * c[2]) * s + c[1]
    }

    /// Where the slope is zero, within (0, 1) and in order.
    fn turns(&self) -> [Option<f64>; 2] {
        let [_, c1, c2, c3] = self.0;
        let discriminant = c2 * c2 - 3.0 * c3 * c1;
        if discriminant.is_nan() || discriminant <= 0.0 {
            return [None; 2];
        }
        // Without cancellation: one root from the sum, the other from the product of the roots.
        let q = -(c2 + discriminant.sqrt().copysign(c2));
        let [u, v] = [q / (3.0 * c3), c1 / q];
        let within = |s: f64| (s > 0.0 && s < 1.0).then_some(s);
        let (low, high) = if u <= v { (u, v) } else { (v, u) };
        [within(low), within(high).filter(|h| *h != low)]
    }

    /// The crossing between `low` and `high`, between which the cubic is monotonic: Newton's method, kept within an interval
    /// that shrinks.
    fn root(&self, low: f64, high: f64, falls: bool) -> f64 {
        let (mut low, mut high) = (low, high);
        let mut s = 0.5 * (low + high);
        for _ in 0..HALVINGS {
            let value = self.value(s);
            if (value < 0.0) == falls {
                high = s;
            } else {
                low = s;
            }
            let newton = s - value / self.slope(s);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - s).abs() <= STEP {
                return next;
            }
            s = next;
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corner values between -1 and 1 that follow from a number.
    fn cell(seed: u64) -> Cell {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        Cell(std::array::from_fn(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        }))
    }

    #[test]
    fn the_interpolant_its_gradient_and_the_cubic_are_one_function() {
        for seed in 0..50 {
            let c = cell(seed);
            let (a, b) = (DVec3::new(0.1, 0.9, 0.4), DVec3::new(0.8, 0.2, 0.7));
            for (i, corner) in c.0.iter().enumerate() {
                let bit = |k: usize| (i >> k & 1) as f64;
                assert_eq!(c.value(DVec3::new(bit(0), bit(1), bit(2))), *corner, "exact at corners");
            }
            let (h, g) = (1e-6, c.gradient(a));
            for k in 0..3 {
                let step = DVec3::AXES[k] * h;
                let difference = (c.value(a + step) - c.value(a - step)) / (2.0 * h);
                assert!((difference - g[k]).abs() < 1e-9, "{difference} {}", g[k]);
            }
            let cubic = c.along(a, b - a);
            for s in [0.0, 0.3, 0.6, 1.0] {
                let direct = c.value(a + (b - a) * s);
                assert!((cubic.value(s) - direct).abs() < 1e-14, "{} {direct}", cubic.value(s));
            }
        }
    }

    #[test]
    fn every_crossing_of_a_line_is_found_in_order() {
        let mut of_number = [0; 4];
        for seed in 0..4000 {
            let c = cell(seed);
            let (a, b) = (DVec3::new(0.0, 0.03, 0.05), DVec3::new(1.0, 0.98, 0.93));
            let mut found = Vec::new();
            c.crossings(a, b, |x| {
                found.push(x);
                true
            });
            // The signs at many points of the line.
            let (n, mut changes, mut last) = (2000, 0, c.value(a));
            for i in 1..=n {
                let v = c.value(a + (b - a) * (f64::from(i) / f64::from(n)));
                changes += usize::from((v < 0.0) != (last < 0.0));
                last = v;
            }
            assert!(found.len() >= changes && (found.len() - changes).is_multiple_of(2), "{seed}: {found:?}");
            assert!(found.is_sorted_by(|x, y| x.s <= y.s && x.inwards != y.inwards), "{found:?}");
            for x in &found {
                assert!(c.value(a + (b - a) * x.s).abs() < 1e-12, "{seed}: {x:?}");
            }
            of_number[found.len()] += 1;
        }
        assert!(of_number.iter().all(|n| *n > 0), "none to three crossings all occur: {of_number:?}");
    }
}
