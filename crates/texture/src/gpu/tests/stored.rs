//! Textures in the precision of files.

use super::lookups::places;
use super::*;
use crate::{Filter, MipTexture, Sampler, Texels, Wrap, level_of_detail, lookup};
use photofit_scalar::vec2;

pub(super) const READ: Kernel = Kernel {
    name: "stored",
    source: &[INDEX, photofit_scalar::WGSL, STORED, include_str!("stored.wgsl")],
    entry: "read_places",
};

/// One of each format, of several sizes.
fn textures() -> Vec<MipTexture> {
    let mut rng = Uniform::new(21);
    let mut bytes = |n: usize| -> Vec<[u8; 4]> {
        (0..n).map(|_| std::array::from_fn(|_| rng.range(0.0, 256.0) as u8)).collect()
    };
    let fine = |t: [u8; 4]| t.map(|b| u16::from(b) * 251 + 17);
    let wide = |t: [u8; 4]| t.map(|b| f32::from(b) * 0.03 - 2.0);
    let layout = MipLayout::full;
    vec![
        MipTexture::new(Texels::Srgb8(bytes(32 * 32)), layout(32, 32), MipTexture::COVERAGE),
        MipTexture::new(Texels::Unorm8(bytes(13 * 6)), layout(13, 6), MipRule::Area),
        MipTexture::new(
            Texels::Unorm16(bytes(37 * 21).into_iter().map(fine).collect()),
            layout(37, 21),
            MipRule::Area,
        ),
        MipTexture::new(Texels::F32(bytes(9).into_iter().map(wide).collect()), layout(1, 9), MipRule::Area),
        MipTexture::new(Texels::Srgb8(bytes(64)), MipLayout::base(8, 8), MipRule::Area),
    ]
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn textures_of_files_read_alike() {
    let gpu = test_device();
    let textures = textures();
    let stored = StoredTextures::new(gpu, &textures.iter().collect::<Vec<_>>()).expect("fits");
    let at = places(2000, &mut Uniform::new(22));
    let (bound, values) =
        (gpu.upload("places", &at).expect("fits"), gpu.zeros::<[f32; 4]>("values", 2000).expect("fits"));
    for (k, texture) in textures.iter().enumerate() {
        let wraps = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];
        for (wrap_u, wrap_v) in wraps.into_iter().flat_map(|u| wraps.map(|v| (u, v))) {
            for filter in [Filter::Nearest, Filter::Bilinear, Filter::Trilinear] {
                let s = Sampler { wrap_u, wrap_v, filter };
                let layout = texture.layout();
                let params = [stored.place(k), layout.count() as u32, sampler_bits(&s), 2000];
                run(gpu, |r| {
                    let buffers = [stored.words.bind(), bound.bind(), values.bind()];
                    r.dispatch(&READ, &params, &buffers, 2000).map(|_| ())
                });
                let base = layout.level(0);
                let expected: Vec<f32> = at
                    .iter()
                    .flat_map(|q| {
                        let (w, h) = (base.width as usize, base.height as usize);
                        let duv = [vec2(q[2], q[3]), vec2(q[4], q[5])];
                        let lod = level_of_detail(&duv, w, h, 0.3, layout.count() - 1);
                        texture.read(&lookup(layout, vec2(q[0], q[1]), Some(&lod), &s))
                    })
                    .collect();
                let what = format!("texture {k}, {s:?}");
                assert_close("STORED", &what, &words(gpu, &values), &expected, tolerances::STORED);
            }
        }
    }
}
