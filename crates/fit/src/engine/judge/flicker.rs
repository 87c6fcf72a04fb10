//! How much pictures change when the camera moves by half a pixel.

use super::{Stage, display};
use crate::FitError;
use crate::engine::light_asset::LightAsset;
use crate::engine::reference::Reference;
use crate::engine::views::{HALF_TANGENT, Lighting, Orbit, Set, Setup, ViewCamera, Views};
use photofit_image::Image;

/// Mean absolute change of display pictures of `size` pixels a side, relative to that of the reference, when the camera moves
/// aside by half a pixel, over `count` views of a report: 1 where a stage, drawn with one sample a pixel, changes as
/// little as the supersampled reference; aliasing changes more.
///
/// # Errors
/// If a picture cannot be made.
///
/// # Panics
/// If there are no views.
pub fn flicker(
    light: &LightAsset,
    reference: &dyn Reference,
    stages: &[Stage],
    lighting: &Lighting,
    (size, count, seed): (usize, u64, u64),
) -> Result<Vec<f64>, FitError> {
    assert!(count > 0, "one view at least");
    let stages: Vec<_> = stages.iter().map(|s| s.drawn(light)).collect();
    let orbit = Orbit::new(seed, lighting, size);
    let (mut own, mut theirs) = (0.0, vec![0.0; stages.len()]);
    for i in 0..count {
        let here = orbit.setup(Set::Report, i, count);
        let there = aside(&here);
        let change =
            |of: &dyn Reference| Ok(difference(&of.picture(&here)?.image, &of.picture(&there)?.image));
        own += change(reference)?;
        for (sum, stage) in theirs.iter_mut().zip(&stages) {
            let of: Result<f64, FitError> = change(&stage.sampled(1));
            *sum += of?;
        }
    }
    Ok(theirs.into_iter().map(|t| t / own.max(1e-12)).collect())
}

/// The view with its camera moved to the right by half a pixel of what lies in its middle.
fn aside(setup: &Setup) -> Setup {
    let mut camera = setup.camera.pinhole();
    let pixel = 2.0 * HALF_TANGENT * camera.eye.length() / setup.width as f32;
    camera.view = glam::Mat4::from_translation(glam::vec3(-0.5 * pixel, 0.0, 0.0)) * camera.view;
    camera.eye = camera.view.inverse().transform_point3(glam::Vec3::ZERO);
    Setup { camera: ViewCamera::Pinhole(camera), ..setup.clone() }
}

/// Mean absolute difference of two linear premultiplied pictures as they are displayed.
fn difference(a: &Image, b: &Image) -> f64 {
    let (a, b) = (display(a), display(b));
    let sum: f64 = a.data.iter().zip(&b.data).map(|(a, b)| f64::from((a - b).abs())).sum();
    sum / a.data.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Normalised;
    use crate::engine::reference::Rasterized;
    use photofit_geometry::shapes;
    use photofit_scene::{Instance, Material, Primitive, Scene};

    #[test]
    fn aliasing_flickers_and_what_is_smooth_does_not() {
        // Vertex colours in stripes that are narrower than a pixel, or none.
        let of = |striped: bool| {
            let mut mesh = shapes::uv_sphere(240, 120);
            let color = |p: &photofit_scalar::Vec3f| {
                let x = if striped { 0.5 + 0.5 * (150.0 * p.y).sin().signum() } else { 0.5 };
                photofit_scalar::vec4(x, x, x, 1.0)
            };
            mesh.colors = mesh.positions.iter().map(color).collect();
            Scene {
                primitives: vec![Primitive { mesh, material: 0 }],
                instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
                materials: vec![Material::clay()],
                ..Scene::default()
            }
        };
        let told = |scene: Scene| {
            let n = Normalised::new(&scene).unwrap();
            let reference = Rasterized::new(&n.flat, &n.library).sampled_by_size(1);
            let stage = [Stage::new("own", scene.clone())];
            flicker(&n.light_asset, &reference, &stage, &Lighting::Point, (32, 4, 0)).unwrap()[0]
        };
        let (smooth, striped) = (told(of(false)), told(of(true)));
        assert!(smooth > 0.8 && smooth < 2.0, "{smooth}");
        assert!(striped > 1.5 * smooth, "{striped} and {smooth}");
    }
}
