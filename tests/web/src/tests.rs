//! The twins on the machine's own device.

use crate::{Twin, check};
use photofit_gpu::{assert_twin, test_device};
use std::task::{Context, Poll, Waker};

/// A future that waits for nothing but the device, for which it blocks the thread.
fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = std::pin::pin!(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
    }
}

#[test]
fn tests_on_a_device_pass_where_there_is_one() {
    photofit_gpu::run_device_tests();
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn twins_agree_without_blocking_calls() {
    let (kernels, twins) = wait(check(test_device())).expect("the device runs them");
    assert!(kernels > 20, "{kernels} kernels");
    for t in twins {
        assert_twin("WEB", t.what, t.error, t.bound);
        assert!(t.agrees(), "{}: a broken side is noticed", t.what);
    }
}

#[test]
fn a_twin_that_is_not_finite_or_shorter_disagrees() {
    for device in [&[1.0, f32::NAN][..], &[1.0], &[1.0, 2.1]] {
        let twin =
            Twin { error: super::difference(&[1.0, 2.0], device), ..Twin::new("", &[1.0], &[1.0], 1e-3) };
        assert!(!twin.agrees(), "{device:?}");
    }
    assert!(Twin::new("", &[1.0, 2.0], &[1.0, 2.0], 1e-3).agrees());
}
