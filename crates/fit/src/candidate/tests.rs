//! The whole step in f64 against central differences. Here: the candidate of these tests, and what is moved of it.

mod alpha;
mod modes;
mod shots;
mod whole;

use super::*;
use crate::engine::views::Sampling;
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::shapes;
use photofit_geometry::skinning::{Affine, Deformation};
use photofit_gradcheck::Uniform;
use photofit_raster::channel;
use photofit_raster::deferred::Masks;
use photofit_raster::loss::Loss;
use photofit_raster::project::Matrix4;
use photofit_scalar::vec2;
use photofit_scene::Camera;
use photofit_shading::{Environment, Light, Yaw};

/// Columns and rows of a picture.
const SIZE: usize = 24;
/// Samples per axis of a pixel, as in the fit.
const SAMPLES: usize = 2;
/// Texels per side of the maps.
const TEXELS: usize = 64;
/// Added to the mip level, so that small pictures read several.
const LOD_BIAS: f64 = 2.5;
/// Step of the differences.
const STEP: f64 = 1e-6;
/// Step of the differences of positions: small against the distances between samples and edges.
const POSITION_STEP: f64 = 1e-8;
/// Random directions in which a group of parameters is moved.
const DIRECTIONS: usize = 12;

/// What of the maps a texel starts with.
#[derive(Clone, Copy, PartialEq)]
enum Content {
    /// Every sample of every texel at random.
    Random,
    /// Linear in uv. Its levels are the same, and the mip level, which passes no gradient to positions, changes nothing.
    Linear,
}

/// What the three classes of triangles are.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// An opaque body, blended sheets and a sheet with a mask.
    Transparent,
    /// All opaque, of one side and of both.
    Opaque,
}

/// A candidate of three classes in front of two cameras with every kind of light.
struct Setting {
    candidate: Candidate<f64>,
    environment: Environment<f64>,
    backgrounds: Vec<Vec<[f64; 3]>>,
    references: Vec<Vec<[f64; 4]>>,
    weights: Vec<Vec<[f64; 4]>>,
    passes: Passes,
    sampling: Sampling,
    lod_bias: f64,
    /// Lights fall on the surfaces, which show their emission alone without.
    lit: bool,
    /// The pictures show vertices of a pose, which are given.
    posed: bool,
    /// What the stages of each picture do, one after the other.
    poses: [Vec<Deformation<f64>>; 2],
}

/// A pose of a skin with two joints and a morph target: the vertices turn about y, the more the higher they are, and are
/// stretched; a bulge with normals of its own is added before.
fn pose(positions: &[Vec3<f64>], angle: f64) -> Deformation<f64> {
    let joint = |angle: f64, stretch: f64| {
        let (s, c) = angle.sin_cos();
        let axes = [vec3(c, 0.05, -s), vec3(0.1, stretch, 0.0), vec3(s, 0.0, c)];
        Affine { axes, translation: vec3(0.1 * s, -0.03, 0.05) }
    };
    let joints = [joint(0.2 * angle, 1.0), joint(angle, 0.9)];
    let blended = |p: &Vec3<f64>| {
        let w = (0.5 + 0.4 * p.y).clamp(0.0, 1.0);
        let mean = |a: Vec3<f64>, b: Vec3<f64>| a * (1.0 - w) + b * w;
        let axes = std::array::from_fn(|k| mean(joints[0].axes[k], joints[1].axes[k]));
        Affine { axes, translation: mean(joints[0].translation, joints[1].translation) }
    };
    let bulge = |p: &Vec3<f64>| vec3(0.03 * (2.0 * p.y).sin(), 0.02 * p.x, 0.04 * p.x * p.y);
    let turned = |p: &Vec3<f64>| vec3(0.05 * p.y, -0.04 * p.x, 0.03);
    Deformation {
        positions: positions.iter().map(bulge).collect(),
        normals: positions.iter().map(turned).collect(),
        moves: positions.iter().map(blended).collect(),
    }
}

/// What is made of the pixels.
#[derive(Clone, Copy)]
enum Value {
    /// Their sum, weighted at random: a seed gradient that knows no loss.
    Weighted,
    /// The loss of the fit.
    Loss(PictureLoss),
}

/// Two blended sheets and a masked one in front of an opaque body.
fn mesh() -> (Mesh, Vec<u32>) {
    let (mut mesh, mut class) = (Mesh::default(), Vec::new());
    let mut add = |part: Mesh, of: u32, place: &dyn Fn(Vec3<f32>) -> Vec3<f32>| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(part.positions.iter().map(|p| place(*p)));
        mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
        class.extend(part.triangles.iter().map(|_| of));
    };
    add(shapes::displaced_sphere(3, 0.15, 3, 5), 0, &|p| p * 0.75);
    let sheet = |x: f32, y: f32, z: f32| {
        move |p: Vec3<f32>| {
            vec3(0.55 * p.x + x, 0.5 * p.y + 0.1 * p.x + y, z + 0.13 * p.x - 0.09 * p.y + 0.05 * p.x * p.y)
        }
    };
    add(shapes::quad_grid(3, 3), 1, &sheet(0.23, 0.31, 0.93));
    add(shapes::quad_grid(3, 3), 1, &sheet(-0.17, 0.19, 1.21));
    add(shapes::quad_grid(3, 3), 2, &sheet(0.09, -0.43, 1.07));
    let options = UnwrapOptions { size: 256, ..UnwrapOptions::default() };
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &options).unwrap();
    let (mut mesh, _) = atlas.build_mesh(&mesh.positions, &mesh.triangles);
    // Away from the border, where the outermost texels go on.
    mesh.uvs.iter_mut().for_each(|uv| *uv = *uv * 0.7 + vec2(0.15, 0.15));
    (mesh, class)
}

fn maps(content: Content, rng: &mut Uniform) -> Maps<f64> {
    let ranges: [[f64; 2]; CHANNELS] = {
        let mut r = [[0.2, 0.8]; CHANNELS];
        r[channel::ROUGHNESS] = [0.35, 0.8];
        r[channel::NORMAL] = [-0.3, 0.3];
        r[channel::NORMAL + 1] = [-0.3, 0.3];
        r[channel::NORMAL + 2] = [0.8, 0.95];
        r
    };
    let mut slopes = ranges.map(|[lo, hi]| [0, 1].map(|_| rng.range(-0.4, 0.4) * (hi - lo)));
    // Alpha weighs the colours of coarse levels: only where it is constant are their means linear too.
    slopes[channel::ALPHA] = [0.0; 2];
    let texel = |i: usize| {
        let at = [i % TEXELS, i / TEXELS].map(|x| (x as f64 + 0.5) / TEXELS as f64 - 0.5);
        std::array::from_fn(|c| {
            let [lo, hi] = ranges[c];
            match content {
                Content::Random => rng.range(lo, hi),
                Content::Linear => 0.5 * (lo + hi) + slopes[c][0] * at[0] + slopes[c][1] * at[1],
            }
        })
    };
    Maps { width: TEXELS, height: TEXELS, texels: (0..TEXELS * TEXELS).map(texel).collect() }
}

impl Setting {
    fn new(kind: Kind, content: Content, seed: u64) -> Self {
        let mut rng = Uniform::new(seed);
        let (mesh, class) = mesh();
        let smoothing = weld_exact(&mesh.positions);
        let alpha = match kind {
            Kind::Transparent => [AlphaMode::Opaque, AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.5 }],
            Kind::Opaque => [AlphaMode::Opaque; 3],
        };
        let sides = [Sides::Front, Sides::Both, Sides::Both];
        let classes = alpha
            .into_iter()
            .zip(sides)
            .map(|(alpha, sides)| SurfaceClass {
                alpha,
                sides,
                opposed: alpha == AlphaMode::Blend,
                see_through: false,
            })
            .collect();
        let mut candidate = Candidate::new(&mesh, &smoothing, class, classes, maps(content, &mut rng));
        let ships = if kind == Kind::Transparent { MipAdjoint::Exact } else { MipAdjoint::Smooth };
        assert_eq!(candidate.mip_adjoint, ships);
        // What ships for opaque ones is the gradient of no function.
        candidate.mip_adjoint = MipAdjoint::Exact;
        if content == Content::Linear {
            // The coarsest levels are not linear in uv where the mesh reads them, next to their borders.
            candidate.maps.levels.truncate(5);
        }
        for p in &mut candidate.positions {
            *p += vec3(rng.range(-0.01, 0.01), rng.range(-0.01, 0.01), rng.range(-0.01, 0.01));
        }
        let sky: Vec<f32> = (0..16 * 8 * 3).map(|_| rng.range(0.1, 0.9) as f32).collect();
        let environment = Environment::from_equirectangular(16, 8, &sky).unwrap().cast();
        let mut pixels = |_: usize| {
            (0..SIZE * SIZE).map(|_| std::array::from_fn(|_| rng.range(0.0, 1.0))).collect::<Vec<[f64; 4]>>()
        };
        let references: Vec<Vec<[f64; 4]>> = (0..2).map(&mut pixels).collect();
        let noise: Vec<Vec<[f64; 4]>> = (0..4).map(&mut pixels).collect();
        let backgrounds = noise[..2].iter().map(|b| b.iter().map(|b| [b[0], b[1], b[2]]).collect()).collect();
        let weights =
            noise[2..].iter().map(|w| w.iter().map(|w| w.map(|w| 2.0 * w - 1.0)).collect()).collect();
        let transparent = kind == Kind::Transparent;
        let passes = Passes {
            alpha_gradients: transparent,
            max_layers: if transparent { Passes::default().max_layers } else { 1 },
            ..Passes::default()
        };
        let sampling = Sampling { per_axis: SAMPLES, shade_per_pixel: false };
        Self {
            candidate,
            environment,
            backgrounds,
            references,
            weights,
            passes,
            sampling,
            lod_bias: LOD_BIAS,
            lit: true,
            posed: false,
            poses: [Vec::new(), Vec::new()],
        }
    }

    /// Lets each picture show a pose of its own: the shape is taken to its bind pose, and from there on.
    fn bend(&mut self) {
        let positions = self.candidate.vertices().positions;
        let rest = pose(&positions, 0.1).moves;
        let moves = rest.iter().map(|m| m.inverse().unwrap()).collect();
        let to_bind = Deformation { moves, ..Deformation::default() };
        let bind = to_bind.positions(&positions);
        self.poses = [0.35, -0.25].map(|angle| vec![to_bind.clone(), pose(&bind, angle)]);
    }

    /// Camera and lights of picture `i`.
    fn lights(&self, i: usize) -> (Matrix4<f64>, Vec3<f64>, Vec<Light<'_, f64>>) {
        let eye = [glam::vec3(0.35, 0.4, 3.6), glam::vec3(-0.6, 0.3, 3.4)][i];
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.62, 1.0, 0.1, 10.0);
        let mut lights = vec![Light::Ambient { radiance: vec3(0.2, 0.25, 0.3) }];
        if i == 0 {
            lights.push(Light::Point { position: vec3(1.0, 1.5, 4.0), intensity: vec3(30.0, 28.0, 25.0) });
            let direction = vec3(-0.6, 0.3, 0.74).normalize_or_zero();
            lights.push(Light::Directional { direction, irradiance: vec3(1.0, 1.1, 1.3) });
        } else {
            lights.push(Light::Environment { map: &self.environment, rotation: Yaw::new(0.7), scale: 0.8 });
        }
        lights.retain(|_| self.lit);
        let [x, y, z] = eye.to_array().map(f64::from);
        (matrix_rows(&camera.view_projection()), vec3(x, y, z), lights)
    }

    /// Runs `f` with both pictures.
    fn with<R>(&self, f: impl FnOnce([CandidateView<'_, f64>; 2]) -> R) -> R {
        let views = [0, 1].map(|i| self.lights(i));
        let posed = self.posed.then(|| {
            let v = self.candidate.vertices();
            let bend = |p: &Vec3<f64>| vec3(p.x + 0.1 * p.y * p.y, p.y - 0.07 * p.x, p.z + 0.05 * p.x);
            let positions = v.positions.iter().map(bend).collect();
            self.candidate.vertices_of(OrientedPoints { positions, normals: v.normals })
        });
        let list = self.poses.each_ref().map(|p| p.iter());
        let stages: [Vec<_>; 2] = list.map(|p| p.map(|d| d as &dyn VertexStage<f64>).collect());
        let picture = |i: usize| {
            let (view_projection, eye, lights) = &views[i];
            let view = View {
                view_projection: *view_projection,
                eye: *eye,
                lights,
                width: SIZE * self.sampling.per_axis,
                height: SIZE * self.sampling.per_axis,
                samples: self.sampling.per_axis,
                shade_per_pixel: self.sampling.shade_per_pixel,
                lod_bias: self.lod_bias,
            };
            let background = &self.backgrounds[i][..];
            let vertices = posed.as_ref().map_or(VertexSource::Stages(&stages[i]), VertexSource::Given);
            // The second camera sees backs, too.
            CandidateView { view, background, vertices, backs: i == 1 }
        };
        f([0, 1].map(picture))
    }

    /// Value of the pixels of picture `i`, and its gradient.
    fn value(&self, value: Value, i: usize, pixels: &[[f64; 4]], g: &mut [[f64; 4]]) -> f64 {
        match value {
            Value::Loss(loss) => loss.value_and_gradient((SIZE, SIZE), pixels, &self.references[i], 0.5, g),
            Value::Weighted => {
                g.copy_from_slice(&self.weights[i]);
                pixels.as_flattened().iter().zip(self.weights[i].as_flattened()).map(|(x, w)| x * w).sum()
            }
        }
    }

    fn gradients(&self, value: Value) -> ParameterGradients<f64> {
        let mut out = self.candidate.gradients();
        let value = |i: usize, p: &[[f64; 4]], g: &mut [[f64; 4]]| self.value(value, i, p, g);
        self.with(|p| self.candidate.pull_back(p, value, &self.passes, &mut out));
        out
    }

    /// The value alone, and which triangles the layers of both pictures show.
    fn evaluate(&self, value: Value) -> (f64, Vec<Vec<u32>>) {
        let (mut sum, mut seen, mut g) = (0.0, Vec::new(), vec![[0.0; 4]; SIZE * SIZE]);
        self.with(|pictures| {
            for (i, p) in pictures.iter().enumerate() {
                let vertices = match p.vertices {
                    VertexSource::Given(v) => v.clone(),
                    VertexSource::Stages(stages) => self.candidate.vertices_through(stages),
                };
                let frame = self.candidate.draw(&vertices, p, &self.passes);
                sum += self.value(value, i, &frame.color, &mut g);
                seen.extend(frame.layers.into_iter().map(|l| l.visibility.triangle));
            }
        });
        (sum, seen)
    }

    /// Relative error of directional derivatives over random directions that `place` adds, times a step, to the
    /// candidate: norm of the differences over the norm of the truth. `along` multiplies the gradient by a direction.
    fn error(
        &mut self,
        value: Value,
        (count, step): (usize, f64),
        place: impl Fn(&mut Candidate<f64>, &[f64], f64),
        along: impl Fn(&ParameterGradients<f64>, &[f64]) -> f64,
    ) -> f64 {
        let g = self.gradients(value);
        let start = self.candidate.clone();
        let mut rng = Uniform::new(77);
        let (mut wrong, mut truth) = (0.0, 0.0);
        for _ in 0..DIRECTIONS {
            let direction = rng.vec(count, -1.0, 1.0);
            let [plus, minus] = [step, -step].map(|step| {
                self.candidate.clone_from(&start);
                place(&mut self.candidate, &direction, step);
                self.evaluate(value)
            });
            assert!(plus.1 == minus.1, "the scene is tuned away from ties: nothing appears within the step");
            let difference = (plus.0 - minus.0) / (2.0 * step);
            wrong += (difference - along(&g, &direction)).powi(2);
            truth += difference * difference;
        }
        self.candidate = start;
        (wrong / truth).sqrt()
    }

    /// [`Self::error`] of one sample of every texel.
    fn channel_error(&mut self, value: Value, c: usize) -> f64 {
        // Alpha of opaque texels is no parameter, nor that of masks that are cut.
        let cut = self.passes.masks == Masks::Cut;
        // Every level whose texels are parameters.
        let levels = self.candidate.fitted_levels();
        let texels = |k: usize| self.candidate.maps.levels[k].texels.len();
        let count: usize = (0..levels).map(texels).sum();
        let fixed: Vec<bool> = (0..levels)
            .flat_map(|k| (0..texels(k)).map(move |i| (k, i)))
            .map(|(k, i)| {
                let [solid, masked] = self.candidate.held(k);
                let of = |held: &[bool]| held.get(i) == Some(&true);
                c == channel::ALPHA && (of(solid) || (cut && of(masked)))
            })
            .collect();
        let place = |candidate: &mut Candidate<f64>, d: &[f64], step: f64| {
            let texels = candidate.maps.levels.iter_mut().take(levels).flat_map(|l| &mut l.texels);
            for ((t, d), fixed) in texels.zip(d).zip(&fixed) {
                t[c] += if *fixed { 0.0 } else { d * step };
            }
            candidate.maps.rebuild();
        };
        self.error(value, (count, STEP), place, |g, d| {
            let texels = g.rendered.maps.levels.iter().take(levels).flat_map(|l| &l.texels);
            texels.zip(d).map(|(g, d)| g[c] * d).sum()
        })
    }

    /// [`Self::error`] of the positions.
    fn position_error(&mut self, value: Value) -> f64 {
        let place = |candidate: &mut Candidate<f64>, d: &[f64], step: f64| {
            let moved = candidate.positions.iter_mut().zip(d.as_chunks::<3>().0);
            moved.for_each(|(p, d)| *p += vec3(d[0], d[1], d[2]) * step);
        };
        let count = 3 * self.candidate.positions.len();
        self.error(value, (count, POSITION_STEP), place, |g, d| {
            g.positions.iter().zip(d.as_chunks::<3>().0).map(|(g, d)| g.dot(vec3(d[0], d[1], d[2]))).sum()
        })
    }
}

/// The groups of a texel's samples.
const GROUPS: [(&str, std::ops::Range<usize>); 7] = [
    ("base colour", channel::BASE_COLOR..channel::ALPHA),
    ("alpha", channel::ALPHA..channel::SPECULAR_SUPPRESSION),
    ("specular suppression", channel::SPECULAR_SUPPRESSION..channel::ROUGHNESS),
    ("roughness", channel::ROUGHNESS..channel::METALLIC),
    ("metalness", channel::METALLIC..channel::NORMAL),
    ("normal", channel::NORMAL..channel::EMISSIVE),
    ("emission", channel::EMISSIVE..channel::USED),
];
