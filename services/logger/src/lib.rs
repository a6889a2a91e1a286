//! The logger process: all topics to disk.
