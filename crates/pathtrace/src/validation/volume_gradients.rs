//! Gradients of media against central differences, where estimators break first: density at its upper bound, far below
//! it, and none at all; grids voxel group by voxel group; a closed form.

mod colors;
mod company;
mod emission;
mod grids;
mod table;
mod tapes;
mod thick;

use super::scenes::{diffuse, looking, place, quad, square, unit_cube_size};
use crate::{
    Adjoint, Boundary, BoundedMedium, EnvironmentMap, Field, GradientSamples, Instance, LightSource,
    Material, MediumRef, MediumValue, Parameter, ParameterGradient, Parts, RenderOptions, Renderer, Shape,
    View, Volume, World, WorldOptions,
};
use glam::{DAffine3, DVec3};
use photofit_image::Image;
use photofit_sampling::{hash, unit_f32};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Null};

const SIDE: usize = 12;
/// Independent estimates of either kind.
const REPLICATES: u64 = 8;
/// The cube from -1 to 1, in which the media are.
const CUBE: f64 = 1.0;

/// How a medium is given.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Between surfaces, the same everywhere.
    Even,
    /// Between surfaces, on a grid.
    Bounded,
    /// In a box of its own.
    Box,
    /// The same everywhere, around the camera: flights have no end.
    Around,
}

impl Kind {
    fn medium(self) -> MediumRef {
        if self == Self::Box { MediumRef::Volume(0) } else { MediumRef::Bounded(0) }
    }

    fn parameter(self, value: MediumValue) -> Parameter {
        Parameter::Medium { medium: self.medium(), value }
    }
}

/// A number in [0, 1) for two keys.
fn noise(a: u64, b: u64) -> f32 {
    unit_f32((hash(0x501d, a, b) >> 32) as u32)
}

/// A cube of a medium above a floor under a lamp and a sky.
#[derive(Clone)]
struct Cloud {
    kind: Kind,
    size: [usize; 3],
    /// One value, or one per voxel.
    density: Vec<f32>,
    albedo: Vec<Vec3f>,
    /// Empty: it has none.
    emission: Vec<Vec3f>,
    /// Factor of the density of each colour, between surfaces and around the camera.
    tint: Vec3f,
    scale: f32,
    g: f32,
    /// Factor of the upper bounds.
    factor: f32,
    /// Most scattering events.
    depth: u32,
    /// There are another medium and a clear solid that absorbs, and both reach into it.
    in_company: bool,
}

impl Cloud {
    fn uniform(kind: Kind, density: f32) -> Self {
        let albedo = vec![vec3(0.8, 0.6, 0.9)];
        let size = if matches!(kind, Kind::Even | Kind::Around) { [1; 3] } else { [3, 2, 2] };
        let tint = Vec3f::splat(1.0);
        let (density, emission) = (vec![density], Vec::new());
        let (scale, g, factor, depth, in_company) = (1.0, 0.3, 1.0, 6, false);
        Self { kind, size, density, albedo, emission, tint, scale, g, factor, depth, in_company }
    }

    fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// A value for each voxel.
    fn filled<T: Copy>(&self, values: &[T]) -> Vec<T> {
        (0..self.voxels()).map(|i| values[i % values.len()]).collect()
    }

    fn world(&self) -> World {
        let mut parts = Parts::default();
        let floor = quad(vec3(-4.0, -1.3, -4.0), vec3(0.0, 0.0, 8.0), vec3(8.0, 0.0, 0.0));
        place(&mut parts, floor, Material::new(diffuse(0.6, 0.5, 0.4)));
        let lamp = quad(vec3(-0.5, 2.5, -0.5), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
        place(&mut parts, lamp, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(vec3(5.0, 6.0, 7.0)));
        if self.kind != Kind::Around {
            // In a medium, light near a point has no finite variance.
            let (position, intensity) = (DVec3::new(2.5, 1.0, 1.5), vec3(4.0, 3.0, 2.0));
            parts.lights.push(LightSource::Point { position, intensity });
        }
        let sky = Image::from_fn(8, 4, 3, |x, y, c| 0.2 + 0.1 * ((3 * x + 5 * y + c) % 7) as f32);
        parts.environment = Some(EnvironmentMap::new(sky));
        let transform =
            DAffine3::from_translation(DVec3::splat(-CUBE)) * DAffine3::from_scale(DVec3::splat(2.0 * CUBE));
        let (density, albedo) = (self.filled(&self.density), self.filled(&self.albedo));
        let emits = !self.emission.is_empty();
        let emission =
            emits.then(|| Field { size: self.size, values: self.filled(&self.emission), transform });
        if self.kind == Kind::Box {
            parts.volumes.push(Volume {
                size: self.size,
                density,
                scale: self.scale,
                albedo: Vec3f::splat(1.0),
                albedos: albedo,
                g: self.g,
                emission,
                transform,
            });
        } else {
            let grey = density.iter().map(|d| self.tint * *d).collect();
            let field = |values| Field { size: self.size, values, transform };
            let (extinction, albedo) = (field(grey), field(albedo));
            parts.media.push(BoundedMedium { extinction, scale: self.scale, albedo, g: self.g, emission });
        }
        if self.kind == Kind::Around {
            parts.medium_around_camera = Some(0);
        } else if self.kind != Kind::Box {
            parts.shapes.push(Shape::Mesh(photofit_geometry::shapes::cube()));
            parts.materials.push(Material::new(Bsdf::Null(Null)));
            let scale = DVec3::splat(2.0 * CUBE / f64::from(unit_cube_size()));
            let (shape, material) = (parts.shapes.len() - 1, parts.materials.len() - 1);
            parts.instances.push(Instance { shape, material, transform: DAffine3::from_scale(scale) });
            let instance = parts.instances.len() - 1;
            parts.boundaries.push(Boundary { instance, interior: Some(0), exterior: None });
        }
        if self.in_company {
            let clear =
                Material { absorption: vec3(0.2, 0.5, 0.9), solid: true, ..Material::new(Bsdf::Null(Null)) };
            parts.add(Shape::Sphere { center: vec3(0.5, 0.2, 0.6), radius: 0.7 }, clear);
            parts.volumes.push(Volume {
                size: [1; 3],
                density: vec![0.7],
                scale: 1.0,
                albedo: vec3(0.5, 0.7, 0.6),
                albedos: Vec::new(),
                g: 0.0,
                emission: None,
                transform: DAffine3::from_translation(DVec3::new(-0.6, -0.5, -0.2)),
            });
        }
        let options = WorldOptions { majorant_factor: self.factor, ..WorldOptions::default() };
        World::with_options(parts, options).unwrap()
    }

    fn options(&self, spp: u32, seed: u64) -> RenderOptions {
        let mut options = RenderOptions { seed, ..square(SIDE, spp) };
        options.path.max_depth = self.depth;
        options
    }

    /// Derivative of the loss along `direction`, of voxel and channel, by replay: mean and standard error.
    fn replayed(&self, value: MediumValue, spp: u32, direction: impl Fn(usize, usize) -> f64) -> (f64, f64) {
        let [found] = self.replayed_at_once([value], spp, direction);
        found
    }

    /// Those of several values, of the same paths.
    fn replayed_at_once<const K: usize>(
        &self,
        values: [MediumValue; K],
        spp: u32,
        direction: impl Fn(usize, usize) -> f64,
    ) -> [(f64, f64); K] {
        let world = self.world();
        let parameters = values.map(|value| self.kind.parameter(value));
        let adjoint = Adjoint::new(&world, &view(), self.options(1, 0), &parameters).unwrap();
        let one = |seed: u64| {
            let gradient =
                adjoint.render_vjp(&weights(), GradientSamples { spp, seed: Some(1000 + seed) }).unwrap();
            assert!(gradient.residual < 1e-9, "{} is left", gradient.residual);
            assert_eq!(gradient.not_finite, 0);
            let along = |p: &ParameterGradient| -> f64 {
                p.values.iter().enumerate().map(|(i, g)| g * direction(i / p.channels, i % p.channels)).sum()
            };
            gradient.parameters.iter().map(along).collect()
        };
        let runs: Vec<Vec<f64>> = (0..REPLICATES).map(one).collect();
        std::array::from_fn(|k| statistics(&runs.iter().map(|r| r[k]).collect::<Vec<f64>>()))
    }

    /// Weighted sum of the picture.
    fn loss(&self, spp: u32, seed: u64) -> f64 {
        let world = self.world();
        let mut renderer = Renderer::new(&world, &view(), self.options(spp, seed)).unwrap();
        while !renderer.pass(|| false).done {}
        let (picture, weights) = (renderer.picture(), weights());
        let pixel = |i: usize| {
            (0..3)
                .map(|c| f64::from(picture.data[4 * i + c]) * f64::from(weights.data[3 * i + c]))
                .sum::<f64>()
        };
        (0..SIDE * SIDE).map(pixel).sum()
    }
}

/// Derivative at 0 of the loss of clouds by differences with steps of `step`: central, or of second order from above
/// where there is nothing below 0.
fn differences(at: impl Fn(f64) -> Cloud, step: f64, from_above: bool, spp: u32) -> (f64, f64) {
    let one = |seed: u64| {
        let loss = |x: f64| at(x).loss(spp, seed);
        if from_above {
            (4.0 * loss(step) - loss(2.0 * step) - 3.0 * loss(0.0)) / (2.0 * step)
        } else {
            (loss(step) - loss(-step)) / (2.0 * step)
        }
    };
    statistics(&(0..REPLICATES).map(one).collect::<Vec<f64>>())
}

/// Weights of a loss that is linear in the picture: random, of both signs.
fn weights() -> Image {
    Image::from_fn(SIDE, SIDE, 3, |x, y, c| {
        (1.4 * noise((y * SIDE + x) as u64, c as u64) - 0.4) / (SIDE * SIDE) as f32
    })
}

fn view() -> View {
    looking([1.2, 0.4, 3.6], [0.0, -0.1, 0.0], 0.75)
}

/// Mean and standard error.
fn statistics(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Whether two derivatives agree: within 2 % or four standard errors.
fn agree((a, sa): (f64, f64), (b, sb): (f64, f64)) -> bool {
    (a - b).abs() <= (0.02 * b.abs()).max(4.0 * sa.hypot(sb))
}

/// Demands that two derivatives agree, with standard errors below `resolved` of the derivative.
fn compare(name: &str, a: (f64, f64), b: (f64, f64), resolved: f64) {
    compare_within(name, a, b, resolved * b.0.abs());
}

/// The same with standard errors below `most`, for derivatives that may be near 0.
fn compare_within(name: &str, a: (f64, f64), b: (f64, f64), most: f64) {
    let text =
        format!("{name:<36} replay {:>9.5} +- {:.5}, differences {:>9.5} +- {:.5}", a.0, a.1, b.0, b.1);
    println!("{text}");
    assert!(agree(a, b), "{text}");
    assert!(a.1.hypot(b.1) < most, "says nothing: {text}");
}
