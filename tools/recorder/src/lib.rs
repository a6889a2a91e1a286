//! The recorder command line.
