//! The control process and its laws.

pub mod law;
