//! Times one forward and reverse pass: `throughput [triangle frequency] [image size] [texture size] [threads]`.
#![expect(clippy::print_stdout, reason = "an example reports to the terminal")]
use photofit_geometry::{Edges, normals, shapes};
use photofit_raster::{
    CHANNELS, Maps,
    antialias::Topology,
    deferred::{Geometry, Gradients, Passes, View, render, render_vjp},
    project::matrix_rows,
    texture::Pyramid,
};
use photofit_scalar::{Vec2f, Vec4f, vec2, vec3};
use photofit_shading::Light;
use std::time::Instant;

fn main() {
    let arg = |k: usize, d: usize| std::env::args().nth(k).and_then(|a| a.parse().ok()).unwrap_or(d);
    let (freq, size, texture, threads) = (arg(1, 22), arg(2, 512), arg(3, 1024), arg(4, 2));
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().expect("threads");
    let mesh = shapes::displaced_sphere(freq as u32, 0.1, 4, 7);
    let weld = photofit_geometry::weld::weld_exact(&mesh.positions);
    let edges = Edges::new(&mesh.triangles, &weld);
    let (opposite, neighbour) =
        (edges.opposite_vertices(&mesh.triangles, &weld), edges.triangle_neighbours());

    let n = normals::mesh_normals(&mesh);
    let tangents: Vec<Vec4f> = n.iter().map(|n| n.orthonormal_pair().0.extend(1.0)).collect();
    let uvs: Vec<Vec2f> = mesh.positions.iter().map(|p| vec2(p.x * 0.4 + 0.5, 0.5 - p.y * 0.4)).collect();
    let mut t = [0.0f32; CHANNELS];
    t[..10].copy_from_slice(&[0.5, 0.4, 0.3, 1.0, 0.0, 0.5, 0.2, 0.05, 0.02, 0.99]);
    let maps: Pyramid<f32, CHANNELS> = Pyramid::new(Maps::filled(texture, texture, t));
    let camera = photofit_scene::Camera::look_at(
        glam::vec3(0.0, 0.0, 3.0),
        glam::Vec3::ZERO,
        glam::Vec3::Y,
        0.75,
        1.0,
        0.1,
        10.0,
    );
    let lights = [
        Light::Point { position: vec3(2.0, 2.0, 3.0), intensity: vec3(20.0, 20.0, 20.0) },
        Light::Ambient { radiance: vec3(0.3, 0.3, 0.3) },
    ];
    let geometry = Geometry {
        positions: &mesh.positions,
        normals: &n,
        tangents: &tangents,
        uvs: &uvs,
        topology: Topology { triangles: &mesh.triangles, opposite: &opposite, neighbour: &neighbour },
        alpha: &[],
    };
    let view = View {
        view_projection: matrix_rows(&camera.view_projection()),
        eye: vec3(0.0, 0.0, 3.0),
        lights: &lights,
        width: size,
        height: size,
        lod_bias: 0.0,
    };
    let background = vec![[0.2; 3]; size * size];
    let passes = Passes::default();
    let mut g = Gradients::new(mesh.positions.len(), &maps);
    let (mut f, mut b) = (vec![], vec![]);
    for _ in 0..7 {
        let t0 = Instant::now();
        let frame = render(&geometry, &maps, &view, &background, &passes);
        f.push(t0.elapsed().as_secs_f64());
        let seed: Vec<[f32; 4]> =
            frame.color.iter().map(|c| [c[0] - 0.25, c[1] - 0.25, c[2] - 0.25, 0.0]).collect();
        let t0 = Instant::now();
        render_vjp(&geometry, &maps, &view, &passes, &frame, &seed, &mut g);
        b.push(t0.elapsed().as_secs_f64());
        if f.len() == 1 {
            let covered = frame.layers[0].visibility.triangle.iter().filter(|t| **t != u32::MAX).count();
            println!("{} triangles, {covered} pixels covered", mesh.triangles.len());
        }
    }
    f.sort_by(f64::total_cmp);
    b.sort_by(f64::total_cmp);
    println!("forward {:.1} ms, reverse {:.1} ms (medians)", f[3] * 1e3, b[3] * 1e3);
}
