//! Samples of one material that are shaded together, eight at a time: each formula runs over arrays of eight numbers,
//! which the compiler turns into vectors. Every sample goes through the operations that it would go through alone.

use super::{Shading, TILE};
use crate::engine::reference::ENERGY;
use photofit_raster::interpolate::{derivatives, interpolate};
use photofit_raster::rasterize::{Barycentrics, barycentrics};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use photofit_scene::SurfacePacket;
use photofit_shading::{Light, Surface, face_viewer, perturb, shade, view_direction};

/// Numbers that one instruction takes.
const WIDE: usize = 8;
/// Packets of as many samples that are shaded together: their data stay in the nearest cache.
const PACKETS: usize = 8;
/// Samples that are shaded together.
pub(super) const MOST: usize = WIDE * PACKETS;

type Lanes = [f32; WIDE];
/// One number per sample. What a whole packet writes at the last sample has a place.
type Column = [Lanes; PACKETS + 1];
type Columns<const C: usize> = [Column; C];

/// The three corners of a triangle.
pub(super) struct Corners {
    clip: [Vec4f; 3],
    position: [[f32; 3]; 3],
    normal: [[f32; 3]; 3],
    /// Where the material has a normal map.
    tangent: Option<[[f32; 3]; 3]>,
    handedness: f32,
    /// Both sets of texture coordinates, where something reads them.
    uv: Option<[[f32; 4]; 3]>,
    color: Option<[[f32; 4]; 3]>,
    /// Normal of the triangle, of any length.
    geometric: Vec3f,
}

impl Corners {
    #[inline(always)]
    pub(super) fn load(of: &Shading<'_>, material: usize, triangle: usize) -> Self {
        let mesh = &of.renderer.flat.mesh;
        let id = mesh.triangles[triangle].map(|i| i as usize);
        let [p0, p1, p2] = id.map(|i| mesh.positions[i]);
        let uv = |set: &[Vec2f], i: usize| if set.is_empty() { [0.0; 2] } else { set[i].to_array() };
        let uvs = |i: usize| {
            let ([a, b], [c, d]) = (uv(&mesh.uvs, i), uv(&mesh.uvs1, i));
            [a, b, c, d]
        };
        let mapped = is_bumped(of, material);
        Self {
            clip: id.map(|i| of.clip[i]),
            position: [p0, p1, p2].map(Vec3f::to_array),
            normal: id.map(|i| mesh.normals[i].to_array()),
            tangent: mapped.then(|| id.map(|i| mesh.tangents[i].xyz().to_array())),
            handedness: if mapped { mesh.tangents[id[0]].w } else { 1.0 },
            uv: reads_uvs(of, material).then(|| id.map(uvs)),
            color: (!mesh.colors.is_empty()).then(|| id.map(|i| mesh.colors[i].to_array())),
            geometric: (p1 - p0).cross(p2 - p0),
        }
    }
}

/// Samples of one material with what is interpolated over their triangles.
#[derive(Default)]
pub(super) struct Fragments {
    len: usize,
    position: Columns<3>,
    normal: Columns<3>,
    tangent: Columns<3>,
    handedness: Column,
    geometric: Columns<3>,
    uv: Columns<4>,
    /// Derivatives of [`Self::uv`] along x, then along y.
    uv_dx: Columns<4>,
    uv_dy: Columns<4>,
    color: Columns<4>,
    surface: Surfaces,
    radiance: Columns<3>,
}

/// What samples are made of.
#[derive(Default)]
struct Surfaces {
    base_color: Columns<3>,
    roughness: Column,
    metallic: Column,
    normal: Columns<3>,
    emissive: Columns<3>,
    alpha: Column,
}

/// Whether a material has textures that are read, and the asset something to read them at.
#[inline(always)]
fn reads_uvs(of: &Shading<'_>, material: usize) -> bool {
    let mesh = &of.renderer.flat.mesh;
    !(of.renderer.library.is_constant(material) || mesh.uvs.is_empty() && mesh.uvs1.is_empty())
}

/// Whether a normal map is drawn.
#[inline(always)]
fn is_bumped(of: &Shading<'_>, material: usize) -> bool {
    of.renderer.library.has_normal_map(material) && !of.renderer.flat.mesh.tangents.is_empty()
}

/// Writes a packet whose first lane is sample `first`.
#[inline(always)]
fn store<const C: usize>(columns: &mut Columns<C>, first: usize, lanes: &[Lanes; C]) {
    for (column, lanes) in columns.iter_mut().zip(lanes) {
        column.as_flattened_mut()[first..first + WIDE].copy_from_slice(lanes);
    }
}

/// An attribute of a packet.
#[inline(always)]
fn interpolated<const C: usize>(corners: &[[f32; C]; 3], b: &[Barycentrics<f32>; WIDE]) -> [Lanes; C] {
    let mut out = [[0.0; WIDE]; C];
    for l in 0..WIDE {
        let a = interpolate([&corners[0], &corners[1], &corners[2]], &b[l]);
        for c in 0..C {
            out[c][l] = a[c];
        }
    }
    out
}

/// Vector number `l` of a packet.
#[inline(always)]
fn vector(columns: &Columns<3>, packet: usize, l: usize) -> Vec3f {
    vec3(columns[0][packet][l], columns[1][packet][l], columns[2][packet][l])
}

#[inline(always)]
fn set<const C: usize>(columns: &mut Columns<C>, at: usize, values: [f32; C]) {
    for (column, value) in columns.iter_mut().zip(values) {
        column[at / WIDE][at % WIDE] = value;
    }
}

impl Fragments {
    /// Forgets all samples.
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds samples of one triangle, at most [`MOST`] in all: `keys` ends with their places in the tile whose first sample
    /// is `corner`.
    #[inline(always)]
    pub(super) fn add(&mut self, of: &Shading<'_>, corners: &Corners, corner: (usize, usize), keys: &[u64]) {
        for keys in keys.chunks(WIDE) {
            let first = self.len;
            let (mut x, mut y) = ([0.0; WIDE], [0.0; WIDE]);
            for (l, key) in keys.iter().enumerate() {
                let place = (key & 0xffff_ffff) as usize;
                let (column, row) = (place % TILE, place / TILE);
                let f = of.grid.ndc(corner.0 + column, corner.1 + row);
                (x[l], y[l]) = (f.x, f.y);
            }
            self.add_packet(of, corners, first, &x, &y);
            self.len += keys.len();
        }
    }

    #[inline(always)]
    fn add_packet(&mut self, of: &Shading<'_>, corners: &Corners, first: usize, x: &Lanes, y: &Lanes) {
        let mut b = [Barycentrics { u: 0.0, v: 0.0, du: Vec2f::zero(), dv: Vec2f::zero() }; WIDE];
        for l in 0..WIDE {
            b[l] = barycentrics(&corners.clip, vec2(x[l], y[l]), of.grid);
        }
        store(&mut self.position, first, &interpolated(&corners.position, &b));
        store(&mut self.normal, first, &interpolated(&corners.normal, &b));
        store(&mut self.geometric, first, &corners.geometric.to_array().map(|c| [c; WIDE]));
        if let Some(tangent) = &corners.tangent {
            store(&mut self.tangent, first, &interpolated(tangent, &b));
            self.handedness.as_flattened_mut()[first..first + WIDE].fill(corners.handedness);
        }
        if let Some(uv) = &corners.uv {
            store(&mut self.uv, first, &interpolated(uv, &b));
            let (mut dx, mut dy) = ([[0.0; WIDE]; 4], [[0.0; WIDE]; 4]);
            for l in 0..WIDE {
                let d = derivatives([&uv[0], &uv[1], &uv[2]], &b[l]);
                for c in 0..4 {
                    (dx[c][l], dy[c][l]) = (d[c].x, d[c].y);
                }
            }
            store(&mut self.uv_dx, first, &dx);
            store(&mut self.uv_dy, first, &dy);
        }
        if let Some(color) = &corners.color {
            store(&mut self.color, first, &interpolated(color, &b));
        }
    }

    /// Radiance and alpha of sample `i`, once they are shaded; without alpha the radiance means nothing.
    #[inline(always)]
    pub(super) fn radiance_alpha(&self, i: usize) -> (Vec3f, f32) {
        let (packet, l) = (i / WIDE, i % WIDE);
        (vector(&self.radiance, packet, l), self.surface.alpha[packet][l])
    }

    /// Shades all samples.
    #[inline(always)]
    pub(super) fn shade(&mut self, of: &Shading<'_>, material: usize) {
        let unlit = of.renderer.library.factors(material).unlit;
        self.look_up(of, material);
        for packet in 0..self.len.div_ceil(WIDE) {
            let rgb = if unlit {
                self.surface.base_color.map(|c| c[packet])
            } else {
                self.lit(of, material, packet)
            };
            for (column, lanes) in self.radiance.iter_mut().zip(rgb) {
                column[packet] = lanes;
            }
        }
    }

    /// What all samples are made of.
    #[inline(always)]
    fn look_up(&mut self, of: &Shading<'_>, material: usize) {
        let library = of.renderer.library;
        let (colored, read) = (!of.renderer.flat.mesh.colors.is_empty(), reads_uvs(of, material));
        let mut points = SurfacePacket::<WIDE>::WHITE;
        let mut samples = [library.factors(material); WIDE];
        for packet in 0..self.len.div_ceil(WIDE) {
            for c in 0..4 {
                if read {
                    points.uv[c] = self.uv[c][packet];
                    points.dx[c] = self.uv_dx[c][packet];
                    points.dy[c] = self.uv_dy[c][packet];
                }
                if colored {
                    points.color[c] = self.color[c][packet];
                }
            }
            let n = (self.len - packet * WIDE).min(WIDE);
            library.lookup_packet(material, &points, n, &mut samples);
            let out = &mut self.surface;
            for (l, s) in samples.iter().enumerate() {
                let i = packet * WIDE + l;
                set(&mut out.base_color, i, s.base_color.to_array());
                set(&mut out.normal, i, s.normal.to_array());
                set(&mut out.emissive, i, s.emissive.to_array());
                (out.roughness[packet][l], out.metallic[packet][l]) = (s.roughness, s.metallic);
                out.alpha[packet][l] = s.alpha;
            }
        }
    }

    /// Radiance of a packet, channel by channel.
    #[inline(always)]
    fn lit(&self, of: &Shading<'_>, material: usize, packet: usize) -> [Lanes; 3] {
        let s = &self.surface;
        let mapped = is_bumped(of, material);
        let mut normal = [Vec3f::zero(); WIDE];
        if mapped {
            for l in 0..WIDE {
                let (n, t) = (vector(&self.normal, packet, l), vector(&self.tangent, packet, l));
                normal[l] = perturb(n, t, self.handedness[packet][l], vector(&s.normal, packet, l));
            }
        } else {
            for l in 0..WIDE {
                normal[l] = vector(&self.normal, packet, l).normalize_or_zero();
            }
        }
        let (mut position, mut wo) = ([Vec3f::zero(); WIDE], [Vec3f::zero(); WIDE]);
        let mut surface = [Surface::default(); WIDE];
        for l in 0..WIDE {
            position[l] = vector(&self.position, packet, l);
            wo[l] = view_direction(of.eye, position[l]);
            normal[l] = face_viewer(normal[l], vector(&self.geometric, packet, l), wo[l]);
            let base_color = vector(&s.base_color, packet, l);
            let (roughness, metallic) = (s.roughness[packet][l], s.metallic[packet][l]);
            surface[l] = Surface { base_color, roughness, metallic, gamma: 0.0 };
        }
        let mut out = [[0.0; WIDE]; 3];
        for light in of.lights {
            // A loop for each kind, so that none is chosen within it.
            let seen = Seen { surface: &surface, position: &position, normal: &normal, wo: &wo };
            match *light {
                Light::Point { position, intensity } => {
                    seen.add(Light::Point { position, intensity }, &mut out);
                }
                Light::Directional { direction, irradiance } => {
                    seen.add(Light::Directional { direction, irradiance }, &mut out);
                }
                Light::Ambient { radiance } => seen.add(Light::Ambient { radiance }, &mut out),
                Light::Environment { map, rotation, scale } => {
                    seen.add(Light::Environment { map, rotation, scale }, &mut out);
                }
            }
        }
        for l in 0..WIDE {
            let emissive = vector(&s.emissive, packet, l);
            out[0][l] += emissive.x;
            out[1][l] += emissive.y;
            out[2][l] += emissive.z;
        }
        out
    }
}

/// A packet as lights see it.
struct Seen<'a> {
    surface: &'a [Surface; WIDE],
    position: &'a [Vec3f; WIDE],
    normal: &'a [Vec3f; WIDE],
    wo: &'a [Vec3f; WIDE],
}

impl Seen<'_> {
    /// Adds the light that comes back from a light.
    #[inline(always)]
    fn add(&self, light: Light<'_, f32>, out: &mut [Lanes; 3]) {
        for l in 0..WIDE {
            let (p, n, wo) = (self.position[l], self.normal[l], self.wo[l]);
            let rgb = shade(&self.surface[l], ENERGY, p, n, wo, &[light]);
            out[0][l] += rgb.x;
            out[1][l] += rgb.y;
            out[2][l] += rgb.z;
        }
    }
}
