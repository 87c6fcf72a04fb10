//! Shrink-wrapping: a mesh of given topology is pulled onto the reference before anything is rendered.
//!
//! The squared distances between the two surfaces, both ways (a symmetric chamfer distance), are lowered by
//! preconditioned steps: each vertex wants to go to the mean of what pulls at it, and the motion is smoothed by
//! `(I + lambda L)^-1` (Nicolet et al. 2021) with `lambda` falling from stage to stage, so that the shape follows as a
//! whole first and in detail last.

use crate::bake::{BakeError, ReferenceSurface};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::{Edges, Mesh, weld::weld_exact};
use photofit_optim::LargeSteps;
use photofit_rays::Accel;
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Share of the way that a step goes.
const STEP: f32 = 0.8;
/// Most points of the reference that pull.
const MOST_SAMPLES: usize = 250_000;
/// Seed of the points.
const SEED: u64 = 0x7772_6170;

/// How to wrap.
pub(super) struct Wrap {
    /// Smoothness of each stage.
    lambda: &'static [f64],
    /// Steps in a stage.
    steps: u64,
    /// Points of the reference that pull, per vertex of the mesh.
    samples_per_vertex: usize,
    /// Which points of the reference are left out as gone from the mesh; `None`: all pull.
    gone: Option<Gone>,
}

/// A decimated mesh has lost whole parts (ropes, rivets): their points must not pull at what is left.
#[derive(Clone, Copy)]
struct Gone {
    /// Least cosine between the normals of the point and of the triangle that is nearest to it.
    cosine: f32,
    /// Most distance in sizes of that triangle (square root of twice its area).
    sizes: f32,
}

/// A point of a surface with the normal there.
pub(crate) struct Sample {
    pub(crate) at: Vec3f,
    /// Unit length, or zero for a triangle without area.
    pub(crate) normal: Vec3f,
}

/// From a shape that has nothing to do with the reference.
pub(super) const FROM_AFAR: Wrap =
    Wrap { lambda: &[200.0, 60.0, 20.0, 6.0, 2.0, 0.6], steps: 12, samples_per_vertex: 8, gone: None };
/// From a decimated reference: quadrics look at single vertices, this at the whole surface.
pub(super) const NEARBY: Wrap =
    Wrap { lambda: &[0.1], steps: 15, samples_per_vertex: 64, gone: Some(Gone { cosine: 0.5, sizes: 0.25 }) };

impl Wrap {
    /// Pulls `mesh` onto what can be seen of the reference; vertices at one place move together, and those that are `locked`
    /// (empty: none is) not at all.
    pub(super) fn run(
        &self,
        mesh: &mut Mesh,
        locked: &[bool],
        reference: &ReferenceSurface<'_>,
        (seen, weights): (&Visibility, &[f32]),
        progress: &dyn Progress,
    ) -> Result<(), FitError> {
        let weld = weld_exact(&mesh.positions);
        let mut positions = weld.pick(&mesh.positions);
        let held: Vec<(usize, Vec3f)> = (0..locked.len())
            .filter(|v| locked[*v])
            .map(|v| (weld.ids[v] as usize, mesh.positions[v]))
            .collect();
        let triangles = weld.triangles(&mesh.triangles);
        let edges = Edges::new(&mesh.triangles, &weld);
        let count = (self.samples_per_vertex * positions.len()).min(MOST_SAMPLES);
        let samples = sample(reference.mesh(), (seen, weights), count);
        let total = self.lambda.len() as u64 * self.steps;
        for (stage, lambda) in self.lambda.iter().enumerate() {
            let smooth = LargeSteps::new(positions.len(), &edges.vertices, *lambda)
                .map_err(FitError::Preconditioner)?;
            for step in 0..self.steps {
                progress.report("wrap", stage as u64 * self.steps + step, total, "");
                if progress.is_cancelled() {
                    return Err(FitError::Interrupted);
                }
                let pull = self.pull(&positions, &triangles, reference, seen, &samples)?;
                let motion = smooth.to_x(bytemuck::cast_slice(&pull)).map_err(FitError::Preconditioner)?;
                for (p, m) in positions.iter_mut().zip(bytemuck::cast_slice::<f32, Vec3f>(&motion)) {
                    *p += *m * STEP;
                }
                held.iter().for_each(|(v, p)| positions[*v] = *p);
            }
        }
        mesh.positions = weld.expand(&positions);
        Ok(())
    }

    /// Where each vertex wants to go, relative to where it is.
    fn pull(
        &self,
        positions: &[Vec3f],
        triangles: &[[u32; 3]],
        reference: &ReferenceSurface<'_>,
        seen: &Visibility,
        samples: &[Sample],
    ) -> Result<Vec<Vec3f>, FitError> {
        let own: Vec<Option<Vec3f>> = positions
            .par_iter()
            .map(|p| {
                let visible = |n: &photofit_rays::NearestPoint| seen.is_visible(n.triangle as usize);
                let n = reference.accel().closest_point_where(*p, f32::INFINITY, visible)?;
                let [a, b, c] = reference.mesh().corners(n.triangle as usize);
                Some(a + (b - a) * n.u + (c - a) * n.v - *p)
            })
            .collect();
        let accel = Accel::build(positions, triangles)
            .map_err(|source| BakeError::Geometry { mesh: "target", source })?;
        let nearest: Vec<_> = samples.par_iter().map(|s| accel.closest_point(s.at, f32::INFINITY)).collect();
        // A weighted mean of the pulls at a vertex; the sums run in a fixed order.
        let mut sum: Vec<(Vec3f, f32)> =
            own.iter().map(|p| p.map_or((Vec3f::zero(), 0.0), |p| (p, 1.0))).collect();
        for (s, n) in samples.iter().zip(&nearest) {
            let Some(n) = n else { continue };
            let t = triangles[n.triangle as usize].map(|i| i as usize);
            let corners = t.map(|i| positions[i]);
            if self.gone.is_some_and(|g| g.holds(s, corners, n.distance)) {
                continue;
            }
            let w = [1.0 - n.u - n.v, n.u, n.v];
            let at = (0..3).fold(Vec3f::zero(), |at, k| at + corners[k] * w[k]);
            for k in 0..3 {
                sum[t[k]].0 += (s.at - at) * w[k];
                sum[t[k]].1 += w[k] * w[k];
            }
        }
        Ok(sum.into_iter().map(|(p, w)| if w > 0.0 { p * (1.0 / w) } else { Vec3f::zero() }).collect())
    }
}

impl Gone {
    /// Whether the surface at `sample` is gone from the mesh, whose nearest triangle has these `corners`.
    fn holds(self, sample: &Sample, [a, b, c]: [Vec3f; 3], distance: f32) -> bool {
        let normal = (b - a).cross(c - a);
        let size = normal.length();
        sample.normal.dot(normal) < self.cosine * size || distance > self.sizes * size.sqrt()
    }
}

/// Points on the visible triangles, evenly by area times weight (empty: 1 everywhere).
pub(crate) fn sample(mesh: &Mesh, (seen, weights): (&Visibility, &[f32]), count: usize) -> Vec<Sample> {
    let mut sum = 0.0;
    let visible: Vec<(usize, f64)> = (0..mesh.triangles.len())
        .filter(|t| seen.is_visible(*t))
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            let weight = weights.get(t).copied().unwrap_or(1.0);
            sum += f64::from((b - a).cross(c - a).length() * weight);
            (t, sum)
        })
        .collect();
    let mut rng = Rng::new(SEED, 0);
    (0..count)
        .filter_map(|i| {
            // One point in each of `count` equal shares of the area.
            let at = (i as f64 + f64::from(rng.next_f32())) / count as f64 * sum;
            let k = visible.partition_point(|(_, end)| *end <= at).min(visible.len().checked_sub(1)?);
            let [a, b, c] = mesh.corners(visible[k].0);
            let (u, v) = (rng.next_f32(), rng.next_f32());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            Some(Sample {
                at: a + (b - a) * u + (c - a) * v,
                normal: (b - a).cross(c - a).normalize_or_zero(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;
    use crate::bake::tests::World;
    use photofit_geometry::shapes;
    use photofit_scalar::vec3;
    use photofit_scene::Material;

    #[test]
    fn a_decimated_shape_comes_closer() {
        let shape = shapes::displaced_sphere(40, 0.3, 4, 5);
        let mut world = World::default();
        world.add(&shape, Material::clay());
        let seen = world.visibility();
        let target = photofit_geometry::decimate::Target::Triangles(300);
        let options = photofit_geometry::decimate::Options::new(target);
        let group = vec![0; shape.triangles.len()];
        let mut mesh = photofit_geometry::decimate::decimate(&shape, &group, &[], &options).unwrap().mesh;
        let distance = |mesh: &Mesh| {
            let accel = Accel::build(&mesh.positions, &mesh.triangles).unwrap();
            let squared = |p: &Vec3f| f64::from(accel.closest_point(*p, 10.0).unwrap().distance).powi(2);
            (shape.positions.iter().map(squared).sum::<f64>() / shape.positions.len() as f64).sqrt()
        };
        let before = distance(&mesh);
        world.with(|r| NEARBY.run(&mut mesh, &[], r, (&seen, &[]), &Silent).unwrap());
        assert!(distance(&mesh) < 0.99 * before, "rms distance {before} became {}", distance(&mesh));
    }

    #[test]
    fn parts_that_are_gone_do_not_pull() {
        let mut world = World::default();
        world.add(&shapes::icosphere(16), Material::clay());
        world.add(&shapes::torus(64, 6, 1.5, 0.01), Material::clay());
        let seen = world.visibility();
        let farthest = |wrap: &Wrap| {
            let mut mesh = shapes::icosphere(4);
            mesh.normals.clear();
            world.with(|r| wrap.run(&mut mesh, &[], r, (&seen, &[]), &Silent).unwrap());
            mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max)
        };
        let kept = farthest(&NEARBY);
        assert!(kept < 1.03, "a ring that the mesh does not hold pulls it out to {kept}");
        let torn = farthest(&Wrap { gone: None, ..NEARBY });
        assert!(torn > 1.05, "the ring would pull at the mesh: {torn}");
    }

    #[test]
    fn a_sphere_becomes_the_shape_around_it() {
        let mut target = shapes::torus(48, 24, 1.0, 0.45);
        target.positions.iter_mut().for_each(|p| *p = vec3(p.x, p.y * 1.3, p.z) + vec3(0.1, 0.2, 0.0));
        // A torus is no sphere: its hole stays closed. A displaced sphere is.
        let bumpy = shapes::displaced_sphere(24, 0.3, 3, 5);
        for (shape, limit) in [(bumpy, 0.012), (target, 0.25)] {
            let mut world = World::default();
            world.add(&shape, Material::clay());
            let seen = world.visibility();
            let mut mesh = shapes::icosphere(8);
            mesh.normals.clear();
            let distance = world.with(|r| {
                FROM_AFAR.run(&mut mesh, &[], r, (&seen, &[]), &Silent).unwrap();
                let reach = |p: &Vec3f| r.accel().closest_point(*p, 10.0).unwrap().distance;
                mesh.positions.iter().map(reach).sum::<f32>() / mesh.positions.len() as f32
            });
            assert!(distance < limit, "mean distance {distance}");
            let back = Accel::build(&mesh.positions, &mesh.triangles).unwrap();
            let reach = |p: &Vec3f| back.closest_point(*p, 10.0).unwrap().distance;
            let far = shape.positions.iter().map(reach).sum::<f32>() / shape.positions.len() as f32;
            assert!(far < limit, "mean distance back {far}");
        }
    }
}
