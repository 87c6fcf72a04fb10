//! The layer rule: a crate names only crates of a layer below its own.

use super::Findings;
use super::metadata::Crate;

/// One crate's place.
struct Place {
    /// Package name without `photofit-`; the facade is `photofit`.
    name: &'static str,
    layer: u32,
    /// The only crates it may name; `None` allows every lower layer.
    only: Option<&'static [&'static str]>,
}

const fn place(layer: u32, name: &'static str) -> Place {
    Place { name, layer, only: None }
}

const fn narrow(layer: u32, name: &'static str, only: &'static [&'static str]) -> Place {
    Place { name, layer, only: Some(only) }
}

/// The layers of ARCHITECTURE.md, lowest first.
///
/// Optimizers, denoisers and flows work on plain slices: their lists keep scenes and renderers out. The rasterizer
/// knows meshes, textures and shading, not files.
const PLACES: &[Place] = &[
    place(0, "scalar"),
    narrow(0, "gpu", &[]),
    place(0, "gradcheck"),
    narrow(0, "mutants", &[]),
    narrow(0, "ktx2", &[]),
    narrow(1, "fft", &["scalar"]),
    place(1, "image"),
    narrow(1, "texture", &["scalar", "gpu"]),
    place(1, "sampling"),
    place(1, "geometry"),
    narrow(1, "rays", &["scalar"]),
    place(2, "shading"),
    narrow(2, "optim", &["scalar", "fft", "sampling", "gpu"]),
    narrow(2, "denoise", &["scalar", "fft", "image", "gpu"]),
    place(3, "scene"),
    narrow(3, "flow", &["scalar", "sampling", "optim"]),
    narrow(4, "raster", &["scalar", "geometry", "texture", "shading", "gpu"]),
    place(4, "pathtrace"),
    place(5, "fit"),
    place(6, "photofit"),
    place(6, "cli"),
    place(6, "bench"),
    place(6, "tests"),
    place(6, "web-tests"),
    narrow(6, "xtask", &[]),
];

/// Crates that production code never names.
const DEV_ONLY: &[&str] = &["gradcheck", "mutants"];

/// (crate or `*`, dependency): allowed only behind a feature.
const OPTIONAL: &[(&str, &str)] = &[("*", "gpu")];

pub(super) fn check(crates: &[Crate], findings: &mut Findings) {
    for from in crates {
        let Some(place) = find(&from.name) else {
            findings.error(&from.name, "has no place in PLACES of xtask/src/tidy/layers.rs");
            continue;
        };
        for dependency in &from.dependencies {
            let Some(to) = find(&dependency.name) else { continue };
            if dependency.dev {
                // Tests may look sideways, never up: that would make a cycle of the crates' test builds.
                if to.layer > place.layer {
                    findings.error(&from.name, format_args!("its tests name {}, a higher layer", to.name));
                }
                continue;
            }
            if DEV_ONLY.contains(&to.name) {
                findings.error(&from.name, format_args!("{} is for dev-dependencies only", to.name));
            } else if to.layer >= place.layer {
                findings.error(
                    &from.name,
                    format_args!("layer {} may not name {} of layer {}", place.layer, to.name, to.layer),
                );
            } else if place.only.is_some_and(|only| !only.contains(&to.name)) {
                findings.error(&from.name, format_args!("may not name {}", to.name));
            }
            let optional = OPTIONAL.iter().any(|(a, b)| (*a == "*" || *a == place.name) && *b == to.name);
            if optional && !dependency.optional {
                findings.error(&from.name, format_args!("{} is allowed only behind a feature", to.name));
            }
        }
    }
}

fn find(package: &str) -> Option<&'static Place> {
    let name = package.strip_prefix("photofit-").unwrap_or(package);
    PLACES
        .iter()
        .find(|place| place.name == name && (package != name || matches!(name, "photofit" | "xtask")))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::metadata::Dependency;
    use super::*;

    /// A crate from `name: dependency, dev dependency, optional dependency`.
    fn parse(line: &str) -> Crate {
        let (name, dependencies) = line.split_once(':').expect("a colon");
        let dependencies =
            dependencies.split(',').map(str::trim).filter(|d| !d.is_empty()).map(|d| Dependency {
                name: d.rsplit(' ').next().unwrap_or(d).to_owned(),
                dev: d.starts_with("dev "),
                optional: d.starts_with("optional "),
            });
        Crate {
            name: name.to_owned(),
            version: String::new(),
            folder: PathBuf::new(),
            features: Vec::new(),
            dependencies: dependencies.collect(),
        }
    }

    fn errors(line: &str) -> usize {
        let mut findings = Findings::default();
        check(&[parse(line)], &mut findings);
        findings.errors.len()
    }

    #[test]
    fn layers_are_kept() {
        for line in [
            "photofit-geometry: photofit-scalar, glam, dev photofit-sampling, dev photofit-gradcheck",
            "photofit-raster: photofit-texture, photofit-shading, optional photofit-gpu",
            "photofit-texture: photofit-scalar, dev photofit-gradcheck",
            "photofit-optim: photofit-scalar, photofit-sampling, optional photofit-gpu",
            "photofit-cli: photofit-fit, image",
            "photofit: photofit-fit, optional photofit-gpu",
            "xtask: anyhow",
        ] {
            assert_eq!(errors(line), 0, "{line}");
        }
    }

    #[test]
    fn breaches_are_found() {
        for line in [
            "photofit-image: photofit-geometry",
            "photofit-image: photofit-raster",
            "photofit-raster: photofit-pathtrace",
            "photofit-raster: photofit-scene",
            "photofit-texture: photofit-image",
            "photofit-raster: photofit-gpu",
            "photofit-optim: photofit-geometry",
            "photofit-optim: optional photofit-shading",
            "photofit-denoise: photofit-sampling",
            "photofit-rays: photofit-sampling",
            "photofit-scene: photofit-gradcheck",
            "photofit-scene: dev photofit-raster",
            "photofit-cli: photofit",
            "photofit-novel: photofit-scalar",
            "xtask: photofit-image",
        ] {
            assert_eq!(errors(line), 1, "{line}");
        }
    }
}
