//! Cases of `photofit-geometry`.

use photofit_geometry::atlas::{UnwrapOptions, coverage, unwrap};
use photofit_geometry::decimate::{Options, Target, decimate};
use photofit_geometry::{normals, shapes};
use photofit_image::Image;

use super::raster::view;

/// Texels of an unwrapped torus, coloured by chart and shaded by triangle.
pub(super) fn atlas() -> Image {
    let mesh = shapes::torus(16, 8, 1.0, 0.45);
    let options = UnwrapOptions { size: 96, ..UnwrapOptions::default() };
    let group = vec![0; mesh.triangles.len()];
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &group, &options).expect("a valid mesh");
    let owners = coverage(&atlas.corner_uv, 96, 96, false);
    Image::from_fn(96, 96, 3, |x, y, c| {
        let Some(&chart) = atlas.triangle_chart.get(owners.triangle[y * 96 + x] as usize) else { return 0.0 };
        let shade = 0.8 + 0.2 * owners.barycentric[y * 96 + x][0];
        shade * [0.2, 0.55, 0.9][(chart as usize + c * (1 + chart as usize / 3)) % 3]
    })
}

/// A shape with detail at several scales, decimated to 200 triangles; face normals as colours.
pub(super) fn decimated() -> Image {
    let heavy = shapes::displaced_sphere(20, 0.3, 3, 5);
    let options = Options::new(Target::Triangles(200));
    let mut mesh = decimate(&heavy, &[], &[], &options).expect("a valid mesh").mesh;
    mesh.normals = normals::mesh_normals(&mesh);
    let view = view(mesh, [2.0, 1.4, 3.4]);
    view.shade(|corners, _| {
        let [a, b, c] = corners.map(|v| view.mesh.positions[v]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        n.to_array().map(|v| (0.5 + 0.5 * v).clamp(0.0, 1.0))
    })
}
