//! The frames of a rendered sequence: which files belong to which camera.

use crate::denoise::Files;
use crate::surface_camera::kind;
use anyhow::{Result, anyhow, bail};
use photofit_denoise::mc::Camera;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Largest file of cameras.
const MAX_BYTES: u64 = 64 << 20;

/// One frame.
#[derive(Clone, Debug)]
pub(crate) struct SequenceFrame {
    pub(crate) files: Files,
    pub(crate) camera: Camera,
    /// Whether depths are measured along the camera's axis, not from its centre.
    pub(crate) axial: bool,
}

/// The frames up to the one of `last`, in order.
///
/// The file holds `{"frames": [...]}`, or `{"scenes": {"name": [...]}}` where the name is the beginning of the colour's
/// file name. `"depth": "axis"` beside it says that depths are measured along the camera's axis (as `photofit render`
/// does), else they are distances. Each entry has `frame`, its number, and `world_to_pixel`, three rows of four. The files of a frame are
/// those of the last one with its number, the longest run of digits in the name that equals it, replaced.
///
/// # Errors
/// If the file is no such list, the number of `last` is not in it, or a file of an earlier frame is missing.
pub(crate) fn frames(cameras: &Path, last: &Files) -> Result<Vec<SequenceFrame>> {
    let place = cameras.display();
    let text = photofit_image::file_bytes(cameras, MAX_BYTES)?;
    let json: Value =
        serde_json::from_slice(&text).map_err(|e| anyhow!("{place}: is no JSON, which it must be: {e}"))?;
    let axial = match json.get("depth") {
        None => false,
        Some(depth) => match depth.as_str() {
            Some("distance") => false,
            Some("axis") => true,
            _ => bail!("{place}: `depth` is {}; it must be \"distance\" or \"axis\"", kind(depth)),
        },
    };
    let name = last.color.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let list = match (json.get("frames"), json.get("scenes").and_then(Value::as_object)) {
        (Some(list), _) => list,
        (None, Some(scenes)) => match scenes.iter().find(|(scene, _)| name.starts_with(scene.as_str())) {
            Some((_, list)) => list,
            None => bail!("{place}: has no scene whose name begins {name}; it must have one"),
        },
        (None, None) => bail!("{place}: has neither `frames` nor `scenes`; it must have one of them"),
    };
    let Some(list) = list.as_array() else {
        bail!("{place}: the frames are {}; they must be an array", kind(list))
    };
    let mut numbered = Vec::with_capacity(list.len());
    for (k, entry) in list.iter().enumerate() {
        let number = entry.get("frame").and_then(Value::as_u64).unwrap_or(k as u64);
        numbered.push((number, camera(entry).map_err(|e| anyhow!("{place}: frame {number}: {e}"))?));
    }
    numbered.sort_by_key(|(number, _)| *number);
    let Some((own, digits)) = number_of(&name, &numbered) else {
        bail!("{place}: the name {name} holds the number of no frame in it");
    };
    numbered
        .into_iter()
        .filter(|(number, _)| *number <= own)
        .map(|(number, camera)| {
            let files = renumbered(last, &digits, number)?;
            Ok(SequenceFrame { files, camera, axial })
        })
        .collect()
}

fn camera(entry: &Value) -> Result<Camera> {
    const RULE: &str = "it must be three rows of four finite numbers";
    let Some(matrix) = entry.get("world_to_pixel") else { bail!("has no world_to_pixel; {RULE}") };
    let Some(rows) = matrix.as_array().filter(|r| r.len() == 3) else {
        bail!("world_to_pixel is {}; {RULE}", kind(matrix))
    };
    let mut m = [[0.0; 4]; 3];
    for (k, (out, row)) in m.iter_mut().zip(rows).enumerate() {
        let Some(numbers) = row.as_array().filter(|r| r.len() == 4) else {
            bail!("row {k} of world_to_pixel is {}; {RULE}", kind(row))
        };
        for (out, v) in out.iter_mut().zip(numbers) {
            let number = v.as_f64().filter(|v| v.is_finite());
            *out = number.ok_or_else(|| anyhow!("row {k} of world_to_pixel holds {}; {RULE}", kind(v)))?;
        }
    }
    Ok(Camera { world_to_pixel: m })
}

/// The longest run of digits that is the number of a frame, the last of equally long ones: the number, and the run.
fn number_of(name: &str, frames: &[(u64, Camera)]) -> Option<(u64, String)> {
    let runs = name.split(|c: char| !c.is_ascii_digit()).filter(|r| !r.is_empty());
    runs.filter_map(|r| Some((r.parse::<u64>().ok()?, r.to_owned())))
        .filter(|(n, _)| frames.iter().any(|(f, _)| f == n))
        .max_by_key(|(_, run)| run.len())
}

/// The same files of another frame.
fn renumbered(files: &Files, digits: &str, number: u64) -> Result<Files> {
    let other = |path: &Path| -> Result<PathBuf> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(at) = last_run(&name, digits) else {
            bail!("{}: the name does not hold the number {digits} of the frame", path.display());
        };
        let width = digits.len();
        let replaced = format!("{}{number:0width$}{}", &name[..at], &name[at + width..]);
        let path = path.with_file_name(replaced);
        if !path.is_file() {
            bail!("{}: missing, the cameras list frame {number}", path.display());
        }
        Ok(path)
    };
    Ok(Files {
        color: other(&files.color)?,
        guides: files.guides.iter().map(|(k, p)| Ok((*k, other(p)?))).collect::<Result<_>>()?,
        half: None,
    })
}

/// Where the last run of digits that equals `digits` begins.
fn last_run(name: &str, digits: &str) -> Option<usize> {
    let bytes = name.as_bytes();
    let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
    name.match_indices(digits)
        .map(|(at, _)| at)
        .filter(|at| !digit(at + digits.len()) && (*at == 0 || !digit(at - 1)))
        .last()
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_mutants::{Shape, Target};
    use serde_json::json;

    #[test]
    fn numbers_are_whole_runs_of_digits() {
        assert_eq!(last_run("room2_02_color.exr", "02"), Some(6));
        assert_eq!(last_run("room_102_color.exr", "02"), None);
        let frames: Vec<(u64, Camera)> =
            [1, 2].map(|n| (n, Camera { world_to_pixel: [[0.0; 4]; 3] })).to_vec();
        assert_eq!(number_of("room1_002.4k.exr", &frames), Some((2, "002".to_owned())));
        assert_eq!(number_of("room_02_color1.exr", &frames), Some((2, "02".to_owned())));
        assert_eq!(number_of("room1_2.exr", &frames), Some((2, "2".to_owned())));
        assert_eq!(number_of("room.exr", &frames), None);
    }

    #[test]
    fn mutants_are_read_or_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = |k: u32| dir.path().join(format!("room_{k:02}.exr"));
        for k in 0..4 {
            std::fs::write(file(k), "").unwrap();
        }
        let last = Files { color: file(3), guides: Vec::new(), half: None };
        let entry =
            |k: u32| json!({"frame": k, "world_to_pixel": [[1, 0, 0.5, k], [0, 1, 0.5, 0], [0, 0, 1, 2]]});
        let list: Vec<Value> = (0..4).map(entry).collect();
        let seeds = [json!({"depth": "axis", "frames": list}), json!({"scenes": {"hall": [], "room": list}})]
            .map(|v| v.to_string().into_bytes());
        let cameras = dir.path().join("cameras.json");
        let seen = Target { name: "sequence", shape: Shape::Json, seeds: &seeds }.run(
            |n| n == 1000,
            |bytes| {
                std::fs::write(&cameras, bytes).unwrap();
                let frames = frames(&cameras, &last).map_err(|e| e.to_string())?;
                assert!(
                    frames.last().is_some_and(|f| f.files.color == last.color),
                    "the last frame is the own one"
                );
                Ok(())
            },
        );
        seen.assert_deep("sequence", 25);
    }
}
