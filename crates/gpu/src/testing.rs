//! The device that tests of kernels share, and the test of a crate that runs them.

use crate::{Choice, Gpu, GpuError};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::Write;
use std::process::{Command, Output};
use std::sync::OnceLock;

/// How the reason begins by which tests on a device are ignored.
const MARK: &str = "ignored, gpu:";
/// Nothing fails for an error beyond its bound, so that all worst errors of a device are told: not where [`REQUIRED`] asks for
/// tests that can fail.
const MEASURED: &str = "PHOTOFIT_MEASURE_TWINS";
/// An adapter must be there.
const REQUIRED: &str = "PHOTOFIT_REQUIRE_GPU";

/// The device of the tests in this process: any adapter, or the one that `PHOTOFIT_TEST_GPU` names. A test that asks for it
/// is `#[ignore = "gpu: needs an adapter"]`; [`run_device_tests`] runs it where there is one.
///
/// # Panics
/// If the test is not ignored, or no device can be opened.
pub fn test_device() -> &'static Gpu {
    static DEVICE: OnceLock<Gpu> = OnceLock::new();
    assert!(asked(), "a test on a device must be #[ignore = \"gpu: needs an adapter\"]");
    DEVICE.get_or_init(|| open().unwrap_or_else(|e| panic!("a test on a device: {e}")))
}

/// Whether ignored tests are to run.
fn asked() -> bool {
    std::env::args().any(|a| a == "--ignored" || a == "--include-ignored")
}

fn open() -> Result<Gpu, GpuError> {
    Gpu::new(&std::env::var("PHOTOFIT_TEST_GPU").map_or(Choice::Any, Choice::Named))
}

/// How a line of [`assert_twin`] begins.
const TWIN: &str = "twin ";

/// Asserts that a twin is within its bound, whose name is `bound`, and tells how far it is, for the table of
/// [`run_device_tests`]. `what` says which case it is.
///
/// # Panics
/// If the error is larger, or not a number; larger ones are told alone where `PHOTOFIT_MEASURE_TWINS` is `1`, to find the
/// bounds of a new device. That together with `PHOTOFIT_REQUIRE_GPU` panics always.
#[expect(clippy::print_stdout, reason = "the test runner reads these lines")]
pub fn assert_twin(bound: &str, what: impl Display, error: f64, most: f64) {
    println!("{TWIN}{bound} {error:e} {most:e}");
    let told = measures(is_set(MEASURED), is_set(REQUIRED)) && error.is_finite();
    assert!(told || error <= most, "{what}: differs by {error:.2e}, more than {bound}, {most:.1e}");
}

fn is_set(variable: &str) -> bool {
    std::env::var(variable).is_ok_and(|v| v == "1")
}

/// Whether errors beyond their bounds are told alone.
fn measures(measured: bool, required: bool) -> bool {
    assert!(
        !(measured && required),
        "{MEASURED}=1 enforces no bounds, and {REQUIRED}=1 asks for tests that do"
    );
    measured
}

/// What the line of [`run_device_tests`] says of bounds.
fn enforced(measured: bool) -> String {
    if measured { format!(", bounds not enforced ({MEASURED}=1)") } else { String::new() }
}

/// The worst error of each bound of the lines of [`assert_twin`], and the bound itself.
fn worst_errors(text: &str) -> String {
    let mut worst: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    for line in text.lines().filter_map(|l| l.strip_prefix(TWIN)) {
        let mut words = line.split(' ');
        let (Some(name), mut numbers) = (words.next(), words.flat_map(str::parse::<f64>)) else { continue };
        let (Some(error), Some(most)) = (numbers.next(), numbers.next()) else { continue };
        let entry = worst.entry(name).or_insert([error, most]);
        *entry = [entry[0].max(error), entry[1].max(most)];
    }
    worst.iter().map(|(name, [error, most])| format!("\n  {name}: {error:.1e} of {most:.1e}")).collect()
}

/// Runs the tests of this binary that are ignored for want of a device, in a process of their own, and tells how many ran;
/// with the worst error of each bound of [`assert_twin`];
/// without an adapter they stay ignored, and it tells how many. Every crate with such tests calls it from a test. With
/// `PHOTOFIT_REQUIRE_GPU` set to `1` there must be an adapter. With `PHOTOFIT_MEASURE_TWINS` the line says that bounds are not
/// enforced.
///
/// # Panics
/// If a test fails, there is none, an adapter is required and missing, or both variables are set.
pub fn run_device_tests() {
    let required = is_set(REQUIRED);
    let measured = measures(is_set(MEASURED), required);
    let names = device_tests();
    assert!(!names.is_empty(), "no test of this binary is #[ignore = \"gpu: ...\"]");
    let crate_name = binary_name();
    let line = match open() {
        Ok(gpu) => {
            let adapter = gpu.report().name.clone();
            drop(gpu);
            let run = run(&mut this_binary(
                &[&["--ignored", "--exact", "--show-output"], &strs(&names)[..]].concat(),
            ));
            let text = text(&run);
            assert!(run.status.success(), "tests on {adapter} failed:\n{text}");
            let all = format!("ok. {} passed", names.len());
            assert!(text.contains(&all), "not all of {} tests ran:\n{text}", names.len());
            let (ran, bounds) = (names.len(), enforced(measured));
            format!("{crate_name}: {ran} tests ran on {adapter}{bounds}{}", worst_errors(&text))
        }
        Err(e) if required => panic!("{REQUIRED}=1, but {} tests cannot run: {e}", names.len()),
        Err(e @ GpuError::NoAdapter { .. }) => {
            format!("{crate_name}: {} tests on a device are IGNORED: {e}", names.len())
        }
        Err(e) => panic!("there is an adapter, but {} tests cannot run: {e}", names.len()),
    };
    // Past the capture of the harness, which shows nothing of tests that pass.
    drop(writeln!(std::io::stdout(), "{line}"));
}

/// The tests that are ignored for want of a device: by the reason that the harness gives when it is asked to run the ignored
/// ones by name, which it does not do.
fn device_tests() -> Vec<String> {
    let list = text(&run(&mut this_binary(&["--ignored", "--list"])));
    let ignored: Vec<String> =
        list.lines().filter_map(|l| Some(l.strip_suffix(": test")?.to_owned())).collect();
    if ignored.is_empty() {
        return ignored;
    }
    let told = text(&run(&mut this_binary(&[&["--exact"], &strs(&ignored)[..]].concat())));
    let name = |line: &str| {
        line.strip_prefix("test ")?
            .split_once(" ... ")
            .filter(|(_, r)| r.starts_with(MARK))
            .map(|(n, _)| n.to_owned())
    };
    told.lines().filter_map(name).collect()
}

fn strs(names: &[String]) -> Vec<&str> {
    names.iter().map(String::as_str).collect()
}

fn this_binary(args: &[&str]) -> Command {
    let mut command = Command::new(std::env::current_exe().expect("a test has a binary"));
    command.args(args);
    command
}

fn run(command: &mut Command) -> Output {
    command.output().expect("a test binary runs")
}

fn text(run: &Output) -> String {
    String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr)
}

/// The binary without the hash of its file.
fn binary_name() -> String {
    let path = std::env::current_exe().ok();
    let stem = path.as_ref().and_then(|p| Some(p.file_stem()?.to_string_lossy().into_owned()));
    let stem = stem.unwrap_or_default();
    stem.rsplit_once('-').map_or(stem.clone(), |(name, _)| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUNNER: &str = "tests::tests_on_a_device_pass_where_there_is_one";

    #[test]
    fn a_test_on_a_device_that_is_not_ignored_fails() {
        assert_eq!(
            std::panic::catch_unwind(|| {
                let _ = test_device();
            })
            .is_err(),
            !asked()
        );
    }

    #[test]
    fn the_worst_error_of_a_bound_is_told() {
        let text = "twin A 1e-7 2e-6\nanother line\ntwin B 0e0 1e0\ntwin A 1.5e-6 2e-6\ntwin A 3e-9 2e-6\n";
        assert_eq!(worst_errors(text), "\n  A: 1.5e-6 of 2.0e-6\n  B: 0.0e0 of 1.0e0");
        assert!(std::panic::catch_unwind(|| assert_twin("A", "a case", 2.1, 2.0)).is_err());
        assert!(std::panic::catch_unwind(|| assert_twin("A", "a case", f64::NAN, 2.0)).is_err());
    }

    #[test]
    fn bounds_that_are_not_enforced_are_told_and_none_of_required_tests() {
        assert!(measures(true, false) && !measures(false, true) && !measures(false, false));
        assert!(std::panic::catch_unwind(|| measures(true, true)).is_err());
        assert_eq!(enforced(false), "");
        assert_eq!(enforced(true), ", bounds not enforced (PHOTOFIT_MEASURE_TWINS=1)");
        let both = run(this_binary(&["--exact", RUNNER]).envs([(MEASURED, "1"), (REQUIRED, "1")]));
        assert!(!both.status.success() && text(&both).contains("enforces no bounds"), "{}", text(&both));
    }

    #[test]
    fn tests_are_found_by_their_reason() {
        let found = device_tests();
        assert!(found.iter().any(|n| n == "tests::many_groups_and_none"), "{found:?}");
        assert!(!found.iter().any(|n| n == "testing::tests::ignored_for_another_reason"), "{found:?}");
    }

    #[test]
    #[ignore = "an example for the test above: not on a device"]
    fn ignored_for_another_reason() {
        assert!(asked(), "runs only where ignored tests are to run");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn without_an_adapter_tests_stay_ignored_unless_one_is_required() {
        // No driver is found.
        let without = |required: &str| {
            let mut command = this_binary(&["--exact", RUNNER]);
            let none =
                [("VK_DRIVER_FILES", "/dev/null"), ("VK_ICD_FILENAMES", "/dev/null"), (REQUIRED, required)];
            run(command.envs(none))
        };
        let (ignored, refused) = (without("0"), without("1"));
        let count = device_tests().len();
        let told = format!("photofit_gpu: {count} tests on a device are IGNORED: no GPU adapter");
        assert!(ignored.status.success() && text(&ignored).contains(&told), "{}", text(&ignored));
        assert!(!refused.status.success(), "{}", text(&refused));
        assert!(text(&refused).contains("PHOTOFIT_REQUIRE_GPU=1"), "{}", text(&refused));
    }
}
