//! The declared model beside the running machine (§ 2.2.2), and when the machine departs from it.
//!
//! | step | what it does |
//! |---|---|
//! | [`row`] | thins samples to the rows with which a model is compared, 500 Hz |
//! | [`bank`] | runs observers side by side: the declared model, and the same with each change |
//! | [`sums`] | sums innovations and directions over blocks of half a second of movement |
//! | [`calibration`] | follows the declared parameters within their tolerances |
//! | [`score`] | scores how much the rest of the newest blocks looks like one of the changes |
//! | [`departure`] | compares the rest with its baseline, by a cumulative sum, and the score |
//! | [`origin`] | finds the effect, and with it the place, that explains a departure |
//! | [`axis_monitor`], [`rig_monitor`] | put these together for an axis and for a rig |
//! | `process` | subscribes to samples and publishes what the others found |
//!
//! All but the process is pure: the same samples give the same results, live, replayed from a
//! recording, or simulated.
#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod axis_monitor;
pub mod bank;
pub mod calibration;
pub mod departure;
pub mod origin;
mod process;
pub mod rig_monitor;
pub mod row;
pub mod score;
pub mod sums;

pub use process::{MonitorError, run};
pub use rig_monitor::{Report, RigMonitor};
