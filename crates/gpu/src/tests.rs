//! Buffers, kernels, recordings and order-independent sums on a device.

use super::*;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    count: u32,
    sums: u32,
    scale: f32,
    pad: u32,
}

const HEAD: &str = "
struct Params { count: u32, sums: u32, scale: f32, pad: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> terms: array<f32>;
";

const ADD: Kernel = Kernel {
    name: "add",
    source: &[
        INDEX,
        FIXED,
        HEAD,
        "@group(0) @binding(2) var<storage, read_write> sums: array<FixedSum>;
         @compute @workgroup_size(64)
         fn run(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                @builtin(local_invocation_index) lane: u32) {
             let i = index(group, groups, lane, 64u);
             if i < params.count { add_fixed(i % params.sums, terms[i], params.scale); }
         }",
    ],
    entry: "run",
};

const READ: Kernel = Kernel {
    name: "read",
    source: &[
        INDEX,
        FIXED_READ,
        HEAD,
        "@group(0) @binding(2) var<storage, read> words: array<u32>;
         @group(0) @binding(3) var<storage, read_write> out: array<f32>;
         @compute @workgroup_size(64)
         fn run(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                @builtin(local_invocation_index) lane: u32) {
             let i = index(group, groups, lane, 64u);
             if i < params.sums { out[i] = read_fixed(words[2u * i], words[2u * i + 1u], params.scale); }
         }",
    ],
    entry: "run",
};

/// Sums by the device, and their status. Term `i` goes to sum `i % sums`.
fn sum(gpu: &Gpu, terms: &[f32], sums: usize, scale: f32) -> (Vec<f32>, u32) {
    let params = Params { count: terms.len() as u32, sums: sums as u32, scale, pad: 0 };
    let terms = gpu.upload("terms", terms).expect("uploaded");
    let words = gpu.zeros::<u32>("words", fixed_words(sums)).expect("made");
    let out = gpu.zeros::<f32>("out", sums).expect("made");
    let mut r = gpu.record("sum");
    r.dispatch(&ADD, &params, &[terms.bind(), words.bind()], terms.len()).expect("fits");
    r.dispatch(&READ, &params, &[words.bind(), out.bind()], sums).expect("fits");
    r.finish().expect("recorded").run().expect("runs");
    let status = *gpu.read(&words).expect("read").last().expect("has a status");
    (gpu.read(&out).expect("read"), status)
}

/// Numbers in [0, 1), by a seed.
fn uniform(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    }
}

/// The device of the tests, which adds words of 64 bits if it can, and the same without.
fn devices() -> [Gpu; 2] {
    let choice = Choice::Named(test_device().report().name.clone());
    [true, false].map(|wide_words| Gpu::within(&choice, Caps { wide_words, ..Caps::NONE }).expect("opens"))
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sums_by_words_of_32_and_64_bits_are_the_same() {
    let mut random = uniform(3);
    let scale = (1_u64 << 40) as f32;
    for (largest, lost) in [(10.0, false), (1e5, true)] {
        let mut terms: Vec<f32> = (0..50_000)
            .map(|_| (random() - 0.5) * largest * 10_f32.powi(-(random() * 12.0) as i32))
            .collect();
        terms[7] = if lost { f32::NAN } else { 1e6 };
        let [a, b] = devices().map(|gpu| sum(&gpu, &terms, 91, scale));
        assert_eq!(a, b);
        assert_eq!(a.1 & FIXED_LOST != 0, lost);
        assert_ne!(a.1 & FIXED_LIMITED, 0, "the largest one is limited");
    }
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    run_device_tests();
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn fixed_sums_are_exact_in_any_order() {
    for gpu in &devices() {
        let mut random = uniform(7);
        // Signs and sizes mixed, from 1e-9 to 1e3.
        let terms: Vec<f32> =
            (0..100_000).map(|_| (random() - 0.5) * 10_f32.powi((random() * 12.0) as i32 - 9)).collect();
        let (sums, scale) = (37, (1_u64 << 40) as f32);
        let (found, status) = sum(gpu, &terms, sums, scale);
        assert_eq!(status, 0);
        for (k, found) in found.iter().enumerate() {
            let of = terms.iter().skip(k).step_by(sums);
            let expected: f64 =
                of.map(|x| (f64::from(*x) * f64::from(scale)).round()).sum::<f64>() / f64::from(scale);
            assert!((f64::from(*found) - expected).abs() <= expected.abs() * 2e-7, "{k}: {found} {expected}");
        }
        let mut turned = Vec::new();
        // Terms of a sum in another order.
        for row in terms.chunks(sums).rev().filter(|r| r.len() == sums) {
            turned.extend_from_slice(row);
        }
        let whole: Vec<f32> = terms.chunks(sums).filter(|r| r.len() == sums).flatten().copied().collect();
        assert_eq!(sum(gpu, &turned, sums, scale).0, sum(gpu, &whole, sums, scale).0);
        // The comparison is one that can fail.
        turned[5] += 1e-3;
        assert_ne!(sum(gpu, &turned, sums, scale).0, sum(gpu, &whole, sums, scale).0);
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn fixed_sums_keep_their_extremes() {
    for gpu in &devices() {
        let scale = (1_u64 << 40) as f32;
        // What fills the lower word.
        let word = (1_u64 << 32) as f32;
        for x in [
            0.0,
            1.0,
            -1.0,
            1e-12,
            -1e-12,
            16383.0,
            -16383.0,
            0.999_999_94,
            word.next_down() / scale,
            word / scale,
            -word / scale,
        ] {
            let (found, status) = sum(gpu, &[x], 1, scale);
            let expected = ((f64::from(x) * f64::from(scale)).round() / f64::from(scale)) as f32;
            assert!(status == 0 && found[0] == expected, "{x}: {} {expected}", found[0]);
            assert_eq!(sum(gpu, &[x, -x], 1, scale).0, [0.0], "{x}");
        }
        // What is 2^40 times as large as the largest number is limited, too.
        for (x, limited) in
            [(16384.0, 0), (16385.0, FIXED_LIMITED), (-1e30, FIXED_LIMITED), (f32::MAX, FIXED_LIMITED)]
        {
            let (found, status) = sum(gpu, &[1.0, x], 1, scale);
            assert_eq!(status, limited, "{x}");
            assert!(found[0] == 1.0 + 16384_f32.copysign(x), "{x} ends at the limit: {}", found[0]);
        }
        for x in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            assert_ne!(sum(gpu, &[1.0, x], 1, scale).1 & FIXED_LOST, 0, "{x} is refused");
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sums_that_may_leave_their_range_are_told_in_any_order() {
    let scale = (1_u64 << 40) as f32;
    for gpu in &devices() {
        let of = |terms: &[f32], sums: usize| {
            let (found, status) = sum(gpu, terms, sums, scale);
            (found, status & FIXED_LOST != 0)
        };
        let largest = 16384.0_f32;
        let of_both = |up: usize, down: usize| [vec![largest; up], vec![-largest; down]].concat();
        let turns = |n: usize| -> Vec<f32> { (0..2 * n).map(|i| [largest, -largest][i % 2]).collect() };
        // As many of one sign as fit, and one more; of either sign, whatever comes first.
        assert_eq!(of(&of_both(255, 0), 1), (vec![255.0 * largest], false));
        assert_eq!(of(&of_both(0, 255), 1), (vec![-255.0 * largest], false));
        assert_eq!(of(&of_both(255, 255), 1), (vec![0.0], false));
        assert_eq!(of(&turns(255), 1), (vec![0.0], false));
        for terms in [of_both(256, 0), of_both(0, 256), of_both(256, 256), turns(256)] {
            assert!(of(&terms, 1).1, "{} terms", terms.len());
        }
        // Sums that are 0 modulo 2^64, and modulo 2^64 within the range.
        assert!(of(&of_both(1024, 0), 1).1 && of(&of_both(1040, 0), 1).1 && of(&of_both(0, 2048), 1).1);
        // Not by a few that reach the limit, but by many that are less.
        assert!(!of(&[64.0; 65_000], 1).1 && of(&[64.0; 66_000], 1).1);
        // Small ones beside them, with a carry each.
        let small = [vec![0.003_906; 50_000], of_both(255, 0)].concat();
        let (found, lost) = of(&small, 1);
        let expected = 255.0 * largest + 50_000.0 * 0.003_906;
        assert!(!lost && (found[0] / expected - 1.0).abs() < 1e-6, "{} {expected}", found[0]);
        // 16 sums share a count; others have their own.
        assert!(of(&[largest; 16 * 16], 16).1 && !of(&[largest; 16 * 15], 16).1);
        let mut apart = vec![0.0; 32 * 200];
        for row in apart.chunks_mut(32) {
            (row[15], row[16]) = (largest, largest);
        }
        assert!(!of(&apart, 32).1, "200 of each count");
        apart.chunks_mut(32).for_each(|row| row[17] = largest);
        assert!(of(&apart, 32).1, "400 of the second one");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn many_groups_and_none() {
    let gpu = test_device();
    // More than 65,535 groups of 64.
    let n = 65_535 * 64 + 1000;
    let (found, status) = sum(gpu, &vec![1.0; n], 3, 1.0);
    assert_eq!(status, 0);
    assert_eq!(found.iter().sum::<f32>(), n as f32);
    let empty = gpu.zeros::<f32>("empty", 0).expect("made");
    assert!(empty.is_empty() && gpu.read(&empty).expect("read").is_empty());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_does_not_fit_is_told() {
    let gpu = test_device();
    let limit = gpu.report().largest_binding as usize;
    let error = gpu.zeros::<u32>("huge", limit / 4 + 1).expect_err("too large");
    assert!(matches!(&error, GpuError::TooLarge { name, .. } if name == "huge"), "{error}");
    let x = gpu.upload("x", &[1.0_f32; 4]).expect("uploaded");
    assert!(matches!(gpu.write(&x, &[0.0; 5]), Err(GpuError::Buffer { .. })));
    assert!(matches!(x.bind_range(1..3), Err(GpuError::Buffer { .. })));
    let mut r = gpu.record("wrong");
    assert!(matches!(r.copy(&x, &x), Err(GpuError::Buffer { .. })));
    let params = Params { count: 4, sums: 1, scale: 1.0, pad: 0 };
    assert!(matches!(r.dispatch(&ADD, &params, &[x.bind()], 4), Err(GpuError::Dispatch { .. })));
    assert!(matches!(
        r.dispatch(&ADD, &[0_u32; 3], &[x.bind(), x.bind()], 4),
        Err(GpuError::Dispatch { .. })
    ));
    let words = gpu.zeros::<u32>("words", 2).expect("made");
    assert!(matches!(
        r.dispatch_indirect(&ADD, &params, &[x.bind(), words.bind()], &words, 0),
        Err(GpuError::Buffer { .. })
    ));
    let broken = Kernel { name: "broken", source: &["fn f() { let x: u32 = 1.0; }"], entry: "f" };
    let error = r.dispatch(&broken, &params, &[], 1).expect_err("does not compile");
    assert!(matches!(&error, GpuError::Kernel { kernel, .. } if kernel == "broken"), "{error}");
    assert_eq!(
        validate(&Kernel { entry: "none", ..ADD }).err(),
        Some(GpuError::Kernel { kernel: "add".into(), reason: "has no entry point none".into() })
    );
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn recordings_run_again_with_other_parameters_and_are_profiled() {
    let gpu = test_device();
    let terms = gpu.upload("terms", &[1.0_f32; 6]).expect("uploaded");
    let words = gpu.zeros::<u32>("words", fixed_words(1)).expect("made");
    let out = gpu.zeros::<f32>("out", 1).expect("made");
    let groups = gpu.upload("groups", &[7_u32, 1, 1, 1]).expect("uploaded");
    let mut params = Params { count: 6, sums: 1, scale: 1.0, pad: 0 };
    let mut r = gpu.record("twice");
    r.clear(&words);
    let slot = r.dispatch_indirect(&ADD, &params, &[terms.bind(), words.bind()], &groups, 1).expect("fits");
    r.dispatch(&READ, &params, &[words.bind(), out.bind()], 1).expect("fits");
    let mut recording = r.finish().expect("recorded");
    recording.run().expect("runs");
    assert_eq!(gpu.read(&out).expect("read"), [6.0]);
    params.count = 4;
    recording.set(slot, &params);
    recording.run().expect("runs");
    assert_eq!(gpu.read(&out).expect("read"), [4.0]);
    let profile = recording.profile().expect("runs");
    assert_eq!(gpu.read(&out).expect("read"), [4.0]);
    assert!(profile.is_empty() || profile.iter().map(|p| p.0).eq(["add", "read"]), "{profile:?}");
    let report = recording.report().expect("runs");
    let of = |r: &KernelReport| (r.kernel, r.dispatches, r.indirect, r.milliseconds.is_some());
    let timed = !profile.is_empty();
    assert!(report.iter().map(of).eq([("add", 1, 1, timed), ("read", 1, 0, timed)]), "{report:?}");
    assert!(report[1].invocations >= 1 && report[1].bytes == words.bytes() + out.bytes(), "{report:?}");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sources_of_copies_change_from_run_to_run() {
    let gpu = test_device();
    let [a, b] = [[1.0_f32, 2.0, 3.0], [4.0, 5.0, 6.0]].map(|x| gpu.upload("source", &x).expect("uploaded"));
    let to = gpu.zeros::<f32>("to", 2).expect("made");
    let mut r = gpu.record("copies");
    let slot = r.copy_in(&to).expect("fits");
    let mut recording = r.finish().expect("recorded");
    recording.run().expect("runs");
    assert_eq!(gpu.read(&to).expect("read"), [0.0; 2], "no source yet");
    let cases =
        [(&a, 0..2, [1.0, 2.0]), (&b, 1..3, [5.0, 6.0]), (&b, 0..1, [4.0, 6.0]), (&a, 0..2, [1.0, 2.0])];
    for (source, elements, expected) in cases {
        recording.set_source(slot, source, elements).expect("fits");
        recording.run().expect("runs");
        assert_eq!(gpu.read(&to).expect("read"), expected);
    }
    for (wrong, elements) in [(&a, 2..4), (&a, 0..3), (&to, 0..2)] {
        let refused = recording.set_source(slot, wrong, elements);
        assert!(matches!(refused, Err(GpuError::Buffer { .. })), "{refused:?}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn parts_of_buffers_are_written_read_and_copied() {
    let gpu = test_device();
    let [a, b] = ["a", "b"].map(|name| gpu.upload(name, &[1.0_f32, 2.0, 3.0, 4.0]).expect("uploaded"));
    gpu.write_from(&a, 1, &[5.0, 6.0]).expect("fits");
    assert_eq!(gpu.read(&a).expect("read"), [1.0, 5.0, 6.0, 4.0]);
    assert_eq!(gpu.read_range(&a, 2..4).expect("read"), [6.0, 4.0]);
    assert!(gpu.read_range(&a, 4..4).expect("read").is_empty());
    let mut r = gpu.record("part");
    r.copy_range(&a, &b, 2..3).expect("fits");
    r.finish().expect("recorded").run().expect("runs");
    assert_eq!(gpu.read(&b).expect("read"), [1.0, 2.0, 6.0, 4.0]);
    let bytes = gpu.upload("bytes", &[0_u8; 8]).expect("uploaded");
    let mut r = gpu.record("refused");
    let refused = [
        gpu.write_from(&a, 3, &[0.0; 2]).err(),
        gpu.write_from(&a, usize::MAX, &[0.0; 2]).err(),
        gpu.write_from(&bytes, 2, &[0; 4]).err(),
        gpu.read_range(&a, 3..5).err(),
        gpu.read_range(&bytes, 1..5).err(),
        r.copy_range(&a, &b, 3..5).err(),
        r.copy_range(&a, &a, 0..1).err(),
    ];
    assert!(refused.iter().all(|e| matches!(e, Some(GpuError::Buffer { .. }))), "{refused:?}");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_device_that_is_used_in_part_has_no_more() {
    let choice = Choice::Named(test_device().report().name.clone());
    let gpu = &Gpu::within(&choice, Caps { binding: 1 << 10, memory: 4 << 10, ..Caps::NONE }).expect("opens");
    let large = gpu.zeros::<u32>("large", 257).expect_err("larger than a binding");
    assert!(matches!(large, GpuError::TooLarge { bytes: 1028, limit: 1024, .. }) && large.is_of_size());
    assert!(large.to_string().contains("maxStorageBufferBindingSize"), "{large}");
    let store = gpu.store::<u32>("store", 257).expect("is not bound");
    assert_eq!(gpu.held(), 1028);
    let some: Vec<_> = (0..3).map(|_| gpu.zeros::<u32>("some", 250).expect("fits")).collect();
    let full = gpu.zeros::<u32>("one more", 25).expect_err("no room");
    assert!(matches!(full, GpuError::OutOfMemory { bytes: 100, .. }) && full.is_of_size(), "{full:?}");
    assert_eq!(gpu.held(), 4028, "what is refused takes nothing");
    // What a recording binds is there as long as the recording.
    let mut r = gpu.record("keeps");
    r.clear(&store);
    drop((store, some));
    assert_eq!(gpu.held(), 1028);
    drop(r);
    assert_eq!(gpu.held(), 0);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn few_submissions_wait_and_traffic_is_counted() {
    let name = test_device().report().name.clone();
    // Counted by a device that no other test uses.
    let gpu = &Gpu::new(&Choice::Named(name)).expect("opens");
    let terms = gpu.upload("terms", &vec![1.0_f32; 1 << 20]).expect("uploaded");
    let words = gpu.zeros::<u32>("words", fixed_words(1)).expect("made");
    let params = Params { count: 1 << 20, sums: 1, scale: 1.0, pad: 0 };
    let mut r = gpu.record("slow");
    let slot = r.dispatch(&ADD, &params, &[terms.bind(), words.bind()], 1 << 20).expect("fits");
    let mut recording = r.finish().expect("recorded");
    let before = gpu.traffic();
    for _ in 0..6 {
        recording.set(slot, &params);
        recording.run().expect("runs");
        assert!(gpu.waiting() <= 2, "{} submissions", gpu.waiting());
    }
    let after = gpu.traffic();
    assert_eq!(after.submissions - before.submissions, 6);
    // The parameters of a dispatch fill 256 bytes.
    assert_eq!((after.uploaded - before.uploaded, after.read - before.read), (6 * 256, 0));
    assert_eq!(gpu.read(&words).expect("read")[0], 6 << 20, "all of them ran");
    assert_eq!(gpu.traffic().read, after.read + words.bytes());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_lost_device_is_told_by_every_call() {
    let name = test_device().report().name.clone();
    let gpu = Gpu::new(&Choice::Named(name)).expect("opens");
    let x = gpu.upload("x", &[1.0_f32; 4]).expect("uploaded");
    let words = gpu.zeros::<u32>("words", fixed_words(1)).expect("made");
    let params = Params { count: 4, sums: 1, scale: 1.0, pad: 0 };
    let mut r = gpu.record("lost");
    r.dispatch(&ADD, &params, &[x.bind(), words.bind()], 4).expect("fits");
    let mut recording = r.finish().expect("recorded");
    recording.run().expect("runs");
    gpu.destroy();
    let lost = |r: Result<(), GpuError>| matches!(r, Err(GpuError::Lost(_)));
    assert!(lost(recording.run()));
    assert!(lost(gpu.wait()));
    assert!(lost(gpu.write(&x, &[2.0])));
    assert!(lost(gpu.read(&x).map(|_| ())));
    assert!(lost(gpu.zeros::<f32>("more", 4).map(|_| ())));
    assert!(lost(gpu.record("another").dispatch(&READ, &params, &[], 4).map(|_| ())));
    assert!(lost(recording.profile().map(|_| ())));
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn adapters_are_chosen_by_name() {
    let gpu = test_device();
    let name = gpu.report().name.clone();
    assert!(adapters().iter().any(|a| a.name == name));
    let part: String = name.to_uppercase().chars().take(5).collect();
    assert_eq!(Gpu::new(&Choice::Named(part)).expect("opens").report().name, name);
    let error = Gpu::new(&Choice::Named("no such card".into())).expect_err("is not there");
    assert!(error.to_string().contains("no such card") && error.to_string().contains(&name), "{error}");
}
