//! Futures that wait for nothing but a device.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The value of a future that never waits: without a device, and outside of browsers, where calls to one block the thread.
pub(crate) fn at_once<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
    }
}
