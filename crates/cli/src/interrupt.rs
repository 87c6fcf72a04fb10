//! Ctrl-C and SIGTERM: before there is anything to keep they end the program; then the first asks the work to stop and keep
//! what it has, and the second ends the program at once. `timeout` sends its signal to the program and to its group, service
//! managers do alike: what follows at once is the same request.

use crate::progress::say;
use crate::status::INTERRUPTED;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Whether there is something to keep.
static KEEPING: AtomicBool = AtomicBool::new(false);
/// When the first signal came while there was.
static FIRST: OnceLock<Instant> = OnceLock::new();
/// Signals within this time are one.
const TOGETHER: Duration = Duration::from_millis(200);

/// Whether a signal asked the work to stop.
pub(crate) fn is_stopping() -> bool {
    FIRST.get().is_some()
}

/// Makes signals end the program with status [`INTERRUPTED`]; a hangup is left as it is, so that `nohup` keeps its meaning.
pub(crate) fn listen() {
    // Without a handler a signal ends the program as usual.
    let _ = installed();
}

/// From now on there is something to keep: the first signal asks for it.
pub(crate) fn handle() {
    KEEPING.store(true, Ordering::SeqCst);
}

fn received() {
    let keeping = KEEPING.load(Ordering::SeqCst);
    if keeping && FIRST.set(Instant::now()).is_ok() {
        say(
            "stopping; what was reached, if anything, is kept. A second Ctrl-C or SIGTERM ends the program at once.",
        );
    } else if !keeping || FIRST.get().is_none_or(|first| first.elapsed() >= TOGETHER) {
        std::process::exit(i32::from(INTERRUPTED));
    }
}

#[cfg(unix)]
fn installed() -> std::io::Result<()> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|_| received()))
        .map(drop)
}

#[cfg(not(unix))]
fn installed() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(received)
}
