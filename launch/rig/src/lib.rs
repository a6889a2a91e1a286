//! Rig and protocol files: schema, checks, conversion.
