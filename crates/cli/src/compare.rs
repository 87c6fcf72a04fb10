//! `photofit compare`: how much two images, or two assets, look alike.

use crate::args::Compare;
use crate::output::{self, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say, say_warnings};
use crate::{memory, threads};
use anyhow::{Result, anyhow, bail};
use photofit_fit::compare::compare_assets;
use photofit_fit::engine::judge::{BEST_PSNR, JudgeRenderer, Judged, Quality, ViewQuality};
use photofit_fit::footprint::Task;
use photofit_image::{
    DEFAULT_PIXELS_PER_DEGREE, Image, contact_sheet, flip, heatmap, psnr_from_mse, rmse, ssim, to_display,
    write_png,
};
use photofit_scene::{Material, Scene};
use serde_json::{Value, json};
use std::path::Path;

/// FLIP of the brightest colour of a heat map.
const HEAT: f32 = 1.0;

/// Views of two assets, and their width and height, where the command line says none.
const VIEWS: u64 = 8;
const RESOLUTION: u32 = 512;
/// How assets were drawn whose materials need more than the rasterizer.
const PATH_TRACED: &str = "path traced";

/// The four figures.
#[derive(Clone, Copy, Debug, Default)]
struct Figures {
    psnr: f64,
    ssim: f64,
    flip: f64,
    rmse: f64,
    /// Whether the PSNR, or that of a view of a mean, reached the largest that is told apart.
    bounded: bool,
}

impl Figures {
    fn of(v: &ViewQuality) -> Self {
        let q = &v.quality;
        Self { psnr: q.psnr, ssim: q.ssim, flip: q.flip, rmse: v.rmse, bounded: q.psnr >= BEST_PSNR }
    }

    fn json(&self) -> Value {
        let mut value = json!({ "ssim": self.ssim, "flip": self.flip, "rmse": self.rmse });
        output::write_psnr(&mut value, self.psnr, self.bounded);
        value
    }

    /// A line of the table; the PSNR of assets is told up to a bound, that of images is not.
    fn row(&self, name: &str, of_assets: bool) -> String {
        let psnr = match of_assets {
            true => Quality { psnr: self.psnr, ..Quality::default() }.decibels(2),
            false => format!("{:.2}", self.psnr),
        };
        format!("{name:<10} {psnr:>10} {:>8.4} {:>8.4} {:>8.6}\n", self.ssim, self.flip, self.rmse)
    }
}

pub(crate) fn run(a: &Compare) -> Result<()> {
    let places = Places::default()
        .reads("A", Some(&a.reference))
        .reads("B", Some(&a.candidate))
        .writes("--json", a.json.as_deref())
        .writes("--heatmap", a.heatmap.as_deref());
    places.check()?;
    threads::set(a.threads)?;
    let Compared { kind, drawn, heat, views } = match (is_asset(&a.reference), is_asset(&a.candidate)) {
        (true, true) => assets(a, &places)?,
        (false, false) => images(a)?,
        (asset, _) => {
            let kind = if asset { "asset" } else { "image" };
            bail!(
                "{}: is no {kind} as {} is; both must be images or both assets",
                a.candidate.display(),
                a.reference.display()
            )
        }
    };
    let mean = mean(&views);
    let mut text = format!("{:<10} {:>10} {:>8} {:>8} {:>8}\n", "", "PSNR dB", "SSIM", "FLIP", "RMSE");
    if views.len() > 1 {
        views
            .iter()
            .enumerate()
            .for_each(|(i, v)| text += &v.row(&format!("view {}", i + 1), drawn.is_some()));
    }
    text += &mean.row(if views.len() > 1 { "mean" } else { "" }, drawn.is_some());
    if let Some(drawn) = &drawn {
        let width = if drawn.how == PATH_TRACED {
            ", at most 256 pixels wide, with noise: it counts in SSIM and FLIP, PSNR and RMSE are estimated without it, and no finer than the \
             estimate is sure"
        } else {
            ""
        };
        text += &format!("{}{width}: {}\n", drawn.how, drawn.why);
    }
    if let Some(file) = &a.heatmap {
        write_png(file, &heat)?;
        text += &format!("wrote {}\n", file.display());
    }
    if let Some(file) = &a.json {
        let mut value = mean.json();
        value["reference"] = json!(a.reference.display().to_string());
        value["candidate"] = json!(a.candidate.display().to_string());
        value["kind"] = json!(kind);
        value["drawn"] = json!(drawn.as_ref().map(|d| d.how));
        value["drawn_because"] = json!(drawn.map(|d| d.why));
        if views.len() > 1 {
            value["views"] = views.iter().map(Figures::json).collect();
        }
        output::write_json(file, &value)?;
    }
    print(&text)
}

pub(crate) fn is_asset(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    ["glb", "gltf", "obj", "ply"].contains(&ending.as_str())
}

fn mean(views: &[Figures]) -> Figures {
    let n = views.len().max(1) as f64;
    let of = |f: fn(&Figures) -> f64| views.iter().map(f).sum::<f64>() / n;
    Figures {
        psnr: of(|v| v.psnr),
        ssim: of(|v| v.ssim),
        flip: of(|v| v.flip),
        rmse: of(|v| v.rmse),
        bounded: views.iter().any(|v| v.bounded),
    }
}

/// How assets were drawn, and why.
struct Drawn {
    how: &'static str,
    why: String,
}

/// The kind of what was compared and how it was drawn, the heat map, and the figures of each view.
struct Compared {
    kind: &'static str,
    drawn: Option<Drawn>,
    heat: Image,
    views: Vec<Figures>,
}

/// Whether something is drawn with the material that glTF has where a file names none.
fn lacks_material(scene: &Scene) -> bool {
    let is_default = |m: &Material| Material { name: String::new(), ..m.clone() } == Material::default();
    scene.instances.iter().any(|i| is_default(&scene.materials[scene.primitives[i.primitive].material]))
}

fn assets(a: &Compare, places: &Places) -> Result<Compared> {
    let load = |path: &Path| -> Result<Scene> {
        let scene = photofit_scene::load(path)?;
        places.check_against("an asset", &scene.files)?;
        say_warnings(path, &scene);
        scene.validate_for_fit().map_err(|e| anyhow!("{}: {e}", path.display()))?;
        Ok(scene)
    };
    let (reference, candidate) = (load(&a.reference)?, load(&a.candidate)?);
    let [plain, other] = [&reference, &candidate].map(lacks_material);
    if plain != other {
        let which = if plain { &a.reference } else { &a.candidate };
        say(&format!(
            "warning: {}: some of it has no material, which glTF draws as a white metal; the other asset has one everywhere",
            which.display()
        ));
    }
    memory::check_textures(Task::Compare, &a.candidate, &[&reference, &candidate])?;
    let progress = Terminal::new();
    let compared = compare_assets(
        &reference,
        &candidate,
        a.views.unwrap_or(VIEWS),
        a.resolution.unwrap_or(RESOLUTION) as usize,
        a.judge.map_or(JudgeRenderer::Auto, Into::into),
        &progress,
    )?;
    progress.finish();
    let views = &compared.views;
    let maps: Vec<Image> = views.iter().map(|v| heatmap(&v.flip, HEAT)).collect();
    let columns = (maps.len() as f64).sqrt().ceil() as usize;
    let sheet = contact_sheet(&maps.iter().collect::<Vec<_>>(), columns, 4);
    let how = match compared.method {
        Judged::PathTraced => PATH_TRACED,
        Judged::Rasterized | Judged::RasterizedAgainst(_) => "rasterized",
    };
    let views = views.iter().map(Figures::of).collect();
    let drawn = Some(Drawn { how, why: compared.reason });
    Ok(Compared { kind: "assets", drawn, heat: sheet, views })
}

fn images(a: &Compare) -> Result<Compared> {
    let (reference, candidate) = (photofit_image::read(&a.reference)?, photofit_image::read(&a.candidate)?);
    let size = |i: &Image| format!("{} x {}", i.width, i.height);
    if (reference.width, reference.height) != (candidate.width, candidate.height) {
        bail!(
            "{}: is {}, but {} is {}; both must have one size",
            a.candidate.display(),
            size(&candidate),
            a.reference.display(),
            size(&reference)
        );
    }
    for (image, path) in [(&reference, &a.reference), (&candidate, &a.candidate)] {
        let odd = image.data.iter().filter(|v| !v.is_finite()).count();
        if odd > 0 {
            let values = output::counted(odd, "value");
            let rule = "what is infinite is shown white or black, what is no number black";
            say(&format!("warning: {}: {values} of its pixels are not finite; {rule}", path.display()));
        }
    }
    let (r, c) = (shown(&reference, &a.reference)?, shown(&candidate, &a.candidate)?);
    let error = flip(&r, &c, DEFAULT_PIXELS_PER_DEGREE);
    let rmse = rmse(&r, &c);
    let figures = Figures {
        psnr: psnr_from_mse(rmse * rmse),
        ssim: ssim(&r, &c).mean,
        flip: error.mean,
        rmse,
        bounded: false,
    };
    Ok(Compared { kind: "images", drawn: None, heat: heatmap(&error.map, HEAT), views: vec![figures] })
}

/// The display picture of an image: RGB over black for straight alpha (PNG) and premultiplied alpha (`OpenEXR`), grey
/// replicated.
fn shown(image: &Image, path: &Path) -> Result<Image> {
    let premultiplied = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let rgb = match image.channels {
        1 => image.select(&[0, 0, 0]),
        4 if !premultiplied => image.over([0.0; 3]),
        3.. => image.select(&[0, 1, 2]),
        n => bail!("{}: has {n} channels; it must have 1, 3 or 4", path.display()),
    };
    Ok(to_display(&rgb))
}
