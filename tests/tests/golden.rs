//! The golden images, and the machinery on folders where something is wrong.

use std::fs;
use std::path::Path;

use photofit_image::Image;
use photofit_tests::cases::{CASES, Case};
use photofit_tests::store::{self, Format};
use photofit_tests::tolerances::EXACT;
use photofit_tests::{report, suite};

#[test]
fn every_golden_image_matches() {
    let folder = suite::golden_folder();
    let outcomes = suite::run(CASES, &folder);
    let path = suite::report_path();
    report::write(&path, &outcomes).expect("the report is written");
    let failed: Vec<String> = outcomes.iter().filter(|o| !o.passed()).map(suite::Outcome::summary).collect();
    assert!(failed.is_empty(), "{}\nsee {}", failed.join("\n"), path.display());
}

#[test]
fn every_golden_file_has_a_case() {
    let orphans = suite::orphans(CASES, &suite::golden_folder()).expect("a folder");
    assert!(orphans.is_empty(), "no case for {orphans:?}: cargo xtask golden prune");
    let mut names: Vec<&str> = CASES.iter().map(|case| case.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), CASES.len(), "names are unique");
}

fn spot() -> Image {
    let mut image = Image::new(16, 8, 3);
    image.pixel_mut(5, 2)[0] = 0.5;
    image
}

static SAMPLE: [Case; 2] = [
    Case { name: "spot", format: Format::Png, tolerance: EXACT, make: spot },
    Case { name: "spot-floats", format: Format::Exr, tolerance: EXACT, make: spot },
];

fn accepted(folder: &Path) {
    suite::accept(&SAMPLE, folder, &["spot".to_owned(), "spot-floats".to_owned()]).expect("accepted");
}

#[test]
fn accepted_images_pass_and_a_run_writes_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let outcomes = suite::run(&SAMPLE, folder.path());
    assert!(outcomes.iter().all(|o| !o.passed()), "missing files are failures");
    assert!(outcomes[0].summary().contains("no golden image"), "{}", outcomes[0].summary());
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "a run writes no golden file");
    accepted(folder.path());
    assert!(suite::run(&SAMPLE, folder.path()).iter().all(suite::Outcome::passed));
}

#[test]
fn a_perturbed_file_fails_and_stands_in_the_report() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    accepted(folder.path());
    for case in &SAMPLE {
        let path = store::path(folder.path(), case.name, case.format);
        let mut stored = store::read(&path, case.format).expect("read");
        stored.pixel_mut(5, 2)[0] += 2.0 / 255.0;
        store::write(&path, case.format, &stored).expect("written");
    }
    let before = fs::read(folder.path().join("spot.png")).expect("the file");
    let outcomes = suite::run(&SAMPLE, folder.path());
    assert!(outcomes.iter().all(|o| !o.passed()));
    assert!(outcomes[0].summary().contains("1 of 128 pixels"), "{}", outcomes[0].summary());
    assert_eq!(before, fs::read(folder.path().join("spot.png")).expect("the file"), "never self-updating");
    let html = report::html(&outcomes).expect("a report");
    assert_eq!(html.matches("class=\"failed\"").count(), 2);
    assert_eq!(
        html.matches("data:image/png;base64,").count(),
        6,
        "actual, expected and difference of two cases"
    );
    assert!(!html.contains("http"), "the report needs no other file");
}

#[test]
fn wrong_sizes_damage_and_unknown_names_are_errors() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    accepted(folder.path());
    let png = folder.path().join("spot.png");
    store::write(&png, Format::Png, &Image::new(8, 8, 3)).expect("written");
    fs::write(folder.path().join("spot-floats.exr"), b"no EXR").expect("written");
    let outcomes = suite::run(&SAMPLE, folder.path());
    assert!(outcomes.iter().all(|o| !o.passed()));
    assert!(
        outcomes[0].summary().contains("shape 8x16x3 against the golden 8x8x3"),
        "{}",
        outcomes[0].summary()
    );
    assert!(report::html(&outcomes).is_ok(), "a report without differences");
    let error = suite::accept(&SAMPLE, folder.path(), &["other".to_owned()]).expect_err("no such case");
    assert!(error.to_string().contains("there are: spot, spot-floats"), "{error}");
}

#[test]
fn files_without_a_case_are_found() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    accepted(folder.path());
    fs::write(folder.path().join("gone.png"), b"").expect("written");
    fs::write(folder.path().join("notes.txt"), b"").expect("written");
    let orphans = suite::orphans(&SAMPLE, folder.path()).expect("a folder");
    assert_eq!(orphans, [folder.path().join("gone.png")]);
}
