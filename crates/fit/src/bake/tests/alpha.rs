//! Masks and blending.

use super::{World, color_of, go_on, moved, painted, sheet, size};
use crate::bake::reference::SurfacePoint;
use crate::bake::{AlphaClass, BakeClass, BakeSettings, Target, bake};
use crate::visibility::Visibility;
use photofit_raster::channel;
use photofit_scalar::vec3;
use photofit_scene::{AlphaMode, Extensions, Material, Transmission};

#[test]
fn masks_are_sampled_and_holes_give_no_colour() {
    // Stripes of 8 texels: white and solid, then green and cut.
    let mut world = World::default();
    let stripes: Vec<[u8; 4]> =
        (0..64 * 64).map(|i| if (i % 64) / 8 % 2 == 0 { [255; 4] } else { [0, 255, 0, 0] }).collect();
    let base_color_texture = world.image(64, stripes);
    let mut masked =
        Material { base_color_texture, alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..Material::clay() };
    masked.base_color = [1.0; 4];
    world.add(&sheet(1), masked);
    world.add(&moved(&sheet(1), 1.0, vec3(0.0, 0.0, -0.01)), painted([0.8, 0.1, 0.1]));
    let seen = world.visibility();
    let target = sheet(1);
    let ask = |classes: Option<&[BakeClass]>| {
        world
            .with(|r| bake(r, &seen, &Target { classes, ..Target::new(&target) }, &size(20), &go_on))
            .unwrap()
    };
    let baked = ask(Some(&[AlphaClass::Mask.into(); 2]));
    let alpha: f32 = baked.maps.texels.iter().map(|t| t[channel::ALPHA]).sum::<f32>() / 400.0;
    assert!((alpha - 0.5).abs() < 0.03, "coverage {alpha}");
    assert!(baked.cut.iter().filter(|&&c| c).count() > 50, "texels inside of the holes");
    assert!(
        baked.maps.texels.iter().any(|t| (0.2..0.8).contains(&t[channel::ALPHA])),
        "borders are partly covered"
    );
    for (i, t) in baked.maps.texels.iter().enumerate().filter(|(i, _)| baked.valid[*i]) {
        // Bilinear filtering mixes the two at the border itself.
        assert!(t[0] > 0.2 && t[1] > 0.9, "texel {i}: {:?}", color_of(t));
    }
    let mut filled = baked.clone();
    filled.fill(None);
    for i in 0..400 {
        assert!(filled.maps.texels[i][0] > 0.2, "texel {i} is filled");
        assert_eq!(filled.maps.texels[i][channel::ALPHA], baked.maps.texels[i][channel::ALPHA]);
    }
    // The opaque class sees only the sheet behind; without classes the holes show it.
    for t in ask(Some(&[AlphaClass::Opaque.into(); 2])).maps.texels {
        assert_eq!((color_of(&t), t[channel::ALPHA]), ([0.8, 0.1, 0.1], 1.0));
    }
    let mixed = ask(None);
    assert!(mixed.cut.iter().all(|&c| !c) && mixed.maps.texels.iter().any(|t| t[1] < 0.2));
}

#[test]
fn blended_alpha_weighs_colours() {
    let mut world = World::default();
    // Each baked texel holds a dense red and a thin blue one.
    let texels: Vec<[u8; 4]> =
        (0..64).map(|i| if i % 2 == 0 { [255, 0, 0, 192] } else { [0, 0, 255, 64] }).collect();
    let base_color_texture = world.image(8, texels);
    let glass = Material {
        base_color_texture,
        base_color: [1.0; 4],
        alpha_mode: AlphaMode::Blend,
        ..Material::clay()
    };
    world.add(&sheet(1), glass);
    let fine = BakeSettings { samples_per_side: 8, ..size(4) };
    let baked = world.bake(&Visibility::everything(2), &sheet(1), &fine);
    let mean = |c: usize| baked.maps.texels.iter().map(|t| t[c]).sum::<f32>() / 16.0;
    assert!((mean(channel::ALPHA) - 128.0 / 255.0).abs() < 0.01, "alpha {}", mean(channel::ALPHA));
    assert!((0.57..0.62).contains(&mean(0)), "the denser half weighs more: {} and {}", mean(0), mean(2));
    assert!((mean(0) + mean(2) - 1.0).abs() < 0.01, "straight colours: {} and {}", mean(0), mean(2));
}

#[test]
fn a_place_knows_its_cut() {
    let mut world = World::default();
    let image = world.image(2, vec![[255, 255, 255, 255], [255, 255, 255, 0]]);
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    world.add(&sheet(1), Material { base_color_texture: image, alpha_mode: mask, ..Material::clay() });
    world.with(|r| {
        // Triangle 0: upper left, lower left, lower right.
        assert!(!r.is_cut(&SurfacePoint { triangle: 0, u: 0.9, v: 0.05 }), "left");
        assert!(r.is_cut(&SurfacePoint { triangle: 0, u: 0.05, v: 0.9 }), "right");
    });
}

#[test]
fn glass_takes_nothing_of_other_blended_surfaces_and_gives_them_nothing() {
    // A plain blended sheet, and glass close behind it.
    let mut world = World::default();
    let blend = |material: Material| Material { alpha_mode: AlphaMode::Blend, ..material };
    world.add(&sheet(1), Material { base_color: [0.8, 0.1, 0.1, 0.6], ..blend(Material::clay()) });
    let transmission = Some(Transmission { factor: 1.0, texture: None });
    let extensions = Some(Box::new(Extensions { transmission, ..Extensions::default() }));
    let glass = Material { base_color: [0.1, 0.8, 0.1, 0.25], extensions, ..blend(Material::clay()) };
    world.add(&moved(&sheet(1), 1.0, vec3(0.0, 0.0, -0.01)), glass);
    let (seen, target) = (Visibility::everything(4), sheet(1));
    for (see_through, expected) in [(false, [0.8, 0.1, 0.1, 0.6]), (true, [0.1, 0.8, 0.1, 0.25])] {
        let classes = [BakeClass { see_through, ..AlphaClass::Blend.into() }; 2];
        let onto = Target { classes: Some(&classes), ..Target::new(&target) };
        let baked = world.with(|r| bake(r, &seen, &onto, &size(4), &go_on)).unwrap();
        for t in &baked.maps.texels {
            let found = [t[0], t[1], t[2], t[channel::ALPHA]];
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3),
                "{see_through}: {found:?}"
            );
        }
    }
}
