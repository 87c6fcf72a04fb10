//! Random points, uniform over edges or triangles.

use photofit_sampling::Rng;
use photofit_scalar::Vec3f;

/// Points of items that are drawn with probabilities proportional to their sizes; none where all sizes are 0.
pub(crate) fn chosen<I: Copy, P>(
    items: &[I],
    size: impl Fn(&I) -> f64,
    count: usize,
    rng: &mut Rng,
    mut point: impl FnMut(I, &mut Rng) -> P,
) -> Vec<P> {
    let mut total = 0.0;
    let sums: Vec<f64> = items
        .iter()
        .map(|i| {
            total += size(i);
            total
        })
        .collect();
    let count = if total > 0.0 { count } else { 0 };
    (0..count)
        .map(|_| {
            let at = rng.next_f64() * total;
            let k = sums.partition_point(|s| *s < at).min(items.len() - 1);
            point(items[k], rng)
        })
        .collect()
}

/// A point, uniformly distributed over a triangle.
pub(crate) fn on_triangle([a, b, c]: [Vec3f; 3], rng: &mut Rng) -> Vec3f {
    let (u, v) = (rng.next_f32(), rng.next_f32());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    a + (b - a) * u + (c - a) * v
}

/// Area of a triangle.
pub(crate) fn area([a, b, c]: &[Vec3f; 3]) -> f64 {
    0.5 * f64::from((*b - *a).cross(*c - *a).length())
}
