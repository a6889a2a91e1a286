//! Zero drift of the force channel.
//!
//! `F → F + rate · t`, `t` since the start of the record. Source: warm-up of bridge amplifiers;
//! data sheets give a few tenths of a per cent of the range per hour, bad cables far more.
//!
//! Parameter: `rate` (N/s, N·m/s or V/s), any sign.
//!
//! In a residual: a ramp over time, independent of the movement. Confused with: a slow real force,
//! thermal drift of friction (which changes sign with the velocity), relaxation of an element that
//! is held.

use super::{Effect, Term};

pub(super) const EFFECT: Effect = Effect {
    id: "sensor_drift",
    sites: &["sensor"],
    words: "a zero of the force that wanders",
    experiment: "the unloaded channel recorded for as long as the run, before and after it",
    terms: |axis| vec![Term::free("rate", format!("{}/s", axis.units.force))],
    force: Some(|now, _, _, out| out[0] = now.time),
    ..Effect::NONE
};
