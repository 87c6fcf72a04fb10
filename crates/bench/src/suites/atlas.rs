//! Unwrapping: time, share of the texture in use and stretch over the number of triangles.

use anyhow::Result;
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::decimate::{Options, Target, decimate};
use photofit_geometry::shapes;

use crate::context::Context;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let heavy = shapes::displaced_sphere(71, 0.35, 5, 3);
    for budget in [1_000, 3_000, 10_000, 30_000] {
        let mesh = decimate(&heavy, &[], &[], &Options::new(Target::Triangles(budget)))?.mesh;
        let count = mesh.triangles.len();
        let group = vec![0; count];
        let case = format!("{count} triangles");
        let options = UnwrapOptions::default();
        ctx.measure(
            "unwrap",
            &case,
            count,
            || unwrap(&mesh.positions, &mesh.triangles, &group, &options),
            |atlas| {
                atlas.as_ref().map_or_else(
                    |_| vec![],
                    |atlas| {
                        vec![
                            ("mean stretch - 1", f64::from(atlas.stretch.mean) - 1.0),
                            ("largest stretch", f64::from(atlas.stretch.max)),
                            ("share in use", f64::from(atlas.occupancy)),
                            ("charts", f64::from(atlas.charts)),
                        ]
                    },
                )
            },
        )?;
    }
    ctx.note("Into 1024 x 1024 texels. There is no naive method to time: stretch 1 is the ideal.");
    Ok(())
}
