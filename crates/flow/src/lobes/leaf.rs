//! What a leaf of the tree learns: its lobes by expectation and maximisation, and the share of directions they get by
//! records that they have not learned from.

use super::mixture::{LOBES, Mixture, WIDTH};
use super::parallax::{Moved, Parallax, Turning, center};
use super::vmf::{Lobe, mean_length};
use super::{KAPPA_FIRST, LobeLocal};
use crate::guide::{Query, Record, SHARE};
use photofit_sampling::fibonacci_sphere;
use photofit_scalar::Vec3f;
use photofit_scalar::wide::{Kernel, run_up_to};

/// Rounds of expectation and maximisation of the lobes.
const ROUNDS: usize = 4;
/// Halvings of the bounds of a share: as many as single precision can tell apart.
const HALVINGS: usize = 24;
/// Largest weight of a record in units of its leaf's mean.
const WEIGHT_MAX: f32 = 20.0;
/// Records without direction that every lobe is thought to have seen beside the true ones: keeps few from making it
/// narrow or empty.
const PRIOR: f32 = 0.5;
/// What a call of [`Learn::learn`](crate::Learn::learn) leaves of the weight of earlier ones: the first records come from
/// poor directions.
const MEMORY: f32 = 0.5;

#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    pub(super) lobes: Mixture,
    pub(super) parallax: Parallax,
    /// Weight of the records that made the lobes (1 on average, cut at [`WEIGHT_MAX`]), those of earlier calls for less;
    /// 0 where none has.
    pub(super) seen: f32,
    pub(super) share: f32,
    pub(super) depth: u32,
}

/// A record under two densities, 1/sr: that of the lobes and that of the scattering function.
#[derive(Clone, Copy, Debug)]
struct Score {
    guide: f32,
    other: f32,
    weight: f32,
}

/// [`Leaf::local`], for one width.
struct AtVertex<'a>(&'a Leaf, &'a Query);

impl Kernel for AtVertex<'_> {
    type Output = LobeLocal;

    #[inline(always)]
    fn run(self) -> LobeLocal {
        let Self(leaf, at) = self;
        let n = if at.normal.dot(at.wo) < 0.0 { -at.normal } else { at.normal };
        let lobes = leaf.parallax.at(&leaf.lobes, at.position).lobes.with_cosine(n);
        LobeLocal { lobes, share: leaf.share }
    }
}

impl Leaf {
    /// All directions nearly alike, asked rarely.
    pub(super) fn untrained() -> Self {
        let lobe = |k| Lobe::new(1.0 / LOBES as f32, fibonacci_sphere(k, LOBES), KAPPA_FIRST);
        Self {
            lobes: Mixture::new(std::array::from_fn(lobe)),
            parallax: Parallax::none(),
            seen: 0.0,
            share: SHARE[0],
            depth: 0,
        }
    }

    #[inline]
    pub(super) fn local(&self, at: &Query) -> LobeLocal {
        run_up_to(WIDTH, AtVertex(self, at))
    }

    /// Learns from its useful records `own`; `extent` is that of the records of all leaves, `unguided` says that no guide had a
    /// part in their densities.
    pub(super) fn learn(&mut self, own: &[u32], records: &[Record], extent: f32, unguided: bool) {
        let before = *self;
        // Lobes that are scored by what they learned from look better than they are, the more so the fewer records: those
        // of earlier calls are scored, or the first ones of one half by the other.
        let share = if before.seen > 0.0 {
            before.share_of(&before, own.iter(), records, unguided)
        } else {
            let mut half = before;
            half.fit(own.iter().step_by(2), records, extent);
            half.share_of(&before, own.iter().skip(1).step_by(2), records, unguided)
        };
        if self.fit(own.iter(), records, extent) {
            self.share = share.unwrap_or(self.share);
        }
    }

    /// Expectation and maximisation from the present lobes, which count for the records that made them; whether there
    /// was anything to learn.
    fn fit<'a>(
        &mut self,
        own: impl ExactSizeIterator<Item = &'a u32> + Clone,
        records: &[Record],
        extent: f32,
    ) -> bool {
        let own = own.map(|i| &records[*i as usize]);
        let mean = own.clone().map(incident).sum::<f32>() / own.len() as f32;
        let usable = mean > 0.0 && mean.is_finite();
        if !usable {
            return false;
        }
        let pivot = center(own.clone());
        self.parallax.move_to(&mut self.lobes, pivot);
        let told = self.parallax.fading(MEMORY);
        let seen = MEMORY * self.seen;
        let known = std::array::from_fn(|k| self.lobes.lobe(k));
        let priors: [(f32, Vec3f); LOBES] = known.map(|l: Lobe| {
            let mass = seen * l.weight;
            (PRIOR + mass, l.mean * (mass * mean_length(l.kappa)))
        });
        for _ in 0..ROUNDS {
            let (mut mass, mut sums) = (priors.map(|p| p.0), priors.map(|p| p.1));
            let (mut gathered, mut turning) = (seen, Turning::none());
            for r in own.clone() {
                let weight = (incident(r) / mean).min(WEIGHT_MAX);
                let offset = r.query.position - pivot;
                let Moved { lobes, distance, inverse } = self.parallax.at(&self.lobes, r.query.position);
                let parts = lobes.parts(r.wi);
                let all: f32 = parts.iter().sum();
                if all <= 0.0 {
                    continue;
                }
                gathered += weight;
                for k in 0..LOBES {
                    let part = weight * parts[k] / all;
                    mass[k] += part;
                    // The direction from the pivot of what is seen there.
                    let place = r.wi * distance[k] + offset * inverse[k];
                    sums[k] += place.normalize_or_zero() * part;
                    turning.add(k, part, (r.wi, offset), self.lobes.mean(k), distance[k]);
                }
            }
            let total = gathered + LOBES as f32 * PRIOR;
            // Means are those under the places of the round before; the rounds bring both together.
            for k in 0..LOBES {
                self.parallax.learn(k, &told, turning.found(k, self.lobes.kappa[k]), extent);
            }
            let lobe = |k: usize| Lobe::of_mean(mass[k] / total, sums[k] * (1.0 / mass[k]));
            self.lobes = Mixture::new(std::array::from_fn(lobe));
            // What the next call takes for a prior is what was gathered, not the number of records.
            self.seen = gathered;
        }
        true
    }

    /// The share with which these lobes and the scattering function explain records best that were made with the leaf
    /// `made_with`; `None` without any.
    fn share_of<'a>(
        &self,
        made_with: &Self,
        own: impl ExactSizeIterator<Item = &'a u32> + Clone,
        records: &[Record],
        unguided: bool,
    ) -> Option<f32> {
        let own = own.map(|i| &records[*i as usize]);
        let usual = own.clone().map(worth).sum::<f32>() / own.len() as f32;
        let scores: Vec<Score> = own
            .filter_map(|r| {
                let guide = self.local(&r.query).lobes.density(r.wi);
                let other = if unguided {
                    r.pdf
                } else {
                    let old = made_with.local(&r.query);
                    (r.pdf - old.share * old.lobes.density(r.wi)).max(0.0) / (1.0 - old.share)
                };
                let usable = guide.max(other) > 0.0 && (guide + other).is_finite();
                usable.then(|| Score { guide, other, weight: worth(r).min(WEIGHT_MAX * usual) })
            })
            .collect();
        best_share(&scores)
    }
}

/// The share `s` within [`SHARE`] that makes the sum of `w ln(s g + (1 - s) o)` largest, by bisection of its derivative,
/// which falls. Where both densities are alike the lobes get as little as they can.
fn best_share(scores: &[Score]) -> Option<f32> {
    if scores.is_empty() {
        return None;
    }
    let slope = |s: f32| {
        let part = |x: &Score| x.weight * (x.guide - x.other) / (s * x.guide + (1.0 - s) * x.other);
        scores.iter().map(|x| f64::from(part(x))).sum::<f64>()
    };
    let [mut lo, mut hi] = SHARE;
    if slope(hi) > 0.0 {
        return Some(hi);
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (lo + hi);
        *(if slope(middle) > 0.0 { &mut lo } else { &mut hi }) = middle;
    }
    Some(lo)
}

/// The radiance over the density that chose the direction.
#[inline]
fn incident(r: &Record) -> f32 {
    r.incident / r.pdf
}

/// The integrand over the density that chose the direction.
#[inline]
fn worth(r: &Record) -> f32 {
    r.value / r.pdf
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::{Rng, uniform_sphere};
    use photofit_scalar::vec3;
    use photofit_scalar::wide::Width;

    #[test]
    fn wider_vectors_give_the_same_bits() {
        let mut rng = Rng::new(12, 5);
        let mut next = || rng.next_f32();
        for _ in 0..20 {
            let mut leaf = Leaf::untrained();
            leaf.lobes = Mixture::new(std::array::from_fn(|_| {
                Lobe::new(1.0 / LOBES as f32, uniform_sphere([next(), next()]), 2e3 * next() * next())
            }));
            leaf.parallax.inverse = std::array::from_fn(|_| next());
            let normal = uniform_sphere([next(), next()]);
            let at =
                Query { position: vec3(next(), next(), 2.0 * next()), normal, wo: normal, roughness: 1.0 };
            let of = |width| format!("{:?}", run_up_to(width, AtVertex(&leaf, &at)));
            // Where the machine lacks a width, a narrower one answers; text of numbers is exact.
            for width in Width::ALL {
                assert_eq!(of(Width::Base), of(width), "{width:?}");
            }
            assert_eq!(of(Width::Base), format!("{:?}", leaf.local(&at)));
        }
    }
}
