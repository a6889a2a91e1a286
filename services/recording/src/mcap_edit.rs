//! Recover, cut and merge.
