//! A mesh of many triangles with random attributes and maps, under all kinds of lights.

use crate::antialias::Topology;
use crate::deferred::{Geometry, View};
use crate::maps::{CHANNELS, Maps, channel};
use photofit_geometry::{Edges, Weld};
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3, vec4};
use photofit_shading::{Environment, Light, Yaw};
use photofit_texture::{AlphaMode, Pyramid};

const COLUMNS: u32 = 13;
const ROWS: u32 = 9;

pub(super) const BLEND: AlphaMode = AlphaMode::Blend;
pub(super) const MASK: AlphaMode = AlphaMode::Mask { cutoff: 0.55 };

/// The scene; its sizes are no multiples of those of workgroups.
#[derive(Clone)]
pub(super) struct Scene {
    pub(super) positions: Vec<Vec3f>,
    pub(super) normals: Vec<Vec3f>,
    pub(super) tangents: Vec<Vec4f>,
    pub(super) uvs: Vec<Vec2f>,
    pub(super) maps: Pyramid<f32, CHANNELS>,
    pub(super) environment: Environment<f32>,
    pub(super) background: Vec<[f32; 3]>,
    shade_per_pixel: bool,
    triangles: Vec<[u32; 3]>,
    opposite: Vec<[u32; 3]>,
    neighbour: Vec<[u32; 3]>,
    alpha: Vec<AlphaMode>,
    samples: usize,
}

/// Pixels.
const WIDTH: usize = 53;
const HEIGHT: usize = 38;

impl Scene {
    pub(super) fn new(seed: u64, samples: usize) -> Self {
        let mut rng = Uniform::new(seed);
        let mut next = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
        let (mut positions, mut normals, mut tangents, mut uvs) = (vec![], vec![], vec![], vec![]);
        let mut triangles = vec![];
        // A sheet, and a smaller one before it, tilted.
        for (size, depth, tilt) in [(1.0, 0.0, 0.0), (0.55, 0.5, 0.5)] {
            let first = positions.len() as u32;
            for j in 0..ROWS {
                for i in 0..COLUMNS {
                    let (u, v) = (i as f32 / (COLUMNS - 1) as f32, j as f32 / (ROWS - 1) as f32);
                    let (x, y) = (2.0 * u - 1.0 + next(-0.04, 0.04), 1.0 - 2.0 * v + next(-0.04, 0.04));
                    let z = depth + tilt * x + size * next(-0.1, 0.1);
                    positions.push(vec3(1.1 * size * (x + tilt * y), 0.8 * size * (y - tilt * x), z));
                    normals.push(vec3(next(-0.4, 0.4), next(-0.4, 0.4), 1.0));
                    let w = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                    tangents.push(vec4(1.0, next(-0.3, 0.3), next(-0.3, 0.3), w));
                    // Past the border of the maps too.
                    uvs.push(vec2(1.1 * u - 0.05 + next(-0.01, 0.01), 1.1 * v - 0.05 + next(-0.01, 0.01)));
                }
            }
            for j in 0..ROWS - 1 {
                for i in 0..COLUMNS - 1 {
                    let a = first + j * COLUMNS + i;
                    triangles.push([a, a + COLUMNS, a + 1]);
                    triangles.push([a + 1, a + COLUMNS, a + COLUMNS + 1]);
                }
            }
        }
        let weld = Weld::identity(positions.len());
        let edges = Edges::new(&triangles, &weld);
        let (width, height) = (97, 64);
        let mut texels = vec![[0.0; CHANNELS]; width * height];
        for t in &mut texels {
            t.iter_mut().for_each(|x| *x = next(0.1, 0.9));
            t[channel::ROUGHNESS] = next(0.25, 1.0);
            t[channel::NORMAL] = next(-0.3, 0.3);
            t[channel::NORMAL + 1] = next(-0.3, 0.3);
            t[channel::NORMAL + 2] = 0.9;
        }
        let rgb: Vec<f32> = (0..16 * 8 * 3).map(|_| next(0.0, 2.0)).collect();
        let background =
            (0..WIDTH * HEIGHT).map(|_| [next(0.0, 1.0), next(0.0, 1.0), next(0.0, 1.0)]).collect();
        Self {
            positions,
            normals,
            tangents,
            uvs,
            maps: Pyramid::new(Maps { width, height, texels }),
            environment: Environment::from_equirectangular(16, 8, &rgb).expect("an image"),
            background,
            shade_per_pixel: false,
            opposite: edges.opposite_vertices(&triangles, &weld),
            neighbour: edges.triangle_neighbours(),
            triangles,
            alpha: vec![],
            samples,
        }
    }

    pub(super) fn shaded_per_pixel(self) -> Self {
        Self { shade_per_pixel: true, ..self }
    }

    /// The scene with every third triangle of another class.
    pub(super) fn with_alpha(&self, alpha: AlphaMode) -> Self {
        let of = |t: usize| if t.is_multiple_of(3) { AlphaMode::Opaque } else { alpha };
        Self { alpha: (0..self.triangles.len()).map(of).collect(), ..self.clone() }
    }

    /// Runs `f` with the geometry and the view.
    pub(super) fn with<R>(&self, f: impl FnOnce(&Geometry<'_, f32>, &View<'_, f32>) -> R) -> R {
        let geometry = Geometry {
            positions: &self.positions,
            normals: &self.normals,
            tangents: &self.tangents,
            uvs: &self.uvs,
            topology: Topology {
                triangles: &self.triangles,
                opposite: &self.opposite,
                neighbour: &self.neighbour,
            },
            alpha: &self.alpha,
            sides: &[],
        };
        let lights = [
            Light::Point { position: vec3(1.0, 1.5, 3.0), intensity: vec3(20.0, 18.0, 15.0) },
            Light::Directional { direction: vec3(0.0, 0.6, 0.8), irradiance: vec3(0.5, 0.7, 0.6) },
            Light::Ambient { radiance: vec3(0.3, 0.3, 0.4) },
            Light::Environment { map: &self.environment, rotation: Yaw::new(0.4), scale: 0.5 },
        ];
        let view = View {
            view_projection: [
                [1.9, 0.0, 0.0, 0.0],
                [0.0, 2.6, 0.0, 0.0],
                [0.0, 0.0, -1.2, 1.8],
                [0.0, 0.0, -1.0, 2.5],
            ],
            eye: vec3(0.0, 0.0, 2.5),
            lights: &lights,
            width: WIDTH * self.samples,
            height: HEIGHT * self.samples,
            samples: self.samples,
            shade_per_pixel: self.shade_per_pixel,
            lod_bias: 0.0,
        };
        f(&geometry, &view)
    }
}
