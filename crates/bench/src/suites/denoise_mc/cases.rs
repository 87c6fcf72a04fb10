//! The pictures: a folder of rendered sets, or a small analytic scene.

use anyhow::{Context as _, Result, bail};
use photofit_denoise::mc::synthetic::SyntheticFrame;
use photofit_denoise::mc::{Camera, Frame, Guides};
use photofit_image::{Image, read, srgb_encode};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// One rendered view, as planes.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) color: Vec<f32>,
    pub(super) albedo: Option<Vec<f32>>,
    pub(super) normal: Option<Vec<f32>>,
    pub(super) position: Option<Vec<f32>>,
    pub(super) camera: Option<Camera>,
}

/// A noisy picture with its reference, and the views before it.
#[derive(Clone, Debug)]
pub(super) struct Case {
    /// Name and size.
    pub(super) name: String,
    pub(super) spp: u32,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Radiance, 3 planes.
    pub(super) reference: Vec<f32>,
    /// In order of time; the last one is denoised.
    pub(super) views: Vec<View>,
}

impl Case {
    pub(super) fn pixels(&self) -> usize {
        self.height * self.width
    }

    pub(super) fn last(&self) -> &View {
        &self.views[self.views.len() - 1]
    }

    pub(super) fn frame<'a>(&self, view: &'a View) -> Frame<'a> {
        Frame::new(self.width, self.height, &view.color).with_guides(Guides {
            albedo: view.albedo.as_deref(),
            normal: view.normal.as_deref(),
            position: view.position.as_deref(),
            depth: None,
        })
    }

    /// Whether the views before the last one can be used.
    pub(super) fn is_sequence(&self) -> bool {
        self.views.len() > 1
    }
}

/// All cases of `PHOTOFIT_BENCH_DENOISE`, or those of the analytic scene.
pub(super) fn cases() -> Result<Vec<Case>> {
    let Ok(folder) = std::env::var("PHOTOFIT_BENCH_DENOISE") else { return Ok(synthetic()) };
    let folder = Path::new(&folder);
    let mut children: Vec<PathBuf> = std::fs::read_dir(folder)
        .with_context(|| format!("{}: cannot be listed", folder.display()))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    children.sort();
    children.insert(0, folder.to_owned());
    let mut out = Vec::new();
    for child in &children {
        if child.join("cameras.json").is_file() {
            out.extend(sequences(child)?);
        }
        if child.join("spp1.png").is_file() {
            out.extend(display_pictures(child)?);
        }
        if child.join("cornell_1spp/color.hdr").is_file() {
            out.push(radiance_pictures(child)?);
        }
    }
    if out.is_empty() {
        bail!("{}: no set of noisy pictures in it", folder.display());
    }
    Ok(out)
}

fn synthetic() -> Vec<Case> {
    let (width, height) = (480, 270);
    let frames: Vec<SyntheticFrame> =
        (0..6).map(|k| SyntheticFrame::new(width, height, 0.01 * f64::from(k))).collect();
    let case = |spp: u32| {
        let view = |(k, f): (usize, &SyntheticFrame)| View {
            color: f.noisy(spp, k as u64),
            albedo: Some(f.albedo.clone()),
            normal: Some(f.normal.clone()),
            position: Some(f.position.clone()),
            camera: Some(f.camera),
        };
        let reference = frames[frames.len() - 1].reference.clone();
        let name = "analytic 480x270".to_owned();
        Case { name, spp, height, width, reference, views: frames.iter().enumerate().map(view).collect() }
    };
    vec![case(1), case(4)]
}

/// Sets of EXR files `SCENE_FRAME_LAYER.exr` beside a `cameras.json`, for each number of samples that is there.
fn sequences(folder: &Path) -> Result<Vec<Case>> {
    let path = folder.join("cameras.json");
    let json: Value = serde_json::from_slice(&std::fs::read(&path)?)
        .with_context(|| format!("{}: not valid JSON", path.display()))?;
    let scenes = json["scenes"].as_object().with_context(|| format!("{}: no scenes", path.display()))?;
    let mut out = Vec::new();
    for (scene, list) in scenes {
        let list = list.as_array().map_or(&[][..], Vec::as_slice);
        for (spp, layer) in [(1, "color"), (4, "color4"), (16, "color16")] {
            let file = |k: usize, layer: &str| folder.join(format!("{scene}_{k:02}_{layer}.exr"));
            let known = (0..list.len()).take_while(|k| file(*k, layer).is_file()).count();
            let Some(last) = (0..known).rev().find(|k| file(*k, "ref").is_file()) else { continue };
            let reference = rgb(&file(last, "ref"))?;
            let optional =
                |k, layer: &str| file(k, layer).is_file().then(|| rgb(&file(k, layer))).transpose();
            let mut views = Vec::new();
            for k in 0..=last {
                views.push(View {
                    color: rgb(&file(k, layer))?.planes(),
                    albedo: optional(k, "albedo")?.as_ref().map(Image::planes),
                    normal: optional(k, "normal")?.as_ref().map(Image::planes),
                    position: optional(k, "position")?.as_ref().map(Image::planes),
                    camera: camera(&list[k]),
                });
            }
            out.push(Case::of(scene, spp, &reference, views));
        }
    }
    Ok(out)
}

impl Case {
    fn of(scene: &str, spp: u32, reference: &Image, views: Vec<View>) -> Self {
        let (width, height) = (reference.width, reference.height);
        Self {
            name: format!("{scene} {width}x{height}"),
            spp,
            height,
            width,
            reference: reference.planes(),
            views,
        }
    }
}

/// `sppN.png`, `reference.png`, `albedo.png`, `normal.png`: colours as shown on a display.
fn display_pictures(folder: &Path) -> Result<Vec<Case>> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let file = |stem: &str| rgb(&folder.join(format!("{stem}.png")));
    let reference = file("reference")?;
    let case = |spp: u32| {
        let view = View {
            color: file(&format!("spp{spp}"))?.planes(),
            albedo: Some(file("albedo")?.planes()),
            // The bytes hold (n + 1) / 2 as it is.
            normal: Some(file("normal")?.map(|v| 2.0 * srgb_encode(v) - 1.0).planes()),
            position: None,
            camera: None,
        };
        Ok(Case::of(&name, spp, &reference, vec![view]))
    };
    [1, 4].into_iter().map(case).collect()
}

/// One sample against 64, Radiance files; normals are stored as `(n + 1) / 2`.
fn radiance_pictures(folder: &Path) -> Result<Case> {
    let file = |path: &str| rgb(&folder.join(path));
    let view = View {
        color: file("cornell_1spp/color.hdr")?.planes(),
        albedo: Some(file("cornell_1spp/albedo.hdr")?.planes()),
        normal: Some(file("cornell_1spp/normal.hdr")?.map(|v| 2.0 * v - 1.0).planes()),
        position: None,
        camera: None,
    };
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Case::of(&format!("{name} (of 64)"), 1, &file("cornell_64spp/color.hdr")?, vec![view]))
}

fn camera(entry: &Value) -> Option<Camera> {
    let mut world_to_pixel = [[0.0; 4]; 3];
    for (i, row) in world_to_pixel.iter_mut().enumerate() {
        for (j, v) in row.iter_mut().enumerate() {
            *v = entry["world_to_pixel"][i][j].as_f64()?;
        }
    }
    Some(Camera { world_to_pixel })
}

fn rgb(path: &Path) -> Result<Image> {
    let image = read(path)?;
    if image.channels < 3 {
        bail!("{}: {} channels, three are needed", path.display(), image.channels);
    }
    Ok(image.select(&[0, 1, 2]))
}
