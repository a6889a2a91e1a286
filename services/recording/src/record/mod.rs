//! Measured records.
