//! A displacement map as a model of the engine, written outside of it: parameters that are neither vertices nor texels of
//! the material, between them and the vertices a stage with its reverse, everything else the engine's.

use photofit_fit::candidate::{Candidate, ParameterGradients, SurfaceClass};
use photofit_fit::engine::Normalised;
use photofit_fit::engine::cpu::{Chain, Cpu};
use photofit_fit::engine::fingerprint::Fingerprint;
use photofit_fit::engine::loss::PictureLoss;
use photofit_fit::engine::model::{Group, ModelError};
use photofit_fit::engine::plan::{FitRequest, SurfacePlan};
use photofit_fit::engine::reference::{Rasterized, ReferenceKind};
use photofit_fit::engine::surface::Surface;
use photofit_fit::engine::trainer::{Batch, Checkpointing, HeldOut, Job, Phase, train};
use photofit_fit::views::{Lighting, Orbit, Sampling, Shot};
use photofit_fit::{FitError, Silent};
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Mesh, shapes};
use photofit_optim::{Optimizer, Temporal};
use photofit_raster::deferred::Masks;
use photofit_raster::loss::Loss;
use photofit_raster::texture::{Filter, Level, Sampler, Taps, Wrap, taps};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{Instance, Material, Primitive, Scene};

/// Columns and rows of the displacement map.
const TEXELS: [u32; 2] = [16, 8];
/// Name of its group.
const HEIGHTS: &str = "heights";
const STEPS: u64 = 120;

/// A surface whose welded vertices stand above a shape at rest, as high as the map says at their coordinates.
struct Displaced {
    surface: Surface,
    rest: Vec<Vec3f>,
    /// By which a vertex moves where the map is 1.
    directions: Vec<Vec3f>,
    taps: Vec<Taps<f32>>,
    heights: Vec<f32>,
}

impl Displaced {
    /// Puts the vertices where the map says.
    fn displace(&mut self) {
        let Self { surface, rest, directions, taps, heights } = self;
        for (i, p) in surface.candidate.positions.iter_mut().enumerate() {
            let [height] = taps[i].blend(|t| [heights[t]]);
            *p = rest[i] + directions[i] * height;
        }
    }

    /// Gradients of the map from those of the vertices: adjoint of [`Self::displace`].
    fn displace_vjp(&self, positions: &[Vec3f], heights: &mut [f32]) {
        heights.fill(0.0);
        for ((taps, direction), g) in self.taps.iter().zip(&self.directions).zip(positions) {
            for (t, w) in taps.index.iter().zip(taps.weights()) {
                heights[*t as usize] += w * direction.dot(*g);
            }
        }
    }
}

impl Chain for Displaced {
    type Gradients = (Vec<f32>, ParameterGradients);

    fn groups(&self) -> Vec<Group> {
        let mut groups = self.surface.groups();
        let rows = self.heights.len();
        let (ranges, rates) = (vec![[-0.5, 0.5]], Vec::new());
        groups[0] = Group { name: HEIGHTS.into(), rows, columns: 1, ranges, unit: None, rates };
        groups
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        if group.name != HEIGHTS {
            return self.surface.optimizer(group);
        }
        Optimizer::new(HEIGHTS, group.len(), Temporal::adam()).map_err(FitError::Preconditioner)
    }

    fn step_masks(&mut self, masks: Masks) {
        self.surface.step_masks(masks);
    }

    fn values(&self, group: usize) -> &[f32] {
        if group == 0 { &self.heights } else { self.surface.values(group) }
    }

    fn values_mut(&mut self, group: usize) -> &mut [f32] {
        if group == 0 { &mut self.heights } else { self.surface.values_mut(group) }
    }

    fn changed(&mut self, group: usize) -> Result<(), ModelError> {
        if group == 0 {
            self.displace();
        }
        self.surface.changed(group)
    }

    fn gradients(&self) -> Self::Gradients {
        (vec![0.0; self.heights.len()], self.surface.gradients())
    }

    fn moved<'a>(&'a mut self, g: &'a Self::Gradients, group: usize) -> (&'a mut [f32], &'a [f32]) {
        if group == 0 { (&mut self.heights, &g.0) } else { self.surface.moved(&g.1, group) }
    }

    fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        moving: &[bool],
        g: &mut Self::Gradients,
    ) -> Result<f64, ModelError> {
        let value = self.surface.step(shots, loss, moving, &mut g.1)?;
        if moving[0] {
            self.displace_vjp(&g.1.positions, &mut g.0);
        }
        Ok(value)
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        self.surface.pictures(shots)
    }
}

/// Radius of the asset in a direction.
fn radius(d: Vec3f) -> f32 {
    1.0 + 0.12 * (3.0 * d.x).sin() * (2.0 * d.z).cos() + 0.08 * (4.0 * d.y).sin()
}

/// A fine sphere with these bumps.
fn bumpy() -> Scene {
    let mut mesh = shapes::uv_sphere(96, 48);
    mesh.positions.iter_mut().for_each(|p| *p = *p * radius(*p));
    mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    Scene {
        primitives: vec![Primitive { mesh, material: 0 }],
        materials: vec![Material::clay()],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        ..Scene::default()
    }
}

/// A coarse sphere of clay under a flat map, in the frame of the asset.
fn flat_map(n: &Normalised) -> Displaced {
    let sphere = shapes::uv_sphere(32, 16);
    let frame = n.frame();
    let mesh =
        Mesh { positions: sphere.positions.iter().map(|p| frame.to_frame(*p)).collect(), ..sphere.clone() };
    let weld = weld_exact(&mesh.positions);
    let mut texel = [0.0; CHANNELS];
    let clay = Material::clay();
    texel[..4].copy_from_slice(&clay.base_color);
    texel[channel::ROUGHNESS] = clay.roughness;
    texel[channel::NORMAL + 2] = 1.0;
    let class = vec![0; mesh.triangles.len()];
    let classes = vec![SurfaceClass::default()];
    let candidate = Candidate::new(&mesh, &weld, class, classes, Maps::filled(8, 8, texel));

    let sampler = Sampler { wrap_u: Wrap::Repeat, wrap_v: Wrap::ClampToEdge, filter: Filter::Bilinear };
    let level = Level { offset: 0, width: TEXELS[0], height: TEXELS[1] };
    let first = weld.pick(&(0..mesh.positions.len()).collect::<Vec<usize>>());
    let up = |v: &usize| frame.to_frame(sphere.positions[*v] * 2.0) - frame.to_frame(sphere.positions[*v]);
    let asked = FitRequest { steps: STEPS, moves: true, reference: ReferenceKind::RASTERIZED };
    Displaced {
        rest: candidate.positions.clone(),
        directions: first.iter().map(up).collect(),
        taps: first.iter().map(|v| taps(sphere.uvs[*v], level, &sampler)).collect(),
        heights: vec![0.0; (TEXELS[0] * TEXELS[1]) as usize],
        surface: Surface::new(candidate.clone(), &SurfacePlan::new(&candidate, asked)).moving(true),
    }
}

/// Root mean square of the difference of radii between vertices and asset.
fn error(model: &Displaced, n: &Normalised) -> f64 {
    let of = |p: &Vec3f| {
        let p = n.frame().to_world(*p);
        f64::from(p.length() - radius(p * (1.0 / p.length()))).powi(2)
    };
    let all = &model.surface.candidate.positions;
    (all.iter().map(of).sum::<f64>() / all.len() as f64).sqrt()
}

#[test]
fn a_displacement_map_joins_the_engine_from_outside() -> Result<(), FitError> {
    let scene = bumpy();
    let n = Normalised::new(&scene)?;
    let reference = Rasterized::new(&n.flat, &n.library);
    let model = flat_map(&n);
    let start = error(&model, &n);
    let views = Orbit::new(0, &Lighting::Mixed, 64);
    let held_out = HeldOut::new(&reference, &views, Sampling::SUPERSAMPLED, 4, 0)?;
    let job = Job {
        reference: &reference,
        views: &views,
        held_out: &held_out,
        sampling: Sampling::SUPERSAMPLED,
        loss: PictureLoss::from(Loss::LogSrgbL1),
        seed: 0,
        batch: Batch::new(2, 1),
        steps: STEPS,
        rival: None,
        checkpointing: &Checkpointing::default(),
        fingerprint: Fingerprint::default(),
    };
    let phases = |_| {
        let rates = vec![(HEIGHTS.into(), 0.01)];
        vec![Phase {
            name: "heights",
            first: 0,
            steps: STEPS,
            shrink: 1,
            rates,
            fade: None,
            reinitialised: None,
        }]
    };
    let trained = train(Cpu::new(model)?, &job, phases, &Silent)?;
    let end = error(&trained.model, &n);
    println!("distance of radii: {start:.4} became {end:.4}");
    assert!(start > 0.06 && end < 0.3 * start, "{start} became {end}");
    Ok(())
}

#[test]
fn the_stage_and_its_reverse_are_adjoint() -> Result<(), FitError> {
    let scene = bumpy();
    let n = Normalised::new(&scene)?;
    let mut model = flat_map(&n);
    let wave = |i: usize, f: f32| (f * i as f32).sin();
    let d: Vec<Vec3f> =
        (0..model.rest.len()).map(|i| vec3(wave(i, 0.7), wave(i, 1.3), wave(i, 2.1))).collect();
    let mut g = vec![f32::NAN; model.heights.len()];
    model.displace_vjp(&d, &mut g);
    model.heights = (0..model.heights.len()).map(|i| wave(i, 0.37)).collect();
    let reverse: f64 = g.iter().zip(&model.heights).map(|(g, h)| f64::from(g * h)).sum();
    model.displace();
    let moved = model.surface.candidate.positions.iter().zip(&model.rest).map(|(p, r)| *p - *r);
    let forward: f64 = moved.zip(&d).map(|(m, d)| f64::from(m.dot(*d))).sum();
    assert!((forward - reverse).abs() < 1e-5 * forward.abs().max(1.0), "{forward} and {reverse}");
    Ok(())
}
