//! The memory that the program took, and what it can still take.

use crate::output::bytes;
use anyhow::{Result, bail};
use photofit_fit::footprint::Task;
use photofit_scene::Scene;
use std::path::Path;

/// Largest resident set so far, in MiB; `None` where the system does not tell (it does on Linux).
pub(crate) fn peak_rss_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(kib(&status, "VmHWM:")? as f64 / 1024.0)
}

/// Refuses a fit of maps of `side` x `side` texels (`--texture-size`) to assets that would take more memory than there is:
/// without that the system ends the program in the middle.
///
/// # Errors
/// If it would; the message tells both numbers and the option. Where the system does not tell what there is, nothing is
/// refused.
pub(crate) fn check_fit(task: Task, side: usize, input: &Path, assets: &[&Scene]) -> Result<()> {
    let (maps, own) = (task.maps(side), task.textures(assets));
    let needed = maps.saturating_add(own);
    match room() {
        Some(room) if needed > room => bail!(
            "{}: the fit needs about {} of memory, {} of it for maps of --texture-size {side} and {} for textures of the \
             input; there are {}, and a smaller --texture-size or smaller textures must be given",
            input.display(),
            bytes(needed),
            bytes(maps),
            bytes(own),
            bytes(room)
        ),
        _ => Ok(()),
    }
}

/// Refuses to draw assets whose textures would take more memory than there is.
///
/// # Errors
/// As [`check_fit`].
pub(crate) fn check_textures(task: Task, input: &Path, assets: &[&Scene]) -> Result<()> {
    let needed = task.textures(assets);
    match room() {
        Some(room) if needed > room => bail!(
            "{}: its textures need about {} of memory; there are {}, and smaller textures must be given",
            input.display(),
            bytes(needed),
            bytes(room)
        ),
        _ => Ok(()),
    }
}

/// Bytes that this process can still take: the least of what the system has available, of what the limit on its address
/// space leaves, and of the limit of its control group. `None` where nothing of that is told.
fn room() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let available = read("/proc/meminfo").and_then(|t| kib(&t, "MemAvailable:")).map(|k| k << 10);
    let taken = read("/proc/self/status").and_then(|t| kib(&t, "VmSize:")).unwrap_or(0) << 10;
    let space = read("/proc/self/limits").and_then(|t| address_space(&t)).map(|l| l.saturating_sub(taken));
    let group = read("/proc/self/cgroup")
        .and_then(|t| Some(t.lines().find_map(|l| l.strip_prefix("0::"))?.to_owned()));
    let group = group.and_then(|g| read(&format!("/sys/fs/cgroup{g}/memory.max")));
    let group = group.and_then(|t| t.trim().parse().ok());
    [available, space, group].into_iter().flatten().min()
}

/// The value of a line of `/proc` in KiB.
fn kib(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|l| l.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}

/// The soft limit on the address space in `/proc/self/limits`, bytes.
fn address_space(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|l| l.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_the_system_tells() {
        assert_eq!(kib("Name:\tx\nVmHWM:\t    2048 kB\nVmRSS:\t 1 kB\n", "VmHWM:"), Some(2048));
        assert_eq!(kib("Name:\tx\n", "VmHWM:"), None);
        let limits = "Max locked memory  8388608  8388608  bytes\nMax address space         1073741824           unlimited            bytes\n";
        assert_eq!(address_space(limits), Some(1 << 30));
        assert_eq!(
            address_space("Max address space         unlimited            unlimited            bytes\n"),
            None
        );
    }
}
