//! Packets of four triangles and their watertight intersection.

use super::Hit;
use super::walk::Slabs;
use bytemuck::{Pod, Zeroable};
use glam::{BVec4A, Vec3, Vec3A, Vec4};

/// Up to four triangles side by side; unused lanes are NaN, which no comparison accepts.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Packet {
    /// Corner, then axis.
    pub(super) corners: [[Vec4; 3]; 3],
    /// Triangle indices; [`Self::UNUSED`] in unused lanes, which come last.
    pub(super) ids: [u32; 4],
}

/// What the triangle test needs of a ray: the largest axis of the direction becomes z, a shear makes it (0, 0, 1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Shear {
    pub(super) axes: [usize; 3],
    /// Origin in the order of `axes`.
    pub(super) origin: [Vec4; 3],
    /// `dx/dz`, `dy/dz`, `1/dz`.
    pub(super) shear: [Vec4; 3],
}

impl Shear {
    /// `direction` must be finite and not zero; `slabs` are those of the same ray.
    #[inline(always)]
    pub(super) fn new(origin: Vec3A, direction: Vec3A, slabs: &Slabs) -> Self {
        // No branch depends on the ray, for it would be guessed wrong: numbers are picked by index.
        let pick = |v: Vec3A| v.extend(0.0).to_array();
        let (o, d, inverse) = (pick(origin), pick(direction), pick(slabs.inverse));
        let a = pick(direction.abs());
        let first = (a[0] > a[1]) & (a[0] > a[2]);
        let z = if first { 0 } else { 2 - usize::from(a[1] > a[2]) };
        let axes = AXES[2 * z + (slabs.negative >> z & 1) as usize];
        let [x, y, _] = axes;
        // That of the largest component is not changed for the slabs.
        let inverse = inverse[z];
        Self {
            axes,
            origin: axes.map(|k| Vec4::splat(o[k])),
            shear: [Vec4::splat(d[x] * inverse), Vec4::splat(d[y] * inverse), Vec4::splat(inverse)],
        }
    }
}

/// Axes by the largest one and its sign. Two are exchanged where it is negative, which keeps the winding: the
/// sign of the determinant tells the side.
const AXES: [[usize; 3]; 6] = [[1, 2, 0], [2, 1, 0], [2, 0, 1], [0, 2, 1], [0, 1, 2], [1, 0, 2]];

/// Answers of one packet test; lanes outside of `mask` are meaningless.
pub(super) struct PacketHits {
    pub(super) mask: u32,
    t: [f32; 4],
    u: [f32; 4],
    v: [f32; 4],
    front: u32,
}

impl PacketHits {
    #[inline(always)]
    pub(super) fn lane(&self, packet: &Packet, lane: usize) -> Hit {
        Hit {
            t: self.t[lane],
            triangle: packet.ids[lane],
            u: self.u[lane],
            v: self.v[lane],
            front: self.front & (1 << lane) != 0,
        }
    }
}

impl Packet {
    const UNUSED: u32 = u32::MAX;

    pub(super) fn new(ids: impl Iterator<Item = u32>, corners: impl Fn(u32) -> [Vec3A; 3]) -> Self {
        let mut packet = Self { corners: [[Vec4::NAN; 3]; 3], ids: [Self::UNUSED; 4] };
        for (lane, id) in ids.enumerate() {
            packet.ids[lane] = id;
            for (corner, p) in corners(id).into_iter().enumerate() {
                for axis in 0..3 {
                    packet.corners[corner][axis][lane] = p[axis];
                }
            }
        }
        packet
    }

    /// Lanes in use.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.ids.iter().filter(|&&id| id != Self::UNUSED).count()
    }

    /// Corners of the triangle in `lane`.
    #[inline(always)]
    pub(super) fn triangle(&self, lane: usize) -> [Vec3; 3] {
        std::array::from_fn(|c| {
            let [x, y, z] = &self.corners[c];
            glam::vec3(x[lane], y[lane], z[lane])
        })
    }

    /// Tests all lanes for hits with `t` in `[t_min, t_max]`, both finite.
    #[inline(always)]
    pub(super) fn intersect(&self, ray: &Shear, t_min: f32, t_max: f32) -> PacketHits {
        let [x, y, z] = ray.axes;
        let [a, b, c] = &self.corners;
        let (az, bz, cz) = (a[z] - ray.origin[2], b[z] - ray.origin[2], c[z] - ray.origin[2]);
        let ax = (a[x] - ray.origin[0]) - ray.shear[0] * az;
        let ay = (a[y] - ray.origin[1]) - ray.shear[1] * az;
        let bx = (b[x] - ray.origin[0]) - ray.shear[0] * bz;
        let by = (b[y] - ray.origin[1]) - ray.shear[1] * bz;
        let cx = (c[x] - ray.origin[0]) - ray.shear[0] * cz;
        let cy = (c[y] - ray.origin[1]) - ray.shear[1] * cz;
        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;
        let zero = Vec4::ZERO;
        let none = PacketHits { mask: 0, t: [0.0; 4], u: [0.0; 4], v: [0.0; 4], front: 0 };
        let one_sided = |u: Vec4, v: Vec4, w: Vec4| u.min(v).min(w).cmpge(zero) | u.max(v).max(w).cmple(zero);
        let mut inside = one_sided(u, v, w);
        if !inside.any() {
            return none;
        }
        // Single precision decides the sign of each value that is not zero, hence only these need more.
        let on_edge = inside & (u.cmpeq(zero) | v.cmpeq(zero) | w.cmpeq(zero));
        if on_edge.any() {
            (u, v, w) = in_double([ax, ay, bx, by, cx, cy], on_edge, [u, v, w]);
            inside = one_sided(u, v, w);
        }
        let det = u + v + w;
        // Quotients, not products with a reciprocal: that of a tiny determinant would overflow.
        let t = (u * az + v * bz + w * cz) / det * ray.shear[2];
        let mask = inside & det.cmpne(zero) & t.cmpge(Vec4::splat(t_min)) & t.cmple(Vec4::splat(t_max));
        if !mask.any() {
            return none;
        }
        PacketHits {
            mask: mask.bitmask(),
            t: t.to_array(),
            u: (v / det).to_array(),
            v: (w / det).to_array(),
            front: det.cmpgt(zero).bitmask(),
        }
    }
}

/// Edge functions again in double precision for the lanes that need it: products of singles are exact there.
#[cold]
fn in_double(p: [Vec4; 6], lanes: BVec4A, uvw: [Vec4; 3]) -> (Vec4, Vec4, Vec4) {
    let [mut u, mut v, mut w] = uvw;
    for lane in (0..4).filter(|&l| lanes.test(l)) {
        let [ax, ay, bx, by, cx, cy] = p.map(|q| f64::from(q[lane]));
        u[lane] = sign_kept(cx * by - cy * bx);
        v[lane] = sign_kept(ax * cy - ay * cx);
        w[lane] = sign_kept(bx * ay - by * ax);
    }
    (u, v, w)
}

/// Rounds to single without losing the sign of a value that is not zero.
fn sign_kept(x: f64) -> f32 {
    let y = x as f32;
    if y == 0.0 && x != 0.0 { f32::MIN_POSITIVE.copysign(x as f32) } else { y }
}
