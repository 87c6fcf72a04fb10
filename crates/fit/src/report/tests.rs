//! Tests of the whole page.

use super::*;
use crate::Silent;
use crate::simplify::{SimplifyOptions, simplify};
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes::displaced_sphere;
use photofit_scalar::vec4;
use photofit_scene::{Instance, Material, Primitive};

fn asset() -> Scene {
    // Colours that vary, so that there is a texture.
    let mut mesh = displaced_sphere(8, 0.2, 3, 1);
    mesh.colors = mesh.positions.iter().map(|p| vec4(0.5 + 0.4 * p.x, 0.5, 0.5 - 0.4 * p.y, 1.0)).collect();
    Scene {
        name: "rock".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![Material::clay()],
        ..Scene::default()
    }
}

#[test]
fn the_page_is_whole_and_needs_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let scene = asset();
    let options = SimplifyOptions {
        target: Target::Triangles(200),
        resolution: 32,
        steps: 3,
        batch: 1,
        own_textures: false,
        texture_size: 32,
        report_views: 2,
        ..SimplifyOptions::default()
    };
    let mut outcome = simplify(&scene, &dir.path().join("rock.glb"), &options, &Silent).unwrap();
    let light = dir.path().join("rock.glb");
    outcome.left_out = vec!["2 animations".into()];
    let info = ReportInfo {
        scene: &scene,
        light: &light,
        title: "rock <&>".into(),
        command: "photofit simplify \"a b\"".into(),
        bytes_in: Some(5_000_000),
        warnings: vec!["3 of <4> parts".into()],
        screen_size: Some(20.0),
    };
    let page = write_report(&dir.path().join("new/report"), &outcome, &info).unwrap();
    // An earlier report is replaced, somebody else's page is kept.
    write_report(&dir.path().join("new/report"), &outcome, &info).unwrap();
    assert_eq!(std::fs::read_dir(dir.path().join("new/report")).unwrap().count(), 1);
    std::fs::create_dir(dir.path().join("site")).unwrap();
    std::fs::write(dir.path().join("site/index.html"), "<h1>mine</h1>").unwrap();
    write_report(&dir.path().join("site"), &outcome, &info).unwrap();
    assert_eq!(std::fs::read_to_string(dir.path().join("site/index.html.bak")).unwrap(), "<h1>mine</h1>");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>\n"));
    for part in [
        "rock &lt;&amp;&gt;",
        "4.8 MiB",
        "View 2",
        "Course of the fit",
        "Wireframes",
        "texture layout",
        "Plan",
        "20 pixels, the screen size that the budget is for",
        "<li>2 animations</li>",
        "<li>3 of &lt;4&gt; parts</li>",
        "before the file was written; textures of the file: ",
        "texels per unit of length",
        "<th>geometry</th>",
    ] {
        assert!(html.contains(part), "{part}");
    }
    // What a reader asks first comes first; what a developer asks is folded at the end.
    let at = |part: &str| html.find(part).unwrap_or_else(|| panic!("{part}"));
    let order =
        ["<main>\n<p class=\"verdict", "<h1>", "At its size", "What the file holds", "Left out", "View 1"];
    assert!(order.windows(2).all(|w| at(w[0]) < at(w[1])), "{:?}", order.map(at));
    let folded = at("How the fit went");
    for part in ["Course of the fit", "million pixels per second", "<h3>Plan</h3>", "photofit simplify"] {
        assert!(at(part) > folded, "{part} is folded");
    }
    assert!(html.contains(&Verdict::of(&outcome).likeness.to_string()));
    // Two views, asset and light asset, at their size; per view a picture of the asset, and a picture and a heat map of each
    // stage; 2 wireframes, 3 maps and the layout.
    let stages = outcome.stages.len();
    assert!([4, 5].contains(&stages), "the fit beside the file where something else was written");
    assert_eq!(html.matches("src=\"data:image/png;base64,").count(), 4 + 2 * (1 + 2 * stages) + 2 + 4);
    let outside = html.replace("http://www.w3.org/2000/svg", "");
    for address in ["http:", "https:", "src=\"/", "@import", "url("] {
        assert!(!outside.contains(address), "the page refers to {address}");
    }
    assert_eq!(html.matches("<svg ").count(), 2, "two curves");
    assert_eq!(html.matches("<figure>").count(), html.matches("</figure>").count());
}
