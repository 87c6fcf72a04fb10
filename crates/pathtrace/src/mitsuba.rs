//! Worlds, cameras and options from scenes of the Mitsuba 3 renderer.

use crate::camera::{Lens, Projection, View};
use crate::film::Filter;
use crate::integrator::PathOptions;
use crate::light::{EnvironmentMap, Falloff, LightSource};
use crate::render::RenderOptions;
use crate::volume::{Boundary, BoundedMedium, Field};
use crate::world::{Instance, Material, Parts, Shape};
use glam::{DMat3, DVec3, Quat};
use photofit_image::Image;
use photofit_scene::mitsuba::{
    MitsubaEnvironment, MitsubaFilter, MitsubaMedium, MitsubaScene, MitsubaSensor, MitsubaShape,
    MitsubaVolume, Projection as Seen,
};

impl Parts {
    /// Everything in a scene that light meets.
    pub fn from_mitsuba(scene: MitsubaScene) -> Self {
        let boundaries = scene.instances.iter().enumerate().filter_map(|(instance, i)| {
            let (interior, exterior) = (i.interior, i.exterior);
            interior.or(exterior).map(|_| Boundary { instance, interior, exterior })
        });
        let boundaries = boundaries.collect();
        let shapes = scene.shapes.into_iter().map(|shape| match shape {
            MitsubaShape::Sphere { center, radius } => Shape::Sphere { center, radius },
            MitsubaShape::Mesh(mesh) => Shape::Mesh(mesh),
            MitsubaShape::DistanceGrid { size, values, smooth } => {
                Shape::DistanceGrid { size, values, smooth }
            }
        });
        let instances = scene.instances.iter().map(|i| Instance {
            shape: i.shape,
            material: i.material,
            transform: i.transform,
        });
        Self {
            shapes: shapes.collect(),
            instances: instances.collect(),
            materials: scene.materials.into_iter().map(Material::from_graph).collect(),
            lights: scene.lights.iter().map(|l| LightSource::of_file(l, Falloff::Linear)).collect(),
            environment: scene.environment.map(environment),
            media: scene.media.into_iter().map(medium).collect(),
            boundaries,
            medium_around_camera: scene.sensor.medium,
            ..Self::default()
        }
    }
}

fn medium(m: MitsubaMedium) -> BoundedMedium {
    let field = |v: MitsubaVolume| Field { size: v.size, values: v.values, transform: v.to_unit.inverse() };
    BoundedMedium {
        extinction: field(m.extinction),
        scale: m.scale,
        albedo: field(m.albedo),
        g: m.g,
        emission: m.emission.map(field),
    }
}

fn environment(e: MitsubaEnvironment) -> EnvironmentMap {
    let mut to_world = e.to_world;
    let mut image = e.image;
    if to_world.determinant() < 0.0 {
        // A mirrored map is the map with its columns in reverse, turned.
        to_world *= DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let from = image;
        image = Image::from_fn(from.width, from.height, 3, |x, y, c| from.pixel(from.width - 1 - x, y)[c]);
    }
    // Our maps begin at -x, Mitsuba's at -z.
    let quarter = DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X);
    let rotation = Quat::from_mat3(&(to_world * quarter).as_mat3()).normalize();
    let rows_to_poles = image.height > 1;
    EnvironmentMap { scale: e.scale, rotation, rows_to_poles, ..EnvironmentMap::new(image) }
}

impl View {
    /// The camera of a scene.
    pub fn from_mitsuba(sensor: &MitsubaSensor) -> Self {
        let film = &sensor.film;
        let share = |a: u32, k: usize| f64::from(a) / f64::from(film.size[k].max(1));
        // Offsets move what is seen, in parts of the picture.
        let window = [
            (share(film.crop_offset[0], 0) + sensor.shift[0]) as f32,
            (share(film.crop_offset[1], 1) + sensor.shift[1]) as f32,
            share(film.crop_size[0], 0) as f32,
            share(film.crop_size[1], 1) as f32,
        ];
        let (projection, lens) = match sensor.projection {
            Seen::Perspective { lens } => {
                let lens = lens.map(|[radius, focus]| Lens { radius, focus });
                (Projection::Perspective, lens)
            }
            Seen::Orthographic => (Projection::Orthographic, None),
        };
        Self {
            eye: sensor.eye,
            axes: sensor.axes.map(|a| a.as_vec3()),
            half: sensor.half.map(|x| x as f32),
            projection,
            window,
            clip: sensor.clip.map(|x| x as f32),
            lens,
        }
    }
}

impl RenderOptions {
    /// Size, samples, filter and bounds of paths as a scene has them.
    pub fn from_mitsuba(scene: &MitsubaScene) -> Self {
        let film = &scene.sensor.film;
        let (i, usual) = (&scene.integrator, PathOptions::default());
        Self {
            width: film.crop_size[0] as usize,
            height: film.crop_size[1] as usize,
            spp: scene.sensor.samples,
            filter: match film.filter {
                MitsubaFilter::Box => Filter::Box,
                MitsubaFilter::Tent(radius) => Filter::Tent { radius },
                MitsubaFilter::Gaussian(sigma) => Filter::Gaussian { sigma },
            },
            path: PathOptions {
                max_depth: i.max_depth,
                roulette_depth: i.roulette_depth.unwrap_or(usual.roulette_depth),
                show_environment: !i.hide_emitters,
                show_emitters: !i.hide_emitters,
                ..usual
            },
            ..Self::default()
        }
    }
}
