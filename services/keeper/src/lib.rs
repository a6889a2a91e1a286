//! The keeper process: founds the rig's shared-memory domain, chooses its timing profile, holds
//! every service open, cleans up after processes that died.
//!
//! It has no ports and no part in the data. When it dies, everything goes on; nothing new starts
//! until it is back.

use std::sync::atomic::Ordering;
use std::time::Duration;

use runtime::{Keeper, NotifyState, RigName, ServiceError, notify};

/// Longest wait for a death: so often, at least, the stop flag is read and the service manager's
/// watchdog is fed.
const WAIT: Duration = Duration::from_millis(250);

/// Keeps the domain of a rig until a signal ends it. `founded` is called before the keeper is
/// ready, hence before any other process starts; it is told whether a new session begins.
///
/// # Errors
/// [`ServiceError`], or that of `founded`.
pub fn run<E: From<ServiceError>>(
    rig_name: &str,
    founded: impl FnOnce(bool) -> Result<(), E>,
) -> Result<(), E> {
    runtime::realtime::name_thread("fr-keeper");
    let stop = runtime::stop_flag()?;
    let name: RigName = rig_name.parse().map_err(ServiceError::from)?;
    let mut keeper = Keeper::start(&name).map_err(ServiceError::from)?;
    founded(keeper.is_cold())?;
    notify(NotifyState::Status(keeper.profile().text()));
    notify(NotifyState::Ready);
    while !stop.load(Ordering::Relaxed) {
        keeper.clean(WAIT);
        notify(NotifyState::Watchdog);
    }
    notify(NotifyState::Stopping);
    keeper.end().map_err(ServiceError::from)?;
    Ok(())
}
