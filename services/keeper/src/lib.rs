//! The keeper process: founds the rig's shared-memory domain, chooses its timing profile, holds
//! every service open, cleans up after processes that died.
//!
//! It has no ports and no part in the data. When it dies, everything goes on; nothing new starts
//! until it is back.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use runtime::{DomainError, Keeper, RigName};
use thiserror::Error;

/// Longest wait for a death: so often, at least, the stop flag is read and the service manager's
/// watchdog is fed.
const WAIT: Duration = Duration::from_millis(250);

/// Why the keeper ended.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum KeeperError {
    #[error(transparent)]
    Domain(#[from] DomainError),
    #[error("signal handler: {0}")]
    Signal(#[from] std::io::Error),
}

/// Keeps the domain of a rig until a signal ends it.
pub fn run(rig_name: &str) -> Result<(), KeeperError> {
    runtime::realtime::name_thread("fr-keeper");
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let name: RigName = rig_name.parse()?;
    let mut keeper = Keeper::start(&name)?;
    notify(&[
        sd_notify::NotifyState::Ready,
        sd_notify::NotifyState::Status(keeper.profile().text()),
    ]);
    while !stop.load(Ordering::Relaxed) {
        keeper.clean(WAIT);
        notify(&[sd_notify::NotifyState::Watchdog]);
    }
    notify(&[sd_notify::NotifyState::Stopping]);
    keeper.end()?;
    Ok(())
}

fn notify(states: &[sd_notify::NotifyState<'_>]) {
    // Without a service manager nobody listens.
    let _sent = sd_notify::notify(states);
}
