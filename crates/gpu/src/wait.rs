//! Waiting for a device: by blocking the thread, or, in a browser, which does not allow that, by futures alone.

use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

/// Waits for a future by blocking the thread.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use pollster::block_on;

/// Runs calls of the driver and tells what it refused of them. A browser tells later, by the error that [`crate::Gpu`] keeps
/// for the next call.
pub(crate) fn refused<T>(
    device: &wgpu::Device,
    filter: wgpu::ErrorFilter,
    call: impl FnOnce() -> T,
) -> Result<T, wgpu::Error> {
    #[cfg(target_arch = "wasm32")]
    {
        let _ = (device, filter);
        Ok(call())
    }
    #[cfg(not(target_arch = "wasm32"))]
    block_on(refused_in_time(device, filter, call))
}

/// [`refused`] for those who can wait for a future: a browser's refusal is told, too.
pub(crate) async fn refused_in_time<T>(
    device: &wgpu::Device,
    filter: wgpu::ErrorFilter,
    call: impl FnOnce() -> T,
) -> Result<T, wgpu::Error> {
    let scope = device.push_error_scope(filter);
    let made = call();
    scope.pop().await.map_or(Ok(made), Err)
}

/// What a callback will say, once.
pub(crate) struct Answer<T>(Arc<Mutex<(Option<T>, Option<Waker>)>>);

impl<T> Answer<T> {
    pub(crate) fn new() -> Self {
        Self(Arc::new(Mutex::new((None, None))))
    }

    /// What the callback calls.
    pub(crate) fn sender(&self) -> impl FnOnce(T) + use<T> {
        let shared = self.0.clone();
        move |value| {
            let mut shared = shared.lock().unwrap_or_else(PoisonError::into_inner);
            shared.0 = Some(value);
            if let Some(waker) = shared.1.take() {
                waker.wake();
            }
        }
    }

    /// What it was called with.
    pub(crate) async fn value(self) -> T {
        std::future::poll_fn(|context| {
            let mut shared = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match shared.0.take() {
                Some(value) => Poll::Ready(value),
                None => {
                    shared.1 = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}
