//! The safety watchdog: interlocks and the enable line.

pub mod machine;
