//! The whole step in f64 against central differences: several samples per pixel, live mip chains with their exact
//! adjoint (which ships where something is transparent), peeled blended layers, a faded mask (the fit cuts masks), silhouettes, every sample of a texel, random seed gradients and the loss of the product. Then the other modes that
//! ship: pixels that are shaded once for each triangle, as for levels of detail; masks that are cut; the squared error, of noisy pictures.

use super::*;
use crate::engine::views::Sampling;
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::shapes;
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
    fn new(content: Content, seed: u64) -> Self {
        let mut rng = Uniform::new(seed);
        let (mesh, class) = mesh();
        let smoothing = weld_exact(&mesh.positions);
        let classes = [
            (AlphaMode::Opaque, Sides::Front),
            (AlphaMode::Blend, Sides::Both),
            (AlphaMode::Mask { cutoff: 0.5 }, Sides::Both),
        ]
        .map(|(alpha, sides)| SurfaceClass { alpha, sides })
        .to_vec();
        let mut candidate = Candidate::new(&mesh, &smoothing, class, classes, maps(content, &mut rng));
        candidate.mip_adjoint = MipAdjoint::Exact;
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
        let passes = Passes { masks: Masks::Faded { slope: 2.0 }, ..Passes::default() };
        let sampling = Sampling { per_axis: SAMPLES, shade_per_pixel: false };
        Self { candidate, environment, backgrounds, references, weights, passes, sampling, lod_bias: 0.0 }
    }

    /// Camera and lights of picture `i`.
    fn lights(&self, i: usize) -> (Matrix4<f64>, Vec3<f64>, Vec<Light<'_, f64>>) {
        let eye = [glam::vec3(0.35, 0.4, 3.6), glam::vec3(-0.6, 0.3, 3.4)][i];
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.62, 1.0, 0.1, 10.0);
        let mut lights = vec![Light::Ambient { radiance: vec3(0.2, 0.25, 0.3) }];
        lights.push(if i == 0 {
            Light::Point { position: vec3(1.0, 1.5, 4.0), intensity: vec3(30.0, 28.0, 25.0) }
        } else {
            Light::Environment { map: &self.environment, rotation: Yaw::new(0.7), scale: 0.8 }
        });
        let [x, y, z] = eye.to_array().map(f64::from);
        (matrix_rows(&camera.view_projection()), vec3(x, y, z), lights)
    }

    /// Runs `f` with both pictures.
    fn with<R>(&self, f: impl FnOnce([Picture<'_, f64>; 2]) -> R) -> R {
        let views = [0, 1].map(|i| self.lights(i));
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
            Picture { view, background: &self.backgrounds[i], vertices: None }
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
        let vertices = self.candidate.vertices();
        let (mut sum, mut seen, mut g) = (0.0, Vec::new(), vec![[0.0; 4]; SIZE * SIZE]);
        self.with(|pictures| {
            for (i, p) in pictures.iter().enumerate() {
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
        let fixed: Vec<bool> = match c == channel::ALPHA {
            false => Vec::new(),
            true => (0..TEXELS * TEXELS)
                .map(|i| {
                    let of = |held: &[bool]| held.get(i) == Some(&true);
                    of(&self.candidate.solid) || (cut && of(&self.candidate.masked))
                })
                .collect(),
        };
        let place = |candidate: &mut Candidate<f64>, d: &[f64], step: f64| {
            let texels = &mut candidate.maps.levels[0].texels;
            for (i, (t, d)) in texels.iter_mut().zip(d).enumerate() {
                t[c] += if fixed.get(i) == Some(&true) { 0.0 } else { d * step };
            }
            candidate.maps.rebuild();
        };
        self.error(value, (TEXELS * TEXELS, STEP), place, |g, d| {
            g.rendered.maps.levels[0].texels.iter().zip(d).map(|(g, d)| g[c] * d).sum()
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
    ("alpha", channel::ALPHA..channel::GAMMA),
    ("specular suppression", channel::GAMMA..channel::ROUGHNESS),
    ("roughness", channel::ROUGHNESS..channel::METALLIC),
    ("metalness", channel::METALLIC..channel::NORMAL),
    ("normal", channel::NORMAL..channel::EMISSIVE),
    ("emission", channel::EMISSIVE..channel::USED),
];

#[test]
fn gradients_of_the_whole_step() {
    let values =
        [Value::Weighted, Value::Loss(Loss::LogSrgbL1.into()), Value::Loss(PictureLoss::RELATIVE_SQUARES)];
    let mut setting = Setting::new(Content::Random, 3);
    let (_, seen) = setting.evaluate(values[0]);
    assert!(seen.len() >= 6, "{} layers of two pictures", seen.len());
    assert!(setting.candidate.maps.levels.len() == 7, "a live chain");
    let mut rows: Vec<(&str, [f64; 3])> = GROUPS
        .map(|(name, channels)| {
            let worst = |v| channels.clone().map(|c| setting.channel_error(v, c)).fold(0.0, f64::max);
            (name, values.map(worst))
        })
        .to_vec();
    let padding = setting.gradients(values[0]);
    let padding = padding.rendered.maps.levels[0].texels.iter().flat_map(|t| &t[channel::USED..]);
    assert!(padding.into_iter().all(|g| *g == 0.0), "unused samples have no gradient");
    let mut linear = Setting::new(Content::Linear, 3);
    rows.push(("positions", values.map(|v| linear.position_error(v))));
    println!("| group | random weights | log-sRGB L1 | relative squares |\n|---|---|---|---|");
    for (name, [weighted, logarithmic, relative]) in &rows {
        println!("| {name} | {weighted:.1e} | {logarithmic:.1e} | {relative:.1e} |");
    }
    for (name, errors) in rows {
        assert!(errors.iter().all(|e| *e < 1e-6), "{name}: relative errors {errors:?}");
    }
}

#[test]
fn gradients_of_the_other_modes_that_ship() {
    let faded = Masks::Faded { slope: 2.0 };
    let usual = Sampling { per_axis: SAMPLES, shade_per_pixel: false };
    let modes = [
        ("shaded once per pixel and triangle", Sampling::ENGINE, faded, Loss::LogSrgbL1),
        ("masks are cut", usual, Masks::Cut, Loss::LogSrgbL1),
        ("squared error", usual, faded, Loss::Mse),
        ("all three", Sampling::ENGINE, Masks::Cut, Loss::Mse),
    ];
    println!("| mode | maps | positions |\n|---|---|---|");
    for (name, sampling, masks, loss) in modes {
        let set = |content| {
            let mut setting = Setting::new(content, 3);
            (setting.sampling, setting.passes.masks) = (sampling, masks);
            setting
        };
        let (mut random, mut linear) = (set(Content::Random), set(Content::Linear));
        // The footprint of a whole pixel reaches levels whose border texels are no longer linear in uv: the base alone.
        linear.lod_bias = if sampling.shade_per_pixel { -16.0 } else { 0.0 };
        // One of each group: all of them are moved in the usual mode.
        let channels = GROUPS.map(|(_, channels)| channels.start);
        let maps = channels
            .map(|c| random.channel_error(Value::Loss(loss.into()), c))
            .into_iter()
            .fold(0.0, f64::max);
        let positions = linear.position_error(Value::Loss(loss.into()));
        println!("| {name} | {maps:.1e} | {positions:.1e} |");
        assert!(maps < 1e-6 && positions < 1e-6, "{name}: relative errors {maps:e}, {positions:e}");
    }
}

#[test]
fn the_smooth_adjoint_of_mips_keeps_the_sums() {
    let mut setting = Setting::new(Content::Random, 5);
    let sums = |g: &ParameterGradients<f64>, c: usize| {
        let texels = g.rendered.maps.levels[0].texels.iter().map(|t| t[c]);
        (texels.clone().sum::<f64>(), texels.map(f64::abs).sum::<f64>())
    };
    let exact = setting.gradients(Value::Weighted);
    setting.candidate.mip_adjoint = MipAdjoint::Smooth;
    let smooth = setting.gradients(Value::Weighted);
    // Those that are averaged by area.
    for c in channel::GAMMA..channel::USED {
        let ((a, size), (b, _)) = (sums(&exact, c), sums(&smooth, c));
        assert!((a - b).abs() < 1e-10 * size, "sample {c}: {a} and {b}");
    }
    assert_ne!(exact.rendered.maps, smooth.rendered.maps, "levels beyond the first are at work");
}

#[test]
fn alpha_of_one_and_zero_has_a_gradient() {
    // One sheet in front of the background, all of it at one alpha: brighter or darker than what lies behind.
    for (alpha, mode, masks) in [
        (1.0, AlphaMode::Blend, Masks::Cut),
        (0.0, AlphaMode::Blend, Masks::Cut),
        (1.0, AlphaMode::Mask { cutoff: 0.5 }, Masks::Faded { slope: 1.0 }),
        (0.0, AlphaMode::Mask { cutoff: 0.5 }, Masks::Faded { slope: 1.0 }),
    ] {
        let mut setting = Setting::new(Content::Random, 3);
        let c = &mut setting.candidate;
        c.maps.levels[0].texels.iter_mut().for_each(|t| t[channel::ALPHA] = alpha);
        c.maps.rebuild();
        c.classes.iter_mut().for_each(|class| class.alpha = mode);
        c.alpha.fill(mode);
        c.solid.clear();
        c.masked.clear();
        setting.passes.masks = masks;
        let g = setting.gradients(Value::Weighted);
        let (value, _) = setting.evaluate(Value::Weighted);
        // From the ends of its range alpha can go one way only: a one-sided difference of second order.
        let step = if alpha > 0.5 { -1e-4 } else { 1e-4 };
        let mut at = |n: f64| {
            let texels = &mut setting.candidate.maps.levels[0].texels;
            texels.iter_mut().for_each(|t| t[channel::ALPHA] = alpha + n * step);
            setting.candidate.maps.rebuild();
            setting.evaluate(Value::Weighted).0
        };
        let difference = (4.0 * at(1.0) - at(2.0) - 3.0 * value) / (2.0 * step);
        let sum: f64 = g.rendered.maps.levels[0].texels.iter().map(|t| t[channel::ALPHA]).sum();
        assert!((difference / sum - 1.0).abs() < 1e-5, "{mode:?} at {alpha}: {sum} against {difference}");
    }
}

#[test]
fn the_outline_of_a_mask_is_found() {
    let n = 32;
    let mut card = shapes::quad_grid(2, 2);
    card.uvs = card.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.y)).collect();
    let class = vec![0; card.triangles.len()];
    let mask = SurfaceClass { alpha: AlphaMode::Mask { cutoff: 0.5 }, sides: Sides::Both };
    // White and unlit, cut out to a disc of the given radius.
    let disc = |radius: f64| {
        let texel = |i: usize| {
            let [x, y] = [i % n, i / n].map(|k| (k as f64 + 0.5) / n as f64 * 2.0 - 1.0);
            let mut t = [0.0; CHANNELS];
            t[channel::EMISSIVE..channel::USED].fill(1.0);
            t[channel::NORMAL + 2] = 1.0;
            t[channel::ROUGHNESS] = 1.0;
            t[channel::ALPHA] = (0.5 + 8.0 * (radius - x.hypot(y))).clamp(0.0, 1.0);
            t
        };
        Maps { width: n, height: n, texels: (0..n * n).map(texel).collect() }
    };
    let smoothing = weld_exact(&card.positions);
    let candidate =
        |radius| Candidate::<f64>::new(&card, &smoothing, class.clone(), vec![mask], disc(radius));
    let background = vec![[0.1; 3]; SIZE * SIZE];
    let camera =
        Camera::look_at(glam::vec3(0.0, 0.0, 3.0), glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 10.0);
    let view = View {
        view_projection: matrix_rows(&camera.view_projection()),
        eye: vec3(0.0, 0.0, 3.0),
        lights: &[],
        width: SIZE * SAMPLES,
        height: SIZE * SAMPLES,
        samples: SAMPLES,
        shade_per_pixel: false,
        lod_bias: 0.0,
    };
    let picture = Picture { view, background: &background, vertices: None };
    let cut = |c: &Candidate<f64>| c.draw(&c.vertices(), &picture, &Passes::default()).color;
    let covered = |c: &Candidate<f64>| cut(c).iter().map(|p| p[3]).sum::<f64>();
    let truth = candidate(0.7);
    let reference = cut(&truth);
    let mut fit = candidate(0.45);
    let before = covered(&fit) / covered(&truth);
    let mut g = fit.gradients();
    for k in 0..60 {
        let passes =
            Passes { masks: Masks::Faded { slope: 4_f32.powf(k as f32 / 60.0) }, ..Passes::default() };
        let value = |_: usize, p: &[[f64; 4]], g: &mut [[f64; 4]]| {
            PictureLoss::from(Loss::LogSrgbL1).value_and_gradient((SIZE, SIZE), p, &reference, 1.0, g)
        };
        fit.pull_back([picture], value, &passes, &mut g);
        for (t, g) in fit.maps.levels[0].texels.iter_mut().zip(&g.rendered.maps.levels[0].texels) {
            let g = g[channel::ALPHA];
            let step = if g == 0.0 { 0.0 } else { 0.06 * (1.0 - f64::from(k) / 60.0) * g.signum() };
            t[channel::ALPHA] = (t[channel::ALPHA] - step).clamp(0.0, 1.0);
        }
        fit.maps.rebuild();
    }
    let after = covered(&fit) / covered(&truth);
    assert!(before < 0.5, "starts with {before:.2} of the disc");
    assert!((after - 1.0).abs() < 0.03, "a disc of {before:.2} of the area became one of {after:.3}");
}
