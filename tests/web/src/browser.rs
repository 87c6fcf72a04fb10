//! What a page calls.

use crate::check;
use photofit_gpu::{Caps, Choice, Gpu};
use std::fmt::Write;
use wasm_bindgen::prelude::wasm_bindgen;

/// Opens the browser's device and checks it. Gives lines for a person; the last one begins with `passed` or `FAILED`.
#[wasm_bindgen]
pub async fn run() -> String {
    let gpu = match Gpu::open(&Choice::Any, Caps::NONE).await {
        Ok(gpu) => gpu,
        Err(e) => return format!("FAILED: {e}\n"),
    };
    let report = gpu.report();
    let (name, backend) = (report.name.as_str(), report.backend.as_str());
    let mut out = format!("adapter: {name} ({:?}, {backend})\n", report.kind);
    let twins = match check(&gpu).await {
        Ok((kernels, twins)) => {
            let _ = writeln!(out, "{kernels} kernels compile");
            twins
        }
        Err(e) => return format!("{out}FAILED: {e}\n"),
    };
    for t in &twins {
        let _ = writeln!(out, "twin {}: {:.1e} of {:.1e}", t.what, t.error, t.bound);
    }
    let failed = twins.iter().filter(|t| !t.agrees()).count();
    let last = if failed == 0 { "passed" } else { "FAILED" };
    out + &format!("{last}: {} of {} twins agree\n", twins.len() - failed, twins.len())
}
