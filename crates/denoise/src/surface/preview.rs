//! Pictures of the maps for people: depth colours, normals, shading, and a sheet of before and after.

use super::{Maps, Pinhole};
use photofit_image::{Image, contact_sheet, heatmap_color, srgb_decode};
use photofit_scalar::{Vec3f, vec3};

/// Linear grey where nothing was seen.
const BACKGROUND: [f32; 3] = [0.03; 3];
/// Colour of surfaces of clouds without colours.
const CLAY: [f32; 3] = [0.62; 3];
/// Share of light that comes from everywhere.
const AMBIENT: f32 = 0.12;

/// Range of depth that previews show: the 1st and 99th percentile of the covered pixels.
pub fn depth_range(maps: &Maps) -> (f32, f32) {
    let mut z: Vec<f32> = maps.depth.data.iter().copied().filter(|z| *z > 0.0).collect();
    if z.is_empty() {
        return (1.0, 2.0);
    }
    z.sort_unstable_by(f32::total_cmp);
    let at = |q: f32| z[((z.len() - 1) as f32 * q) as usize];
    (at(0.01), at(0.99))
}

/// Depth as colours, linear RGB: pale yellow is near, purple is far, in equal steps of 1/z.
pub fn depth_preview(maps: &Maps, (near, far): (f32, f32)) -> Image {
    let (a, b) = (1.0 / near, 1.0 / far);
    let span = (a - b).max(1e-6 * a);
    picture(maps, |_, i| {
        let t = (1.0 / maps.depth.data[i] - b) / span;
        heatmap_color(0.12 + 0.88 * t.clamp(0.0, 1.0)).map(srgb_decode)
    })
}

/// Normals as colours, linear RGB whose sRGB values are `n / 2 + 1 / 2` with x right, y up and z towards the camera.
pub fn normal_preview(maps: &Maps, camera: &Pinhole) -> Image {
    picture(maps, |_, i| {
        let n = camera_normal(maps, camera, i);
        [n.x, -n.y, -n.z].map(|v| srgb_decode(0.5 + 0.5 * v.clamp(-1.0, 1.0)))
    })
}

/// The surface under a light over the left shoulder of the camera, linear RGB.
pub fn shaded_preview(maps: &Maps, camera: &Pinhole) -> Image {
    let light = vec3(-0.45_f32, -0.55, -0.7).normalize_or_zero();
    picture(maps, |maps, i| {
        let n = camera_normal(maps, camera, i);
        let shade = AMBIENT + (1.0 - AMBIENT) * n.dot(light).max(0.0);
        albedo(maps, i).map(|c| c * shade)
    })
}

/// The colours, linear RGB; grey without colours.
pub fn albedo_preview(maps: &Maps) -> Image {
    picture(maps, albedo)
}

/// Two rows of four previews, `before` above `after`: depth, normals, shading, colours.
pub fn before_after_sheet(before: &Maps, after: &Maps, camera: &Pinhole) -> Image {
    let range = depth_range(after);
    let row = |maps: &Maps| {
        [
            depth_preview(maps, range),
            normal_preview(maps, camera),
            shaded_preview(maps, camera),
            albedo_preview(maps),
        ]
    };
    let (before, after) = (row(before), row(after));
    let all: Vec<&Image> = before.iter().chain(&after).collect();
    contact_sheet(&all, 4, 4)
}

fn albedo(maps: &Maps, i: usize) -> [f32; 3] {
    match &maps.albedo {
        Some(a) => [a.data[3 * i], a.data[3 * i + 1], a.data[3 * i + 2]],
        None => CLAY,
    }
}

fn camera_normal(maps: &Maps, camera: &Pinhole, i: usize) -> Vec3f {
    let n = &maps.normal.data[3 * i..3 * i + 3];
    camera.direction_to_camera(vec3(n[0], n[1], n[2]))
}

fn picture(maps: &Maps, color: impl Fn(&Maps, usize) -> [f32; 3]) -> Image {
    let mut data = Vec::with_capacity(3 * maps.depth.data.len());
    for (i, z) in maps.depth.data.iter().enumerate() {
        data.extend(if *z > 0.0 { color(maps, i) } else { BACKGROUND });
    }
    Image::from_data(maps.depth.width, maps.depth.height, 3, data)
}
