//! Attachable live probes.
