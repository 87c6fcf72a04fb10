//! Cases of `photofit-raster`: single operations on procedural meshes.

use photofit_geometry::{Mesh, shapes};
use photofit_image::{Image, contact_sheet};
use photofit_raster::antialias::{MeshTopology, antialias, silhouettes as find_silhouettes};
use photofit_raster::interpolate::{derivatives, interpolate};
use photofit_raster::project::{matrix_rows, project};
use photofit_raster::rasterize::{Barycentrics, NONE, PixelGrid, Visibility, barycentrics, rasterize};
use photofit_raster::texture::{Pyramid, Texture, level_of_detail, lookup, sample};
use photofit_scalar::{Vec4f, vec2, vec4};
use photofit_scene::{Camera, Filter, Sampler, Wrap};

/// Width and height of the pictures.
const SIZE: usize = 64;

/// A mesh in clip space with what each pixel sees.
pub(super) struct View {
    pub(super) mesh: Mesh,
    clip: Vec<Vec4f>,
    visible: Visibility,
}

/// Looks at the origin from `eye`.
pub(super) fn view(mesh: Mesh, eye: [f32; 3]) -> View {
    let camera = Camera::look_at(eye.into(), glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 20.0);
    let mut clip = vec![vec4(0.0, 0.0, 0.0, 0.0); mesh.positions.len()];
    project(&matrix_rows(&camera.view_projection()), &mesh.positions, &mut clip);
    let visible = rasterize(&clip, &mesh.triangles, SIZE, SIZE, None);
    View { mesh, clip, visible }
}

impl View {
    /// An image `[SIZE, SIZE, 3]` of `color(corners, barycentrics)`, black where nothing is seen.
    pub(super) fn shade(&self, color: impl Fn([usize; 3], &Barycentrics<f32>) -> [f32; 3]) -> Image {
        let grid = PixelGrid::new(SIZE, SIZE);
        let mut image = Image::new(SIZE, SIZE, 3);
        for (i, &t) in self.visible.triangle.iter().enumerate().filter(|(_, t)| **t != NONE) {
            let corners = self.mesh.triangles[t as usize].map(|v| v as usize);
            let (x, y) = (i % SIZE, i / SIZE);
            let b = barycentrics(&corners.map(|v| self.clip[v]), grid.ndc(x, y), &grid);
            image.pixel_mut(x, y).copy_from_slice(&color(corners, &b));
        }
        image
    }
}

/// Interpolated normals of a shape with detail at several scales, as colours.
pub(super) fn normals() -> Image {
    let view = view(shapes::displaced_sphere(12, 0.3, 3, 5), [2.0, 1.4, 3.4]);
    view.shade(|corners, b| {
        let [n0, n1, n2] = corners.map(|v| view.mesh.normals[v].to_array());
        interpolate([&n0, &n1, &n2], b).map(|n| (0.5 + 0.5 * n).clamp(0.0, 1.0))
    })
}

/// A checkerboard on a floor that runs to the horizon: levels of detail from fine to coarse.
pub(super) fn textured_floor() -> Image {
    let texels = (0..64 * 64)
        .map(|i| {
            let (x, y) = (i % 64, i / 64);
            let bright = if (x / 4 + y / 4) % 2 == 0 { 0.9 } else { 0.1 };
            [bright, 0.5 * bright + 0.3, y as f32 / 63.0]
        })
        .collect();
    let texture = Pyramid::new(Texture { width: 64, height: 64, texels });
    let sampler = Sampler { wrap_u: Wrap::Repeat, wrap_v: Wrap::MirroredRepeat, filter: Filter::Trilinear };
    let mut mesh = shapes::quad_grid(4, 4);
    for p in &mut mesh.positions {
        *p = photofit_scalar::vec3(4.0 * p.x, -0.6, -4.0 * p.y);
    }
    let view = view(mesh, [0.3, 0.5, 4.0]);
    view.shade(|corners, b| {
        let [a0, a1, a2] = corners.map(|v| {
            let uv = view.mesh.uvs[v];
            [3.0 * uv.x, 3.0 * uv.y]
        });
        let [u, v] = interpolate([&a0, &a1, &a2], b);
        let footprint = derivatives([&a0, &a1, &a2], b);
        let lod = level_of_detail(&footprint, 64, 64, 0.0, texture.levels.len() - 1);
        sample(&texture, &lookup(&texture, vec2(u, v), Some(&lod), &sampler))
    })
}

/// White on black, silhouettes blended by the crossing of their edges.
pub(super) fn silhouettes() -> Image {
    let view = view(shapes::icosphere(2), [0.7, 0.4, 2.9]);
    let topology = MeshTopology::new(&view.mesh.triangles, &view.mesh.positions);
    let pairs = find_silhouettes(&view.visible, &view.clip, &topology.topology());
    let color: Vec<[f32; 1]> =
        view.visible.triangle.iter().map(|t| [if *t == NONE { 0.0 } else { 1.0 }]).collect();
    let mut out = color.clone();
    antialias(&pairs, &color, &mut out);
    Image::from_data(SIZE, SIZE, 1, out.iter().map(|c| c[0].clamp(0.0, 1.0)).collect())
}

/// The four depth layers of a torus, nearest first, without perspective in the grey values.
pub(super) fn depth_layers() -> Image {
    let view = view(shapes::torus(24, 12, 1.0, 0.4), [0.0, 1.0, 3.0]);
    let mut layers = vec![view.visible.clone()];
    for k in 0..3 {
        layers.push(rasterize(&view.clip, &view.mesh.triangles, SIZE, SIZE, Some(&layers[k])));
    }
    let images: Vec<Image> = layers
        .iter()
        .map(|layer| {
            // Distance from the eye, 1 at the near and 0 at the far end of the torus.
            let grey =
                |z: f32| if z >= 1.0 { 0.0 } else { ((4.8 - 2.0 / (20.0 - 19.9 * z)) / 3.2).clamp(0.0, 1.0) };
            Image::from_data(SIZE, SIZE, 1, layer.depth.iter().map(|z| grey(*z)).collect())
        })
        .collect();
    contact_sheet(&images.iter().collect::<Vec<_>>(), 4, 0)
}
