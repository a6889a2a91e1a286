//! `farreach demo`: the main job on the embedded simulated rig.
//!
//! ```text
//! $ farreach demo --out demo
//! ...
//! control killed: motor at 0 V after 5.4 ms; back after 72 ms; ...
//! acquisition killed: motor at 0 V after 7.6 ms; back after 76 ms; ...
//! protocol done
//! ...
//!
//! samples     64783 on disk, 0 lost, 0 never acquired; 25.4 MB
//! control     498.64 and 499.32 Hz, by incarnation
//! woke late   p50 42, p99 207, max 1966 µs (worst process)
//! to command  p50 247, p99 510, max 3432 µs from the scan
//! control     killed at -1.0 V: 0 V after 5.4 ms, back after 71.7 ms, volts again after 200.4 ms
//! acquisition killed at 1.4 V: 0 V after 7.6 ms, back after 75.8 ms, volts again after 204.1 ms
//! model       rms error, free-running: master_rad 0.0007 rad, slave_rad 0.0007 rad, ...
//!
//! all requirements met; the host was too busy for an uninterrupted movement
//! ```
//!
//! That host was busy: some loops missed their deadlines, and the watchdog tripped without a kill,
//! which does not happen on a quiet host. `demo/` then holds `run.mcap` (every topic, from the
//! first sample), `report.html` (one page with figures, no network) and `summary.json`
//! ([`Summary`]).
//!
//! # Steps
//!
//! 1. A rig of its own (`demo-PID`) comes up with the simulated card, an operator resets, arms and
//!    enables, `launch/protocols/home.toml` finds the stops, and `launch/protocols/demo.toml` is
//!    played: rest, guided 1 Hz, a short excitation, hold.
//! 2. During the movement **control** is killed with SIGKILL. The gate, in acquisition, writes 0 V
//!    when the last command has expired. Later **acquisition** is killed: the DAC holds its last
//!    volts, the watchdog stops toggling the enable line, and the card removes power from the
//!    motor. Each trip ends the protocol; the launcher restarts the killed process, reset, arm and
//!    enable restore power, and the protocol is started again.
//! 3. The recording ends, the rig goes down, and all numbers are computed from the recording by
//!    pure functions ([`analysis`]); only the times of the kills come from the demo itself.
//! 4. The declared plant, with the effects of the rig file and no others, is simulated in open loop
//!    on the volts that reached the motor. Without `--effect` the error is the resolution of the
//!    encoders and the torque cell; with one, the effect adds to it.
//! 5. `farreach identify` runs on the recording and reports which effect the declared model lacks,
//!    or that nothing is missing. It takes a minute or more; `--no-identify` leaves it out.
//!
//! Exit codes: 0 all requirements met; 1 one was not met (the motor was not at 0 V, a process did
//! not come back), or the run could not be made or was interrupted; 2 usage; 3 data was lost.
//! Whatever happens, Ctrl-C included, the rig is brought down and its shared memory removed.

pub mod analysis;
mod closed_loop;
mod demonstrated;
mod display_unit;
mod folder;
mod hidden_effect;
mod identify_result;
mod page;
mod run;
mod session;
mod summary;
mod tables;
mod terminal;

pub use closed_loop::{ClosedLoop, ClosedLoopSummary, Naming};
pub use demonstrated::Run;
pub use folder::Folder;
pub use hidden_effect::draw;
pub use identify_result::IdentifyResult;
pub use page::page;
pub use run::{Args, run};
pub use summary::{Outcome, Summary};
