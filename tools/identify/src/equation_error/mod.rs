//! Models read inversely: the measured motion goes in, the force that it needs comes out, and what
//! the measured force has beyond that is the residual. Such models are linear in their parameters
//! but for a few shapes, so fits are exact and fast, and nothing drifts as a free simulation of a
//! machine without a spring would.

mod coarse_screen;
pub mod fit;
pub mod model;
pub mod search;
pub mod signals;
pub mod spline;
pub mod split;
