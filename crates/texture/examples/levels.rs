//! Reads a picket fence from near and far, by area and by coverage: `cargo run -p photofit-texture --example levels`.

#![expect(clippy::print_stdout, reason = "an example shows its results")]

use photofit_scalar::vec2;
use photofit_texture::{MipRule, Pyramid, Sampler, Texture, level_of_detail, lookup, sample};

fn main() {
    // Brown pickets; between them nothing, stored as green.
    let texel = |x: usize| if x.is_multiple_of(4) { [0.4, 0.2, 0.1, 1.0] } else { [0.0, 1.0, 0.0, 0.0] };
    let fence = Texture { width: 16, height: 4, texels: (0..64).map(|i| texel(i % 16)).collect() };
    for rule in [MipRule::Area, MipRule::Coverage { colors: 3, alpha: 3 }] {
        let pyramid = Pyramid::with_rule(fence.clone(), rule);
        println!("{rule:?}");
        for texels_per_pixel in [1.0_f32, 2.0, 4.0] {
            let footprint = [vec2(texels_per_pixel / 16.0, 0.0), vec2(0.0, texels_per_pixel / 4.0)];
            let lod = level_of_detail(&footprint, 16, 4, 0.0, pyramid.levels.len() - 1);
            let at = lookup(&pyramid, vec2(0.53, 0.5), Some(&lod), &Sampler::default());
            let [r, g, b, a] = sample(&pyramid, &at);
            println!("  {texels_per_pixel} texels a pixel: colour {r:.2} {g:.2} {b:.2}, alpha {a:.2}");
        }
    }
}
