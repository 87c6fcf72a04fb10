//! What a shape is recovered from: pictures, the frame around what they show, and a mesh to begin with.

use super::shape_error::Truth;
use super::{MIN_TRIANGLES, MOST_LEVELS, PictureSource};
use crate::engine::given::GivenPicture;
use crate::engine::reference::{Rasterized, Reference};
use crate::engine::views::{Lighting, Orbit, Set, Views};
use crate::engine::{FitFrame, LightAsset, Normalised};
use crate::error::in_ranges;
use crate::pictures::{MIN_PICTURES, MOST_SIDE, PictureFolder, PosedPictures};
use crate::recover::bare;
use crate::simplify::prepare::visibility;
use crate::{FitError, Progress};
use glam::{DMat3, DVec3, Vec3};
use photofit_geometry::{Mesh, shapes};
use photofit_image::Image;
use photofit_scalar::Vec3f;
use photofit_scene::{Camera, FlatScene, Scene};
use photofit_shading::Sides;
use std::path::Path;

/// Radius of the ball to begin with, relative to the sphere around what the cameras see.
const BALL: f32 = 0.7;
/// Radius of the frame, relative to that of the sphere that the outlines tell: room for a shape on its way.
const ROOM: f32 = 1.15;
/// Alpha above which a pixel shows the shape.
const SHOWN: f32 = 0.5;
/// Least sine of the angle between cameras, about, from which depth can be told.
const LEAST_PARALLAX: f64 = 0.05;

/// Pictures in a frame.
pub(super) struct Pictures {
    pub(super) photos: PictureFolder,
    /// The frame, and the materials of what is recovered.
    pub(super) light_asset: LightAsset,
    /// The surface that they show, where it is known.
    pub(super) truth: Option<Truth>,
}

impl Pictures {
    pub(super) fn new(
        source: PictureSource<'_>,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let (photos, frame, truth) = match source {
            PictureSource::Asset { asset, views, size } => drawn(asset, [views, size], seed, progress)?,
            PictureSource::Folder(path) => given(path, seed, progress)?,
        };
        let scene = Scene { name: "recovered".into(), ..Scene::default() };
        let (light_asset, _) = LightAsset::of(&bare(&scene, !photos.lit), frame);
        Ok(Self { photos, light_asset, truth })
    }
}

/// Pictures with a frame around what they show, and its surface where that is known.
type Framed = (PictureFolder, FitFrame, Option<Truth>);

/// Pictures of a folder.
fn given(path: &Path, seed: u64, progress: &dyn Progress) -> Result<Framed, FitError> {
    let posed = PosedPictures::open(path)?.read(MIN_PICTURES, MOST_SIDE)?;
    let (some, all) = (posed.pictures.iter().filter(|p| p.is_opaque()).count(), posed.pictures.len());
    if some > 0 {
        return Err(posed.error(format!(
            "{some} of {all} pictures have no alpha; a shape needs pictures with alpha, which is its outline"
        )));
    }
    let cameras = (0..all).map(|i| posed.camera(i, FitFrame::WORLD)).collect::<Result<Vec<_>, _>>()?;
    let images = posed.pictures.iter().map(|p| &p.image);
    let pictures: Vec<(Camera, &Image)> = cameras.into_iter().zip(images).collect();
    let seen = seen_sphere(&pictures).map_err(|rule| posed.error(rule))?;
    let frame = FitFrame { radius: ROOM * seen.radius, ..seen };
    let photos = PictureFolder::in_frame(posed, frame, seed, None)?;
    photos.doubts().iter().for_each(|d| progress.warn(d));
    Ok((photos, frame, None))
}

/// Pictures of an asset by the rasterizer.
fn drawn(
    asset: &Scene,
    [views, size]: [usize; 2],
    seed: u64,
    progress: &dyn Progress,
) -> Result<Framed, FitError> {
    in_ranges([("views", views, MIN_PICTURES..=256), ("size", size, 16..=2048)])?;
    asset.validate_for_fit()?;
    let shown = Normalised::new(asset)?;
    let seen = visibility(&shown.surface()?, progress)?;
    let lit = asset.materials.iter().any(|m| !m.unlit);
    let orbit = Orbit::new(seed, &Lighting::Point, size);
    let renderer = Rasterized::new(&shown.flat, &shown.library);
    let photo = |i: u64| {
        let setup = orbit.setup(Set::Report, i, views as u64);
        let image = renderer.picture(&setup)?.image;
        Ok(GivenPicture { camera: setup.camera, lights: setup.lights, image })
    };
    let photos = (0..views as u64).map(photo).collect::<Result<Vec<_>, FitError>>()?;
    let frame = shown.frame();
    Ok((PictureFolder::of(photos, seed, lit), frame, Some(Truth { mesh: shown.flat.mesh, seen })))
}

/// The sphere around what the outlines show: its centre is closest to the rays through their middles, its radius the
/// largest that an outline tells.
fn seen_sphere(pictures: &[(Camera, &Image)]) -> Result<FitFrame, String> {
    let all = |image: &Image| -> Vec<[usize; 2]> {
        let pixels = (0..image.height).flat_map(|y| (0..image.width).map(move |x| [x, y]));
        pixels.filter(|[x, y]| image.pixel(*x, *y)[3] > SHOWN).collect()
    };
    let (mut matrix, mut right, mut count) = (DMat3::ZERO, DVec3::ZERO, 0.0);
    for (camera, image) in pictures {
        let shown = all(image);
        let Some(first) = shown.first() else { continue };
        let (lo, hi) = shown.iter().fold((*first, *first), |(lo, hi), [x, y]| {
            ([lo[0].min(*x), lo[1].min(*y)], [hi[0].max(*x), hi[1].max(*y)])
        });
        let d = ray(camera, image, [0, 1].map(|k| 0.5 * (lo[k] + hi[k] + 1) as f32));
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * camera.eye.as_dvec3();
        count += 1.0;
    }
    if count == 0.0 {
        return Err(
            "no picture shows anything: alpha is below 0.5 everywhere; it must be the outline of the shape"
                .into(),
        );
    }
    if (matrix * (1.0 / count)).determinant() < LEAST_PARALLAX * LEAST_PARALLAX {
        return Err("the cameras see the shape from one direction; it must be seen from several".into());
    }
    let center = matrix.inverse() * right;
    let mut radius = 0.0_f64;
    for (camera, image) in pictures {
        let to = center - camera.eye.as_dvec3();
        for [x, y] in all(image) {
            let d = ray(camera, image, [x as f32 + 0.5, y as f32 + 0.5]);
            // Where the ray comes closest to the centre.
            if d.dot(to) > 0.0 {
                radius = radius.max(d.cross(to).length());
            }
        }
    }
    if !(center.is_finite() && radius.is_finite() && radius > 0.0) {
        return Err("the outlines have no place in common; cameras and pictures must belong together".into());
    }
    Ok(FitFrame { center: Vec3f::from_array(center.as_vec3().to_array()), radius: radius as f32 })
}

/// Unit direction of the ray through a place in a picture, pixels from its upper left corner.
fn ray(camera: &Camera, image: &Image, [x, y]: [f32; 2]) -> DVec3 {
    let (w, h) = (image.width as f32, image.height as f32);
    let at = Vec3::new(2.0 * x / w - 1.0, 1.0 - 2.0 * y / h, 0.5);
    let there = camera.view_projection().inverse().project_point3(at);
    (there - camera.eye).as_dvec3().normalize_or_zero()
}

/// The mesh to begin with, in the frame.
pub(super) struct Start {
    pub(super) mesh: Mesh,
    pub(super) class: Vec<u32>,
    /// Levels of the fit: each has four times the triangles of the one before.
    pub(super) levels: u32,
}

impl Start {
    pub(super) fn new(
        light: &LightAsset,
        mesh: Option<&Scene>,
        budget: usize,
        lit: bool,
    ) -> Result<Self, FitError> {
        // There is a class for each side, lit or not.
        let class = |double_sided: bool| {
            let sides = Sides::of(double_sided);
            light.classes.iter().position(|c| c.sides == sides && c.unlit != lit).unwrap_or_default() as u32
        };
        let (mesh, class) = match mesh {
            Some(scene) => {
                scene.validate_for_fit()?;
                let FlatScene { mut mesh, triangle_material, .. } = scene.flatten();
                for p in &mut mesh.positions {
                    *p = light.frame.to_frame(*p);
                }
                let of = |m: &u32| class(scene.materials[*m as usize].double_sided);
                let classes = triangle_material.iter().map(of).collect();
                (mesh, classes)
            }
            None => {
                let mesh = ball(budget);
                let classes = vec![class(false); mesh.triangles.len()];
                (mesh, classes)
            }
        };
        let levels =
            1 + (1..=MOST_LEVELS).take_while(|k| mesh.triangles.len() <= budget >> (2 * k)).count() as u32;
        Ok(Self { mesh, class, levels })
    }
}

/// A ball that has at most `budget` triangles after as many splits as leave [`MIN_TRIANGLES`] at the start.
fn ball(budget: usize) -> Mesh {
    let splits = (0..MOST_LEVELS).take_while(|k| budget >> (2 * (k + 1)) >= MIN_TRIANGLES).count();
    let coarse = budget >> (2 * splits);
    let mut mesh = shapes::icosphere(((coarse as f64 / 20.0).sqrt().floor() as u32).max(1));
    mesh.positions.iter_mut().for_each(|p| *p *= BALL);
    mesh
}
