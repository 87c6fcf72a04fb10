//! The memory that the program took, and what it can still take.

use crate::output::bytes;
use anyhow::{Result, bail};
use photofit_fit::footprint::{Task, grid};
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
    if let Some(room) = too_little_for(needed) {
        bail!(
            "{}: the fit needs about {} of memory, {} of it for maps of --texture-size {side} and {} for textures of the \
             input; there are {}, and a smaller --texture-size or smaller textures must be given",
            input.display(),
            bytes(needed),
            bytes(maps),
            bytes(own),
            bytes(room)
        );
    }
    Ok(())
}

/// Refuses to draw assets whose textures would take more memory than there is.
///
/// # Errors
/// As [`check_fit`].
pub(crate) fn check_textures(task: Task, input: &Path, assets: &[&Scene]) -> Result<()> {
    let needed = task.textures(assets);
    if let Some(room) = too_little_for(needed) {
        bail!(
            "{}: its textures need about {} of memory; there are {}, and smaller textures must be given",
            input.display(),
            bytes(needed),
            bytes(room)
        );
    }
    Ok(())
}

/// Refuses a grid of so many voxels (`--size` along its longest side), of each of which so many values are found, that would take
/// more memory than there is.
///
/// # Errors
/// As [`check_fit`]; the message tells a size for which there is enough.
pub(crate) fn check_grid(voxels: [usize; 3], values: usize) -> Result<()> {
    let (needed, [x, y, z]) = (grid(voxels, values), voxels);
    if let Some(room) = too_little_for(needed) {
        bail!(
            "--size: {x} x {y} x {z} voxels need about {} of memory; there are {}, and --size must be {} at most",
            bytes(needed),
            bytes(room),
            largest_side(voxels, values, room)
        );
    }
    Ok(())
}

/// The bytes that there are, where they are fewer than these.
fn too_little_for(needed: u64) -> Option<u64> {
    room().filter(|room| needed > *room)
}

/// The longest side of a grid of the same shape that takes no more than so many bytes; at least 1.
fn largest_side(voxels: [usize; 3], values: usize, room: u64) -> usize {
    let longest = voxels.into_iter().max().unwrap_or(1);
    let of = |side: usize| voxels.map(|n| (n * side).div_ceil(longest));
    (1..longest).rev().find(|side| grid(of(*side), values) <= room).unwrap_or(1)
}

/// Bytes that this process can still take: the least of what the system has available, of what the limit on its address
/// space leaves, and of what the limits of its control groups leave. `None` where nothing of that is told.
fn room() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let available = read("/proc/meminfo").and_then(|t| kib(&t, "MemAvailable:")).map(|k| k << 10);
    let taken = read("/proc/self/status").and_then(|t| kib(&t, "VmSize:")).unwrap_or(0) << 10;
    let space = read("/proc/self/limits").and_then(|t| address_space(&t)).map(|l| l.saturating_sub(taken));
    let group = read("/proc/self/cgroup").and_then(|t| group_room(&t, read));
    [available, space, group].into_iter().flatten().min()
}

/// Bytes that the control groups of `/proc/self/cgroup` leave, of both versions: each group and all that hold it. Pages of
/// files that have not been used lately are given up before memory runs out, and do not count as used.
fn group_room(groups: &str, read: impl Fn(&str) -> Option<String>) -> Option<u64> {
    let number = |path: &str| read(path)?.trim().parse::<u64>().ok();
    let left = |folder: &str, limit: &str, usage: &str, inactive: &str| {
        // A limit that is not a number is none.
        let limit = number(&format!("{folder}/{limit}"))?;
        let used = number(&format!("{folder}/{usage}")).unwrap_or(0);
        let stat = read(&format!("{folder}/memory.stat")).unwrap_or_default();
        let files = stat.lines().find_map(|l| l.strip_prefix(inactive)?.trim().parse::<u64>().ok());
        Some(limit.saturating_sub(used.saturating_sub(files.unwrap_or(0))))
    };
    let one = |line: &str| {
        let mut parts = line.splitn(3, ':');
        let (_, kinds, path) = (parts.next()?, parts.next()?, parts.next()?);
        let (root, [limit, usage, inactive]) = if kinds.is_empty() {
            ("/sys/fs/cgroup", ["memory.max", "memory.current", "inactive_file "])
        } else if kinds.split(',').any(|k| k == "memory") {
            let files = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "];
            ("/sys/fs/cgroup/memory", files)
        } else {
            return None;
        };
        let within = Path::new(path).ancestors().filter_map(|p| p.to_str());
        let folder = |p: &str| format!("{root}{}", p.trim_end_matches('/'));
        within.filter_map(|p| left(&folder(p), limit, usage, inactive)).min()
    };
    groups.lines().filter_map(one).min()
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
    fn the_largest_side_fits() {
        let voxels = [100, 50, 200];
        for room in [grid([25, 13, 50], 4), grid([99, 50, 199], 4)] {
            let side = largest_side(voxels, 4, room);
            let of = |side: usize| grid(voxels.map(|n| (n * side).div_ceil(200)), 4);
            assert!(of(side) <= room && room < of(side + 1), "{side}");
        }
        assert_eq!(largest_side(voxels, 4, 0), 1);
    }

    #[test]
    fn the_narrowest_control_group_counts_with_what_is_used_of_it() {
        let files = [
            ("/sys/fs/cgroup/a/b/memory.max", "max\n"),
            ("/sys/fs/cgroup/a/memory.max", "1000\n"),
            ("/sys/fs/cgroup/a/memory.current", "700\n"),
            ("/sys/fs/cgroup/a/memory.stat", "anon 400\ninactive_file 250\n"),
            ("/sys/fs/cgroup/memory/job/memory.limit_in_bytes", "800\n"),
            ("/sys/fs/cgroup/memory/job/memory.usage_in_bytes", "300\n"),
        ];
        let read = |path: &str| files.iter().find(|f| f.0 == path).map(|f| f.1.to_owned());
        assert_eq!(group_room("0::/a/b\n", read), Some(550));
        assert_eq!(group_room("4:cpu,memory:/job\n0::/a/b\n", read), Some(500));
        assert_eq!(group_room("3:cpuset:/job\n0::/\n", read), None);
    }

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
