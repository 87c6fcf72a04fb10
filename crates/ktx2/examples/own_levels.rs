//! A texture with levels of its own: each mip level of another colour, as a reader sees them from farther and farther away.
//!
//! `cargo run -p photofit-ktx2 --example own_levels [OUT.ktx2]`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_ktx2::{Level, Options, decode, encode, level_count};

/// Width and height of the first level, texels.
const SIDE: u32 = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let colors = [[220, 40, 40, 255], [40, 200, 60, 255], [50, 80, 230, 255]];
    let level = |k: u32| -> Level {
        let side = SIDE >> k;
        (side, side, vec![colors[k as usize % colors.len()]; (side * side) as usize])
    };
    let levels: Vec<Level> = (0..=SIDE.ilog2()).map(level).collect();
    let file = encode(&levels, &Options::new(true))?;
    let raw: usize = levels.iter().map(|l| 4 * l.2.len()).sum();
    println!("{} bytes of texels in a file of {} bytes", raw, file.len());
    for k in 0..level_count(&file)? {
        let (width, height, texels) = decode(&file, k)?;
        println!("  level {k}: {width} x {height}, {:?}", texels[0]);
    }
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(path, file)?;
    }
    Ok(())
}
