//! Values of options: how they are read, and which are taken.
//!
//! A refused value is told with what it must be; the help of an option has the same words in `[range: ...]`.

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Arg, Command};
use std::fmt::{self, Display};
use std::ops::{Bound, RangeBounds};
use std::path::PathBuf;
use std::time::Duration;

/// Longest time, seconds.
const MOST_SECONDS: f64 = 1e9;

/// A whole number in a range.
pub(crate) fn whole<T: TryFrom<u64> + 'static>(
    range: impl RangeBounds<u64> + Clone + Send + Sync + 'static,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| {
        let value = text.parse::<u64>().ok().filter(|n| range.contains(n));
        let value = value.and_then(|n| T::try_from(n).ok());
        value.ok_or_else(|| {
            // Of ranges without an end the type has one.
            let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let too_large = digits && text.parse::<u64>().map_or(true, |n| range.contains(&n));
            let ends = [u64::MAX, u64::from(u32::MAX), u64::from(u16::MAX), u64::from(u8::MAX)];
            let end = ends.into_iter().find(|n| T::try_from(*n).is_ok());
            let end = end.filter(|_| too_large && matches!(range.end_bound(), Bound::Unbounded));
            let end = end.map_or_else(String::new, |n| format!(", at most {n}"));
            format!("it must be a whole number, {}{end}", words(&range))
        })
    }
}

/// A number in a range.
pub(crate) fn number(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|x| x.is_finite() && range.contains(x));
        value.ok_or_else(|| format!("it must be a number, {}", words(&range)))
    }
}

/// A number in a range, or one behind a name and the last `=`.
pub(crate) fn of_key(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
) -> impl Fn(&str) -> Result<(Option<String>, f64), String> + Clone + Send + Sync + 'static {
    move |text| {
        let (key, value) = text.rsplit_once('=').map_or((None, text), |(k, v)| (Some(k.to_owned()), v));
        number(range.clone())(value).map(|x| (key, x))
    }
}

/// Numbers between commas.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Numbers(pub(crate) Vec<f64>);

/// One of these counts of numbers between commas, each in a range.
pub(crate) fn numbers(
    counts: &'static [usize],
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
) -> impl Fn(&str) -> Result<Numbers, String> + Clone + Send + Sync + 'static {
    move |text| {
        let list: Vec<f64> =
            text.split(',').map(|t| number(range.clone())(t.trim())).collect::<Result<_, _>>()?;
        if counts.contains(&list.len()) {
            return Ok(Numbers(list));
        }
        let counts: Vec<String> = counts.iter().map(usize::to_string).collect();
        Err(format!("has {} numbers; it must have {}", list.len(), counts.join(" or ")))
    }
}

/// A number in a range, in single precision.
pub(crate) fn single(
    range: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
) -> impl Fn(&str) -> Result<f32, String> + Clone + Send + Sync + 'static {
    move |text| number(range.clone())(text).map(|x| x as f32)
}

/// Numbers above a bound.
pub(crate) fn above(low: f64) -> (Bound<f64>, Bound<f64>) {
    (Bound::Excluded(low), Bound::Unbounded)
}

/// Numbers above a bound, up to another.
pub(crate) fn above_to(low: f64, high: f64) -> (Bound<f64>, Bound<f64>) {
    (Bound::Excluded(low), Bound::Included(high))
}

/// Numbers between two bounds.
pub(crate) fn between(low: f64, high: f64) -> (Bound<f64>, Bound<f64>) {
    (Bound::Excluded(low), Bound::Excluded(high))
}

/// An angle, degrees.
pub(crate) fn degrees(text: &str) -> Result<f32, String> {
    single(-36000.0..=36000.0)(text)
}

/// A time, seconds.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    number(above_to(0.0, MOST_SECONDS))(text).map(Duration::from_secs_f64)
}

/// Where a fit or a denoiser runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Device {
    /// A GPU in hardware, else the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// A GPU in hardware.
    Gpu,
    /// The first adapter whose name or driver holds this.
    Named(String),
}

/// As `--device` takes it.
impl Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu => f.write_str("gpu"),
            Self::Named(name) => write!(f, "gpu:{name}"),
        }
    }
}

/// A [`Device`].
pub(crate) fn device(text: &str) -> Result<Device, String> {
    match (text, text.split_once(':')) {
        ("auto", _) => Ok(Device::Auto),
        ("cpu", _) => Ok(Device::Cpu),
        ("gpu", _) => Ok(Device::Gpu),
        (_, Some(("gpu", name))) if !name.trim().is_empty() => Ok(Device::Named(name.trim().into())),
        _ => Err("it must be auto, cpu, gpu or gpu:NAME".into()),
    }
}

/// A name and a value around the first `=`.
pub(crate) fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("it must have the form NAME=VALUE".into()),
    }
}

/// A file whose name has one of some endings, in any case.
pub(crate) fn ending(endings: &'static [&'static str]) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| {
        let own = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if endings.contains(&own.as_str()) {
            return Ok(path);
        }
        let list: Vec<String> = endings.iter().map(|e| format!(".{e}")).collect();
        Err(format!("it must end in {}", list.join(" or ")))
    })
}

/// The command and those below it with negative numbers as values of all options: one that is out of its range is told as such,
/// and not taken for an option.
pub(super) fn with_negative_numbers(command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
    let takes_value = |a: &Arg| !a.is_positional() && a.get_action().takes_values();
    let command = command.mut_args(|a| if takes_value(&a) { a.allow_negative_numbers(true) } else { a });
    names.into_iter().fold(command, |c, name| c.mut_subcommand(name, with_negative_numbers))
}

/// A range in words.
fn words<T: Display>(range: &impl RangeBounds<T>) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Included(low), Bound::Included(high)) => format!("{low} to {high}"),
        (Bound::Excluded(low), Bound::Included(high)) => format!("more than {low}, at most {high}"),
        (Bound::Excluded(low), Bound::Excluded(high)) => format!("more than {low}, less than {high}"),
        (Bound::Included(low), Bound::Excluded(high)) => format!("at least {low}, less than {high}"),
        (Bound::Included(low), Bound::Unbounded) => format!("at least {low}"),
        (Bound::Excluded(low), Bound::Unbounded) => format!("more than {low}"),
        (Bound::Unbounded, Bound::Included(high)) => format!("at most {high}"),
        (Bound::Unbounded, Bound::Excluded(high)) => format!("less than {high}"),
        (Bound::Unbounded, Bound::Unbounded) => "any".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_kept_and_told() {
        let told = |r: Result<f64, String>| r.expect_err("refused");
        assert_eq!(whole::<u8>(1..=100)("100"), Ok(100));
        for wrong in ["0", "101", "-1", "1.5", "", "many", "99999999999999999999"] {
            assert_eq!(whole::<u8>(1..=100)(wrong), Err("it must be a whole number, 1 to 100".into()));
        }
        let open = "it must be a whole number, at least 0";
        assert_eq!(
            whole::<u64>(0..)("18446744073709551616"),
            Err(format!("{open}, at most 18446744073709551615"))
        );
        assert_eq!(whole::<u64>(0..)("-1"), Err(open.into()));
        assert_eq!(whole::<usize>(1..)("0"), Err("it must be a whole number, at least 1".into()));
        let colour = numbers(&[1, 3], 0.0..=1.0);
        assert_eq!(colour("0.5,0, 1"), Ok(Numbers(vec![0.5, 0.0, 1.0])));
        assert_eq!(colour("0.5,1"), Err("has 2 numbers; it must have 1 or 3".into()));
        assert_eq!(colour("0.5,2,1"), Err("it must be a number, 0 to 1".into()));
        let ratio = number(above_to(0.0, 1.0));
        assert_eq!(ratio("1"), Ok(1.0));
        for wrong in ["0", "1.0001", "nan", "inf", "-0.5", ""] {
            assert_eq!(told(ratio(wrong)), "it must be a number, more than 0, at most 1");
        }
        assert_eq!(told(number(between(0.0, 1.0))("1")), "it must be a number, more than 0, less than 1");
        assert_eq!(told(number(above(0.0))("0")), "it must be a number, more than 0");
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert!(seconds("1e300").is_err(), "no overflow");
        assert!(degrees("-30").is_ok() && degrees("1e9").is_err());
    }

    #[test]
    fn devices_are_named() {
        assert_eq!(device("auto"), Ok(Device::Auto));
        assert_eq!(device("cpu"), Ok(Device::Cpu));
        assert_eq!(device("gpu"), Ok(Device::Gpu));
        assert_eq!(device("gpu:llvm pipe:1"), Ok(Device::Named("llvm pipe:1".into())));
        for wrong in ["", "GPU", "gpu:", "gpu: ", "cpu:x", "cuda"] {
            assert_eq!(device(wrong), Err("it must be auto, cpu, gpu or gpu:NAME".into()), "{wrong}");
        }
    }

    #[test]
    fn endings_are_taken_in_any_case() {
        let command = Command::new("x");
        let parse = |name: &str| ending(&["png", "exr"]).parse_ref(&command, None, name.as_ref());
        assert!(parse("a.png").is_ok() && parse("a.b.EXR").is_ok());
        for wrong in ["a.jpg", "png", "a", ".png"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
