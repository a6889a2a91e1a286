//! The main job on the embedded simulated rig.

pub mod analysis;
mod console;
mod folder;
mod page;
mod run;
mod session;
mod summary;

pub use folder::{Folder, FolderError};
pub use page::page;
pub use run::{Args, run};
pub use summary::{Outcome, Summary};
