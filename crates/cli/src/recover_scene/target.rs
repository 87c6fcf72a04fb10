//! The pictures that a scene is to look like, with their cameras.

use crate::args::{ParameterScene, RecoverScene};
use crate::mitsuba;
use crate::status::Misuse;
use anyhow::{Result, bail};
use photofit_fit::pictures::{named_files, value_fault, world_pictures};
use photofit_image::Image;
use photofit_pathtrace::{RenderOptions, View};
use std::path::{Path, PathBuf};

/// Where the pictures come from.
#[derive(Debug)]
pub(super) enum Source<'a> {
    /// The scene's own: what is recovered is known. Of this many views around it, or if it is one of its cameras.
    Own { views: usize },
    /// One file for each camera of the scene.
    Files(&'a [PathBuf]),
    /// A folder with `transforms.json`, or such a file: the cameras come with the pictures.
    List(&'a Path),
}

impl<'a> Source<'a> {
    /// What the command line says.
    ///
    /// # Errors
    /// If files and lists are mixed, there is another number of files than of cameras, or cameras are given twice.
    pub(super) fn new(a: &'a RecoverScene) -> Result<Self> {
        if a.self_test {
            if a.views > 1 && a.scene.camera != [0] {
                bail!(Misuse(
                    "--camera: --views go around the first camera; only one of them may be given".into()
                ));
            }
            return Ok(Self::Own { views: a.views });
        }
        if a.views > 1 {
            bail!(Misuse("--views: belongs to --self-test, which must be given".into()));
        }
        let is_list =
            |p: &&PathBuf| p.is_dir() || p.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        if let Some(list) = a.picture.iter().find(is_list) {
            if a.picture.len() > 1 {
                let rule = format!("--picture: {} lists pictures; it must be the only one", list.display());
                bail!(Misuse(rule));
            }
            if a.scene.camera != [0] {
                bail!(Misuse(format!("--camera: the cameras are those of {}", list.display())));
            }
            return Ok(Self::List(list));
        }
        let is_linear = |p: &&PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        if let Some(other) = a.picture.iter().find(|p| !is_linear(p)) {
            bail!(Misuse(format!(
                "--picture: {}; it must be an .exr, a folder with transforms.json, or such a file",
                other.display()
            )));
        }
        let (pictures, cameras) = (a.picture.len(), a.scene.camera.len());
        if pictures != cameras {
            bail!(Misuse(format!(
                "--picture: {pictures} files for {cameras} of --camera; there must be one for each"
            )));
        }
        Ok(Self::Files(&a.picture))
    }

    /// The scene of the command line; the picture of an asset, which has no size of its own, has that of the first file
    /// where none is given.
    ///
    /// # Errors
    /// If that file cannot be read.
    pub(super) fn sized(&self, scene: &ParameterScene) -> Result<ParameterScene> {
        let mut scene = scene.clone();
        if let (Self::Files([first, ..]), None, None, false) =
            (self, scene.width, scene.height, mitsuba::is_scene(&scene.input))
        {
            let image = photofit_image::read(first)?;
            (scene.width, scene.height) = (u32::try_from(image.width).ok(), u32::try_from(image.height).ok());
        }
        Ok(scene)
    }

    /// The files that are read.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        match self {
            Self::Own { .. } => Vec::new(),
            Self::Files(files) => files.to_vec(),
            Self::List(list) => named_files(list),
        }
    }

    /// Number of pictures, `cameras` of them where each has a camera of the scene.
    pub(super) fn count(&self, cameras: usize) -> usize {
        match self {
            Self::Own { views } => cameras.max(*views),
            Self::Files(_) => cameras,
            // The list itself is one of its files.
            Self::List(_) => self.files().len() - 1,
        }
    }
}

/// Reads the pictures of a list: they bring their cameras and their size.
pub(super) fn list(
    a: &RecoverScene,
    file: &Path,
    options: &mut RenderOptions,
) -> Result<(Vec<View>, Vec<Image>)> {
    let pictures = world_pictures(file)?;
    let (width, height) = (pictures[0].image.width, pictures[0].image.height);
    for (option, given, is) in [("--width", a.scene.width, width), ("--height", a.scene.height, height)] {
        if let Some(given) = given.filter(|g| *g as usize != is) {
            bail!(Misuse(format!(
                "{option}: is {given}; it must be {is}, as the pictures of {}",
                file.display()
            )));
        }
    }
    (options.width, options.height) = (width, height);
    Ok(pictures.into_iter().map(|p| (p.camera.view(), p.image)).unzip())
}

/// Reads a picture of the size that is rendered.
pub(super) fn read(file: &Path, options: &RenderOptions) -> Result<Image> {
    let image = photofit_image::read(file)?;
    let (w, h) = (options.width, options.height);
    let name = file.display();
    if (image.width, image.height) != (w, h) {
        let (own_w, own_h) = (image.width, image.height);
        bail!(
            "{name}: is {own_w} x {own_h} pixels; it must be {w} x {h}, or --width and --height must say so"
        );
    }
    if image.channels < 3 {
        bail!("{name}: has {} channels; it must have three or four", image.channels);
    }
    if let Some(fault) = value_fault(&image) {
        bail!("{name}: {fault}");
    }
    Ok(Image::from_fn(w, h, 4, |x, y, c| if c < image.channels { image.pixel(x, y)[c] } else { 1.0 }))
}
