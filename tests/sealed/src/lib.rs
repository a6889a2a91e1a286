//! Sealed cases: records as a rig would give them, with an effect that its rig file does not
//! declare.
//!
//! `farreach identify` is to name what a model lacks. Whether it can is judged here, on records
//! from a simulator that shares no code with the model: the equations of chapter 3 are written down
//! again ([`model`]), with another integrator (classical Runge-Kutta, ten or more steps a row),
//! another friction at rest ([`smoothing`]), constants off the declared ones within their
//! tolerances ([`machine`]), counted angles, noisy torque, and disturbed sides ([`record`]). What
//! is wrong with a machine is drawn from the catalogue or from a list of things that are in no
//! catalogue ([`effects`]); `truth.json` has it, and only the scoring reads that ([`score`],
//! [`table`]).
//!
//! ```text
//! $ cargo run --release -p sealed --bin generate -- --set listed --cases 31 --seed 1 --out cases
//! $ cargo run --release -p sealed --bin campaign -- --farreach target/release/farreach --seed 1 --results campaign.jsonl
//! $ cargo run --release -p sealed --bin campaign -- --seed 1 --listed 0 --clean 0 --pairs 0 --unlisted-kinds new --results holdout.jsonl
//! $ cargo run --release -p sealed --bin campaign -- --seed 1 --results campaign.jsonl --only-print
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod case;
pub mod detect;
pub mod deviation;
pub mod draw;
pub mod effective;
pub mod effects;
pub mod fingerprint;
pub mod machine;
pub mod model;
pub mod record;
pub mod reference;
pub mod results;
pub mod score;
pub mod smoothing;
pub mod table;
