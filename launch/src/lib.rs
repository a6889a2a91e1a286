//! The launcher for machines without systemd, and the unit files for machines with it.
//!
//! Both follow from the table of processes ([`units`]). The launcher starts the processes in their
//! order, waits for `READY=1`, watches them, restarts them with back-off, and stops them in the
//! reverse order. It knows neither shared memory nor messages.
//!
//! ```no_run
//! # fn main() -> Result<(), launch::Error> {
//! let config = launch::Config::new("bench", "/run/farreach/bench", "/usr/local/bin/farreach")
//!     .with_processes(ipc_types::PROCESSES)
//!     .with_environment("FARREACH_RIG", "/etc/farreach/bench/rig.toml");
//! let running = launch::start(config)?; // all are ready; the launcher is a process of its own
//! println!("up, launcher {}", running.launcher.pid);
//! for unit in launch::status(&running.run_dir)?.units {
//!     println!("{:12} {:?} {} restarts", unit.name, unit.state, unit.restarts);
//! }
//! let report = launch::stop(&running.run_dir)?; // the watchdog first: motor first
//! # Ok(())
//! # }
//! ```
//!
//! The launcher process is `EXECUTABLE service launcher --run-dir DIR`, whose body is
//! [`launcher_main`]; `up --foreground` calls [`supervise`] instead of [`start`].

mod client;
mod config;
mod control_socket;
mod error;
mod identity;
pub mod lifecycle;
mod log;
mod notify;
#[doc(hidden)]
pub mod parsers;
mod process;
mod run_dir;
mod scheduling;
mod status;
mod supervision;
mod supervisor;
pub mod systemd;
pub mod units;

pub use client::{Running, change, replace, restart, start, status, stop};
pub use config::Config;
pub use error::{Error, StartError, StartFailure};
pub use identity::{ProcessIdentity, boot_id};
pub use run_dir::RunDir;
pub use scheduling::Scheduling;
pub use status::{Leftover, RigState, Status, StopReport, UnitState, UnitStatus, UnitStop};
pub use supervision::Supervision;
pub use supervisor::{launcher_main, supervise};
