//! Throughput of the differentiable rasterizer: pixels, triangles, threads, and what each skip saves.

use crate::context::Context;
use anyhow::Result;
use photofit_fit::views::Sampling;
use photofit_geometry::{Mesh, normals::mesh_normals, shapes};
use photofit_raster::antialias::MeshTopology;
use photofit_raster::deferred::{Frame, Geometry, Gradients, Passes, View, render_into, render_vjp};
use photofit_raster::project::matrix_rows;
use photofit_raster::texture::Pyramid;
use photofit_raster::{CHANNELS, Maps};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use photofit_scene::{AlphaMode, Camera};
use photofit_shading::Light;
use rayon::prelude::*;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let mut item = Item::new(22, 1024);
    for threads in [1_usize, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| {
            item.measure(ctx, &format!("forward, {threads} thread(s)"), 512, &Passes::default(), false, &[]);
            item.measure(ctx, &format!("both, {threads} thread(s)"), 512, &Passes::default(), true, &[]);
        });
    }
    for size in [128, 256, 1024, 2048] {
        item.measure(ctx, "pixels", size, &Passes::default(), true, &[]);
    }
    for frequency in [7, 71, 224] {
        Item::new(frequency, 1024).measure(ctx, "triangles", 512, &Passes::default(), true, &[]);
    }
    let all = Passes::default();
    let skips = [
        ("without map gradients", Passes { map_gradients: false, ..all }),
        ("without position gradients", Passes { position_gradients: false, ..all }),
        ("without antialias", Passes { antialias: false, ..all }),
        ("without normal map", Passes { normal_map: false, ..all }),
        ("without emission", Passes { emissive: false, ..all }),
    ];
    for (name, passes) in skips {
        item.measure(ctx, name, 512, &passes, true, &[]);
    }
    let blend = vec![AlphaMode::Blend; item.mesh.triangles.len()];
    item.measure(ctx, "with transparent layers", 512, &all, true, &blend);
    item.sampling = Sampling::ENGINE;
    item.measure(ctx, "shaded once per pixel and triangle", 512, &all, true, &[]);
    ctx.note("One picture of a displaced sphere (its samples, 2 x 2 to a pixel, 4 x 4 where these are shaded once) with GGX, normal map, a point and an ambient light, 1024^2 maps of 16 samples; `both` is forward and reverse.");
    Ok(())
}

struct Item {
    mesh: Mesh,
    normals: Vec<Vec3f>,
    tangents: Vec<Vec4f>,
    uvs: Vec<Vec2f>,
    topology: MeshTopology,
    maps: Pyramid<f32, CHANNELS>,
    sampling: Sampling,
}

impl Item {
    fn new(frequency: u32, texture: usize) -> Self {
        let mesh = shapes::displaced_sphere(frequency, 0.1, 4, 7);
        let normals = mesh_normals(&mesh);
        let mut texel = [0.0f32; CHANNELS];
        texel[..10].copy_from_slice(&[0.5, 0.4, 0.3, 0.7, 0.0, 0.5, 0.2, 0.05, 0.02, 0.99]);
        Self {
            tangents: normals.iter().map(|n| n.orthonormal_pair().0.extend(1.0)).collect(),
            uvs: mesh.positions.iter().map(|p| vec2(p.x * 0.4 + 0.5, 0.5 - p.y * 0.4)).collect(),
            topology: MeshTopology::new(&mesh.triangles, &mesh.positions),
            maps: Pyramid::new(Maps::filled(texture, texture, texel)),
            normals,
            mesh,
            sampling: Sampling::SUPERSAMPLED,
        }
    }

    fn measure(
        &self,
        ctx: &mut Context,
        name: &str,
        size: usize,
        passes: &Passes,
        both: bool,
        alpha: &[AlphaMode],
    ) {
        let camera =
            Camera::look_at(glam::vec3(0.0, 0.0, 3.0), glam::Vec3::ZERO, glam::Vec3::Y, 0.75, 1.0, 0.1, 10.0);
        let lights = [
            Light::Point { position: vec3(2.0, 2.0, 3.0), intensity: Vec3f::splat(20.0) },
            Light::Ambient { radiance: Vec3f::splat(0.3) },
        ];
        let geometry = Geometry {
            positions: &self.mesh.positions,
            normals: &self.normals,
            tangents: &self.tangents,
            uvs: &self.uvs,
            topology: self.topology.topology(),
            alpha,
            sides: &[],
        };
        let view = View {
            view_projection: matrix_rows(&camera.view_projection()),
            eye: vec3(0.0, 0.0, 3.0),
            lights: &lights,
            width: size,
            height: size,
            samples: self.sampling.per_axis,
            shade_per_pixel: self.sampling.shade_per_pixel,
            lod_bias: 0.0,
        };
        let background = vec![[0.2; 3]; (size / self.sampling.per_axis).pow(2)];
        let mut gradients = Gradients::new(self.mesh.positions.len(), &self.maps);
        let (mut frame, mut g) = (Frame::default(), Vec::new());
        let case = format!("{} tri, {size}^2", self.mesh.triangles.len());
        ctx.measure(
            name,
            &case,
            size * size,
            || {
                render_into(&geometry, &self.maps, &view, &background, passes, &mut frame);
                if both {
                    frame.color.par_iter().map(|c| c.map(|c| c - 0.25)).collect_into_vec(&mut g);
                    render_vjp(&geometry, &self.maps, &view, passes, &frame, &g, &mut gradients);
                }
                frame.layers.len()
            },
            |layers| vec![("layers", *layers as f64)],
        );
    }
}
