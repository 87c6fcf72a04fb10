//! Points on the surfaces of a material: means of textures are over what is seen of them, not over whole images.

use crate::{Scene, TextureImage, TextureSlot, Wrap};

/// Most points on the triangles of a material, where there are fewer triangles.
const MOST: usize = 100_000;
/// Most points along the side of a triangle.
const FINEST: usize = 24;

/// A point: both sets of texture coordinates, and the area that it stands for.
#[derive(Clone, Copy, Debug)]
struct Point {
    uvs: [[f32; 2]; 2],
    area: f64,
}

/// Points on the surfaces of a material, spread evenly over each of its triangles.
#[derive(Clone, Debug, Default)]
pub struct SurfacePoints(Vec<Point>);

impl Scene {
    /// Points on all placed surfaces of a material; areas are those of the scene.
    ///
    /// # Panics
    /// If the scene is not valid (see [`Scene::validate`]).
    pub fn surface_points(&self, material: usize) -> SurfacePoints {
        let placed = || self.instances.iter().filter(|i| self.primitives[i.primitive].material == material);
        let triangles: usize = placed().map(|i| self.primitives[i.primitive].mesh.triangles.len()).sum();
        let side = ((MOST as f64 / triangles.max(1) as f64).sqrt() as usize).clamp(1, FINEST);
        let mut points = Vec::new();
        for instance in placed() {
            let mesh = &self.primitives[instance.primitive].mesh;
            let matrix = instance.transform.matrix3;
            for (t, corners) in mesh.triangles.iter().enumerate() {
                let p = mesh.corners(t).map(|p| matrix * glam::vec3a(p.x, p.y, p.z));
                let area = 0.5 * (p[1] - p[0]).as_dvec3().cross((p[2] - p[0]).as_dvec3()).length();
                if area.is_nan() || area <= 0.0 {
                    continue;
                }
                let sets = [&mesh.uvs, &mesh.uvs1]
                    .map(|set| corners.map(|c| set.get(c as usize).map_or([0.0; 2], |uv| uv.to_array())));
                let area = area / (side * side) as f64;
                points.extend(centroids(side).map(|b| {
                    let at = |uv: &[[f32; 2]; 3]| [0, 1].map(|k| (0..3).map(|c| b[c] * uv[c][k]).sum());
                    Point { uvs: [at(&sets[0]), at(&sets[1])], area }
                }));
            }
        }
        SurfacePoints(points)
    }
}

impl SurfacePoints {
    /// The mean of a texture over the points, nearest texels; over the image where there are no points.
    pub(crate) fn mean(
        &self,
        slot: &TextureSlot,
        image: &TextureImage,
        decode: impl Fn(&[u8; 4]) -> f64,
    ) -> f32 {
        if self.0.is_empty() || image.texels.is_empty() {
            let sum: f64 = image.texels.iter().map(decode).sum();
            return (sum / image.texels.len().max(1) as f64) as f32;
        }
        let (mut sum, mut area) = (0.0, 0.0);
        for point in &self.0 {
            let [u, v] = point.uvs[slot.tex_coord.min(1) as usize];
            let [x, y] = slot.transform.map(|row| row[0] * u + row[1] * v + row[2]);
            let column = texel(x, image.width, slot.sampler.wrap_u);
            let row = texel(y, image.height, slot.sampler.wrap_v);
            sum += point.area * decode(&image.texels[row * image.width + column]);
            area += point.area;
        }
        (sum / area) as f32
    }
}

/// Barycentric coordinates of the centroids of `n * n` equal parts of a triangle.
fn centroids(n: usize) -> impl Iterator<Item = [f32; 3]> {
    let part = move |i: usize, j: usize, third: f32| {
        let (a, b) = ((i as f32 + third) / n as f32, (j as f32 + third) / n as f32);
        [1.0 - a - b, a, b]
    };
    let upright = move |i: usize| (0..n - i).map(move |j| part(i, j, 1.0 / 3.0));
    let turned = move |i: usize| (0..(n - i).saturating_sub(1)).map(move |j| part(i, j, 2.0 / 3.0));
    (0..n).flat_map(move |i| upright(i).chain(turned(i)))
}

/// The texel along an axis of `n` texels that a coordinate falls into.
fn texel(x: f32, n: usize, wrap: Wrap) -> usize {
    let inside = match wrap {
        Wrap::Repeat => x - x.floor(),
        Wrap::MirroredRepeat => 1.0 - (x.rem_euclid(2.0) - 1.0).abs(),
        Wrap::ClampToEdge => x.clamp(0.0, 1.0),
    };
    ((inside * n as f32) as usize).min(n.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, Material, Primitive, Sampler};
    use photofit_geometry::Mesh;
    use photofit_scalar::{vec2, vec3};

    #[test]
    fn means_are_over_what_is_shown() {
        // A triangle over the left half of an image, placed twice: as it is, and three times as large with the right half.
        let triangle = |u: f32| Mesh {
            positions: vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)],
            uvs: vec![vec2(u, 0.1), vec2(u + 0.4, 0.1), vec2(u, 0.9)],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let scaled = |primitive, s: f32| Instance {
            primitive,
            transform: glam::Affine3A::from_scale(glam::Vec3::splat(s)),
        };
        let primitive = |u| Primitive { mesh: triangle(u), material: 0 };
        let scene = Scene {
            primitives: vec![primitive(0.05), primitive(0.55)],
            instances: vec![scaled(0, 1.0), scaled(1, 3.0)],
            materials: vec![Material::clay()],
            ..Scene::default()
        };
        let texels = (0..8).map(|i| if i % 4 < 2 { [0; 4] } else { [200; 4] }).collect();
        let image = TextureImage { width: 4, height: 2, texels, ..TextureImage::default() };
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut slot =
            TextureSlot { image: 0, sampler: Sampler::default(), tex_coord: 0, transform: identity };
        let points = scene.surface_points(0);
        let mean = |slot: &TextureSlot| points.mean(slot, &image, |t| f64::from(t[0]));
        assert!((mean(&slot) - 180.0).abs() < 1e-3, "nine parts of ten: {}", mean(&slot));
        slot.transform[0][2] = 0.5;
        assert!((mean(&slot) - 20.0).abs() < 1e-3, "shifted by half: {}", mean(&slot));
        slot.sampler.wrap_u = Wrap::ClampToEdge;
        assert!((mean(&slot) - 200.0).abs() < 1e-3, "held at the border: {}", mean(&slot));
        let none = SurfacePoints::default().mean(&slot, &image, |t| f64::from(t[0]));
        assert!((none - 100.0).abs() < 1e-6);
        let sum = centroids(5).map(|b| b[0]).sum::<f32>();
        assert!(centroids(5).count() == 25 && (sum - 25.0 / 3.0).abs() < 1e-4);
    }
}
