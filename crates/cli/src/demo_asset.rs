//! The asset of the demo: a glazed vase with spiral ridges on a stone pedestal, with a braided gold collar and beads.
//!
//! Everything is a formula: surfaces of revolution and tubes on fine grids, and textures of noise and bands.

use photofit_geometry::{Mesh, shapes};
use photofit_image::linear_to_srgb_u8;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{Instance, Material, Primitive, Scene, TextureImage, TextureSlot};
use std::f32::consts::TAU;

/// Width of the vase's textures; they are half as high.
const TEXTURE: usize = 1024;
/// Beads around the belly.
const BEADS: usize = 14;
/// Where the collar sits: height and radius of its circle, and of the braid around it.
const COLLAR: [f32; 3] = [1.63, 0.345, 0.055];

/// Outline of the vase from the middle of its foot over the lip to the inside: radius and height.
const VASE: [[f32; 2]; 14] = [
    [0.0, 0.0],
    [0.30, 0.0],
    [0.34, 0.03],
    [0.30, 0.10],
    [0.40, 0.32],
    [0.64, 0.70],
    [0.70, 1.00],
    [0.56, 1.32],
    [0.33, 1.58],
    [0.30, 1.78],
    [0.42, 1.98],
    [0.40, 2.01],
    [0.26, 1.76],
    [0.0, 1.45],
];
/// Outline of the pedestal, likewise; edges are double points.
const PEDESTAL: [[f32; 2]; 12] = [
    [0.0, -0.52],
    [0.78, -0.52],
    [0.80, -0.50],
    [0.80, -0.38],
    [0.74, -0.34],
    [0.66, -0.30],
    [0.62, -0.22],
    [0.64, -0.12],
    [0.72, -0.08],
    [0.72, -0.02],
    [0.69, 0.0],
    [0.0, 0.0],
];

/// The asset: about 300,000 triangles, four materials.
pub(crate) fn demo_asset() -> Scene {
    let mut scene = Scene { name: "vase".into(), ..Scene::default() };
    let glaze = add_material(&mut scene, "glaze", glaze);
    let stone = add_material(&mut scene, "stone", stone);
    let gold = Material { base_color: [0.95, 0.66, 0.27, 1.0], roughness: 0.28, ..Material::default() };
    let ruby = Material {
        base_color: [0.45, 0.015, 0.03, 1.0],
        metallic: 0.0,
        roughness: 0.16,
        ..Material::default()
    };
    scene.materials.push(Material { name: "gold".into(), ..gold });
    scene.materials.push(Material { name: "ruby".into(), ..ruby });
    let (gold, ruby) = (scene.materials.len() - 2, scene.materials.len() - 1);
    place(&mut scene, grid(480, 256, vase), glaze, &[Vec3f::zero()]);
    place(&mut scene, grid(192, 56, pedestal), stone, &[Vec3f::zero()]);
    place(&mut scene, grid(900, 14, collar), gold, &[Vec3f::zero()]);
    let mut bead = shapes::icosphere(10);
    for p in &mut bead.positions {
        *p *= 0.042;
    }
    let beads: Vec<Vec3f> = (0..BEADS)
        .map(|i| {
            let a = TAU * i as f32 / BEADS as f32;
            vec3(0.722 * a.sin(), 1.0, 0.722 * a.cos())
        })
        .collect();
    place(&mut scene, bead, ruby, &beads);
    scene
}

fn place(scene: &mut Scene, mesh: Mesh, material: usize, at: &[Vec3f]) {
    let primitive = scene.primitives.len();
    scene.primitives.push(Primitive { mesh, material });
    scene.instances.extend(at.iter().map(|p| Instance {
        primitive,
        transform: glam::Affine3A::from_translation(glam::vec3(p.x, p.y, p.z)),
    }));
}

/// A sheet over the unit square, closed along u, with uvs and normals by differences.
fn grid(columns: u32, rows: u32, surface: impl Fn(f32, f32) -> Vec3f) -> Mesh {
    let mut mesh = Mesh::default();
    let step = 1e-3;
    for j in 0..=rows {
        for i in 0..=columns {
            let (u, v) = (i as f32 / columns as f32, j as f32 / rows as f32);
            // The seam's two columns carry the same bits.
            let at = |u: f32, v: f32| surface(u.rem_euclid(1.0), v.clamp(0.0, 1.0));
            let du = at(u + step, v) - at(u - step, v);
            let dv = at(u, v + step) - at(u, v - step);
            let normal = du.cross(dv).normalize_or_zero();
            let pole = vec3(0.0, if v < 0.5 { -1.0 } else { 1.0 }, 0.0);
            mesh.positions.push(at(u, v));
            mesh.normals.push(if normal == Vec3f::zero() { pole } else { normal });
            mesh.uvs.push(vec2(u, 1.0 - v));
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let [b, c, d] = [a + 1, a + columns + 1, a + columns + 2];
            mesh.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    // Rows at the axis are points.
    let positions = &mesh.positions;
    mesh.triangles.retain(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        (b - a).cross(c - a).length_squared() > 0.0
    });
    mesh
}

/// A point of a polyline smoothed by Catmull-Rom splines, `t` in [0, 1].
fn outline(points: &[[f32; 2]], t: f32) -> [f32; 2] {
    let n = points.len() - 1;
    let x = t * n as f32;
    let i = (x as usize).min(n - 1);
    let f = x - i as f32;
    let p = |k: isize| points[(i as isize + k).clamp(0, n as isize) as usize];
    std::array::from_fn(|c| {
        let [a, b, d, e] = [p(-1)[c], p(0)[c], p(1)[c], p(2)[c]];
        let tangents = (0.5 * (d - a), 0.5 * (e - b));
        let (f2, f3) = (f * f, f * f * f);
        let value = (2.0 * f3 - 3.0 * f2 + 1.0) * b
            + (f3 - 2.0 * f2 + f) * tangents.0
            + (3.0 * f2 - 2.0 * f3) * d
            + (f3 - f2) * tangents.1;
        if c == 0 { value.max(0.0) } else { value }
    })
}

/// 0 below `a`, 1 above `b`, smooth between.
fn smooth(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Part of the vase, along its outline, that carries ridges.
fn belly(v: f32) -> f32 {
    smooth(0.26, 0.36, v) * (1.0 - smooth(0.52, 0.60, v))
}

/// Height of the relief on the vase, in [0, 1]: spiral ridges with a fine cord on top.
fn relief(u: f32, v: f32) -> f32 {
    let ridge = 0.5 + 0.5 * (TAU * (18.0 * u + 9.0 * v)).sin();
    let cord = 0.5 + 0.5 * (TAU * (90.0 * u - 120.0 * v)).sin();
    ridge.powf(1.6) * (0.86 + 0.14 * cord)
}

fn revolve([r, y]: [f32; 2], u: f32) -> Vec3f {
    let (s, c) = (TAU * u).sin_cos();
    vec3(r * s, y, r * c)
}

fn vase(u: f32, v: f32) -> Vec3f {
    let [r, y] = outline(&VASE, v);
    let foot = smooth(0.0, 0.1, r);
    let lumps = 0.012 * (fbm(12.0 * u, 9.0 * v, 12) - 0.5) * foot;
    revolve([r * (1.0 + 0.075 * belly(v) * relief(u, v)) + lumps, y], u)
}

fn pedestal(u: f32, v: f32) -> Vec3f {
    let [r, y] = outline(&PEDESTAL, v);
    // Flutes around the waist.
    let waist = smooth(-0.34, -0.28, y) * (1.0 - smooth(-0.14, -0.08, y)) * smooth(0.3, 0.5, r);
    let flute = (0.5 + 0.5 * (TAU * 32.0 * u).cos()).sqrt();
    revolve([r * (1.0 - 0.03 * waist * flute), y], u)
}

/// A braid: a torus knot as a tube.
fn collar(u: f32, v: f32) -> Vec3f {
    let [height, circle, braid] = COLLAR;
    let axis = |u: f32| {
        let (turn, wind) = (TAU * 2.0 * u, TAU * 23.0 * u);
        revolve([circle + braid * wind.cos(), height + 0.7 * braid * wind.sin()], turn / TAU)
    };
    let middle = revolve([circle, height], 2.0 * u);
    let tangent = (axis(u + 1e-4) - axis(u - 1e-4)).normalize_or_zero();
    let out = axis(u) - middle;
    let out = (out - tangent * out.dot(tangent)).normalize_or_zero();
    let (s, c) = (TAU * v).sin_cos();
    axis(u) + (out * c + out.cross(tangent) * s) * 0.026
}

/// A fixed pseudo-random number in [0, 1) of a lattice point.
fn lattice(x: i32, y: i32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    ((h ^ (h >> 15)) >> 8) as f32 / (1 << 24) as f32
}

/// Value noise in [0, 1], periodic along x.
fn noise(x: f32, y: f32, period: i32) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let (fx, fy) = (smooth(0.0, 1.0, x - i), smooth(0.0, 1.0, y - j));
    let at = |a: i32, b: i32| lattice((i as i32 + a).rem_euclid(period), j as i32 + b);
    let row = |b: i32| at(0, b) + (at(1, b) - at(0, b)) * fx;
    row(0) + (row(1) - row(0)) * fy
}

/// Four octaves of noise, periodic along x.
fn fbm(x: f32, y: f32, period: i32) -> f32 {
    (0..4)
        .map(|o| noise(x * (1 << o) as f32, y * (1 << o) as f32, period << o) * 0.5_f32.powi(o + 1))
        .sum::<f32>()
        / 0.9375
}

/// A texel of a material: linear base colour, roughness, metalness.
type Texel = ([f32; 3], f32, f32);

fn mix(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
}

/// Teal glaze that pools between the ridges, cream below and above, painted gold bands and speckles.
fn glaze(u: f32, v: f32) -> Texel {
    let cloud = fbm(16.0 * u, 12.0 * v, 16);
    let flow = v + 0.05 * (fbm(24.0 * u, 3.0, 24) - 0.5);
    let teal = mix([0.008, 0.09, 0.12], [0.03, 0.34, 0.33], 0.65 * relief(u, v) * belly(v) + 0.35 * cloud);
    let cream = mix([0.62, 0.50, 0.33], [0.80, 0.72, 0.56], cloud);
    let covered = smooth(0.20, 0.24, flow) * (1.0 - smooth(0.69, 0.74, flow));
    let mut color = mix(cream, teal, covered);
    let mut roughness = 0.55 + (0.2 - 0.55) * covered + 0.12 * (cloud - 0.5);
    let speckle = smooth(0.80, 0.86, noise(140.0 * u, 90.0 * v, 140)) * (1.0 - covered);
    color = mix(color, [0.16, 0.09, 0.04], 0.8 * speckle);
    // Bands with a zigzag between them.
    let line = |at: f32, half: f32| 1.0 - smooth(half, half + 0.002, (v - at).abs());
    let wave = 0.609 + 0.012 * (4.0 * (36.0 * u).fract() - 2.0).abs();
    let paint = line(0.255, 0.004).max(line(0.600, 0.004)).max(line(wave, 0.0025)).max(line(0.645, 0.004));
    color = mix(color, [0.95, 0.68, 0.28], paint);
    roughness += (0.3 - roughness) * paint;
    (color, roughness, paint)
}

/// Dark marble with pale veins.
fn stone(u: f32, v: f32) -> Texel {
    let warp = fbm(10.0 * u, 8.0 * v, 10);
    let vein = (TAU * (3.0 * u + 2.0 * v + 1.6 * warp)).sin().abs();
    let vein = 1.0 - smooth(0.0, 0.14, vein);
    let grain = fbm(60.0 * u, 40.0 * v, 60);
    let color = mix([0.035, 0.034, 0.045], [0.12, 0.11, 0.13], grain);
    (mix(color, [0.62, 0.58, 0.52], 0.75 * vein), 0.35 + 0.25 * grain, 0.0)
}

/// Adds a material with its two textures.
fn add_material(scene: &mut Scene, name: &str, texel: fn(f32, f32) -> Texel) -> usize {
    let (width, height) = (TEXTURE, TEXTURE / 2);
    let at = |i: usize| {
        let (x, y) = (i % width, i / width);
        texel((x as f32 + 0.5) / width as f32, 1.0 - (y as f32 + 0.5) / height as f32)
    };
    let unorm = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let texels: Vec<Texel> = (0..width * height).map(at).collect();
    let mut add = |kind: &str, encode: &dyn Fn(&Texel) -> [u8; 4]| {
        scene.images.push(TextureImage {
            name: format!("{name}-{kind}"),
            width,
            height,
            texels: texels.iter().map(encode).collect(),
            ..TextureImage::default()
        });
        Some(TextureSlot::new(scene.images.len() - 1))
    };
    let base_color_texture = add("base-color", &|(c, _, _)| {
        [linear_to_srgb_u8(c[0]), linear_to_srgb_u8(c[1]), linear_to_srgb_u8(c[2]), 255]
    });
    let metallic_roughness_texture = add("roughness", &|(_, r, m)| [255, unorm(*r), unorm(*m), 255]);
    scene.materials.push(Material {
        name: name.into(),
        base_color_texture,
        metallic_roughness_texture,
        ..Material::default()
    });
    scene.materials.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_asset_is_heavy_and_sound() {
        let scene = demo_asset();
        scene.validate_for_fit().unwrap();
        assert!(scene.triangle_count() >= 200_000, "{}", scene.triangle_count());
        assert!(scene.materials.len() >= 4 && scene.primitives.len() >= 4);
        for p in &scene.primitives {
            let m = &p.mesh;
            assert!(m.positions.iter().all(|p| p.is_finite()));
            assert!(m.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            // Faces and normals agree about where the outside is, on almost all of the surface.
            let outside = (0..m.triangles.len()).filter(|t| {
                let [a, b, c] = m.corners(*t);
                let n = m.triangles[*t].iter().fold(Vec3f::zero(), |s, i| s + m.normals[*i as usize]);
                (b - a).cross(c - a).dot(n) > 0.0
            });
            assert!(outside.count() as f64 > 0.99 * m.triangles.len() as f64);
        }
    }

    #[test]
    fn noise_is_periodic() {
        for k in 0..20 {
            let y = 0.37 * k as f32;
            assert!((fbm(0.0, y, 8) - fbm(8.0, y, 8)).abs() < 1e-5);
        }
    }
}
