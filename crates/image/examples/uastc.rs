//! Bytes, error and time of UASTC by effort and lambda.
//!
//! `cargo run --release -p photofit-image --example uastc PICTURES`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_image::{Limits, decode_texture};
use photofit_ktx2::{Effort, Options, decode, encode};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("{:<40} {:>14} {:>9} {:>8} {:>8}", "file, effort", "lambda", "bytes", "PSNR dB", "MPixel/s");
    for path in std::env::args().skip(1) {
        let (width, height, texels) = decode_texture(&std::fs::read(&path)?, &Limits::default())?;
        let level = (width as u32, height as u32, texels);
        let name = std::path::Path::new(&path).file_name().unwrap_or_default().to_string_lossy().into_owned();
        let of = |effort, rdo_lambda| Options { effort, rdo_lambda, ..Options::new(true) };
        let normal = [0.0, 5.0, 10.0, 20.0].map(|lambda| of(Effort::Normal, lambda));
        for options in [of(Effort::Fast, 0.0)].into_iter().chain(normal).chain([of(Effort::Best, 0.0)]) {
            let start = Instant::now();
            let file = encode(std::slice::from_ref(&level), &options)?;
            let seconds = start.elapsed().as_secs_f64();
            let (_, _, again) = decode(&file, 0)?;
            let squares = again.iter().flatten().zip(level.2.iter().flatten());
            let sum: f64 = squares.map(|(a, b)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2)).sum();
            let psnr = 10.0 * ((4 * again.len()) as f64 / sum).log10();
            println!(
                "{:<40} {:>14} {:>9} {psnr:>8.2} {:>8.2}",
                format!("{name}, {:?}", options.effort),
                options.rdo_lambda,
                file.len(),
                again.len() as f64 / seconds / 1e6
            );
        }
    }
    Ok(())
}
