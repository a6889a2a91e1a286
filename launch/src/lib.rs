//! The launcher for machines without systemd, and the unit files.
