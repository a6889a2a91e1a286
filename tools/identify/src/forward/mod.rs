//! Models that are simulated forward, volts in and motion out, and pulled toward the measurement as
//! they go.
//!
//! Free simulation would bury effects under noise and the drift of stick-slip. An observer pulls
//! master and slave toward what was measured; what it has to pull by, the innovation, is the
//! residual. With a bandwidth `ω` a torque `Δτ` that the model lacks at a side of inertia `I` shows
//! as an innovation of about `Δτ/(I ω²)`: a low bandwidth gives contrast, and a high one holds the
//! model to the record. Where friction falls with speed, a model that is held too loosely has two
//! ways to go from the same place, and no fit finds across; the bandwidth is chosen so high that
//! this does not happen.
//!
//! - [`record`]: measured records, checked and laid out;
//! - [`machine`]: the declared model with its tolerances, and its residual on a record for any
//!   setting of parameters and effects;
//! - [`knob`]: the numbers that a fit moves, each within its range;
//! - [`fit`]: Levenberg-Marquardt with a variance of its own for every record and channel;
//! - [`catalogue`]: the listed effects, what of them is free, and from which sizes and shapes a
//!   search begins;
//! - [`screen`]: which of them point along the residual, by score, the declared parameters
//!   projected out;
//! - [`generic`]: torques as functions of one variable that have no name: what shows that something
//!   unlisted is missing;
//! - [`judge`]: how a model does on records that its fit has not seen, beside what repeats of a
//!   movement differ by;
//! - [`sight`]: what the records show of each declared parameter;
//! - [`unnamed`]: where functions without a name are tried, and how each does;
//! - [`origin`]: where what has no name enters, whatever it depends on, by how a known torque
//!   ([`stimulus`]) at each place is answered;
//! - [`finer`]: whether what an effect explains is still missing with finer steps;
//! - [`folded`]: which sign a torque had whose sensor shows both as one;
//! - [`sensor`]: the torque cell's errors taken back, and readings that come late;
//! - [`refit`]: the whole model fitted, and again once an effect is in it;
//! - [`prune`]: effects that later ones, or a single other one, made needless;
//! - [`round`]: one round of it: candidates fitted, first briefly, then as far as it is worth it;
//! - [`search`]: all of it, round by round, to a verdict;
//! - [`chance`]: how often machines that lack nothing give as much.

pub mod catalogue;
pub mod chance;
pub mod finer;
pub mod fit;
pub mod folded;
pub mod generic;
pub mod judge;
pub mod knob;
pub mod machine;
pub mod origin;
pub mod prune;
pub mod record;
pub mod refit;
pub mod round;
pub mod screen;
pub mod search;
pub mod sensor;
pub mod sight;
pub mod stimulus;
pub mod unnamed;
