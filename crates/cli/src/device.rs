//! `--device` and `inspect --devices`: where a fit or a denoiser runs, and what there is to choose from.

use crate::args::Device as Choice;
#[cfg(feature = "gpu")]
use crate::output::bytes;
use crate::output::{self, print};
use crate::status::Misuse;
use anyhow::Result;
use photofit_fit::simplify::Device;
#[cfg(feature = "gpu")]
pub(crate) use photofit_gpu::Gpu;
use serde_json::{Value, json};
use std::path::Path;

/// A program without GPUs never has one.
#[cfg(not(feature = "gpu"))]
pub(crate) type Gpu = std::convert::Infallible;

/// What is told without asking drivers.
#[cfg(feature = "gpu")]
const NO_HARDWARE: &str = "--device gpu: no GPU adapter in hardware: this machine has no GPU; inspect --devices lists adapters in \
                           software, which --device gpu:NAME takes";

/// The device of a fit. One that was asked for and cannot be had is a wrong command line.
pub(crate) fn choose(choice: &Choice) -> Result<Device> {
    Ok(match gpu(choice)? {
        #[cfg(feature = "gpu")]
        (Some(gpu), why) => Device::gpu(gpu, *choice != Choice::Auto, &why),
        #[cfg(not(feature = "gpu"))]
        (Some(never), _) => match never {},
        (None, why) => Device::cpu(&why),
    })
}

/// The GPU of a choice, none for the CPU; and why it is that. One that was asked for and cannot be had is a wrong command line.
#[cfg(feature = "gpu")]
pub(crate) fn gpu(choice: &Choice) -> Result<(Option<Gpu>, String)> {
    use photofit_gpu::Choice as Adapter;
    let said = || "as --device says".to_owned();
    let required = |option: &str, adapter: Adapter| {
        let gpu = Gpu::new(&adapter).map_err(|e| Misuse(format!("--device {option}: {e}")))?;
        Ok((Some(gpu), said()))
    };
    match choice {
        Choice::Cpu => Ok((None, said())),
        Choice::Gpu if !may_have_hardware() => Err(Misuse(NO_HARDWARE.into()).into()),
        Choice::Gpu => required("gpu", Adapter::Hardware),
        Choice::Named(name) => required(&format!("gpu:{name}"), Adapter::Named(name.clone())),
        Choice::Auto if !may_have_hardware() => Ok((None, "this machine has no GPU".into())),
        Choice::Auto => Ok(match Gpu::new(&Adapter::Hardware) {
            Ok(gpu) => (Some(gpu), "the first GPU in hardware".into()),
            Err(e) => (None, e.to_string()),
        }),
    }
}

/// The GPU of a choice, of a program that knows the CPU alone.
#[cfg(not(feature = "gpu"))]
pub(crate) fn gpu(choice: &Choice) -> Result<(Option<Gpu>, String)> {
    match choice {
        Choice::Auto => Ok((None, "this program was built without GPUs".into())),
        Choice::Cpu => Ok((None, "as --device says".into())),
        Choice::Gpu => Err(Misuse("--device gpu: this program was built without GPUs".into()).into()),
        Choice::Named(name) => {
            Err(Misuse(format!("--device gpu:{name}: this program was built without GPUs")).into())
        }
    }
}

/// Whether it is worth to ask drivers for hardware: they are slow to load, and some write to stderr where there is none.
#[cfg(feature = "gpu")]
fn may_have_hardware() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let renders = |e: std::io::Result<std::fs::DirEntry>| {
        e.is_ok_and(|e| e.file_name().to_string_lossy().starts_with("renderD"))
    };
    let nodes = ["/dev/nvidia0", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0", "/dev/mali0"];
    std::fs::read_dir("/dev/dri").is_ok_and(|mut d| d.any(renders))
        || nodes.iter().any(|n| Path::new(n).exists())
}

/// Lists the adapters.
#[cfg(feature = "gpu")]
pub(crate) fn list(file: Option<&Path>) -> Result<()> {
    use photofit_gpu::{AdapterKind, AdapterReport, adapters};
    let kind = |r: &AdapterReport| match r.kind {
        AdapterKind::Discrete => "discrete",
        AdapterKind::Integrated => "integrated",
        AdapterKind::Virtual => "virtual",
        AdapterKind::Software => "software",
        AdapterKind::Other => "of a kind that the driver does not tell",
    };
    let all = adapters();
    if let Some(file) = file {
        let one = |r: &AdapterReport| {
            json!({
                "name": r.name,
                "kind": kind(r),
                "backend": r.backend,
                "driver": r.driver,
                "largest_binding": r.largest_binding,
                "storage_buffers": r.storage_buffers,
                "workgroup_memory": r.workgroup_memory,
                "subgroups": r.subgroups,
                "lacks": r.lacks,
            })
        };
        write(file, all.iter().map(one).collect())?;
    }
    let mut text = String::new();
    for r in &all {
        let lacks = if r.lacks.is_empty() { "nothing".to_owned() } else { r.lacks.join(", ") };
        let [least, most] = r.subgroups;
        text += &format!(
            "{}\n  kind      {}\n  backend   {}\n  driver    {}\n  limits    {} a buffer, {} buffers a kernel, {} of \
             workgroup memory, subgroups of {least} to {most}\n  lacks     {lacks}\n",
            r.name,
            kind(r),
            r.backend,
            r.driver,
            bytes(r.largest_binding),
            r.storage_buffers,
            bytes(u64::from(r.workgroup_memory)),
        );
    }
    if all.is_empty() {
        text += "no GPU adapter: there is no driver of Vulkan, Metal or DirectX 12; fits run on the CPU\n";
    }
    print(&text)
}

/// Says that there are none.
#[cfg(not(feature = "gpu"))]
pub(crate) fn list(file: Option<&Path>) -> Result<()> {
    if let Some(file) = file {
        write(file, Vec::new())?;
    }
    print("this program was built without GPUs; fits run on the CPU\n")
}

fn write(file: &Path, devices: Vec<Value>) -> Result<()> {
    output::write_json(file, &json!({ "devices": devices }))
}
