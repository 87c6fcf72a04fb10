//! `photofit render`: one picture of an asset.

use crate::args::{Render, RenderIntegrator, RenderLight};
use crate::output;
use crate::preflight::Places;
use crate::progress::{Terminal, say, say_warnings};
use crate::status::Ending;
use crate::{animation, camera, light, memory, mitsuba, path_render, threads};
use anyhow::{Result, anyhow};
use glam::Vec3;
use photofit_fit::engine::judge::count_beyond_rasterizer;
use photofit_fit::footprint::Task;
use photofit_fit::scene_render::SceneRenderer;
use photofit_fit::{Progress, Silent};
use photofit_image::Image;
use photofit_pathtrace::View;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{Camera, Scene, SurfaceLibrary};
use photofit_shading::{Light, Yaw};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Vertical field of view, radians.
const FIELD_OF_VIEW: f32 = 0.7;
/// Turn and lift of the camera, degrees.
const AZIMUTH: f32 = 30.0;
const ELEVATION: f32 = 20.0;
/// Irradiance of the main light at the centre of the asset.
const IRRADIANCE: f32 = 2.6;
/// Radiance of the weak constant environment beside a point light.
const AMBIENT: f32 = 0.22;

pub(crate) fn run(a: &Render) -> Result<Ending> {
    let traced = a.is_mitsuba() || a.integrator == Some(RenderIntegrator::Path);
    let state = traced.then(|| path_render::state_file(&a.output));
    let places = Places::default()
        .reads("IN", Some(&a.input))
        .reads("--env", a.env.as_deref())
        .writes("--output", Some(&a.output))
        .sets_aside("the state beside --output", state.as_deref())
        .writes("--json", a.json.as_deref());
    places.check()?;
    if a.is_mitsuba() {
        return mitsuba::render(a, &places);
    }
    if traced {
        return path_render::run(a, &places);
    }
    threads::set(a.threads)?;
    let began = Instant::now();
    let environment = match (a.light, &a.env) {
        (RenderLight::Env, Some(file)) => Some(light::environment(file)?),
        _ => None,
    };
    let scene = posed(a)?;
    places.check_against("IN", &scene.files)?;
    scene.validate_for_fit().map_err(|e| anyhow!("{}: {e}", a.input.display()))?;
    let (beyond, materials) = count_beyond_rasterizer(&scene);
    if !beyond.is_empty() {
        let beyond: Vec<String> =
            beyond.iter().map(|(name, n)| format!("{name} of {n} of {materials} materials")).collect();
        say(&format!(
            "warning: {}: the rasterizer does not draw {}; --integrator path does",
            a.input.display(),
            beyond.join(", ")
        ));
    }
    let (center, radius) = extent(a, &scene)?;
    let camera = match a.camera {
        Some(index) => own_camera(a, &scene, index, center, radius)?,
        None => camera(a, center, radius),
    };
    let lights = match (a.light, &environment) {
        (RenderLight::Env, Some(map)) => {
            vec![Light::Environment { map, rotation: Yaw::new(0.0), scale: 1.0 }]
        }
        (RenderLight::Headlight, _) => headlight(&camera, center),
        _ => point_light(&camera, center, radius),
    };
    // The command line admits squares alone.
    let supersample = a.spp.unwrap_or(16).isqrt() as usize;
    let size = (a.width() as usize, a.height() as usize);
    let picture = render(&scene, &camera, &lights, size, supersample, &Terminal::new());
    write(&a.output, &picture)?;
    warn_unseen(&a.input, &picture);
    let spp = supersample * supersample;
    if let Some(file) = &a.json {
        let value = json!({
            "input": a.input.display().to_string(),
            "output": a.output.display().to_string(),
            "integrator": "raster",
            "width": a.width(),
            "height": a.height(),
            "spp": spp,
            "camera": camera::to_json(&View::pinhole(&camera), a.width(), a.height()),
            "lights": camera::lights(&lights),
            "triangles": scene.triangle_count(),
            "seconds": began.elapsed().as_secs_f64(),
            "threads": rayon::current_num_threads(),
        });
        output::write_json(file, &value)?;
    }
    output::print(&summary(a, spp, began))?;
    Ok(Ending::Done)
}

/// Warns where a picture (RGBA) shows nothing of what it is of.
pub(crate) fn warn_unseen(input: &Path, picture: &Image) {
    if picture.data.chunks_exact(4).all(|p| p[3] <= 0.0) {
        say(&format!(
            "warning: {}: the camera sees nothing of it: it is transparent all over, turns its back, is too small beside its \
             bounds, or outside of the picture",
            input.display()
        ));
    }
}

/// The asset, as it is at the moment that the command names.
pub(crate) fn posed(a: &Render) -> Result<Scene> {
    let mut scene = photofit_scene::load(&a.input)?;
    say_warnings(&a.input, &scene);
    memory::check_textures(Task::Render, &a.input, &[&scene])?;
    let Some(wanted) = &a.animation else { return Ok(scene) };
    let index = animation::index(&a.input, &scene, wanted)?;
    scene.set_pose(scene.pose(Some(index), a.time.unwrap_or(0.0)));
    Ok(scene)
}

/// What was written with so many samples of a pixel, in one line.
pub(crate) fn summary(a: &Render, spp: usize, began: Instant) -> String {
    let (file, w, h) = (a.output.display(), a.width(), a.height());
    let (samples, seconds) = (output::counted(spp, "sample"), began.elapsed().as_secs_f64());
    format!("wrote {file}: {w} x {h} pixels, {samples} each, {seconds:.1} s\n")
}

/// A camera of the asset, with the vertical field of view that it has there; everything of the asset in front of it is seen.
fn own_camera(a: &Render, scene: &Scene, index: usize, center: Vec3, radius: f32) -> Result<Camera> {
    let camera = scene.cameras.get(index).ok_or_else(|| no_camera(&a.input, scene, index))?;
    let (distance, space) = (camera.eye.distance(center), 1.05 * radius);
    let near = (distance - space).max(1e-3 * distance.max(space));
    let far = (distance + space).max(near * 1.001);
    Ok(Camera { aspect: a.width() as f32 / a.height() as f32, near, far, ..*camera })
}

/// What is said about a camera that an asset does not have.
pub(crate) fn no_camera(input: &Path, scene: &Scene, index: usize) -> anyhow::Error {
    let (file, n) = (input.display(), scene.cameras.len());
    match n {
        0 => anyhow!("{file}: has no cameras, and --camera must not be given"),
        n => anyhow!("{file}: has {n} cameras; --camera is {index}, it must be below that number"),
    }
}

/// Centre and radius of the asset.
pub(crate) fn extent(a: &Render, scene: &Scene) -> Result<(Vec3, f32)> {
    scene.bounding_sphere().ok_or_else(|| anyhow!("{}: the asset has no extent", a.input.display()))
}

/// The camera that azimuth, elevation and distance say.
pub(crate) fn camera(a: &Render, center: Vec3, radius: f32) -> Camera {
    let aspect = a.width() as f32 / a.height() as f32;
    let [azimuth, elevation] = [(a.azimuth, AZIMUTH), (a.elevation, ELEVATION)]
        .map(|(given, own)| given.unwrap_or(own).to_radians());
    match a.distance {
        None => Camera::framing(center, radius, azimuth, elevation, FIELD_OF_VIEW, aspect),
        Some(d) => Camera::orbit(center, radius, azimuth, elevation, d * radius, FIELD_OF_VIEW, aspect),
    }
}

/// Renders linear, premultiplied RGBA. Lengths are scaled by a power of two to those of an asset of radius one: the picture is the
/// same for radii from 1e-15 to 1e15, beyond which squares of lengths leave the range of `f32`.
pub(crate) fn render(
    scene: &Scene,
    camera: &Camera,
    lights: &[Light<'_>],
    (width, height): (usize, usize),
    supersample: usize,
    progress: &dyn Progress,
) -> Image {
    let (mut flat, library) = (scene.flatten(), SurfaceLibrary::new(scene));
    let radius = scene.bounding_sphere().map_or(1.0, |(_, radius)| radius);
    let radius = if radius > 0.0 { radius } else { 1.0 };
    let scale = (-radius.log2().round()).clamp(-100.0, 100.0).exp2();
    flat.mesh.positions.iter_mut().for_each(|p| *p *= scale);
    let lights: Vec<Light<'_>> = lights.iter().map(|l| scaled_light(*l, scale)).collect();
    let camera = scaled_camera(camera, scale);
    SceneRenderer::new(&flat, &library).render_with(&camera, &lights, (width, height), supersample, progress)
}

/// The same camera where all lengths are multiplied by `scale`.
fn scaled_camera(c: &Camera, scale: f32) -> Camera {
    let mut view = c.view;
    view.w_axis = (view.w_axis.truncate() * scale).extend(view.w_axis.w);
    Camera { eye: c.eye * scale, view, near: c.near * scale, far: c.far * scale, ..*c }
}

/// The same light where all lengths are multiplied by `scale`.
fn scaled_light(light: Light<'_>, scale: f32) -> Light<'_> {
    match light {
        Light::Point { position, intensity } => {
            Light::Point { position: position * scale, intensity: intensity * scale * scale }
        }
        other => other,
    }
}

/// The camera of the command without options; `None` for a scene without extent.
pub(crate) fn framing(scene: &Scene, aspect: f32) -> Option<Camera> {
    let (center, radius) = scene.bounding_sphere()?;
    Some(Camera::framing(center, radius, AZIMUTH.to_radians(), ELEVATION.to_radians(), FIELD_OF_VIEW, aspect))
}

/// A picture of the whole scene as the command shows it without options, linear and premultiplied.
pub(crate) fn portrait(scene: &Scene, side: usize) -> Option<Image> {
    let (center, radius) = scene.bounding_sphere()?;
    let camera = framing(scene, 1.0)?;
    Some(render(scene, &camera, &point_light(&camera, center, radius), (side, side), 4, &Silent))
}

/// A point light above the camera's left shoulder and a weak constant environment.
pub(crate) fn point_light(camera: &Camera, center: Vec3, radius: f32) -> Vec<Light<'static>> {
    let to_world = camera.view.inverse();
    let direction = to_world.transform_vector3(glam::vec3(-0.5, 0.6, 1.0)).normalize_or_zero();
    let distance = 4.0 * radius;
    let p = center + direction * distance;
    vec![
        Light::Point {
            position: vec3(p.x, p.y, p.z),
            intensity: Vec3f::splat(IRRADIANCE * distance * distance),
        },
        Light::Ambient { radiance: Vec3f::splat(AMBIENT) },
    ]
}

/// A light at the eye that is as bright at the centre as the point light.
pub(crate) fn headlight(camera: &Camera, center: Vec3) -> Vec<Light<'static>> {
    let p = camera.eye;
    let squared = p.distance_squared(center);
    vec![Light::Point { position: vec3(p.x, p.y, p.z), intensity: Vec3f::splat(IRRADIANCE * squared) }]
}

/// Writes linear, premultiplied RGBA: as it is to `.exr`, as sRGB with straight alpha to `.png`.
pub(crate) fn write(path: &Path, picture: &Image) -> Result<()> {
    let exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    if exr {
        photofit_image::write_exr(path, &[("", picture, &["R", "G", "B", "A"])])?;
    } else {
        photofit_image::write_png(path, &straight(picture))?;
    }
    Ok(())
}

/// Straight alpha from premultiplied.
pub(crate) fn straight(picture: &Image) -> Image {
    let mut out = picture.clone();
    for p in out.data.chunks_exact_mut(4) {
        let alpha = p[3];
        if alpha > 0.0 {
            p[..3].iter_mut().for_each(|c| *c /= alpha);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{framing, point_light, render, straight};
    use photofit_fit::Silent;
    use photofit_geometry::shapes::icosphere;
    use photofit_image::Image;
    use photofit_scene::{Instance, Material, Primitive, Scene};

    #[test]
    fn a_picture_does_not_depend_on_the_unit_of_length() {
        let picture = |size: f32| {
            let mut mesh = icosphere(6);
            mesh.positions.iter_mut().for_each(|p| *p *= size);
            let scene = Scene {
                primitives: vec![Primitive { mesh, material: 0 }],
                instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
                materials: vec![Material::clay()],
                ..Scene::default()
            };
            let camera = framing(&scene, 1.0).unwrap();
            let (center, radius) = scene.bounding_sphere().unwrap();
            render(&scene, &camera, &point_light(&camera, center, radius), (32, 32), 2, &Silent)
        };
        let unit = picture(1.0);
        for size in [1e-15, 1e-10, 1e-6, 3e3, 1e10, 1e15] {
            let other = picture(size);
            let differ = |(a, b): (&f32, &f32)| (a - b).abs() > 0.01;
            let differing = unit.data.iter().zip(&other.data).filter(|p| differ(*p)).count();
            // Pixels at the outline may fall to the other side by rounding.
            assert!(differing <= 12, "{size}: {differing} of {} differ", unit.data.len());
        }
    }

    #[test]
    fn alpha_is_divided_out() {
        let image = Image::from_data(2, 1, 4, vec![0.1, 0.2, 0.3, 0.5, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(straight(&image).data, [0.2, 0.4, 0.6, 0.5, 0.0, 0.0, 0.0, 0.0]);
    }
}
