//! Lists the adapters, then runs `y += a x` on the first one that is there.

#![expect(clippy::print_stdout, reason = "an example shows its results")]

use photofit_gpu::{Choice, Gpu, INDEX, Kernel, adapters};

const SAXPY: Kernel = Kernel {
    name: "saxpy",
    source: &[
        INDEX,
        "struct Params { count: u32, a: f32, pad0: u32, pad1: u32 }
         @group(0) @binding(0) var<uniform> params: Params;
         @group(0) @binding(1) var<storage, read> x: array<f32>;
         @group(0) @binding(2) var<storage, read_write> y: array<f32>;
         @compute @workgroup_size(256)
         fn run(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                @builtin(local_invocation_index) lane: u32) {
             let i = index(group, groups, lane, 256u);
             if i < params.count { y[i] += params.a * x[i]; }
         }",
    ],
    entry: "run",
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for a in adapters() {
        println!("{} ({:?}, {}, {}), lacks {:?}", a.name, a.kind, a.backend, a.driver, a.lacks);
    }
    let gpu = Gpu::new(&Choice::Any)?;
    let n = 1 << 20;
    let (x, y) = (gpu.upload("x", &vec![1.0_f32; n])?, gpu.zeros::<f32>("y", n)?);
    let mut recorder = gpu.record("saxpy");
    recorder.dispatch(&SAXPY, &[n as u32, 0.5_f32.to_bits(), 0, 0], &[x.bind(), y.bind()], n)?;
    let mut recording = recorder.finish()?;
    for _ in 0..4 {
        recording.run()?;
    }
    println!("y[0] = {} after four runs; milliseconds: {:?}", gpu.read(&y)?[0], recording.profile()?);
    Ok(())
}
