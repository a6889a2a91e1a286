//! The experiment runner.
pub mod player;
pub mod state;
pub mod trajectory;
