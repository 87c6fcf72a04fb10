//! One way of storing each image, such that they fit into a number of bytes with the least loss: a multiple-choice
//! knapsack, solved by dynamic programming over rounded bytes.

/// Bytes and loss of a variant: a way to store an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variant {
    pub(super) bytes: u64,
    pub(super) loss: f64,
}

/// Parts into which the bytes are divided: what is lost by rounding is less than a part for each image.
const PARTS: u64 = 4096;

/// The index of each image's variant, or none if even the smallest do not fit.
pub(super) fn least_loss(images: &[Vec<Variant>], most: u64) -> Option<Vec<usize>> {
    let part = most.div_ceil(PARTS).max(1);
    let room = (most / part) as usize;
    // The least loss of the images so far within so many parts, and how the last one of them is stored.
    let mut losses = vec![0.0; room + 1];
    let mut chosen: Vec<Vec<usize>> = Vec::new();
    for variants in images {
        let mut next = vec![f64::INFINITY; room + 1];
        let mut how = vec![usize::MAX; room + 1];
        for (index, variant) in variants.iter().enumerate() {
            let parts = usize::try_from(variant.bytes.div_ceil(part)).unwrap_or(usize::MAX);
            for at in parts..=room {
                let loss = losses[at - parts] + variant.loss;
                if loss < next[at] {
                    (next[at], how[at]) = (loss, index);
                }
            }
        }
        losses = next;
        chosen.push(how);
    }
    if !losses[room].is_finite() {
        return None;
    }
    let (mut at, mut out) = (room, vec![0; images.len()]);
    for (k, how) in chosen.iter().enumerate().rev() {
        out[k] = how[at];
        at -= images[k][out[k]].bytes.div_ceil(part) as usize;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All combinations, one after the other.
    fn brute_force(images: &[Vec<Variant>], most: u64) -> Option<f64> {
        let Some((first, rest)) = images.split_first() else { return Some(0.0) };
        let with = |w: &Variant| Some(w.loss + brute_force(rest, most.checked_sub(w.bytes)?)?);
        first.iter().filter_map(with).min_by(f64::total_cmp)
    }

    #[test]
    fn the_loss_is_the_least_of_all_combinations() {
        let mut state = 1_u64;
        let mut random = |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % n
        };
        let mut none = 0;
        for _ in 0..200 {
            let images: Vec<Vec<Variant>> = (0..1 + random(4))
                .map(|_| {
                    let variant = |b: u64| Variant { bytes: 1 + b % 900, loss: (b / 900 % 1000) as f64 };
                    (0..1 + random(6)).map(|_| variant(random(1 << 30))).collect()
                })
                .collect();
            let most = random(2500);
            let best = brute_force(&images, most);
            let Some(choice) = least_loss(&images, most) else {
                assert_eq!(best, None);
                none += 1;
                continue;
            };
            let taken = || choice.iter().zip(&images).map(|(i, variants)| variants[*i]);
            assert!(taken().map(|w| w.bytes).sum::<u64>() <= most);
            assert_eq!(Some(taken().map(|w| w.loss).sum::<f64>()), best);
        }
        assert!((10..190).contains(&none), "both ends were met: {none}");
    }

    #[test]
    fn rounding_loses_little_and_never_overflows() {
        let variant = |bytes, loss| Variant { bytes, loss };
        let images = vec![
            vec![variant(900_001, 0.0), variant(500_000, 3.0)],
            vec![variant(99_000, 1.0), variant(u64::MAX, 0.0)],
        ];
        assert_eq!(least_loss(&images, 1_000_000), Some(vec![0, 0]));
        assert_eq!(least_loss(&images, 800_000), Some(vec![1, 0]));
        assert_eq!(least_loss(&images, 0), None);
    }
}
