//! How far two pictures are apart, by PSNR, SSIM and FLIP, for three faults of about the same squared error.
//!
//! `cargo run -p photofit-image --example metrics [OUT.png]` also writes a sheet of the pictures and their FLIP maps.
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_image::{
    DEFAULT_PIXELS_PER_DEGREE, Image, contact_sheet, flip, heatmap, psnr, resize_bilinear, ssim, to_display,
    write_png,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let size = 128;
    let disc = |x: usize, y: usize, r: f32| (x as f32 - 64.0).hypot(y as f32 - 64.0) < r;
    let clean = Image::from_fn(size, size, 3, |x, y, c| {
        let stripes = if (x / 8 + y / 8) % 2 == 0 { 0.5 } else { 0.3 };
        if disc(x, y, 40.0) { [0.7, 0.4, 0.2][c] } else { stripes }
    });
    let blurred = resize_bilinear(&resize_bilinear(&clean, size / 3, size / 3), size, size);
    let noisy = Image::from_fn(size, size, 3, |x, y, c| {
        let hash = ((x * 73 + y * 179 + c * 283) * 2_654_435) % 1000;
        clean.pixel(x, y)[c] + 0.09 * (hash as f32 / 500.0 - 1.0)
    });
    let brighter = clean.map(|v| v * 1.15);

    let reference = to_display(&clean);
    let mut sheet = vec![clean];
    for (name, image) in [("blurred", blurred), ("noisy", noisy), ("brighter", brighter)] {
        let test = to_display(&image);
        let flip = flip(&reference, &test, DEFAULT_PIXELS_PER_DEGREE);
        let (psnr, ssim) = (psnr(&reference, &test), ssim(&reference, &test).mean);
        println!("{name:>9}: PSNR {psnr:5.2} dB, SSIM {ssim:.3}, FLIP {:.3}", flip.mean);
        sheet.extend([image, heatmap(&flip.map, 1.0)]);
    }
    if let Some(path) = std::env::args().nth(1) {
        write_png(path, &contact_sheet(&sheet.iter().collect::<Vec<_>>(), 7, 4))?;
    }
    Ok(())
}
