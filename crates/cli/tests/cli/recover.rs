//! Textures from pictures: what is refused, with which words. The job itself is tested in `photofit-fit`.

use crate::support::{assert_one_error, photofit, stdout, succeeds, write_rock};

#[test]
fn pictures_that_cannot_be_used_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    std::fs::create_dir(d.join("pictures")).unwrap();
    let run = |more: &[&str]| {
        let all =
            [&["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "out.glb"][..], more].concat();
        photofit(d, &all)
    };
    assert_one_error(&run(&[]), "no list of pictures", &["transforms.json"]);
    std::fs::write(d.join("pictures/transforms.json"), r#"{"fl_x": 50, "frames": []}"#).unwrap();
    assert_one_error(&run(&[]), "no pictures", &["transforms.json", "0 frames", "at least 8"]);
    let o = photofit(d, &["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "rock.glb"]);
    assert_ne!(o.status.code(), Some(0), "the asset is not written over");
    assert!(!d.join("out.glb").exists());
    let help = stdout(&succeeds(d, &["recover", "texture", "--help"]));
    assert!(help.contains("--mesh") && help.contains("transforms.json"), "{help}");
}
