//! What every process is built from: the shared-memory domain, ports with identity and sequence,
//! the grid loop and its timing, the gate, requests and answers, the `Daq` trait, signals and
//! readiness.
//!
//! A process is a thin loop round a pure core:
//!
//! ```no_run
//! use ipc_types::{MotorCommand, Process, COMMAND, SAMPLE};
//! use runtime::{Grid, Losses, Service, ServiceError};
//!
//! fn main() -> Result<(), ServiceError> {
//!     let mut service = Service::start(Process::Control, "demo")?;
//!     let mut samples = service.subscriber(SAMPLE)?;
//!     let mut commands = service.publisher(COMMAND)?;
//!     service.enter_loop()?;
//!     let mut grid = Grid::of_rate(500, 200_000); // Hz, phase in ns
//!     while !service.stopping() {
//!         let Some(wake) = grid.wait() else { continue };
//!         if let Some(sample) = samples.latest()? {
//!             commands.send(MotorCommand {
//!                 sample_tick: sample.tick,
//!                 sample_time_ns: sample.scan_time_ns,
//!                 computed_ns: wake.woke_ns,
//!                 ..Default::default()
//!             })?;
//!         }
//!         let losses = Losses::default().received(samples.counters());
//!         service.end_cycle(&grid, &wake, losses.sent(commands.undelivered()))?;
//!         service.beat();
//!     }
//!     service.end()?;
//!     Ok(())
//! }
//! ```

mod bare_loop;
pub mod clock;
pub mod daq;
mod domain;
pub mod gate;
mod grid;
mod host_stall;
mod identity;
mod locks;
pub mod machine_report;
pub mod placement;
mod ports;
mod process_watch;
pub mod realtime;
pub mod request;
mod service;
mod shared_memory;
mod stale_cleanup;
mod timing;
mod wake_lateness;
mod worker;

pub use bare_loop::{bind, own_processors};
#[doc(hidden)]
pub use domain::check_session;
pub use domain::{Domain, DomainError, Keeper, RigName, shared_memory_room};
pub use grid::{Grid, Wake};
pub use host_stall::{HostStall, MEASURED_FOR, STOLEN_PPM};
pub use identity::{Identity, random_u64};
pub use ipc_types::Timeouts;
pub use machine_report::{CheckResult, MachineReport, Verdict};
pub use ports::{Counters, PortError, Publisher, RawSubscriber, Subscriber, open_raw};
pub use realtime::Grants;
pub use request::{RequestError, Server, call};
pub use service::{NotifyState, Service, ServiceError, notify, stop_flag, stop_on};
pub use shared_memory::SHARED_MEMORY;
pub use timing::Losses;
pub use wake_lateness::{BIN_ENDS_US, WakeLateness};
pub use worker::Worker;
