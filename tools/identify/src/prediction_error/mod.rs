//! Transmissions: volts and hand torque in, positions of master and slave out, identified by the
//! prediction-error method.
//!
//! The model is simulated along each record with an observer that corrects master and slave toward
//! the measured positions; the residual is the observer's innovation (one-step prediction error).
//! An open-loop simulation would bury effects under noise and the drift of stick-slip. With an
//! observer bandwidth `ω`, a torque `Δτ` that the model lacks at a side of inertia `I` appears as
//! an innovation of about `Δτ/(I ω²)`: a low bandwidth gives contrast, a high one keeps the model
//! on the record. Where friction falls with speed, too low a bandwidth leaves the model two
//! solutions from the same state, and no gradient leads from one to the other.
//!
//! - [`record`]: measured records, checked and resampled;
//! - [`transmission_model`]: the declared model with its tolerances, and its innovations along a
//!   record for given parameters and effects;
//! - [`free_parameter`]: the parameters that a fit varies, each within its bounds;
//! - [`dataset`]: the criterion, a likelihood with one noise variance per record and channel;
//! - [`fit`]: its minimum by Levenberg-Marquardt;
//! - `growing_basis`: few coordinates for the long vectors of a fit;
//! - [`known_columns`]: columns of a Jacobian that fits from nearby points share;
//! - [`candidates`]: the listed effects, their free parameters and starting points;
//! - [`record_features`]: spectral lines and orders in residuals, for starting points;
//! - [`screening`]: score test of the candidates against the residual, with the sensitivities to
//!   the declared parameters projected out;
//! - [`nonparametric`]: piecewise-linear torques of one variable, which reveal an unlisted effect;
//! - [`nonparametric_search`]: where such functions are tried, and how each validates;
//! - [`validation`]: gains on records that took no part in the fit;
//! - [`noise_floor`]: errors relative to the repeatability, in sum and octave by octave;
//! - [`excess_over_floor`]: the error above the repeatability record by record, and how much of it
//!   effects leave;
//! - [`floor_comparison`]: a model against the floor, by all of these measures;
//! - [`identifiability`]: what the records tell about each declared parameter;
//! - [`localisation`]: where an unmodelled torque enters, from the responses to a [`probe_torque`]
//!   at each place;
//! - [`location`]: the place that follows, and what may act there;
//! - [`residual_regression`]: on which recorded signals an unmodelled torque depends that is no
//!   function of one variable;
//! - [`recorded_signals`]: those signals;
//! - [`other_axes`]: the other axes at the same handle, and their accelerations;
//! - `handle_coupling`: what these do to the axis identified;
//! - `motion`: a recorded position and its derivatives;
//! - [`step_refinement`]: whether an effect survives finer steps of the simulation;
//! - [`rectified_torque`]: the sign of a torque whose sensor shows magnitudes only;
//! - [`sensor_correction`]: correction of the torque sensor's errors and of late readings;
//! - [`refit`]: fits of the whole model, declared and extended;
//! - [`backward_elimination`]: effects that later ones, or a single other one, made redundant;
//! - [`selection_round`]: one round of the forward selection;
//! - [`search`]: the stepwise selection, round by round, to a verdict;
//! - [`search_result`]: its result;
//! - [`score_bootstrap`]: how probable a gain is by chance, with the search linearised (by
//!   `linearised_model`) and the noise resampled (`resampled_noise`);
//! - [`null_gains`]: the gains of replicates, and p-values from them;
//! - [`parametric_bootstrap`]: how often simulated records without the effect give as large a gain.

pub mod backward_elimination;
pub mod candidates;
pub mod covariance;
pub mod dataset;
pub mod excess_over_floor;
pub mod fit;
mod fit_problem;
pub mod floor_comparison;
pub mod free_parameter;
mod growing_basis;
mod handle_coupling;
pub mod identifiability;
pub mod known_columns;
mod linearised_model;
pub mod localisation;
pub mod location;
mod motion;
pub mod noise_floor;
pub mod nonparametric;
pub mod nonparametric_search;
pub mod null_gains;
pub mod other_axes;
mod other_first_effects;
pub mod parametric_bootstrap;
pub mod probe_torque;
pub mod record;
pub mod record_features;
pub mod recorded_signals;
pub mod rectified_torque;
pub mod refit;
mod resampled_noise;
pub mod residual_regression;
pub mod score_bootstrap;
pub mod screening;
pub mod search;
pub mod search_result;
pub mod selection_round;
pub mod sensor_correction;
pub mod step_refinement;
pub mod transmission_model;
pub mod validation;
