//! Blind cases: simulated records of a machine with an effect that is not in its rig file.
//!
//! They test whether `farreach identify` finds what a model lacks. The simulator shares no code
//! with the model: the equations of chapter 3 are implemented independently ([`simulator`]), with
//! another integrator (classical Runge-Kutta, ten or more steps per row), another smoothing of dry
//! friction ([`smoothing`]), parameters drawn within their tolerances ([`machine_parameters`]),
//! quantised angles, noisy torque, and process noise ([`record`]). Effects are drawn from those
//! that identify knows (listed) or from others (unlisted, [`effects`]); `truth.json` holds them and
//! is read by the scoring only ([`score`], [`table`]).
//!
//! ```text
//! $ cargo run --release -p blind_cases --bin generate -- --set listed --cases 31 --seed 1 \
//!       --out cases
//! $ cargo run --release -p blind_cases --bin campaign -- --farreach target/release/farreach \
//!       --seed 1 --results campaign.jsonl
//! $ cargo run --release -p blind_cases --bin campaign -- --seed 1 --listed 0 --clean 0 --pairs 0 \
//!       --unlisted-kinds new --results holdout.jsonl
//! $ cargo run --release -p blind_cases --bin campaign -- --seed 1 --results campaign.jsonl \
//!       --only-print
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

pub mod case;
pub mod case_plan;
pub mod coverage;
pub mod detectability;
pub mod deviation;
pub mod effective_size;
pub mod effects;
pub mod fingerprint;
pub mod hose_loss;
pub mod machine_parameters;
pub mod one_channel;
pub mod random;
pub mod record;
pub mod reference;
pub mod results;
mod rightly_ambiguous;
pub mod rules;
pub mod score;
pub mod simulator;
pub mod smoothing;
pub mod table;
