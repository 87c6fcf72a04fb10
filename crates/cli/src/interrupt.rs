//! Ctrl-C and SIGTERM: the first asks the work to stop and keep what it has, the second ends the program at once.

use crate::progress::say;
use crate::status::INTERRUPTED;
use std::sync::atomic::{AtomicBool, Ordering};

static STOPPING: AtomicBool = AtomicBool::new(false);

/// Whether a signal asked the work to stop.
pub(crate) fn is_stopping() -> bool {
    STOPPING.load(Ordering::SeqCst)
}

/// Installs the handler; a hangup is left as it is, so that `nohup` keeps its meaning.
pub(crate) fn handle() {
    // Without a handler a signal ends the program as usual.
    let _ = listen();
}

fn received() {
    if STOPPING.swap(true, Ordering::SeqCst) {
        std::process::exit(i32::from(INTERRUPTED));
    }
    say("stopping; what was reached is kept. A second Ctrl-C or SIGTERM ends the program at once.");
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|_| received()))
        .map(drop)
}

#[cfg(not(unix))]
fn listen() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(received)
}
