//! An asset with its own texture coordinates, materials and textures on fewer triangles, in place of a fit.

use super::byte_budget::Budget;
use super::delivery::Delivery;
use super::{Asset, Outcome, SimplifyOptions, Written, byte_budget, dressed, plain};
use crate::candidate::{Candidate, SurfaceClass};
use crate::engine::FitFrame;
use crate::engine::judge::Stage;
use crate::engine::plan::SurfacePlan;
use crate::engine::surface::Surface;
use crate::engine::trainer::{HeldOut, Trained};
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_geometry::weld::weld_exact;
use photofit_raster::Maps;
use photofit_scalar::vec2;
use photofit_scene::Scene;
use std::path::Path;
use std::time::Instant;

/// Decimates an asset in several ways, and writes what looks best.
pub(super) fn simplify(
    asset: Asset<'_>,
    output: &Path,
    options: &SimplifyOptions,
    began: Instant,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    let Asset { given, scene, n, .. } = asset;
    let reference = &*options.rasterized_against().reference(scene, n, options)?;
    let (views, count) = (options.orbit(options.resolution), options.choice_views());
    HeldOut::new(reference, &views, options.sampling(), count, options.seed)?.warn_unseen(progress);
    progress.report("decimate", 0, 1, "");
    let first = plain::decimated(scene, n, &[], &plain::own(options.target, n, options))?;
    let best = plain::best(asset, first, reference, options.target, options, progress)?;
    let decimation = best.1.row();
    let (light, compression, counted) = match options.max_bytes {
        None => (dressed(plain::kept(&best.0, n, options), asset, options), options.compression, None),
        Some(most) => {
            let budget = Budget { most, asset, reference, options, progress };
            let written = |stage: &Stage| plain::kept(stage, n, options);
            let shapes = plain::shapes(asset, &best, (options, progress), &written)?;
            let mut made = budget.within(&shapes)?;
            let best = budget.best(&made)?;
            let fitting = made.iter().filter(|m| m.bytes() <= most).count();
            let of = (fitting, progress.is_cancelled());
            let counted = byte_budget::compared(options, given, (&shapes, best), of);
            let (made, _) = budget.or_whole(made.swap_remove(best), None)?;
            (made.scene, made.compression, counted)
        }
    };
    let cut = progress.is_cancelled();
    let delivery = Delivery { asset, reference, options, output, began, progress };
    let file = delivery.deliver((&light, compression), Written::Kept, Vec::new())?;
    let plan = delivery.told(options.plan(given, reference.kind()).with_counted(counted), &file);
    let plan = plan.with_result(Written::Kept, [0; 2], (None, false)).with_decimation(Some(decimation));
    let shape = stand_in(file.file(), n.frame());
    let fitted = SurfacePlan::new(&shape, options.fit_request(reference.kind()));
    let model = Surface::new(shape, &fitted);
    let trained = Trained {
        model,
        history: Vec::new(),
        steps: 0,
        resumed: 0,
        mpix_per_s: 0.0,
        stopped: false,
        behind: None,
    };
    Ok(Outcome { choice_cut: cut, ..Outcome::new(&delivery, file, trained, plan) })
}

/// The shape of a written asset as a candidate, whose maps are a single texel.
fn stand_in(light: &Scene, frame: FitFrame) -> Candidate {
    let flat = light.flatten();
    let positions: Vec<_> = flat.mesh.positions.iter().map(|p| frame.to_frame(*p)).collect();
    let uvs = vec![vec2(0.0, 0.0); positions.len()];
    let mesh = Mesh { positions, uvs, triangles: flat.mesh.triangles, ..Mesh::default() };
    let class = vec![0; mesh.triangles.len()];
    let maps = Maps::filled(1, 1, crate::bake::blank_texel());
    Candidate::new(&mesh, &weld_exact(&mesh.positions), class, vec![SurfaceClass::default()], maps)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Heard, options, tiled};
    use super::super::{Appearance, Init, simplify};
    use super::*;
    use crate::Silent;
    use crate::engine::asset::bits;
    use crate::lod::{LodOptions, simplify_chain};
    use photofit_geometry::decimate::Target;
    use photofit_scalar::vec3;
    use photofit_scene::VertexAttribute;
    use std::collections::HashSet;

    fn kept() -> SimplifyOptions {
        SimplifyOptions { appearance: Appearance::Kept, target: Target::Ratio(0.25), ..options() }
    }

    #[test]
    fn tiled_textures_and_their_coordinates_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let scene = tiled();
        let made = simplify(&scene, &path, &kept(), &Silent).unwrap();
        let light = photofit_scene::load(&path).unwrap();
        assert_eq!((made.written, made.steps, light.triangle_count()), (Written::Kept, 0, 200));
        assert_eq!(light.images[0].texels, scene.images[0].texels);
        let mesh = &light.primitives[0].mesh;
        // Coordinates are linear in x and y, so they must be right wherever a vertex went.
        for (p, uv) in mesh.positions.iter().zip(&mesh.uvs) {
            let [a, b, c] = [0, 20, 420].map(|v| {
                let m = &scene.primitives[0].mesh;
                (m.positions[v], m.uvs[v])
            });
            let (s, t) = ((p.x - a.0.x) / (b.0.x - a.0.x), (p.y - a.0.y) / (c.0.y - a.0.y));
            let want = a.1 + (b.1 - a.1) * s + (c.1 - a.1) * t;
            assert!((*uv - want).length() < 0.03, "{p:?}: {uv:?}, expected {want:?}");
        }
        assert!(made.shipped().unwrap().psnr > 30.0, "{:?}", made.stages);
        assert!(crate::report::Verdict::of(&made).better.is_none());
        let told = made.plan.to_string();
        assert!(!told.contains("baked") && !told.contains("open ") && !told.contains("gradients"), "{told}");
    }

    #[test]
    fn an_asset_without_coordinates_keeps_its_materials() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let mut scene = tiled();
        let parts = scene.primitives.iter_mut();
        parts.for_each(|p| p.mesh.uvs.clear());
        let made = simplify(&scene, &path, &kept(), &Silent).unwrap();
        let light = photofit_scene::load(&path).unwrap();
        assert_eq!((made.written, made.steps), (Written::Kept, 0));
        assert!(
            light.triangle_count() <= 200 && light.materials[0].base_color == scene.materials[0].base_color
        );
        let sphere = SimplifyOptions { init: Init::Sphere, ..kept() };
        let path = dir.path().join("never-written.glb");
        let refused = simplify(&tiled(), &path, &sphere, &Silent).unwrap_err().to_string();
        assert!(refused.contains("appearance is kept; it goes with"), "{refused}");
        assert!(!path.exists());
    }

    #[test]
    fn locked_borders_stay_to_the_bit_in_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let mut scene = tiled();
        // A frame that does not round well.
        for p in &mut scene.primitives[0].mesh.positions {
            *p = *p * 1.37 + vec3(0.71, -3.3, 0.13);
        }
        let border = |mesh: &Mesh| {
            let weld = weld_exact(&mesh.positions);
            let edges = photofit_geometry::Edges::new(&mesh.triangles, &weld);
            let positions = weld.pick(&mesh.positions);
            let mut uses = vec![0; edges.vertices.len()];
            edges.of_triangle.iter().flatten().for_each(|e| uses[*e as usize] += 1);
            let open = edges.vertices.iter().zip(uses).filter(|(_, n)| *n == 1).flat_map(|(e, _)| *e);
            let mut bits: Vec<_> = open.map(|v| bits(positions[v as usize])).collect();
            bits.sort_unstable();
            bits.dedup();
            bits
        };
        let before = border(&scene.primitives[0].mesh);
        assert_eq!(before.len(), 80);
        for appearance in [Appearance::Kept, Appearance::Maps] {
            let o = SimplifyOptions { lock_borders: true, appearance, ..kept() };
            let heard = Heard::default();
            let made = simplify(&scene, &path, &o, &heard).unwrap();
            assert!(made.triangles_out <= 200 && heard.0.lock().unwrap().is_empty());
            assert!(made.plan.to_string().contains("80 of 80 positions stay to the bit"), "{}", made.plan);
            let light = photofit_scene::load(&path).unwrap().flatten();
            assert_eq!(border(&light.mesh), before, "{appearance:?}");
            // A budget that the border leaves no room for.
            let few = SimplifyOptions { target: Target::Triangles(64), steps: 4, ..o };
            let made = simplify(&scene, &path, &few, &heard).unwrap();
            let told = heard.0.lock().unwrap().join("\n");
            assert!(made.triangles_out > 64 && told.contains("locked vertices"), "{told}");
        }
        let free = SimplifyOptions { target: Target::Triangles(64), ..kept() };
        simplify(&scene, &path, &free, &Silent).unwrap();
        assert_ne!(border(&photofit_scene::load(&path).unwrap().flatten().mesh), before);
    }

    #[test]
    fn vertices_that_an_attribute_marks_stay_to_the_bit_in_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let mut scene = tiled();
        for p in &mut scene.primitives[0].mesh.positions {
            *p = *p * 1.37 + vec3(0.71, -3.3, 0.13);
        }
        let marks: Vec<f32> =
            (0..scene.primitives[0].mesh.positions.len()).map(|v| (v % 29 == 3).into()).collect();
        let attribute = |name: &str, values| VertexAttribute { name: name.into(), primitive: 0, values };
        scene.vertex_attributes = vec![attribute("Seam", marks.clone())];
        let wanted = scene.positions_with("seam").unwrap();
        assert_eq!(wanted.len(), marks.iter().filter(|m| **m > 0.5).count());
        let there = |light: &Scene| {
            let mesh = light.flatten().mesh;
            let all: HashSet<_> =
                mesh.triangles.iter().flatten().map(|v| bits(mesh.positions[*v as usize])).collect();
            wanted.iter().filter(|p| all.contains(&bits(**p))).count()
        };
        for appearance in [Appearance::Kept, Appearance::Maps] {
            let free = SimplifyOptions { appearance, ..kept() };
            simplify(&scene, &path, &free, &Silent).unwrap();
            assert!(there(&photofit_scene::load(&path).unwrap()) < wanted.len(), "{appearance:?}");
            let locked = SimplifyOptions { lock: Some("SEAM".into()), ..free };
            let made = simplify(&scene, &path, &locked, &Silent).unwrap();
            assert!(made.triangles_out <= 200, "{}", made.triangles_out);
            let kept = appearance == Appearance::Kept;
            assert_eq!((made.written == Written::Kept, made.steps > 0), (kept, !kept));
            assert_eq!(there(&photofit_scene::load(&path).unwrap()), wanted.len(), "{appearance:?}");
            assert!(made.left_out.iter().any(|l| l.contains("vertex attribute")), "{:?}", made.left_out);
        }
        // From level to level, too.
        let fit = SimplifyOptions { lock: Some("seam".into()), appearance: Appearance::Maps, ..kept() };
        let chain = LodOptions {
            sizes: vec![64.0, 32.0, 16.0],
            triangles: vec![300, 200, 100],
            fit,
            ..LodOptions::default()
        };
        let made = simplify_chain(&scene, &path, &chain, &Silent).unwrap();
        for level in &made.levels {
            assert_eq!(there(&photofit_scene::load(&level.path).unwrap()), wanted.len(), "{:?}", level.path);
        }
        assert_eq!(made.levels.len(), 3);
        // The fit holds them, and is not what happens to leave them there.
        let fitted = &made.levels[0].outcome.candidate;
        assert_eq!(fitted.locked.len(), wanted.len());
        let other = SimplifyOptions { lock: Some("hem".into()), ..kept() };
        let refused = simplify(&scene, &path, &other, &Silent).unwrap_err().to_string();
        assert!(["lock", "\"hem\"", "Seam"].iter().all(|w| refused.contains(w)), "{refused}");
        scene.vertex_attributes.clear();
        let refused = simplify(&scene, &path, &other, &Silent).unwrap_err().to_string();
        assert!(refused.contains("the asset has none"), "{refused}");
        scene.vertex_attributes = vec![attribute("hem", vec![0.5; marks.len()])];
        let heard = Heard::default();
        simplify(&scene, &path, &other, &heard).unwrap();
        let told = heard.0.lock().unwrap().join("\n");
        assert!(told.contains("no vertex is locked") && told.contains("hem"), "{told}");
    }
}
