//! Fills texels without an owner from the nearest texel that has one.

use rayon::prelude::*;

/// Marks a column without a valid texel.
const FAR: i64 = i64::MAX / 4;

/// Copies into each texel that is not `valid` the nearest valid one (Euclidean, exact; of equally near ones the
/// leftmost, then the upper), for texels at most `reach` texels away, or all with `None`. Without a valid texel
/// nothing changes.
///
/// `texels` and `valid` hold `width x height` entries, row by row; an entry holds any `N` numbers. The nearest texel
/// comes from the separable distance transform of Meijster et al. (2000).
///
/// # Panics
/// When `texels` or `valid` has another length than `width * height`.
pub fn dilate<const N: usize>(
    texels: &mut [[f32; N]],
    valid: &[bool],
    width: usize,
    height: usize,
    reach: Option<u32>,
) {
    assert_eq!(texels.len(), width * height, "texels: one entry per texel");
    assert_eq!(valid.len(), width * height, "valid: one entry per texel");
    if width == 0 || height == 0 {
        return;
    }
    let limit = reach.map_or(FAR, |r| i64::from(r) * i64::from(r));
    let above = nearest_in_columns(valid, width, height);
    let mut source: Vec<u32> = (0..(width * height) as u32).collect();
    source.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        nearest_in_row(&above[y * width..(y + 1) * width], y, width, limit, row);
    });
    // Sources are valid texels and are never written, so that the order does not matter.
    for (i, &s) in source.iter().enumerate() {
        if s != i as u32 {
            texels[i] = texels[s as usize];
        }
    }
}

/// Row of the nearest valid texel in the same column, or `u32::MAX`.
fn nearest_in_columns(valid: &[bool], width: usize, height: usize) -> Vec<u32> {
    let mut near = vec![u32::MAX; width * height];
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if valid[i] {
                near[i] = y as u32;
            } else if y > 0 {
                near[i] = near[i - width];
            }
        }
    }
    for y in (0..height.saturating_sub(1)).rev() {
        for x in 0..width {
            let i = y * width + x;
            let below = near[i + width];
            if below != u32::MAX
                && (near[i] == u32::MAX || below.abs_diff(y as u32) < near[i].abs_diff(y as u32))
            {
                near[i] = below;
            }
        }
    }
    near
}

/// Lower envelope of the parabolas `(x - i)^2 + g(i)^2`, then the source of each texel of the row.
fn nearest_in_row(near: &[u32], y: usize, width: usize, limit: i64, row: &mut [u32]) {
    let height_of = |i: usize| if near[i] == u32::MAX { FAR } else { (i64::from(near[i]) - y as i64).pow(2) };
    let mut top: Vec<(usize, i64)> = Vec::with_capacity(width);
    for i in 0..width {
        let g = height_of(i);
        if g == FAR {
            continue;
        }
        let x = i as i64;
        let mut begin = 0;
        while let Some(&(j, from)) = top.last() {
            let k = j as i64;
            // First x where i is strictly nearer than j.
            let cross = (x * x - k * k + g - height_of(j)).div_euclid(2 * (x - k)) + 1;
            if cross <= from {
                top.pop();
            } else {
                begin = cross;
                break;
            }
        }
        if begin < width as i64 {
            top.push((i, begin));
        }
    }
    let mut at = 0;
    for (x, out) in row.iter_mut().enumerate() {
        while at + 1 < top.len() && top[at + 1].1 <= x as i64 {
            at += 1;
        }
        let Some(&(i, _)) = top.get(at) else { return };
        if (x as i64 - i as i64).pow(2) + height_of(i) <= limit {
            *out = near[i] * width as u32 + i as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(width: usize, height: usize, seed: u32) -> Vec<bool> {
        (0..(width * height) as u32).map(|i| (i ^ seed).wrapping_mul(2_654_435_761) >> 27 == 0).collect()
    }

    #[test]
    fn nearest_matches_brute_force() {
        for (width, height, seed) in [(31, 17, 1), (1, 40, 7), (40, 1, 3), (24, 24, 9)] {
            let valid = pattern(width, height, seed);
            let start: Vec<[f32; 1]> = (0..width * height).map(|i| [i as f32]).collect();
            for reach in [None, Some(0), Some(3)] {
                let mut texels = start.clone();
                dilate(&mut texels, &valid, width, height, reach);
                for i in 0..width * height {
                    let distance = |j: usize| {
                        (i % width).abs_diff(j % width).pow(2) + (i / width).abs_diff(j / width).pow(2)
                    };
                    let best = (0..width * height).filter(|&j| valid[j]).map(distance).min();
                    let got = texels[i][0] as usize;
                    match best {
                        Some(d) if reach.is_none_or(|r| d <= (r * r) as usize) => {
                            assert!(valid[got], "texel {i} took texel {got}, which is not valid");
                            assert_eq!(distance(got), d, "texel {i} took texel {got}, {width} x {height}");
                        }
                        _ => assert_eq!(got, i, "texel {i} is out of reach"),
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_valid_changes_nothing() {
        let mut texels = vec![[1.0_f32, 2.0]; 6];
        dilate(&mut texels, &[false; 6], 3, 2, None);
        assert_eq!(texels, vec![[1.0, 2.0]; 6]);
    }
}
