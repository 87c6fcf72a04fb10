//! Vertices that stay where they are, to the bit: those on open borders, where parts of a larger asset meet, and those that an
//! attribute of the asset marks.

use super::{Normalised, SimplifyOptions, options};
use crate::engine::asset::bits;
use crate::engine::plan::Item;
use crate::{FitError, Progress};
use photofit_geometry::decimate::{Decimated, Options, cleaned};
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Edges, Mesh};
use photofit_scalar::Vec3f;
use photofit_scene::{Compression, FlatScene, Scene};
use std::collections::{BTreeSet, HashMap, HashSet};

impl SimplifyOptions {
    /// Whether any vertex stays where it is.
    pub(super) fn locks(&self) -> bool {
        self.lock_borders || self.lock.is_some()
    }
}

/// The rule that whoever locks vertices must keep.
pub(super) fn rule(options: &SimplifyOptions, holds: bool, must: &str) -> Result<(), FitError> {
    match &options.lock {
        Some(name) => options::rule("lock", name, holds, must),
        None => options::rule("lock_borders", options.lock_borders, holds || !options.lock_borders, must),
    }
}

/// Refuses a name that no attribute of the asset has; warns where it marks no vertex.
pub(crate) fn check(
    scene: &Scene,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(), FitError> {
    let Some(name) = &options.lock else { return Ok(()) };
    let mut of = scene.vertex_attributes.iter().filter(|a| a.name.eq_ignore_ascii_case(name)).peekable();
    if of.peek().is_none() {
        let read = scene.vertex_attributes.iter().map(|a| a.name.as_str());
        let there: BTreeSet<&str> =
            read.chain(scene.ignored_attributes.iter().filter_map(|name| name.strip_prefix('_'))).collect();
        let has = match there.len() {
            0 => "the asset has none".to_owned(),
            _ => format!("the asset has {}", there.into_iter().take(8).collect::<Vec<_>>().join(", ")),
        };
        let rule =
            format!("is {name:?}; it must be an attribute of one number per vertex (_NAME in glTF): {has}");
        return Err(FitError::Setting { field: "lock", rule });
    }
    if !of.any(|a| a.values.iter().any(|x| *x > 0.5)) {
        progress.warn(&format!("no vertex is locked: the attribute {name:?} is above one half nowhere"));
    }
    Ok(())
}

/// `how`, with the vertices of `mesh` locked that the options name.
pub(super) fn locking(how: Options, mesh: &Mesh, n: &Normalised, options: &SimplifyOptions) -> Options {
    let marked = options.lock.as_deref().and_then(|name| n.marked(name));
    let locked = marked.map(|set| mesh.positions.iter().map(|p| set.contains(&bits(*p))).collect());
    Options { lock_border: options.lock_borders, locked: locked.unwrap_or_default(), ..how }
}

/// The positions that a decimation has locked.
pub(super) fn locked(d: &Decimated) -> HashSet<[u32; 3]> {
    d.mesh.positions.iter().zip(&d.locked).filter(|(_, locked)| **locked).map(|(p, _)| bits(*p)).collect()
}

/// Locked positions of an asset, and those of them that its light asset has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Held {
    wanted: usize,
    held: usize,
}

impl Held {
    /// What a written file holds of the positions that the options lock; `None` where they lock none.
    pub(super) fn of(file: &Scene, scene: &Scene, options: &SimplifyOptions) -> Option<Self> {
        if !options.locks() {
            return None;
        }
        let FlatScene { mut mesh, triangle_material } = scene.flatten();
        let weld = weld_exact(&mesh.positions);
        let double = |t: usize| scene.materials[triangle_material[t] as usize].double_sided;
        // Borders are those of what a decimation takes.
        let taken = cleaned(&weld.triangles(&mesh.triangles), double);
        mesh.triangles = taken.into_iter().map(|t| mesh.triangles[t as usize]).collect();
        let mut wanted: HashSet<[u32; 3]> = HashSet::new();
        if let Some(name) = &options.lock {
            let shown = shown(&mesh);
            let marked = scene.positions_with(name).into_iter().flatten().map(bits);
            wanted.extend(marked.filter(|p| shown.contains(p)));
        }
        if options.lock_borders {
            let border = Edges::new(&mesh.triangles, &weld).border_vertices();
            let open = weld.pick(&mesh.positions).into_iter().zip(border).filter(|(_, border)| *border);
            wanted.extend(open.map(|(p, _)| bits(p)));
        }
        let there = shown(&file.flatten().mesh);
        Some(Self { wanted: wanted.len(), held: wanted.intersection(&there).count() })
    }

    /// The row of the plan, for geometry that is stored in a way.
    pub(super) fn row(self, compression: Compression) -> Item {
        Item::note("locked vertices", self.told(compression))
    }

    fn told(self, compression: Compression) -> String {
        let Self { wanted, held } = self;
        let why = match compression {
            _ if held == wanted => "",
            Compression::None => {
                "; the others lie so near to another vertex that the fit does not tell them apart"
            }
            Compression::Meshopt(_) => "; compression rounds the others",
        };
        format!("{held} of {wanted} positions stay to the bit{why}")
    }

    /// Warns where not all are held, though nothing that was asked for is the reason.
    pub(super) fn warn(self, compression: Compression, progress: &dyn Progress) {
        if self.held < self.wanted && compression == Compression::None {
            progress.warn(&format!("locked vertices: {}", self.told(compression)));
        }
    }
}

/// The positions that triangles show.
fn shown(mesh: &Mesh) -> HashSet<[u32; 3]> {
    mesh.triangles.iter().flatten().map(|v| bits(mesh.positions[*v as usize])).collect()
}

/// Gives the vertices of a light asset that did not move the positions of the asset: the way to the frame of the fit and back
/// rounds them.
pub(super) fn restore(light: &mut Scene, scene: &Scene, n: &Normalised) {
    let own = scene.flatten().mesh.positions;
    let back = |p: &Vec3f| bits(n.frame().to_world(*p));
    let mut exact: HashMap<[u32; 3], Vec3f> =
        n.flat.mesh.positions.iter().map(back).zip(own.iter().copied()).collect();
    // Where vertices round to one, what is marked is meant.
    let marked = n.flat.mesh.positions.iter().zip(own).filter(|(p, _)| n.is_marked(**p));
    exact.extend(marked.map(|(p, own)| (back(p), own)));
    for p in light.primitives.iter_mut().flat_map(|p| &mut p.mesh.positions) {
        *p = exact.get(&bits(*p)).copied().unwrap_or(*p);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Heard, of};
    use super::*;
    use photofit_geometry::shapes::{cube, quad_grid};
    use photofit_scene::{Material, Precision};

    #[test]
    fn what_a_file_holds_of_locked_vertices_is_counted_in_it() {
        let scene = of(quad_grid(4, 3), Material::clay());
        let borders = SimplifyOptions { lock_borders: true, ..SimplifyOptions::default() };
        assert_eq!(Held::of(&scene, &scene, &SimplifyOptions::default()), None);
        let all = Held::of(&scene, &scene, &borders).unwrap();
        assert_eq!(all, Held { wanted: 14, held: 14 });
        let mut moved = scene.clone();
        let inner = 6;
        moved.primitives[0].mesh.positions[inner].z += 0.5;
        assert_eq!(Held::of(&moved, &scene, &borders), Some(all), "the vertex {inner} is inside");
        moved.primitives[0].mesh.positions[0].z = f32::from_bits(1);
        let less = Held::of(&moved, &scene, &borders).unwrap();
        assert_eq!(less, Held { wanted: 14, held: 13 });
        let heard = Heard::default();
        all.warn(Compression::None, &heard);
        let rounded = Compression::Meshopt(Precision::default());
        less.warn(rounded, &heard);
        assert!(heard.0.lock().unwrap().is_empty(), "rounding was asked for");
        less.warn(Compression::None, &heard);
        assert!(heard.0.lock().unwrap().join("").contains("13 of 14"));
        assert!(
            all.row(rounded).why.ends_with("to the bit") && less.row(rounded).why.contains("compression")
        );
    }

    /// A closed box with a vertex in the middle of an edge, where a triangle of no area joins both sides; and a triangle that stands
    /// twice, and one of a single point.
    #[test]
    fn borders_are_those_of_what_a_decimation_takes() {
        let borders = SimplifyOptions { lock_borders: true, ..SimplifyOptions::default() };
        let wanted = |mesh: &Mesh| {
            let scene = of(mesh.clone(), Material::clay());
            Held::of(&scene, &scene, &borders).unwrap().wanted
        };
        let mut mesh = quad_grid(1, 1);
        assert_eq!(wanted(&mesh), 4);
        mesh.triangles.push(mesh.triangles[0]);
        mesh.triangles.push([1, 1, 1]);
        assert_eq!(wanted(&mesh), 4, "what stands twice or has no corners is no neighbour");
        let mut mesh = Mesh { normals: Vec::new(), uvs: Vec::new(), ..cube() };
        assert_eq!(wanted(&mesh), 0);
        let [a, b, c] = mesh.triangles[0];
        let p = |v: u32| mesh.positions[v as usize];
        let middle = (p(a) + p(b)) * 0.5;
        let m = mesh.positions.len() as u32;
        mesh.positions.push(middle);
        mesh.triangles[0] = [a, m, c];
        mesh.triangles.push([m, b, c]);
        assert_eq!(wanted(&mesh), 3, "open at both halves of the edge and along it");
        mesh.triangles.push([b, m, a]);
        assert_eq!(wanted(&mesh), 0, "closed by what has no area");
    }
}
