//! Holds every shared-memory service open and cleans up after the dead.
