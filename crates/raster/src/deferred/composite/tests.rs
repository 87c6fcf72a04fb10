//! Layers and samples on a device against the CPU's.

use super::*;
use crate::antialias::Topology;
use crate::deferred::frame::{self, FrameLayer};
use crate::deferred::{Geometry, Masks, Passes, View};
use crate::gpu::tolerances::COMPOSITE;
use crate::gpu::{FrameParams, Shot};
use crate::rasterize::{NONE, Visibility};
use photofit_gpu::Gpu;
use photofit_gpu::{assert_twin, test_device};
use photofit_gradcheck::{Uniform, worst_difference};
use photofit_scalar::Vec3;
use photofit_texture::AlphaMode;

const WIDTH: usize = 36;
const HEIGHT: usize = 22;
const SIDE: usize = 2;
const SAMPLES: usize = WIDTH * HEIGHT;
const PIXELS: usize = SAMPLES / (SIDE * SIDE);
const ALPHA: [AlphaMode; 3] = [AlphaMode::Opaque, AlphaMode::Mask { cutoff: 0.4 }, AlphaMode::Blend];
/// One triangle of each class.
const TRIANGLES: [[u32; 3]; 3] = [[0; 3]; 3];

type Colors = Vec<[f32; 4]>;

fn colors(n: usize, rng: &mut Uniform) -> Colors {
    (0..n).map(|_| std::array::from_fn(|_| rng.range(-0.5, 1.5) as f32)).collect()
}

/// A layer of random fragments, some of which hide what lies behind exactly.
struct Input {
    triangle: Vec<u32>,
    shaded: Colors,
    background: Colors,
    /// What lies behind, where there is another layer.
    behind: Colors,
    g: Colors,
    g_pixels: Colors,
}

impl Input {
    fn new(seed: u64) -> Self {
        let mut rng = Uniform::new(seed);
        let id = |x: f64| if x < 0.3 { NONE } else { (x * 1e4) as u32 % 3 };
        let triangle = (0..SAMPLES).map(|_| id(rng.range(0.0, 1.0))).collect();
        let mut shaded = colors(SAMPLES, &mut rng);
        for s in &mut shaded {
            s[3] =
                [0.0, 1.0, 1.0 - 1.0 / (1 << 21) as f32, 1.0 - 1.0 / (1 << 19) as f32, s[3].clamp(0.0, 1.0)]
                    [(rng.range(0.0, 5.0) as usize).min(4)];
        }
        let mut background = colors(PIXELS, &mut rng);
        background.iter_mut().for_each(|b| b[3] = f32::NAN);
        let [behind, g] = [colors(SAMPLES, &mut rng), colors(SAMPLES, &mut rng)];
        Self { triangle, shaded, background, behind, g, g_pixels: colors(PIXELS, &mut rng) }
    }
}

/// Everything that the operations write.
struct Output {
    blended: Colors,
    g_behind: Colors,
    g_shaded: Colors,
    front: Vec<u32>,
    seen: bool,
    average: Colors,
    magnified: Colors,
}

fn on_device(gpu: &Gpu, input: &Input, passes: &Passes, fits_alpha: bool, last: bool) -> Output {
    let none = [[NONE; 3]; 3];
    let topology = Topology { triangles: &TRIANGLES, opposite: &none, neighbour: &none };
    let mesh = MeshBuffers::new(gpu, &[[0.0; 2]], &topology, &ALPHA, &[]).expect("uploaded");
    let picture = PictureBuffers::new(gpu, &mesh, SAMPLES, PIXELS, 2, true).expect("made");
    let g = GradientBuffers::new(gpu, &mesh, SAMPLES, PIXELS).expect("made");
    let layer = &picture.layers[0];
    gpu.write(&layer.triangle, &input.triangle).expect("written");
    gpu.write(&layer.shaded, &input.shaded).expect("written");
    gpu.write(&layer.behind, &input.behind).expect("written");
    gpu.write(&picture.background, &input.background).expect("written");
    gpu.write(&picture.live, &[1, u32::from(!last), 0]).expect("written");
    gpu.write(&picture.samples, &input.g).expect("written");
    gpu.write(&g.samples[0], &input.g).expect("written");
    gpu.write(&g.color, &input.g_pixels).expect("written");
    let shot =
        Shot { view_projection: [[0.0; 4]; 4], width: WIDTH, height: HEIGHT, samples: SIDE, scale: 1.0 };
    let mut r = gpu.record("composite");
    let mut s = Steps::new(&mut r, &FrameParams::new(&shot, 1, 3, passes, fits_alpha));
    blend(&mut s, &picture, 0, &layer.blended).expect("recorded");
    blend_vjp(&mut s, &picture, 0, &g, &g.samples[0]).expect("recorded");
    s.recorder.clear(&picture.live);
    transparent_part(&mut s, &mesh, &picture, 0).expect("recorded");
    average(&mut s, &picture).expect("recorded");
    magnify(&mut s, &g, &g.samples[1]).expect("recorded");
    r.finish().expect("recorded").run().expect("runs");
    let read = |b: &Buffer<[f32; 4]>| gpu.read(b).expect("read");
    Output {
        blended: read(&layer.blended),
        g_behind: read(&g.samples[0]),
        g_shaded: read(&g.shaded),
        front: gpu.read(&picture.front).expect("read"),
        seen: gpu.read(&picture.live).expect("read")[1] != 0,
        average: read(&picture.color),
        magnified: read(&g.samples[1]),
    }
}

fn on_cpu(input: &Input, passes: &Passes, fits_alpha: bool, last: bool) -> Output {
    let none = [[NONE; 3]; 3];
    let view = View {
        view_projection: [[0.0; 4]; 4],
        eye: Vec3::zero(),
        lights: &[],
        width: WIDTH,
        height: HEIGHT,
        samples: SIDE,
        shade_per_pixel: false,
        lod_bias: 0.0_f32,
    };
    let geometry = Geometry {
        positions: &[],
        normals: &[],
        tangents: &[],
        uvs: &[],
        topology: Topology { triangles: &TRIANGLES, opposite: &none, neighbour: &none },
        alpha: &ALPHA,
        sides: &[],
    };
    let visibility = Visibility {
        width: WIDTH,
        height: HEIGHT,
        triangle: input.triangle.clone(),
        depth: vec![0.5; SAMPLES],
    };
    let mut color = input.behind.clone();
    if last {
        frame::magnify(&input.background, &view, &mut color, |b| [b[0], b[1], b[2], 0.0]);
    }
    let mut layer = FrameLayer::default();
    (layer.visibility, layer.shaded) = (visibility, input.shaded.clone());
    frame::blend(&mut layer, fits_alpha, view.width, &mut color, |_, _| ());
    let (mut g_behind, mut g_shaded) = (input.g.clone(), vec![[0.0; 4]; SAMPLES]);
    frame::blend_vjp(&layer, 0, &mut g_behind, &mut g_shaded);
    let hides = frame::hides(passes, fits_alpha);
    let front = frame::transparent_part(&geometry, &layer.visibility, &layer.shaded, hides);
    let mut average = Vec::new();
    frame::average(&input.g, &view, &mut average);
    let mut magnified = vec![[0.0; 4]; SAMPLES];
    frame::magnify(&input.g_pixels, &view, &mut magnified, |g| g.map(|g| g / (SIDE * SIDE) as f32));
    Output {
        blended: color,
        g_behind,
        g_shaded,
        seen: front.is_some(),
        front: front.map_or_else(|| vec![NONE; SAMPLES], |v| v.triangle),
        average,
        magnified,
    }
}

/// Worst difference of the colours and gradients.
fn worst(a: &Output, b: &Output) -> f64 {
    let pairs = [
        (&a.blended, &b.blended),
        (&a.g_behind, &b.g_behind),
        (&a.g_shaded, &b.g_shaded),
        (&a.average, &b.average),
        (&a.magnified, &b.magnified),
    ];
    let worst = pairs.map(|(a, b)| worst_difference(a.as_flattened(), b.as_flattened()));
    worst.into_iter().fold(0.0, f64::max)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn layers_and_samples_are_those_of_the_cpu() {
    let gpu = test_device();
    let input = Input::new(1);
    let faded = |slope| Passes { masks: Masks::Faded { slope }, ..Passes::default() };
    for passes in [Passes::default(), faded(2.0), faded(1.0)] {
        for fits_alpha in [false, true] {
            for last in [false, true] {
                let found = on_device(gpu, &input, &passes, fits_alpha, last);
                let expected = on_cpu(&input, &passes, fits_alpha, last);
                let error = worst(&found, &expected);
                assert_twin("COMPOSITE", format!("{passes:?} {fits_alpha} {last}"), error, COMPOSITE);
                assert_eq!(found.front, expected.front, "{passes:?} {fits_alpha}");
                assert!(found.seen && expected.seen, "something lets see what lies behind");
            }
        }
    }
    // Where all hides, no layer is drawn behind.
    let mut opaque = Input::new(2);
    opaque.shaded.iter_mut().for_each(|s| s[3] = 1.0);
    let found = on_device(gpu, &opaque, &Passes::default(), false, true);
    assert!(!found.seen && found.front.iter().all(|t| *t == NONE));
    assert!(!on_cpu(&opaque, &Passes::default(), false, true).seen);
    // The comparison can fail.
    let other = Input { shaded: input.shaded.iter().map(|s| s.map(|x| x + 1e-5)).collect(), ..Input::new(1) };
    let (a, b) = (on_device(gpu, &other, &faded(2.0), true, true), on_cpu(&input, &faded(2.0), true, true));
    assert!(worst(&a, &b) > COMPOSITE);
}

/// Pixels of layers that are laid behind one another from the front on, and what of each lets see the next.
fn laid_on_cpu(layers: &[Input]) -> (Colors, Vec<Vec<u32>>) {
    let mut laid = vec![[0.0, 0.0, 0.0, 1.0_f32]; SAMPLES];
    let mut fronts = Vec::new();
    for layer in layers {
        let mut front = layer.triangle.clone();
        for (i, t) in front.iter_mut().enumerate().filter(|(_, t)| **t != NONE) {
            let ([r, g, b, alpha], so_far) = (layer.shaded[i], &mut laid[i]);
            let share = so_far[3] * alpha;
            so_far.iter_mut().zip([r, g, b]).for_each(|(s, c)| *s += c * share);
            so_far[3] *= 1.0 - alpha;
            if so_far[3] < crate::deferred::LEAST_TRANSMITTANCE {
                (so_far[3], *t) = (0.0, NONE);
            }
        }
        fronts.push(front);
    }
    let mut pixels = vec![[0.0; 4]; PIXELS];
    for (i, [r, g, b, through]) in laid.into_iter().enumerate() {
        let pixel = (i / WIDTH / SIDE) * (WIDTH / SIDE) + i % WIDTH / SIDE;
        let sample = [r, g, b, 1.0 - through];
        pixels[pixel].iter_mut().zip(sample).for_each(|(p, s)| *p += s / (SIDE * SIDE) as f32);
    }
    (pixels, fronts)
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn layers_that_are_laid_behind_one_another_are_those_of_the_cpu() {
    let gpu = test_device();
    let mesh = MeshBuffers::drawn(gpu, &[[0.0; 3]], &TRIANGLES, &[]).expect("uploaded");
    let layers: Vec<Input> = (3..6).map(Input::new).collect();
    let (expected, fronts) = laid_on_cpu(&layers);
    let picture = PictureBuffers::drawn(gpu, &mesh, SAMPLES, PIXELS + 5, 3).expect("made");
    assert_eq!(picture.layers.len(), 3);
    let shot =
        Shot { view_projection: [[0.0; 4]; 4], width: WIDTH, height: HEIGHT, samples: SIDE, scale: 1.0 };
    let params = FrameParams { first: 5, ..FrameParams::new(&shot, 1, 3, &Passes::default(), false) };
    gpu.write(&picture.bins.groups, &[SAMPLES.div_ceil(64) as u32, 1, 1].repeat(12)).expect("written");
    for (k, input) in layers.iter().enumerate() {
        gpu.write(&picture.layers[k].triangle, &input.triangle).expect("written");
        gpu.write(&picture.layers[k].shaded, &input.shaded).expect("written");
        let mut r = gpu.record("lay");
        let mut s = Steps::new(&mut r, &params);
        lay_behind(&mut s, &picture, k).expect("recorded");
        resolve(&mut s, &picture).expect("recorded");
        r.finish().expect("recorded").run().expect("runs");
        if k < 2 {
            assert_eq!(gpu.read(&picture.front).expect("read"), fronts[k], "layer {k}");
        }
    }
    assert_eq!(gpu.read(&picture.live).expect("read"), [0, 1, 1, 0], "each lets see the next one");
    let found = gpu.read(&picture.color).expect("read");
    let error = worst_difference(found[5..].as_flattened(), expected.as_flattened());
    assert_twin("COMPOSITE", "laid layers", error, COMPOSITE);
    // The pixels of other bands stay, and the comparison can fail.
    assert_eq!(found[..5], [[0.0; 4]; 5]);
    let (other, _) = laid_on_cpu(&layers[..2]);
    assert!(worst_difference(found[5..].as_flattened(), other.as_flattened()) > COMPOSITE);
}
