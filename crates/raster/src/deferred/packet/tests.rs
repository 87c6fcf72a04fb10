//! Packets against one sample at a time.

use super::*;
use crate::deferred::tests::Patch;
use crate::interpolate::{derivatives, interpolate};
use crate::project::project;
use photofit_gradcheck::Uniform;

#[test]
fn packets_interpolate_as_samples_alone_to_the_bit() {
    let mut patch = Patch::new(9, 4);
    patch.lod_bias = 2.0;
    let (maps, passes) = (patch.maps::<f32>(), Passes::default());
    patch.with(|geometry, view| {
        let footprint = PixelGrid::new(view.width, view.height);
        let scene = Scene { view, passes: &passes, maps: &maps, footprint };
        let mut clip = vec![Vec4::zero(); geometry.positions.len()];
        project(&view.view_projection, geometry.positions, &mut clip);
        let (mut packet, mut rng) = (Packet::new(), Uniform::new(3));
        for triangle in 0..4 {
            let first = packet.len;
            packet.len += 7;
            for row in &mut packet.f {
                row[first..first + 7].fill_with(|| rng.range(-0.9, 0.9) as f32);
            }
            packet.cover(geometry, &clip, true, triangle, first);
        }
        packet.shade(&scene);
        let mut levels = 0;
        for lane in 0..packet.len {
            let corners = geometry.topology.triangles[lane / 7].map(|i| i as usize);
            let f = vec2(packet.f[0][lane], packet.f[1][lane]);
            let b = barycentrics(&corners.map(|i| clip[i]), f, &footprint);
            let vectors = corners.map(|i| {
                let (p, n, t) = (geometry.positions[i], geometry.normals[i], geometry.tangents[i]);
                [p.x, p.y, p.z, n.x, n.y, n.z, t.x, t.y, t.z]
            });
            let alone = interpolate(vectors.each_ref(), &b);
            assert_eq!(packet.surface.each_ref().map(|row| row[lane]), alone, "vectors of lane {lane}");
            let uvs = corners.map(|i| geometry.uvs[i].to_array());
            let uv = interpolate(uvs.each_ref(), &b);
            assert_eq!(packet.uv.each_ref().map(|row| row[lane]), uv, "uv of lane {lane}");
            let level = level_of_detail(&derivatives(uvs.each_ref(), &b), 9, 9, 2.0, 3).level;
            assert_eq!(packet.level[lane].to_bits(), level.to_bits(), "level of lane {lane}");
            levels += usize::from(level > 0.0 && level < 3.0);
        }
        assert!(levels > 10, "{levels} levels lie within the chain");
    });
}
