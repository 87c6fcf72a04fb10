//! `emitter` elements that belong to no shape.

use super::spectrum::Meaning;
use super::{Importer, MitsubaEnvironment};
use crate::error::{Fault, fault};
use crate::{LightKind, LightPicture, PunctualLight};
use glam::{DMat3, DVec3};
use photofit_image::Image;

impl Importer {
    /// An emitter at the top of the scene.
    pub(super) fn emitter(&mut self, element: usize) -> Result<(), Fault> {
        let kind = self.reader.kind(element).to_owned();
        match kind.as_str() {
            // Shapes refer to it.
            "area" => return Ok(()),
            "point" => self.point_light(element)?,
            "spot" => self.spot(element)?,
            "projector" => self.projector(element)?,
            "directional" => self.directional(element)?,
            "constant" => {
                let radiance = self.color(element, "radiance")?;
                let image = Image::from_data(1, 1, 3, radiance.to_vec());
                let name = self.name(element, || "environment".into());
                self.environment(
                    element,
                    MitsubaEnvironment { name, image, scale: 1.0, to_world: DMat3::IDENTITY },
                )?;
            }
            "envmap" => {
                let environment = self.environment_map(element)?;
                self.environment(element, environment)?;
            }
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
            }
        }
        self.reader.ignore(element, &["sampling_weight"]);
        self.reader.finish(element);
        Ok(())
    }

    /// A colour of light, 1 by default.
    fn color(&mut self, element: usize, name: &str) -> Result<[f32; 3], Fault> {
        let texture = self.texture(element, name, Meaning::Emission, 1.0)?;
        match texture.constant() {
            Some(c) => Ok(c.to_array()),
            None => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, format!("a textured {name} of {title}"));
                Ok([0.0; 3])
            }
        }
    }

    fn environment(&mut self, element: usize, environment: MitsubaEnvironment) -> Result<(), Fault> {
        if self.scene.environment.is_some() {
            return Err(fault(
                self.reader.place(element),
                "is a second environment; a scene may have one environment",
            ));
        }
        self.scene.environment = Some(environment);
        Ok(())
    }

    fn point_light(&mut self, element: usize) -> Result<(), Fault> {
        let own = self.reader.point(element, "position")?;
        let position = match own {
            Some(p) => p,
            None => self.reader.affine(element, "to_world")?.translation,
        };
        let intensity = self.color(element, "intensity")?;
        self.light(element, LightKind::Point, position, DVec3::Z, intensity, None);
        Ok(())
    }

    pub(super) fn light(
        &mut self,
        element: usize,
        kind: LightKind,
        position: DVec3,
        direction: DVec3,
        intensity: [f32; 3],
        picture: Option<LightPicture>,
    ) {
        let light = PunctualLight {
            name: self.name(element, || format!("emitter_{}", self.scene.lights.len())),
            range: None,
            kind,
            position: position.as_vec3(),
            direction: direction.as_vec3(),
            intensity,
            picture,
        };
        self.scene.lights.push(light);
    }

    fn directional(&mut self, element: usize) -> Result<(), Fault> {
        let own = self.reader.point(element, "direction")?;
        let direction = match own {
            Some(d) => d,
            None => self.reader.affine(element, "to_world")?.matrix3 * DVec3::Z,
        };
        let direction = self.direction(element, direction)?;
        let irradiance = self.color(element, "irradiance")?;
        self.light(element, LightKind::Directional, DVec3::ZERO, direction, irradiance, None);
        Ok(())
    }

    fn direction(&self, element: usize, d: DVec3) -> Result<DVec3, Fault> {
        d.try_normalize()
            .ok_or_else(|| fault(self.reader.place(element), "the direction is zero; it must not be"))
    }

    fn spot(&mut self, element: usize) -> Result<(), Fault> {
        let to_world = self.reader.affine(element, "to_world")?;
        let direction = self.direction(element, to_world.matrix3 * DVec3::Z)?;
        let cutoff = self.reader.float(element, "cutoff_angle")?.unwrap_or(20.0);
        let beam = self.reader.float(element, "beam_width")?.unwrap_or(0.75 * cutoff);
        if !(cutoff > 0.0 && cutoff <= 90.0 && (0.0..=cutoff).contains(&beam)) {
            let rule = format!(
                "the spot has beam_width {beam} and cutoff_angle {cutoff}; they must be 0 <= beam_width <= cutoff_angle <= 90"
            );
            return Err(fault(self.reader.place(element), rule));
        }
        let intensity = self.color(element, "intensity")?;
        let kind = LightKind::Spot { inner: beam.to_radians() as f32, outer: cutoff.to_radians() as f32 };
        let picture = self.thrown_by_spot(element, &to_world, cutoff)?;
        self.light(element, kind, to_world.translation, direction, intensity, picture);
        Ok(())
    }

    fn environment_map(&mut self, element: usize) -> Result<MitsubaEnvironment, Fault> {
        let place = self.reader.place(element);
        let name = self.reader.string(element, "filename")?;
        let name = name.ok_or_else(|| fault(&place, "the envmap has no filename; it must have one"))?;
        let scale = self.reader.float(element, "scale")?.unwrap_or(1.0) as f32;
        if scale < 0.0 {
            return Err(fault(place, format!("the scale is {scale}; it must not be negative")));
        }
        // Sampling only.
        self.reader.ignore(element, &["mis_compensation"]);
        let to_world = self.reader.affine(element, "to_world")?.matrix3;
        let to_world = self.rigid(element, to_world)?;
        let path = self.reader.document.resolve(&name, &place)?;
        let found = self.image(&path, false, &place)?;
        if found.width < 2 || found.height < 3 {
            return Err(fault(
                place,
                format!("the map has {} x {} pixels; it must have 2 x 3", found.width, found.height),
            ));
        }
        let mut image = Image::new(found.width, found.height, 3);
        for (to, from) in image.data.chunks_exact_mut(3).zip(found.data.chunks_exact(found.channels)) {
            match from {
                [r, g, b, ..] => to.copy_from_slice(&[*r, *g, *b]),
                _ => to.fill(from[0]),
            }
            if to.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(fault(place, "a radiance is infinite or negative; it must be neither"));
            }
        }
        let name = self.name(element, || "environment".into());
        Ok(MitsubaEnvironment { name, image, scale, to_world })
    }

    /// The transform of an environment, without its scale, which does not matter where it is uniform.
    fn rigid(&self, element: usize, m: DMat3) -> Result<DMat3, Fault> {
        let size = m.determinant().abs().cbrt();
        let unit = m * (1.0 / size);
        let error = (unit.transpose() * unit - DMat3::IDENTITY).to_cols_array();
        if size > 0.0 && error.iter().all(|e| e.abs() < 1e-4) {
            return Ok(unit);
        }
        Err(fault(
            self.reader.place(element),
            "the environment is sheared or stretched; it may be turned, mirrored and scaled uniformly",
        ))
    }
}
