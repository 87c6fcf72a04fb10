//! What all rounds of a fit share: the world with its parameters, the light of the start, guides, and the mesh with what was
//! found.

use super::{RecoverMaterialOptions, lit};
use crate::engine::plan::Item;
use crate::engine::traced::{ComparedPixels, Traced, TracedParameter, WHOLE};
use crate::guiding::{Guidance, Guiding, GuidingReport};
use crate::traced_maps::{Map, maps};
use crate::{FitError, Progress};
use photofit_geometry::atlas::dilate;
use photofit_image::Image;
use photofit_pathtrace::{Parameter, PathOptions, RenderOptions, Renderer, View, World};
use photofit_sampling::hash;
use photofit_scene::Scene;

/// Radiance of the environment relative to that of the start, lowest and highest.
const DECADES: [f32; 2] = [1e-3, 1e5];
/// Most views of which a guide learns, and which tell how bright the start is.
const MOST_VIEWS: usize = 8;
/// Samples and seed of the pictures that tell how bright the start is.
const START_SPP: u32 = 4;
/// Tells the numbers of guides from those of pictures.
const GUIDE: u64 = 0x6775_6964;

/// What all rounds share.
pub(super) struct Task<'a> {
    pub(super) blank: &'a Scene,
    pub(super) options: &'a RecoverMaterialOptions,
    /// Columns and rows of the pictures.
    pub(super) size: [usize; 2],
    /// The environment of the start.
    pub(super) environment: Image,
}

impl Task<'_> {
    fn world(&self, environment: &Image) -> Result<World, FitError> {
        lit(self.blank, environment)
    }

    fn rendering(&self) -> RenderOptions {
        let [width, height] = self.size;
        let Self { options: o, .. } = self;
        let path =
            PathOptions { max_depth: o.max_depth, show_environment: o.background, ..PathOptions::default() };
        RenderOptions { width, height, spp: o.spp, seed: o.seed, path, ..RenderOptions::default() }
    }

    /// The environment of the start: the given one, or an even sky under which the blank mesh is as bright as the pictures.
    pub(super) fn sky(&self, views: &[View], pictures: &[Image]) -> Result<Image, FitError> {
        if let Some(given) = &self.options.environment {
            return Ok(given.clone());
        }
        let rows = self.options.environment_size;
        let even = |v: f32| Image::from_fn(2 * rows, rows, 3, |_, _, _| v);
        let world = self.world(&even(1.0))?;
        let (mut given, mut seen, mut covered) = (0.0, 0.0, 0);
        for (view, picture) in views.iter().zip(pictures).take(MOST_VIEWS) {
            let mut renderer =
                Renderer::new(&world, view, RenderOptions { spp: START_SPP, ..self.rendering() })?;
            renderer.finish();
            let drawn = renderer.picture();
            if (drawn.width, drawn.height, 4) != (picture.width, picture.height, picture.channels) {
                // The fit tells which one it is.
                break;
            }
            for (d, p) in drawn.data.chunks_exact(4).zip(picture.data.chunks_exact(4)) {
                if d[3] >= WHOLE && p[3] >= WHOLE {
                    covered += 1;
                    given += p[..3].iter().map(|v| f64::from(v.max(0.0))).sum::<f64>();
                    seen += d[..3].iter().map(|v| f64::from(*v)).sum::<f64>();
                }
            }
        }
        if covered == 0 && !self.options.background {
            let rule = "show the mesh in no pixel whole; transform_matrix must map the camera's frame (y up, looking down -z) \
                        to the world of the mesh, in its units";
            return Err(FitError::Setting { field: "pictures", rule: rule.into() });
        }
        let level = given / seen;
        Ok(even(if level > 0.0 && level.is_finite() { level as f32 } else { 1.0 }))
    }

    /// The world with these values of its parameters, or with those of the start.
    pub(super) fn model(&self, values: Option<&[Vec<f32>]>) -> Result<Traced, FitError> {
        let Self { blank, options: o, environment, .. } = self;
        let world = self.world(environment)?;
        let mut parameters: Vec<TracedParameter> =
            self.maps(&world).iter().map(|m| m.parameter(blank)).collect();
        let fits_environment = !o.keep_environment;
        if fits_environment {
            let mean = environment.data.iter().sum::<f32>() / environment.data.len() as f32;
            let [low, high] = DECADES.map(|d| (d * mean).clamp(f32::MIN_POSITIVE, 1e30));
            parameters.push(TracedParameter {
                name: "environment".into(),
                parameter: Parameter::Environment,
                shape: [1, environment.height, environment.width, 3],
                range: [low, high],
            });
        }
        let mut model = Traced::new(world, self.rendering(), parameters)?;
        model.gradient_spp = o.gradient_spp;
        model.smoothing = o.smoothing;
        if !o.background {
            model.compared = ComparedPixels::Covered;
        }
        if fits_environment {
            model.move_in_logarithms(model.parameters.len() - 1)?;
        }
        for (k, values) in values.unwrap_or_default().iter().enumerate() {
            model.replace(k, values)?;
        }
        Ok(model)
    }

    fn maps(&self, world: &World) -> Vec<Map> {
        maps(self.blank, world)
    }

    /// A guide that learned from paths of what is found so far; none where the user stops it.
    pub(super) fn guidance(
        &self,
        model: &Traced,
        views: &[View],
        round: usize,
        progress: &dyn Progress,
    ) -> Result<Guidance, FitError> {
        let Self { options, .. } = self;
        if options.guiding.guiding == Guiding::Off {
            return Ok(Guidance::off());
        }
        progress.report("guide", 0, 1, "");
        let world = model.world();
        let count = views.len().min(MOST_VIEWS);
        let renderer = |k: usize| {
            let seed = hash(options.seed, GUIDE, (round * MOST_VIEWS + k) as u64);
            Renderer::new(&world, &views[k * views.len() / count], RenderOptions { seed, ..self.rendering() })
        };
        let renderers = (0..count).map(renderer).collect::<Result<Vec<_>, _>>()?;
        Guidance::train_over(&renderers, &options.guiding, || progress.is_cancelled())
    }

    /// The mesh with the maps of a model. Texels that no picture moved get the values of the nearest that one did.
    pub(super) fn asset(&self, model: &Traced) -> Result<Scene, FitError> {
        let start = self.model(None)?;
        let mut scene = self.blank.clone();
        let world = model.world();
        for (k, map) in self.maps(&world).iter().enumerate() {
            let image = &mut scene.images[map.image];
            let mut moved = Vec::new();
            map.write(start.of(k), model.of(k), image, &mut moved);
            let valid: Vec<bool> = moved.iter().map(|m| *m > 0.0).collect();
            let mut texels: Vec<[f32; 4]> = image.texels.iter().map(|t| t.map(f32::from)).collect();
            dilate(&mut texels, &valid, image.width, image.height, None);
            image.texels = texels.iter().map(|t| t.map(|v| v as u8)).collect();
        }
        Ok(scene)
    }

    pub(super) fn found_environment(&self, model: &Traced) -> Result<Image, FitError> {
        let data = model.world().parameter(&Parameter::Environment)?;
        let Image { width, height, .. } = self.environment;
        Ok(Image::from_data(width, height, 3, data))
    }

    pub(super) fn guide_row(&self, guides: &[GuidingReport]) -> Item {
        let why_not = match (self.options.guiding.guiding, guides.last()) {
            (Guiding::Off, _) => "not asked for".into(),
            (_, Some(report)) => report.sentence(),
            (_, None) => "the first round has nothing to learn from".into(),
        };
        let why = guides.last().map(GuidingReport::sentence).unwrap_or_default();
        Item::of("guided paths", guides.iter().any(|g| g.used), why, why_not)
    }
}
