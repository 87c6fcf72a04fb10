//! How much two assets look alike: both rendered from shared views, under shared lights, and compared.

use crate::engine::Normalised;
use crate::engine::judge::{ViewQuality, compare};
use crate::scene_render::SceneRenderer;
use crate::simplify::drawn;
use crate::views::{Lighting, Orbit, Set, Views};
use crate::{FitError, Progress};
use photofit_scene::{FlatScene, Scene, SurfaceLibrary};

/// Samples per axis of a pixel.
const SUPERSAMPLE: usize = 4;

/// One view of both assets.
#[derive(Clone, Debug)]
pub struct ComparedView {
    /// PSNR, SSIM and FLIP over the foreground, the FLIP map, and the candidate's picture.
    pub view: ViewQuality,
    /// Root of the mean squared error over the foreground, of sRGB values in [0, 1].
    pub rmse: f64,
}

/// Renders `reference` and `candidate` from the `views` cameras and lights of a report (seed 0, a point light), framed
/// on the reference, as pictures of `resolution` pixels a side, and compares them.
///
/// # Errors
/// A reference without an extent.
pub fn compare_assets(
    reference: &Scene,
    candidate: &Scene,
    views: u64,
    resolution: usize,
    progress: &dyn Progress,
) -> Result<Vec<ComparedView>, FitError> {
    let n = Normalised::new(reference)?;
    let library = SurfaceLibrary::new(&drawn(candidate));
    let mut flat = candidate.flatten();
    for p in &mut flat.mesh.positions {
        *p = (*p - n.center) / n.radius;
    }
    let view = |i| {
        progress.report("compare", i, views, "");
        let s = Orbit::new(0, &Lighting::Point, resolution).setup(Set::Report, i, views);
        let lights = s.lights.lights();
        let render = |flat: &FlatScene, library: &SurfaceLibrary| {
            SceneRenderer::new(flat, library).render(&s.camera, &lights, resolution, resolution, SUPERSAMPLE)
        };
        let (a, b) = (render(&n.flat, &n.library), render(&flat, &library));
        let view = compare(&a, &b);
        // The PSNR of equal pictures is capped.
        let rmse = if a == b { 0.0 } else { 10_f64.powf(-view.quality.psnr / 20.0) };
        ComparedView { view, rmse }
    };
    Ok((0..views).map(view).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;
    use photofit_geometry::shapes::icosphere;
    use photofit_scene::{Instance, Material, Primitive};

    fn sphere(frequency: u32, scale: f32) -> Scene {
        Scene {
            primitives: vec![Primitive { mesh: icosphere(frequency), material: 0 }],
            instances: vec![Instance {
                primitive: 0,
                transform: glam::Affine3A::from_scale(glam::Vec3::splat(scale)),
            }],
            materials: vec![Material::clay()],
            ..Scene::default()
        }
    }

    #[test]
    fn an_asset_equals_itself_and_differs_from_a_smaller_one() {
        let quality = |a: &Scene, b: &Scene| {
            let views = compare_assets(a, b, 2, 48, &Silent).unwrap();
            assert_eq!(views.len(), 2);
            (views[0].view.quality, views[0].rmse)
        };
        let (same, zero) = quality(&sphere(8, 3.0), &sphere(8, 3.0));
        assert_eq!((same.flip, zero), (0.0, 0.0));
        let (near, _) = quality(&sphere(8, 3.0), &sphere(8, 2.97));
        let (far, rmse) = quality(&sphere(8, 3.0), &sphere(8, 2.4));
        assert!(far.psnr < near.psnr && near.psnr < same.psnr, "{far:?} {near:?}");
        assert!(far.flip > near.flip && far.ssim < near.ssim && rmse > 0.01);
        // Of a sphere that is too small the outline is wrong; of one of another colour it is not.
        let mut red = sphere(8, 3.0);
        red.materials[0].base_color = [0.9, 0.1, 0.1, 1.0];
        let (red, _) = quality(&sphere(8, 3.0), &red);
        assert!(same.outline == 0.0 && far.outline > 0.8 && red.outline < 0.01, "{far:?} {red:?}");
    }
}
