//! Textures of 16 bits through files.

use super::*;

#[test]
fn sixteen_bits_come_back_from_png_wherever_it_is_chosen() {
    let texels16: Vec<[u16; 4]> = (0..36).map(|i| [300 * i, 40_000 + i, 7, 65_535 - 600 * i]).collect();
    let rounded = |t: &[u16; 4]| t.map(|v| ((u32::from(v) + 128) / 257) as u8);
    let texels = texels16.iter().map(rounded).collect();
    let image = TextureImage { width: 6, height: 6, texels, texels16, ..TextureImage::default() };
    let material = |rough, color| Material {
        metallic_roughness_texture: rough,
        base_color_texture: color,
        ..Material::clay()
    };
    let scene = |material: Material, encoding| {
        let image = TextureImage { encoding, ..image.clone() };
        let mut scene = Scene { materials: vec![material], images: vec![image], ..Scene::default() };
        scene.primitives.push(Primitive { mesh: patch(), material: 0 });
        scene.instances.push(Instance { primitive: 0, transform: Affine3A::IDENTITY });
        scene
    };
    let data = || material(Some(slot(0, 0)), None);
    let [jpeg, ktx2] = [TextureEncoding::Jpeg { quality: 90 }, TextureEncoding::Ktx2 { quality: 90 }];
    for encoding in [TextureEncoding::Png, jpeg, ktx2] {
        let stored = scene(data(), encoding).stored_as(0, encoding).unwrap();
        assert_eq!(
            (stored.encoding, &stored.texels16),
            (TextureEncoding::Png, &image.texels16),
            "{encoding:?}"
        );
        let again = round_trip(&scene(data(), encoding));
        assert_eq!((&again.images[0].texels16, &again.images[0].texels), (&image.texels16, &image.texels));
    }
    let color = round_trip(&scene(material(None, Some(slot(0, 0))), TextureEncoding::Png));
    assert_eq!((color.images[0].texels16.len(), &color.images[0].texels), (0, &image.texels));
    let both = round_trip(&scene(material(Some(slot(0, 0)), Some(slot(0, 0))), TextureEncoding::Png));
    assert_eq!(both.images[0].texels16, image.texels16);
    // What is not rounded to the texels beside it is refused.
    let mut changed = scene(data(), TextureEncoding::Png);
    changed.images[0].texels16[3][0] = u16::from(image.texels[3][0]) * 257 + 129;
    changed.validate().unwrap();
    changed.images[0].texels16[3][0] += 1;
    assert!(changed.validate().unwrap_err().to_string().contains("are not its texels of 8"));
}
