//! Finished pictures with cameras: a reference and its views in one.

use super::reference::{Reference, ReferenceKind, ReferencePicture};
use super::views::{Moment, Set, Setup, Sphere, ViewCamera, ViewLights, Views};
use crate::FitError;
use photofit_image::{Image, downsample};
use photofit_sampling::Rng;

/// Random stream of the order of the pictures.
const STREAM_ORDER: u64 = 8 << 32;

/// A finished picture, and how it was taken, in the frame of the fit.
#[derive(Clone, Debug)]
pub struct GivenPicture {
    /// Where it was taken from.
    pub camera: ViewCamera,
    /// The light; empty where it is not known.
    pub lights: ViewLights,
    /// Linear RGBA, premultiplied.
    pub image: Image,
}

/// In which order [`Set::Train`] goes through the pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// As they stand, again and again.
    InTurn,
    /// All of them once in a random order drawn by this seed, then again in another.
    Shuffled(u64),
}

/// Finished pictures: how noisy they are is not known, and neither is the surface that they show.
#[derive(Clone, Debug)]
pub struct GivenPictures {
    pictures: Vec<GivenPicture>,
    train: Vec<usize>,
    held_out: Vec<usize>,
    order: Order,
}

impl GivenPictures {
    /// Pictures of which those with the numbers `train` are fitted and those with the numbers `held_out` judge the fit.
    ///
    /// # Panics
    /// If one of the two lists is empty or names a picture that is not there.
    pub fn new(pictures: Vec<GivenPicture>, train: Vec<usize>, held_out: Vec<usize>, order: Order) -> Self {
        for list in [&train, &held_out] {
            assert!(!list.is_empty() && list.iter().all(|i| *i < pictures.len()), "pictures that are there");
        }
        Self { pictures, train, held_out, order }
    }

    /// All pictures.
    pub fn pictures(&self) -> &[GivenPicture] {
        &self.pictures
    }

    /// Number of pictures that are fitted.
    pub fn fitted(&self) -> usize {
        self.train.len()
    }

    /// Number of pictures that judge the fit.
    pub fn held_out(&self) -> usize {
        self.held_out.len()
    }

    /// The view of a picture.
    pub fn view(&self, number: usize) -> Setup {
        self.pictures[number].setup(number)
    }
}

impl GivenPicture {
    /// The view of a picture that has this number.
    pub(crate) fn setup(&self, number: usize) -> Setup {
        Setup {
            camera: self.camera,
            lights: self.lights.clone(),
            moment: Moment::default(),
            width: self.image.width,
            height: self.image.height,
            picture: Some(number),
            backs: false,
        }
    }
}

impl Views for GivenPictures {
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup {
        let fitted = self.train.len() as u64;
        let at = match (set, self.order) {
            (Set::Train, Order::InTurn) => self.train[(index % fitted) as usize],
            (Set::Train, Order::Shuffled(seed)) => {
                let mut order = self.train.clone();
                let mut rng = Rng::new(seed, STREAM_ORDER + index / fitted);
                for k in (1..order.len()).rev() {
                    order.swap(k, rng.next_u32() as usize % (k + 1));
                }
                order[(index % fitted) as usize]
            }
            (Set::HeldOut | Set::Report, _) => {
                let n = self.held_out.len() as u64;
                self.held_out[(index * n / count.max(1)).min(n - 1) as usize]
            }
        };
        self.view(at)
    }
}

impl Reference for GivenPictures {
    fn kind(&self) -> ReferenceKind {
        ReferenceKind::GIVEN
    }

    /// The picture that the view belongs to.
    fn picture(&self, setup: &Setup) -> Result<ReferencePicture, FitError> {
        let image = &self.pictures[setup.given_picture(self.pictures.len())?].image;
        let factor = (image.width / setup.width.max(1)).max(1);
        let image = if factor > 1 {
            downsample(image, factor).crop(0, 0, setup.width, setup.height)
        } else {
            image.clone()
        };
        Ok(ReferencePicture { image, noise: None, halves: None })
    }

    fn bounds(&self, _: Moment) -> Sphere {
        Sphere::UNIT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::views::{Lighting, Orbit};

    /// Pictures of 4 x 2 pixels, of grey `k`.
    fn pictures(count: usize, held_out: Vec<usize>, order: Order) -> GivenPictures {
        let orbit = Orbit::new(0, &Lighting::Point, 4);
        let picture = |k: usize| GivenPicture {
            camera: orbit.setup(Set::Report, k as u64, count as u64).camera,
            lights: ViewLights::default(),
            image: Image::new(4, 2, 4).map(|_| k as f32),
        };
        let train = (0..count).filter(|k| !held_out.contains(k)).collect();
        GivenPictures::new((0..count).map(picture).collect(), train, held_out, order)
    }

    fn numbers(p: &GivenPictures, set: Set, count: u64) -> Vec<usize> {
        (0..count).map(|i| p.setup(set, i, count).picture.unwrap()).collect()
    }

    #[test]
    fn pictures_come_in_turn_or_all_of_them_in_random_orders() {
        let in_turn = pictures(4, vec![3], Order::InTurn);
        assert_eq!(numbers(&in_turn, Set::Train, 7), [0, 1, 2, 0, 1, 2, 0]);
        let shuffled = pictures(9, vec![7], Order::Shuffled(3));
        let drawn = numbers(&shuffled, Set::Train, 16);
        for round in drawn.chunks(8) {
            let mut round = round.to_vec();
            round.sort_unstable();
            assert_eq!(round, [0, 1, 2, 3, 4, 5, 6, 8]);
        }
        assert_ne!(drawn[..8], drawn[8..], "each round has an order of its own");
        let spread = pictures(9, vec![1, 4, 6, 8], Order::InTurn);
        assert_eq!(numbers(&spread, Set::HeldOut, 2), [1, 6]);
        assert_eq!(numbers(&spread, Set::Report, 6), [1, 1, 4, 6, 6, 8]);
    }

    #[test]
    fn a_view_shows_its_own_picture_at_its_size() {
        let p = pictures(4, vec![3], Order::InTurn);
        let picture = p.picture(&p.view(2)).unwrap();
        assert_eq!((picture.image.width, picture.image.height, picture.noise), (4, 2, None));
        assert!(picture.image.data.iter().all(|v| *v == 2.0));
        let small = p.picture(&p.view(1).shrunk(2)).unwrap().image;
        assert_eq!((small.width, small.height, small.data[0]), (2, 1, 1.0));
    }
}
