//! Help and wrong command lines.

use crate::support::{photofit, stderr, stdout, succeeds};

#[test]
fn help_lists_commands_and_options() {
    let dir = tempfile::tempdir().unwrap();
    let help = stdout(&succeeds(dir.path(), &["--help"]));
    for name in ["simplify", "render", "compare", "inspect", "denoise", "demo"] {
        assert!(help.contains(name), "{name}");
    }
    let help = stdout(&succeeds(dir.path(), &["simplify", "--help"]));
    for option in [
        "--triangles",
        "--ratio",
        "--error",
        "--screen-size",
        "--init",
        "--resolution",
        "--batch",
        "--steps",
        "--time-limit",
        "--texture-size",
        "--light",
        "--env",
        "--seed",
        "--threads",
        "--checkpoint",
        "--resume",
        "--report",
        "--explain",
        "--json",
        "--output",
    ] {
        assert!(help.contains(option), "{option}");
    }
    assert!(stdout(&succeeds(dir.path(), &["--version"])).starts_with("photofit "));
}

#[test]
fn wrong_command_lines_have_status_2() {
    let dir = tempfile::tempdir().unwrap();
    let cases: &[&[&str]] = &[
        &[],
        &["polish", "a.glb"],
        &["simplify", "a.glb"],
        &["simplify", "-o", "b.glb"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "many"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "-3"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "10", "--ratio", "0.1"],
        &["simplify", "a.glb", "-o", "b.glb", "--init", "cube"],
        &["simplify", "a.glb", "-o", "b.glb", "--light", "env"],
        &["simplify", "a.glb", "-o", "b.glb", "--threads", "0"],
        &["simplify", "a.glb", "-o", "b.glb", "--time-limit", "-1"],
        &["simplify", "a.glb", "-o", "b.glb", "--time-limit", "nan"],
        &["simplify", "a.glb", "-o", "b.glb", "--resume"],
        &["simplify", "a.glb", "-o", "b.glb", "--faster"],
        &["render", "a.glb", "-o", "b.png", "--spp", "5"],
        &["render", "a.glb", "-o", "b.png", "--width", "0"],
        &["render", "a.glb", "-o", "b.png", "--light", "env"],
        &["compare", "a.png"],
        &["inspect"],
        &["demo", "extra"],
    ];
    for case in cases {
        let o = photofit(dir.path(), case);
        assert_eq!(o.status.code(), Some(2), "{case:?}: {}", stderr(&o));
        assert!(!stderr(&o).contains("panicked"), "{case:?}");
        assert!(!stderr(&o).is_empty(), "{case:?} explains itself");
    }
    assert!(crate::support::names(dir.path()).is_empty());
}
