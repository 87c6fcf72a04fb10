//! How much two assets look alike: both rendered from shared views, under shared lights, and compared.

use crate::engine::Normalised;
use crate::engine::judge::{Judge, JudgeRenderer, Judged, Stage, ViewQuality};
use crate::engine::reference::{Rasterized, SAMPLES, SUPERSAMPLE};
use crate::views::Lighting;
use crate::{FitError, Progress};
use photofit_scene::Scene;

/// Two assets compared.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// PSNR, SSIM, FLIP and RMSE over the foreground of each view, the FLIP map, and the candidate's picture.
    pub views: Vec<ViewQuality>,
    /// How their pictures were made.
    pub method: Judged,
    /// Why so.
    pub reason: String,
}

/// Renders `reference` and `candidate` from the `views` cameras and lights of a report (seed 0, a point light), framed
/// on the reference, as pictures of `resolution` pixels a side, and compares them. `renderer` draws both, those that are path
/// traced at most 256 pixels wide.
///
/// # Errors
/// A reference without an extent, or what the path tracer refuses.
pub fn compare_assets(
    reference: &Scene,
    candidate: &Scene,
    views: u64,
    resolution: usize,
    renderer: JudgeRenderer,
    progress: &dyn Progress,
) -> Result<Comparison, FitError> {
    let n = Normalised::new(reference)?;
    let _told = n.not_finite.told_at_the_end(progress);
    let judge = Judge {
        scene: reference,
        n: &n,
        reference: &Rasterized::new(&n.flat, &n.library),
        renderer,
        spp: SAMPLES,
        lighting: &Lighting::Point,
        size: resolution,
        samples: [SUPERSAMPLE; 2],
        seed: 0,
    };
    let stages = [Stage::new("candidate", candidate.clone())];
    let (method, reason) = judge.method_and_reason(&stages);
    let judged = judge.views(&stages, views, progress)?;
    let views = judged.into_iter().flat_map(|v| v.quality);
    Ok(Comparison { views: views.collect(), method, reason })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;
    use crate::progress::Heard;
    use photofit_geometry::shapes::icosphere;
    use photofit_scene::{Clearcoat, Extensions, Instance, Material, Primitive};

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
            let compared = compare_assets(a, b, 2, 48, JudgeRenderer::Auto, &Silent).unwrap();
            assert_eq!((compared.views.len(), compared.method), (2, Judged::Rasterized));
            (compared.views[0].quality, compared.views[0].rmse)
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

    #[test]
    fn a_coat_of_the_candidate_alone_is_seen() {
        let plain = sphere(8, 3.0);
        let mut coated = plain.clone();
        let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
        coated.materials[0].extensions =
            Some(Box::new(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
        for (a, b) in [(&plain, &coated), (&coated, &plain)] {
            let compared = compare_assets(a, b, 2, 48, JudgeRenderer::Auto, &Silent).unwrap();
            assert_eq!(compared.method, Judged::PathTraced);
            let psnr = compared.views[0].quality.psnr;
            assert!(psnr < 40.0 && compared.views[0].rmse > 0.01, "{psnr}");
        }
        // As asked, without the coat: the two are one; and a plain one is path traced.
        let asked = |a: &Scene, b: &Scene, renderer| compare_assets(a, b, 1, 48, renderer, &Silent).unwrap();
        let raster = asked(&plain, &coated, JudgeRenderer::Raster);
        assert_eq!((raster.method, raster.views[0].rmse.to_bits()), (Judged::Rasterized, 0));
        let path = asked(&plain, &sphere(8, 2.4), JudgeRenderer::Path);
        assert!(path.method == Judged::PathTraced && path.views[0].rmse > 0.01);
        let same = compare_assets(&coated, &coated, 1, 48, JudgeRenderer::Auto, &Silent).unwrap();
        // Noise of other samples is no error, as far as it can be told.
        assert!(same.views[0].rmse < 0.002, "{}", same.views[0].rmse);
    }

    #[test]
    fn light_that_is_no_number_is_told_once() {
        let mut shining = sphere(8, 1.0);
        let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
        let m = &mut shining.materials[0];
        m.extensions = Some(Box::new(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
        let beside = glam::Affine3A::from_translation(glam::Vec3::X * 2.1);
        shining.instances.push(Instance { primitive: 0, transform: beside });
        // Each lights the other, more than numbers can hold.
        let mut glaring = shining.clone();
        glaring.materials[0].emissive = [3e38; 3];
        let told = |asset: &Scene| {
            let heard = Heard::default();
            compare_assets(asset, asset, 2, 32, JudgeRenderer::Auto, &heard).unwrap();
            heard.0.into_inner().unwrap()
        };
        assert_eq!(told(&shining), [""; 0]);
        let told = told(&glaring);
        assert!(told.len() == 1 && told[0].contains("contributions were not finite"), "{told:?}");
    }
}
