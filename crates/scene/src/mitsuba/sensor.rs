//! `sensor` elements with their film and sampler.

use super::Importer;
use crate::error::{Fault, fault};
use glam::DVec3;

/// How a sensor sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Projection {
    /// Through a point, or a thin lens of the given radius that is sharp at a distance along the axis.
    Perspective {
        /// Radius of the aperture and distance of focus.
        lens: Option<[f32; 2]>,
    },
    /// Along parallel rays.
    #[default]
    Orthographic,
}

/// The camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MitsubaSensor {
    /// How it sees.
    pub projection: Projection,
    /// The eye.
    pub eye: DVec3,
    /// Unit axes: to the right of the picture, up, and against the view. At right angles, of either handedness.
    pub axes: [DVec3; 3],
    /// Half the width and height of the whole picture: at distance 1 along the axis, or of parallel rays.
    pub half: [f64; 2],
    /// Distances along the axis between which surfaces are seen.
    pub clip: [f64; 2],
    /// Moves what is seen, in widths and heights of the whole picture.
    pub shift: [f64; 2],
    /// The film.
    pub film: MitsubaFilm,
    /// Samples per pixel.
    pub samples: u32,
    /// Index of the medium that the camera is in, into [`super::MitsubaScene::media`].
    pub medium: Option<usize>,
}

/// The weight of light around the centre of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MitsubaFilter {
    /// The area of a pixel.
    #[default]
    Box,
    /// A pyramid of this half width, in pixels.
    Tent(f32),
    /// A Gaussian of this standard deviation, in pixels.
    Gaussian(f32),
}

/// The picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MitsubaFilm {
    /// Columns and rows of the whole picture.
    pub size: [u32; 2],
    /// Upper left pixel of the part that is rendered.
    pub crop_offset: [u32; 2],
    /// Columns and rows of that part.
    pub crop_size: [u32; 2],
    /// The filter.
    pub filter: MitsubaFilter,
}

/// Pixels of the part of a film that is rendered.
const PIXELS: u64 = 1 << 28;

impl Importer {
    pub(super) fn sensor(&mut self, element: usize) -> Result<MitsubaSensor, Fault> {
        let kind = self.reader.kind(element).to_owned();
        let perspective = match kind.as_str() {
            "perspective" | "thinlens" => true,
            "orthographic" => false,
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
                return Ok(MitsubaSensor::default());
            }
        };
        let mut film = self.film(element)?;
        for k in 0..2 {
            if let Some(n) = self.size[k] {
                film.size[k] = n.max(1);
            }
        }
        if self.size != [None; 2] {
            (film.crop_offset, film.crop_size) = ([0, 0], film.size);
        }
        let pixels = u64::from(film.crop_size[0]) * u64::from(film.crop_size[1]);
        if pixels > PIXELS {
            let [width, height] = film.crop_size;
            let rule = format!("the film has {width} x {height} pixels, {pixels}; it may have {PIXELS}");
            return Err(fault(self.reader.place(element), rule));
        }
        let samples = self.samples(element)?;
        let to_world = self.reader.affine(element, "to_world")?;
        let clip = [
            self.reader.float(element, "near_clip")?.unwrap_or(1e-2),
            self.reader.float(element, "far_clip")?.unwrap_or(1e4),
        ];
        if !(clip[0] > 0.0 && clip[0] < clip[1]) {
            let rule = format!(
                "near_clip is {} and far_clip {}; they must be 0 < near_clip < far_clip",
                clip[0], clip[1]
            );
            return Err(fault(self.reader.place(element), rule));
        }
        let aspect = f64::from(film.size[0]) / f64::from(film.size[1]);
        let mut shift = [0.0; 2];
        for (s, name) in shift.iter_mut().zip(["principal_point_offset_x", "principal_point_offset_y"]) {
            *s = self.reader.float(element, name)?.unwrap_or(0.0);
        }
        let lens = if kind == "thinlens" { Some(self.lens(element)?) } else { None };
        let x =
            if perspective { (0.5 * self.field_of_view(element, aspect)?.to_radians()).tan() } else { 1.0 };
        self.reader.ignore(
            element,
            &["focus_distance", "shutter_open", "shutter_close", "srf", "needs_sample_2", "needs_sample_3"],
        );
        let medium = match self.reader.nested(element, "medium")?[..] {
            [] => None,
            [(_, medium)] => self.medium(medium, element, "medium")?,
            _ => {
                return Err(fault(
                    self.reader.place(element),
                    "the sensor is in several media; it must be in one",
                ));
            }
        };
        self.reader.finish(element);
        let (axes, scale) = self.axes(element, &to_world)?;
        let projection =
            if perspective { Projection::Perspective { lens } } else { Projection::Orthographic };
        if perspective && (scale - DVec3::ONE).abs().max_element() > 1e-4 {
            return Err(fault(
                self.reader.place(element),
                "the perspective sensor is scaled; it must not be",
            ));
        }
        let half = if perspective { [x, x / aspect] } else { [scale.x, scale.y / aspect] };
        let eye = to_world.translation;
        Ok(MitsubaSensor { projection, eye, axes, half, clip, shift, film, samples, medium })
    }

    fn lens(&mut self, element: usize) -> Result<[f32; 2], Fault> {
        let radius = self.reader.float(element, "aperture_radius")?;
        let focus = self.reader.float(element, "focus_distance")?;
        match (radius, focus) {
            (Some(r), Some(f)) if r >= 0.0 && f > 0.0 => Ok([r as f32, f as f32]),
            _ => {
                let rule =
                    "the thin lens lacks aperture_radius or a positive focus_distance; it must have both";
                Err(fault(self.reader.place(element), rule))
            }
        }
    }

    fn samples(&mut self, element: usize) -> Result<u32, Fault> {
        let samplers = self.reader.nested(element, "sampler")?;
        let Some((_, sampler)) = samplers.first().cloned() else { return Ok(4) };
        let count = self.reader.integer(sampler, "sample_count")?.unwrap_or(4);
        u32::try_from(count).ok().filter(|n| (1..=1 << 24).contains(n)).ok_or_else(|| {
            fault(self.reader.place(sampler), format!("sample_count is {count}; it must be 1 to 2^24"))
        })
    }

    fn film(&mut self, element: usize) -> Result<MitsubaFilm, Fault> {
        let films = self.reader.nested(element, "film")?;
        let Some((_, film)) = films.first().cloned() else {
            let filter = MitsubaFilter::Gaussian(0.5);
            return Ok(MitsubaFilm { size: [768, 576], crop_offset: [0, 0], crop_size: [768, 576], filter });
        };
        let place = self.reader.place(film);
        let mut number = |name: &str, default: i64, least: i64| -> Result<u32, Fault> {
            let n = self.reader.integer(film, name)?.unwrap_or(default);
            u32::try_from(n)
                .ok()
                .filter(|n| (least as u32..=1 << 16).contains(n))
                .ok_or_else(|| fault(&place, format!("{name} is {n}; it must be {least} to 65536")))
        };
        let size = [number("width", 768, 1)?, number("height", 576, 1)?];
        let crop_offset = [number("crop_offset_x", 0, 0)?, number("crop_offset_y", 0, 0)?];
        let mut crop_size = [0; 2];
        for k in 0..2 {
            let name = ["crop_width", "crop_height"][k];
            let rest = i64::from(size[k]) - i64::from(crop_offset[k]);
            crop_size[k] = number(name, rest.max(0), 1)?;
            if i64::from(crop_size[k]) > rest {
                return Err(fault(place, "the crop window leaves the picture; it must lie inside"));
            }
        }
        let filter = self.filter(film)?;
        self.reader.ignore(
            film,
            &[
                "file_format",
                "pixel_format",
                "component_format",
                "sample_border",
                "compensate",
                "banner",
                "high_quality_edges",
                "gamma",
                "exposure",
                "bayer",
            ],
        );
        self.reader.finish(film);
        Ok(MitsubaFilm { size, crop_offset, crop_size, filter })
    }

    fn filter(&mut self, film: usize) -> Result<MitsubaFilter, Fault> {
        let filters = self.reader.nested(film, "rfilter")?;
        let Some((_, filter)) = filters.first().cloned() else { return Ok(MitsubaFilter::Gaussian(0.5)) };
        let kind = self.reader.kind(filter).to_owned();
        let out = match kind.as_str() {
            "box" => {
                self.reader.ignore(filter, &["radius"]);
                MitsubaFilter::Box
            }
            "tent" => MitsubaFilter::Tent(self.width(filter, "radius", 1.0)?),
            "gaussian" => MitsubaFilter::Gaussian(self.width(filter, "stddev", 0.5)?),
            _ => {
                let title = self.reader.title(filter);
                self.reader.unsupported(filter, title);
                self.reader.mark_all(filter);
                MitsubaFilter::Box
            }
        };
        self.reader.finish(filter);
        Ok(out)
    }

    fn width(&mut self, filter: usize, name: &str, default: f64) -> Result<f32, Fault> {
        let width = self.reader.float(filter, name)?.unwrap_or(default);
        if width > 0.0 && width <= 25.0 {
            return Ok(width as f32);
        }
        Err(fault(
            self.reader.place(filter),
            format!("{name} is {width} pixels; it must lie between 0 and 25"),
        ))
    }
}
