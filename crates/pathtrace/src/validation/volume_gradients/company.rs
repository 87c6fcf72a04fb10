//! A medium beside another one and a clear solid: what these leave of light counts for its derivatives.

use super::*;

fn in_company(kind: Kind) -> Cloud {
    Cloud { in_company: true, ..Cloud::uniform(kind, 0.6) }
}

fn check(kind: Kind, spp: [u32; 2], resolved: f64) {
    let c = in_company(kind);
    let thinner = |x: f64| Cloud { density: vec![0.6 + x as f32], ..c.clone() };
    let a = c.replayed(MediumValue::Extinction, spp[0], |_, _| 1.0);
    compare(
        &format!("{kind:?} in company, extinction"),
        a,
        differences(thinner, 0.1, false, spp[1]),
        resolved,
    );
    let darker = |x: f64| Cloud { albedo: vec![c.albedo[0].map(|a| a + x as f32)], ..c.clone() };
    let a = c.replayed(MediumValue::Albedo, spp[0], |_, _| 1.0);
    compare(&format!("{kind:?} in company, albedo"), a, differences(darker, 0.05, false, spp[1]), resolved);
}

#[test]
fn derivatives_beside_other_media_and_in_solids() {
    check(Kind::Box, [64, 256], 0.12);
}

#[test]
#[ignore = "slow: many samples"]
fn derivatives_beside_other_media_and_in_solids_closely() {
    for kind in [Kind::Even, Kind::Bounded, Kind::Box] {
        check(kind, [1024, 4096], 0.02);
    }
}
