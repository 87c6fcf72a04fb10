//! A whole fit without the rest of photofit: a small red square moves, grows and takes on the colour of the square in the
//! picture, by the gradient of the difference alone.
//!
//! `cargo run --release -p photofit-raster --example fit_square`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_raster::antialias::MeshTopology;
use photofit_raster::deferred::{Geometry, Gradients, Passes, View, render, render_vjp};
use photofit_raster::loss::{Loss, PictureLayout};
use photofit_raster::project::Matrix4;
use photofit_raster::texture::Pyramid;
use photofit_raster::{CHANNELS, Maps, Vec3, channel, vec2, vec3, vec4};

/// Pixels per side, and samples per axis of a pixel.
const SIZE: usize = 64;
const SAMPLES: usize = 2;
const STEPS: usize = 200;

/// A square in the plane z = 0 that shines in one colour.
struct Square {
    positions: Vec<Vec3<f32>>,
    maps: Pyramid<f32, CHANNELS>,
}

impl Square {
    fn new([x, y]: [f32; 2], half: f32, color: [f32; 3]) -> Self {
        let corner = |(sx, sy): (f32, f32)| vec3(x + sx * half, y + sy * half, 0.0);
        let mut texel = [0.0; CHANNELS];
        texel[channel::ALPHA] = 1.0;
        texel[channel::ROUGHNESS] = 1.0;
        texel[channel::EMISSIVE..channel::EMISSIVE + 3].copy_from_slice(&color);
        Self {
            positions: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner).to_vec(),
            maps: Pyramid::new(Maps::filled(1, 1, texel)),
        }
    }
}

fn view() -> View<'static, f32> {
    // Perspective from z = 3 down -z; clip z in [0, w] between the planes at distances .1 and 10.
    let (focal, near, far, eye) = (2.4, 0.1, 10.0, vec3(0.0, 0.0, 3.0));
    let depth = far / (near - far);
    let view_projection: Matrix4<f32> = [
        [focal, 0.0, 0.0, 0.0],
        [0.0, focal, 0.0, 0.0],
        [0.0, 0.0, depth, near * depth - depth * eye.z],
        [0.0, 0.0, -1.0, eye.z],
    ];
    View {
        view_projection,
        eye,
        lights: &[],
        width: SIZE * SAMPLES,
        height: SIZE * SAMPLES,
        samples: SAMPLES,
        shade_per_pixel: false,
        lod_bias: 0.0,
    }
}

fn main() {
    let triangles = [[0, 1, 2], [0, 2, 3]];
    let target = Square::new([0.25, 0.15], 0.5, [0.1, 0.5, 0.8]);
    let mut square = Square::new([-0.1, -0.1], 0.3, [0.9, 0.1, 0.1]);
    let topology = MeshTopology::new(&triangles, &square.positions);
    let (normals, tangents) = ([vec3(0.0, 0.0, 1.0); 4], [vec4(1.0, 0.0, 0.0, 1.0); 4]);
    let uvs = [vec2(0.0, 1.0), vec2(1.0, 1.0), vec2(1.0, 0.0), vec2(0.0, 0.0)];
    let fixed = Geometry {
        positions: &[],
        normals: &normals,
        tangents: &tangents,
        uvs: &uvs,
        topology: topology.topology(),
        alpha: &[],
        sides: &[],
    };
    let (view, passes) = (view(), Passes { normal_map: false, ..Passes::default() });
    let background = vec![[0.0; 3]; SIZE * SIZE];
    let reference = render(
        &Geometry { positions: &target.positions, ..fixed },
        &target.maps,
        &view,
        &background,
        &passes,
    )
    .color;
    let shape = PictureLayout::new(SIZE, SIZE, 4);
    let mut gradients = Gradients::new(4, &square.maps);
    for step in 0..=STEPS {
        let geometry = Geometry { positions: &square.positions, ..fixed };
        let frame = render(&geometry, &square.maps, &view, &background, &passes);
        let mut of_pixels = vec![[0.0; 4]; SIZE * SIZE];
        let loss = Loss::Mse.value_and_gradient(
            frame.color.as_flattened(),
            reference.as_flattened(),
            &shape,
            1.0,
            of_pixels.as_flattened_mut(),
        );
        if step % 40 == 0 {
            println!("step {step:3}: loss {loss:.6}");
        }
        gradients.clear();
        render_vjp(&geometry, &square.maps, &view, &passes, &frame, &of_pixels, &mut gradients);
        let rate = 1.0 - step as f32 / STEPS as f32;
        for (p, g) in square.positions.iter_mut().zip(&gradients.positions) {
            // Along the line of sight nothing is seen to change: the square stays in its plane.
            *p -= vec3(g.x, g.y, 0.0) * rate;
        }
        // One texel, which has no coarser levels to make anew.
        let (texel, g) = (&mut square.maps.levels[0].texels[0], &gradients.maps.levels[0].texels[0]);
        for k in channel::EMISSIVE..channel::EMISSIVE + 3 {
            texel[k] -= 0.5 * g[k];
        }
    }
    let error = square.positions.iter().zip(&target.positions).map(|(a, b)| (*a - *b).length());
    println!("largest distance of a corner: {:.4}", error.fold(0.0, f32::max));
}
