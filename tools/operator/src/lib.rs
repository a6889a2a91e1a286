//! What an operator does with a rig: `up`, `down`, `status`, `reset`, `arm`, `enable`, `disarm`,
//! `estop`, `run`.
//!
//! ```text
//! $ farreach up --simulate && farreach reset && farreach arm
//! $ farreach run home
//! $ farreach run guided-1hz
//! $ farreach down
//! ```
//!
//! [`up`], [`down`], [`RigLink`] and [`run_protocol`] are the same as functions, for programs;
//! [`command`] is the command line round them. A rig is known by its name: everything of it lies in
//! one directory of shared memory.

mod arming;
mod changed_rig_file;
mod chosen_protocol;
pub mod command;
mod console_address;
mod down;
mod error;
mod initialise_results;
mod kept_folder;
mod link;
mod restart;
mod run;
mod saved_rig_file;
mod scanner_key;
mod session_files;
pub mod status;
mod systemd_rig;
mod up;

pub use acquisition::CardOptions;
pub use arming::reset_and_arm;
pub use changed_rig_file::change_rig_file;
pub use chosen_protocol::{ChosenProtocol, RunOptions, client_number};
pub use console_address::ConsoleAddress;
pub use down::{Cleaning, Down, down};
pub use error::{DATA_LOST, DONE, Error, FAILED, USAGE};
pub use initialise_results::FoundRange;
pub use kept_folder::{DOCTOR, KeptFolder, LEARNT};
pub use link::{RigLink, verb};
pub use restart::{replace, restart};
pub use run::{Progress, RunOutcome, check_armed, resume_protocol, run_protocol, stop_protocol};
pub use saved_rig_file::{rig_of, running};
pub use session_files::{SessionFiles, Written, sessions_of};
pub use systemd_rig::{become_its_user, describe_to_clients};
pub use up::{PhaseSource, Up, UpOptions, up, up_in_foreground};
