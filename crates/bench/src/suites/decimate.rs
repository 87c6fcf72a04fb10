//! Decimation by quadrics to 3% of the triangles, against clustering of vertices (Rossignac and Borrel 1993).

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use photofit_geometry::decimate::{Options, Target, decimate};
use photofit_geometry::{Mesh, shapes};
use photofit_rays::Accel;
use photofit_scalar::{Vec3, Vec3f, vec3};

use crate::context::Context;

const RATIO: f64 = 0.03;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    for frequency in [32, 71, 158] {
        let mesh = shapes::displaced_sphere(frequency, 0.2, 5, 3);
        let count = mesh.triangles.len();
        let case = format!("{count} triangles");
        let options = Options::new(Target::Ratio(RATIO));
        let light = ctx.measure(
            "quadrics",
            &case,
            count,
            || decimate(&mesh, &[], &[], &options).map(|d| d.mesh),
            |light| light.as_ref().map_or_else(|_| vec![], |light| figures(&mesh, light)),
        )?;
        if ctx.baseline() {
            let cells = cells_for(&mesh, light.triangles.len());
            ctx.measure("clustering", &case, count, || cluster(&mesh, cells), |light| figures(&mesh, light));
        }
        ensure!(light.triangles.len() as f64 <= RATIO * count as f64, "the budget is kept");
    }
    ctx.note(
        "The error is the root mean square distance of the original vertices to the light mesh over the diagonal of \
         the bounding box. Clustering gets the finest grid that keeps the same budget; finding it is not timed.",
    );
    Ok(())
}

/// Error and number of triangles.
fn figures(mesh: &Mesh, light: &Mesh) -> Vec<(&'static str, f64)> {
    let Ok(accel) = Accel::build(&light.positions, &light.triangles) else { return vec![] };
    let diagonal = mesh.bounds().map_or(1.0, |(lo, hi)| f64::from((hi - lo).length()));
    let step = (mesh.positions.len() / 8192).max(1);
    let squares: Vec<f64> = mesh
        .positions
        .iter()
        .step_by(step)
        .filter_map(|p| accel.closest_point(*p, f32::INFINITY))
        .map(|nearest| f64::from(nearest.distance).powi(2))
        .collect();
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    vec![("relative error", mean.sqrt() / diagonal), ("triangles", light.triangles.len() as f64)]
}

/// Joins all vertices of a grid cell at their mean; `cells` to the longest side.
fn cluster(mesh: &Mesh, cells: u32) -> Mesh {
    let Some((lo, hi)) = mesh.bounds() else { return Mesh::default() };
    let size = hi - lo;
    let scale = cells as f32 / size.x.max(size.y).max(size.z);
    let cell = |p: &Vec3f| ((*p - lo) * scale).to_array().map(|c| c as u32);
    let mut ids = BTreeMap::new();
    let mut sums: Vec<(Vec3<f64>, f64)> = Vec::new();
    let of_vertex: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            let id = *ids.entry(cell(p)).or_insert_with(|| {
                sums.push((vec3(0.0, 0.0, 0.0), 0.0));
                sums.len() - 1
            });
            sums[id].0 += p.cast();
            sums[id].1 += 1.0;
            id as u32
        })
        .collect();
    let joined = mesh.triangles.iter().map(|t| t.map(|v| of_vertex[v as usize]));
    Mesh {
        positions: sums.iter().map(|(sum, n)| (*sum * (1.0 / n)).cast()).collect(),
        triangles: joined.filter(|[a, b, c]| a != b && b != c && c != a).collect(),
        ..Mesh::default()
    }
}

/// The finest grid that leaves at most `budget` triangles.
fn cells_for(mesh: &Mesh, budget: usize) -> u32 {
    let (mut low, mut high) = (1, 1024);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if cluster(mesh, middle).triangles.len() <= budget {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clustering_keeps_the_budget_and_the_shape() {
        let mesh = shapes::displaced_sphere(12, 0.2, 3, 3);
        let cells = cells_for(&mesh, 600);
        let light = cluster(&mesh, cells);
        assert!(light.triangles.len() <= 600 && light.triangles.len() > 200, "{}", light.triangles.len());
        assert!(cluster(&mesh, cells + 1).triangles.len() > 600);
        let error = figures(&mesh, &light)[0].1;
        assert!(error > 1e-4 && error < 0.05, "{error}");
    }
}
