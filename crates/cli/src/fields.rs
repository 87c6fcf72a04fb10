//! Fields of the library as the options of the command that runs, in errors.

use crate::args::has_option;
use crate::status::Misuse;
use anyhow::{Error, anyhow};
use photofit_fit::FitError;
use photofit_fit::simplify::Appearance;
use photofit_scene::SceneError;
use std::path::Path;

/// The words that name a command on the command line.
pub(crate) type Command = &'static [&'static str];

pub(crate) const SIMPLIFY: Command = &["simplify"];
pub(crate) const DEMO: Command = &["demo"];
pub(crate) const RETEXTURE: Command = &["retexture"];
pub(crate) const RECOVER_TEXTURE: Command = &["recover", "texture"];
pub(crate) const RECOVER_MESH: Command = &["recover", "mesh"];
pub(crate) const RECOVER_SCENE: Command = &["recover", "scene"];
pub(crate) const RECOVER_MATERIAL: Command = &["recover", "material"];
pub(crate) const RECOVER_VOLUME: Command = &["recover", "volume"];

/// The option of a field, or what the field is where the command has no such option.
fn option(command: Command, field: &str) -> String {
    let name = match field {
        "lighting" => "light".into(),
        _ => field.replace('_', "-"),
    };
    if has_option(command, &name) { format!("--{name}") } else { field.replace('_', " ") }
}

/// What a setting breaks.
fn broken(command: Command, field: &str, rule: &str) -> String {
    // One field of the library is two options.
    let appearance = [
        (Appearance::Kept, "keep-uvs", "--keep-uvs"),
        (Appearance::VertexColors, "textures", "--textures none"),
    ];
    for (value, name, option) in appearance {
        let rest = rule.strip_prefix(&format!("is {}; it ", value.name()));
        if let Some(rest) = rest.filter(|_| field == "appearance" && has_option(command, name)) {
            return format!("{option} {rest}");
        }
    }
    format!("{} {rule}", option(command, field))
}

/// Turns the fields that a refused checkpoint differs in, and the one that makes a fit smaller, into options.
pub(crate) fn name_options(command: Command, error: FitError) -> FitError {
    match error {
        FitError::OtherFit { path, mut differences } => {
            for d in &mut differences {
                d.field = option(command, &d.field);
            }
            FitError::OtherFit { path, differences }
        }
        #[cfg(feature = "gpu")]
        FitError::NoRoom { device, mut source } => {
            let named = source.option.take().map(|field| option(command, &field));
            source.option = named.filter(|name| name.starts_with("--")).map(Into::into);
            FitError::NoRoom { device, source }
        }
        error => error,
    }
}

/// A setting that no asset allows is a wrong command line.
pub(crate) fn misuse(command: Command, error: FitError) -> Error {
    match error {
        FitError::Setting { field, rule } => Misuse(broken(command, field, &rule)).into(),
        error => error.into(),
    }
}

/// Adds the name of the asset to errors that do not name a file, and turns fields into options.
pub(crate) fn explain_error(command: Command, input: &Path, error: FitError) -> Error {
    let error = name_options(command, error);
    if let FitError::Setting { field, rule } = &error {
        return anyhow!("{}: {}", input.display(), broken(command, field, rule));
    }
    let named = matches!(
        &error,
        FitError::Io { .. }
            | FitError::Image(_)
            | FitError::Checkpoint { .. }
            | FitError::OtherFit { .. }
            | FitError::Pictures { .. }
            | FitError::Interrupted
            | FitError::Scene(
                SceneError::Read { .. } | SceneError::Write { .. } | SceneError::Invalid { .. }
            )
    );
    if named { error.into() } else { anyhow!("{}: {error}", input.display()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_options_of_the_command_that_runs() {
        assert_eq!(option(SIMPLIFY, "reference"), "--reference");
        assert_eq!(option(RETEXTURE, "reference"), "reference", "an argument without a name there");
        let (kept, colors) = ("is kept; it goes with x", "is vertex colors; it goes with y");
        assert_eq!(broken(SIMPLIFY, "appearance", kept), "--keep-uvs goes with x");
        assert_eq!(broken(SIMPLIFY, "appearance", colors), "--textures none goes with y");
        assert_eq!(broken(DEMO, "appearance", kept), format!("appearance {kept}"));
        assert_eq!(option(SIMPLIFY, "lighting"), "--light");
        assert_eq!(broken(SIMPLIFY, "batch", "is 0; it must be 1 to 64"), "--batch is 0; it must be 1 to 64");
        assert_eq!(option(RETEXTURE, "texture_size"), "--texture-size");
        assert_eq!(option(DEMO, "texture_size"), "texture size");
        assert_eq!(option(RECOVER_MESH, "optimizer"), "--optimizer");
        assert_eq!(option(RECOVER_TEXTURE, "optimizer"), "optimizer");
        assert_eq!(option(RECOVER_SCENE, "seed"), "--seed");
        assert_eq!(option(RECOVER_VOLUME, "bounds"), "--bounds");
        assert_eq!(option(RECOVER_MATERIAL, "environment_size"), "--environment-size");
    }
}
