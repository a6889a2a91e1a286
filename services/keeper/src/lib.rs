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

/// Keeps the domain of a rig until a signal ends it.
///
/// # Errors
/// [`ServiceError`].
pub fn run(rig_name: &str) -> Result<(), ServiceError> {
    runtime::realtime::name_thread("fr-keeper");
    let stop = runtime::stop_flag()?;
    let name: RigName = rig_name.parse()?;
    let mut keeper = Keeper::start(&name)?;
    notify(NotifyState::Status(keeper.profile().text()));
    notify(NotifyState::Ready);
    while !stop.load(Ordering::Relaxed) {
        keeper.clean(WAIT);
        notify(NotifyState::Watchdog);
    }
    notify(NotifyState::Stopping);
    keeper.end()?;
    Ok(())
}
