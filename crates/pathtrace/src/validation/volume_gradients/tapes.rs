//! What is kept of a path through media tells its replay the same as a second walk.

use super::*;
use crate::validation::gradients::tapes::same_whatever_is_kept;

#[test]
fn gradients_have_the_same_bits_whatever_is_kept_of_flights() {
    let emission: Vec<Vec3f> = (0..12).map(|i| vec3(noise(i, 20), noise(i, 21), 0.0)).collect();
    let plain = |kind| Cloud::uniform(kind, 0.8);
    let company = |kind| Cloud { in_company: true, ..plain(kind) };
    let glowing = |kind| Cloud { emission: emission.clone(), ..company(kind) };
    let colored = Cloud { tint: vec3(0.5, 1.0, 2.0), ..plain(Kind::Even) };
    let deep =
        Cloud { density: vec![40.0], albedo: vec![Vec3f::splat(0.99)], depth: 100, ..plain(Kind::Box) };
    for (name, cloud) in [
        ("box", company(Kind::Box)),
        ("grid", company(Kind::Bounded)),
        ("glowing box", glowing(Kind::Box)),
        ("glowing grid", glowing(Kind::Bounded)),
        ("colours", colored),
        ("around", Cloud::uniform(Kind::Around, 0.1)),
        ("more events than are kept", deep),
    ] {
        let world = cloud.world();
        let mut parameters = vec![MediumValue::Extinction, MediumValue::Albedo];
        if !cloud.emission.is_empty() {
            parameters.push(MediumValue::Emission);
        }
        let parameters: Vec<Parameter> = parameters.into_iter().map(|v| cloud.kind.parameter(v)).collect();
        let mut adjoint = Adjoint::new(&world, &view(), cloud.options(1, 0), &parameters).unwrap();
        same_whatever_is_kept(name, &mut adjoint, &weights(), &[0, 1, 7, 1 << 12]);
    }
}
