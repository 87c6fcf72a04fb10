//! A flow learns the light of a sky with a small sun at points of a floor: the variance falls from round to round.
//!
//! `cargo run --release -p photofit-flow --example sky`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_flow::{FlowError, FlowGuide, FlowOptions, Guide, Learn, Query, Record};
use photofit_sampling::{Rng, cosine_hemisphere, cosine_hemisphere_pdf};
use photofit_scalar::{Vec3f, vec3};

/// The sun stands where the point's shadow says.
fn sky(p: Vec3f, wi: Vec3f) -> f32 {
    let sun = vec3(p.x - 0.5, p.y - 0.5, 0.6).normalize_or_zero();
    0.1 + 50.0 * (200.0 * (sun.dot(wi) - 1.0)).exp()
}

fn main() -> Result<(), FlowError> {
    let up = vec3(0.0, 0.0, 1.0);
    let mut guide = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), FlowOptions::default())?;
    for round in 0..6 {
        let (mut sum, mut squares, mut records) = (0.0, 0.0, Vec::new());
        for i in 0..50_000 {
            let mut rng = Rng::new(round, i);
            let position = vec3(rng.next_f32(), rng.next_f32(), 0.0);
            let query = Query { position, normal: up, wo: up, roughness: 1.0 };
            let (local, u) = (guide.local(&query), [rng.next_f32(), rng.next_f32()]);
            let share = guide.share(&local);
            let guided = if rng.next_f32() < share { guide.sample(&local, u) } else { None };
            let wi = guided.map_or_else(|| cosine_hemisphere(u), |g| g.0);
            let pdf = share * guide.pdf(&local, wi) + (1.0 - share) * cosine_hemisphere_pdf(wi.z);
            let incident = sky(position, wi);
            let value = incident * wi.z.max(0.0);
            (sum, squares) = (sum + value / pdf, squares + (value / pdf).powi(2));
            records.push(Record { query, wi, pdf, value, incident });
        }
        let mean = sum / 50_000.0;
        println!(
            "round {round}: mean {mean:.3}, relative variance {:.3}",
            squares / 50_000.0 / mean.powi(2) - 1.0
        );
        guide.learn(&records)?;
    }
    Ok(())
}
