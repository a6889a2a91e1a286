//! Shared memory domain, grid loop, gate, DAQ trait.
