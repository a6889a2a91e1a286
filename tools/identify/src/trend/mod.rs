//! A trend of each declared parameter over a laboratory's recordings: whether the machine is still
//! the one of the rig file, and when it changed.
//!
//! - [`folder`]: the recordings of a folder, in the order of their calendar time;
//! - [`fits`]: each of them identified by itself;
//! - [`statistics`]: weighted mean and drift;
//! - [`change_points`]: steps of a constant, by optimal partitioning;
//! - [`calibration`]: the limits beyond which either is told, by simulation;
//! - [`quantity`]: what happened to one parameter;
//! - [`assembly`]: all parameters, and the machine's verdict;
//! - [`result`]: both, in the form of `--json`;
//! - [`sentences`]: the verdict in words;
//! - `text`, `page`, `numbers`: for readers.

pub mod assembly;
pub mod calibration;
pub mod change_points;
pub mod fits;
pub mod folder;
mod numbers;
mod page;
pub mod quantity;
pub mod result;
pub(crate) mod run;
pub mod sentences;
pub mod statistics;
mod text;
