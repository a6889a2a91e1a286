//! Checks of the rig that is up: what it shows at rest, and, with a person's consent, under power.

mod connection;
pub(crate) mod enable_line;
mod moved;
pub(crate) mod movement;
pub(crate) mod rest;

pub(crate) use connection::RunningRig;
pub(crate) use moved::Movement;
