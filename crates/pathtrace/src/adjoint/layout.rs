//! Where the gradient of each parameter is accumulated.
//!
//! A cell holds up to three channels. Parameters of few cells come first: they are summed densely by every task; the
//! cells of large images and grids are summed in pages, which are made where they are touched, those of one channel apart.

use super::parameter::{
    MaterialValue, Parameter, VALUES, changes_directions, library_material, maps_of, not_differentiable,
};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use crate::volume::{Derivatives, MediumRef, MediumValue, Untold};
use crate::world::World;
use photofit_scene::MapKind;

/// Most cells of a parameter that is summed densely: of surfaces and lights, and of media, of which every path reads
/// many voxels.
const DENSE: usize = 64;
const DENSE_VOXELS: usize = 1 << 15;
/// No cell.
pub(super) const NONE: u32 = u32::MAX;

/// Where parameters of a material begin.
#[derive(Clone, Debug)]
pub(super) struct MaterialCells {
    values: [u32; VALUES],
    /// By texture of the tree.
    pub(super) graph: Vec<u32>,
    /// Some parameter changes how it scatters.
    pub(super) scatters: bool,
    /// Some parameter changes the directions of scattered light, and not only how much of it there is.
    pub(super) changes_directions: bool,
}

impl MaterialCells {
    #[inline(always)]
    pub(super) fn of(&self, value: MaterialValue) -> u32 {
        self.values[value as usize]
    }
}

/// Where the parameters of a medium begin, and what their derivatives need to know of it.
#[derive(Clone, Debug)]
pub(super) struct MediumCells {
    pub(super) extinction: u32,
    pub(super) albedo: u32,
    pub(super) emission: u32,
    /// Some of it scatters.
    pub(super) scatters: bool,
    /// See [`Derivatives::dark_albedo`].
    pub(super) dark_albedo: f32,
    /// See [`Derivatives::untold`]; of media whose values are asked for.
    pub(super) untold: Option<Untold>,
}

/// A parameter's cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub(super) start: usize,
    pub(super) cells: usize,
    pub(super) channels: usize,
}

/// How the cells of a parameter are summed by a task.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Storage {
    Dense,
    /// In pages of one channel, or of three.
    Single,
    Triple,
}

impl Storage {
    fn of(parameter: &Parameter, cells: usize, channels: usize, most: [usize; 2]) -> Self {
        let is_medium = matches!(parameter, Parameter::Medium { .. });
        match channels {
            _ if cells <= most[usize::from(is_medium)] => Self::Dense,
            1 => Self::Single,
            _ => Self::Triple,
        }
    }
}

/// Where everything is.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) ranges: Vec<Range>,
    pub(super) materials: Vec<MaterialCells>,
    /// By texture of the library.
    pub(super) textures: Vec<u32>,
    /// By light.
    pub(super) lights: Vec<u32>,
    pub(super) environment: u32,
    /// By volume, and by bounded medium.
    pub(super) volumes: Vec<MediumCells>,
    pub(super) bounded: Vec<MediumCells>,
    /// Values of media are asked for.
    pub(super) media: bool,
    /// Cells; the end of those that are summed densely, which come first, and of those of one channel, which follow.
    pub(super) cells: usize,
    pub(super) dense_end: usize,
    pub(super) single_end: usize,
    /// Absorption is asked for.
    pub(super) absorption: bool,
}

impl Layout {
    pub(super) fn new(world: &World, parameters: &[Parameter]) -> Result<Self, PathtraceError> {
        Self::with_most_dense(world, parameters, [DENSE, DENSE_VOXELS])
    }

    /// With so many cells at most that are summed densely: of a parameter of surfaces or lights, and of one of a medium.
    pub(super) fn with_most_dense(
        world: &World,
        parameters: &[Parameter],
        most: [usize; 2],
    ) -> Result<Self, PathtraceError> {
        let mut sizes = Vec::with_capacity(parameters.len());
        for (i, p) in parameters.iter().enumerate() {
            sizes.push(size(world, p).map_err(|rule| invalid(format!("parameter {i}"), rule))?);
        }
        let (mut ranges, mut start) = (vec![Range { start: 0, cells: 0, channels: 3 }; sizes.len()], 0);
        let [mut dense_end, mut single_end] = [0; 2];
        for kind in [Storage::Dense, Storage::Single, Storage::Triple] {
            for ((range, &(cells, channels)), p) in ranges.iter_mut().zip(&sizes).zip(parameters) {
                if Storage::of(p, cells, channels, most) == kind {
                    *range = Range { start, cells, channels };
                    start += cells;
                }
            }
            match kind {
                Storage::Dense => dense_end = start,
                Storage::Single => single_end = start,
                Storage::Triple => {}
            }
        }
        if start >= NONE as usize {
            return Err(invalid(
                "parameters",
                format!("have {start} texels or voxels; there may be at most 2^32 - 2"),
            ));
        }
        let material = |i: usize| {
            let graph = world.materials[i].graph.as_ref().map_or(0, |g| g.textures().len());
            MaterialCells {
                values: [NONE; VALUES],
                graph: vec![NONE; graph],
                scatters: false,
                changes_directions: false,
            }
        };
        let mut out = Self {
            ranges,
            materials: (0..world.materials.len()).map(material).collect(),
            textures: vec![NONE; world.library.as_ref().map_or(0, |l| l.textures())],
            lights: vec![NONE; world.lights.sources()],
            environment: NONE,
            volumes: vec![MediumCells::NONE; world.media.boxes.len()],
            bounded: vec![MediumCells::NONE; world.media.bounded.len()],
            media: false,
            cells: start,
            dense_end,
            single_end,
            absorption: false,
        };
        for (i, p) in parameters.iter().enumerate() {
            out.media |= matches!(p, Parameter::Medium { .. });
            if !out.place(world, p, out.ranges[i].start as u32) {
                return Err(invalid(format!("parameter {i}"), "is given twice; each may be given once"));
            }
        }
        Ok(out)
    }

    /// The same with what replays need to know of the media of these parameters, which reads all their values.
    pub(super) fn with_media(mut self, world: &World, parameters: &[Parameter]) -> Self {
        for p in parameters {
            if let Parameter::Medium { medium, .. } = p {
                let derivatives = Derivatives::of(world, *medium);
                let cells = self.medium_mut(*medium);
                // Read once, also where several values of a medium are asked for.
                if cells.untold.is_none() {
                    cells.scatters = !derivatives.absorbs_only();
                    cells.dark_albedo = derivatives.dark_albedo();
                    cells.untold = Some(derivatives.untold());
                }
            }
        }
        self
    }

    /// Writes down where a parameter is; whether it was free.
    fn place(&mut self, world: &World, parameter: &Parameter, start: u32) -> bool {
        let mut free = true;
        let mut put = |cell: &mut u32| {
            free &= *cell == NONE;
            *cell = start;
        };
        match parameter {
            Parameter::Material { materials, value } => {
                for m in users(world, materials, *value) {
                    let cells = &mut self.materials[m];
                    put(&mut cells.values[*value as usize]);
                    cells.scatters |= !matches!(
                        value,
                        MaterialValue::Emission | MaterialValue::Absorption | MaterialValue::Emissive
                    );
                    cells.changes_directions |= matches!(
                        value,
                        MaterialValue::Alpha
                            | MaterialValue::AlphaU
                            | MaterialValue::AlphaV
                            | MaterialValue::Roughness
                    );
                    self.absorption |= *value == MaterialValue::Absorption;
                }
            }
            Parameter::Texels { texture } => {
                put(&mut self.textures[*texture]);
                for (cells, given) in self.materials.iter_mut().zip(&world.given) {
                    if let Some(m) = library_material(given) {
                        cells.scatters |= maps_of(world, m, *texture).1;
                        cells.changes_directions |= changes_directions(world, m, *texture);
                    }
                }
            }
            Parameter::Graph { places } => {
                for &[m, t] in places {
                    put(&mut self.materials[m].graph[t]);
                    let last = self.materials[m].graph.len() - 1;
                    let graph = world.materials[m].graph.as_ref();
                    let emission = t == last && graph.is_some_and(|g| g.emission.is_some());
                    self.materials[m].scatters |= !emission;
                    self.materials[m].changes_directions |= graph.is_some_and(|g| g.changes_directions()[t]);
                }
            }
            Parameter::Light { light } => put(&mut self.lights[*light]),
            Parameter::Environment => put(&mut self.environment),
            Parameter::Medium { medium, value } => {
                let cells = self.medium_mut(*medium);
                let cell = match value {
                    MediumValue::Extinction => &mut cells.extinction,
                    MediumValue::Albedo => &mut cells.albedo,
                    MediumValue::Emission => &mut cells.emission,
                };
                free &= *cell == NONE;
                *cell = start;
            }
            Parameter::Positions { .. } => {}
        }
        free
    }

    /// The cells of a medium.
    #[inline(always)]
    pub(super) fn medium(&self, medium: MediumRef) -> &MediumCells {
        match medium {
            MediumRef::Volume(i) => &self.volumes[i],
            MediumRef::Bounded(i) => &self.bounded[i],
        }
    }

    fn medium_mut(&mut self, medium: MediumRef) -> &mut MediumCells {
        match medium {
            MediumRef::Volume(i) => &mut self.volumes[i],
            MediumRef::Bounded(i) => &mut self.bounded[i],
        }
    }
}

impl MediumCells {
    const NONE: Self = Self {
        extinction: NONE,
        albedo: NONE,
        emission: NONE,
        scatters: false,
        dark_albedo: 0.0,
        untold: None,
    };
}

/// The materials that a value is of: those that are named, and where it is a factor of library materials all that name
/// the same ones.
fn users(world: &World, named: &[usize], value: MaterialValue) -> Vec<usize> {
    if !value.is_factor() {
        return named.to_vec();
    }
    let library: Vec<_> = named.iter().map(|m| library_material(&world.given[*m])).collect();
    (0..world.given.len()).filter(|m| library.contains(&library_material(&world.given[*m]))).collect()
}

/// Cells and channels of a parameter, or the rule that it breaks.
fn size(world: &World, parameter: &Parameter) -> Result<(usize, usize), String> {
    match parameter {
        Parameter::Material { materials, value } => {
            if materials.is_empty() {
                return Err("names no material; it must name one".into());
            }
            for &m in materials {
                if m >= world.materials.len() {
                    return Err(absent(format!("material {m}"), world.materials.len()));
                }
                if let Some(rule) = value.missing(world, m) {
                    return Err(format!("material {m} has no {value:?} with a derivative: {rule}"));
                }
            }
            Ok((1, value.channels()))
        }
        Parameter::Texels { texture } => {
            let count = world.library.as_ref().map_or(0, |l| l.textures());
            let Some(library) = world.library.as_ref().filter(|_| *texture < count) else {
                return Err(absent(format!("texture {texture}"), count));
            };
            for m in world.given.iter().filter_map(library_material) {
                if maps_of(world, m, *texture).1
                    && let Some(rule) = not_differentiable(world, m)
                {
                    return Err(format!("texture {texture} is read by library material {m}: {rule}"));
                }
                if library.may_have_sheen(m) && library.texture_of(m, MapKind::Normal) == Some(*texture) {
                    return Err(format!(
                        "texture {texture} is the normal map of library material {m}: below sheen it has no derivatives"
                    ));
                }
            }
            let base = library.texture(*texture).layout().levels()[0];
            Ok(((base.width * base.height) as usize, 3))
        }
        Parameter::Graph { places } => {
            let mut found = None;
            for &[m, t] in places {
                let graph = world.materials.get(m).and_then(|c| c.graph.as_ref());
                let textures = graph.map_or_else(Vec::new, |g| g.textures());
                let texture = textures
                    .get(t)
                    .ok_or_else(|| absent(format!("texture {t} of material {m}"), textures.len()))?;
                let has = graph.is_some_and(|g| g.differentiable()[t]);
                let cells = texture.texels().filter(|_| has).ok_or(
                    "is a texture without derivatives; it must be a constant or an image that a diffuse surface or a \
                     rough metal reads, or that is emitted",
                )?;
                if found.is_some_and(|f| f != cells) {
                    return Err("names textures of several sizes; they must be the same".into());
                }
                found = Some(cells);
            }
            found.map(|cells| (cells, 3)).ok_or_else(|| "names no texture; it must name one".into())
        }
        Parameter::Light { light } => {
            let count = world.lights.sources();
            if *light < count { Ok((1, 3)) } else { Err(absent(format!("light {light}"), count)) }
        }
        Parameter::Environment => match &world.lights.environment {
            Some(e) => Ok((e.size()[0] * e.size()[1], 3)),
            None => Err("there is no environment; there must be one".into()),
        },
        Parameter::Medium { medium, value } => world.media.size(*medium, *value),
        Parameter::Positions { shape } => Err(format!(
            "shape {shape}: positions have no derivatives in the path tracer, which does not see how edges move; \
             they must be fitted through the rasterizer"
        )),
    }
}
