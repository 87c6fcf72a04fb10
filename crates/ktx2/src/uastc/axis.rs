//! The line through a set of texels that a fit starts from.

use crate::uastc::fit::{Ends, Set, sum};

/// The part of the principal axis of a set between its outermost texels.
pub(crate) fn principal_ends<const C: usize>(set: &Set<'_, C>) -> Ends<C> {
    let share = 1.0 / sum(|i| set.mask[i]).max(1.0);
    let mut mean = [0.0; C];
    for c in 0..C {
        mean[c] = sum(|i| set.mask[i] * set.channels[c][i]) * share;
    }
    let mut centred = [[0.0; 16]; C];
    for c in 0..C {
        for i in 0..16 {
            centred[c][i] = (set.channels[c][i] - mean[c]) * set.mask[i];
        }
    }
    let mut axis = [0.0; C];
    if C == 1 {
        axis[0] = 1.0;
    } else {
        let mut covariance = [[0.0; C]; C];
        for a in 0..C {
            for b in 0..=a {
                let value = sum(|i| centred[a][i] * centred[b][i]);
                covariance[a][b] = value;
                covariance[b][a] = value;
            }
        }
        axis = dominant(&covariance);
    }
    let norm = square_norm(&axis, set.metric);
    if norm <= 0.0 {
        return [mean; 2];
    }
    let mut along = [0.0; 16];
    for (c, channel) in centred.iter().enumerate() {
        let factor = axis[c] * set.metric[c] / norm;
        for i in 0..16 {
            along[i] += channel[i] * factor;
        }
    }
    let (mut low, mut high) = ([0.0; 4], [0.0; 4]);
    for k in 0..4 {
        for j in 0..4 {
            let t = along[4 * k + j];
            low[j] = if t < low[j] { t } else { low[j] };
            high[j] = if t > high[j] { t } else { high[j] };
        }
    }
    let low = low.into_iter().fold(0.0f32, f32::min);
    let high = high.into_iter().fold(0.0f32, f32::max);
    let mut ends = [mean; 2];
    for c in 0..C {
        ends[0][c] += low * axis[c];
        ends[1][c] += high * axis[c];
    }
    ends
}

/// Squared length of a vector under a metric.
#[inline(always)]
pub(crate) fn square_norm<const C: usize>(vector: &[f32; C], metric: &[f32; C]) -> f32 {
    let mut norm = 0.0;
    for c in 0..C {
        norm += vector[c] * vector[c] * metric[c];
    }
    norm
}

/// Dominant eigenvector (of some length) by power iteration.
fn dominant<const C: usize>(matrix: &[[f32; C]; C]) -> [f32; C] {
    let mut start = 0;
    for c in 1..C {
        if matrix[c][c] > matrix[start][start] {
            start = c;
        }
    }
    // The matrix is symmetric: a row is a column.
    let mut axis = matrix[start];
    for _ in 0..4 {
        let mut next = [0.0; C];
        let mut size = 0.0f32;
        for r in 0..C {
            for c in 0..C {
                next[r] += matrix[r][c] * axis[c];
            }
            size = if next[r].abs() > size { next[r].abs() } else { size };
        }
        if size <= 0.0 {
            return axis;
        }
        let scale = 1.0 / size;
        for c in 0..C {
            axis[c] = next[c] * scale;
        }
    }
    axis
}
