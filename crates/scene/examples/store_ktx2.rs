//! Stores the textures of an asset as KTX 2.0 with mip levels of their own: `store_ktx2 IN.glb OUT.glb [QUALITY]`.

use photofit_scene::{TextureEncoding, load, save_glb};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (from, to, quality) = match &arguments[..] {
        [from, to] => (from, to, 100),
        [from, to, quality] => (from, to, quality.parse()?),
        _ => return Err("store_ktx2 IN.glb OUT.glb [QUALITY of 1 to 100]".into()),
    };
    let mut scene = load(from)?;
    for image in &mut scene.images {
        image.encoding = TextureEncoding::Ktx2 { quality };
    }
    Ok(save_glb(to, &scene)?)
}
