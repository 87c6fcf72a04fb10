use photofit_fit::simplify::*;
use photofit_geometry::decimate::Target;
use std::sync::Mutex;
struct P(Mutex<(std::time::Instant, &'static str)>);
impl photofit_fit::Progress for P {
    fn report(&self, stage: &'static str, done: u64, total: u64, note: &str) {
        let mut p = self.0.lock().unwrap();
        if p.1 != stage || stage == "fit" { eprintln!("{:7.1}s {stage} {done}/{total} {note}", p.0.elapsed().as_secs_f64()); p.1 = stage; }
    }
    fn is_cancelled(&self) -> bool { false }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let env = |k: &str, d: f64| std::env::var(k).ok().and_then(|v| v.parse().ok()).unwrap_or(d);
    let scene = photofit_scene::load(&a[1]).unwrap();
    let o = SimplifyOptions { target: Target::Triangles(a[3].parse().unwrap()), steps: env("STEPS", 400.0) as u64, texture_size: env("TEX", 1024.0) as usize, resolution: env("RES", 512.0) as usize, batch: env("BATCH", 2.0) as usize, init: if env("SPHERE", 0.0) > 0.0 { Init::Sphere } else { Init::Decimate }, ..Default::default() };
    let r = simplify(&scene, a[2].as_ref(), &o, &P(Mutex::new((std::time::Instant::now(), "")))).unwrap();
    if let Ok(f) = std::env::var("SHEET") {
        let lin = |i: &photofit_image::Image| i.map(photofit_image::srgb_decode);
        let mut pics = vec![];
        for v in r.views.iter().take(4) { pics.push(lin(&v.reference)); pics.push(lin(&v.quality[1].picture)); pics.push(lin(&v.quality[2].picture)); pics.push(photofit_image::heatmap(&v.quality[2].flip, 1.0)); }
        let refs: Vec<&photofit_image::Image> = pics.iter().collect();
        photofit_image::write_png(f, &photofit_image::contact_sheet(&refs, 4, 4)).unwrap();
    }
    println!("{} -> {} in {:.1}s (fit {:.1}) {:.2} Mpix/s", r.triangles_in, r.triangles_out, r.seconds, r.fit_seconds, r.mpix_per_s);
    for (n, q) in [("decimated", r.decimated), ("baked", r.baked), ("fitted", r.fitted)] { println!("{n:10} psnr {:.2} ssim {:.4} flip {:.4}", q.psnr, q.ssim, q.flip); }
}
