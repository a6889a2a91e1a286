//! Figures that are not drawn here, with the reason: a place kept free, and no curve in it.

/// A figure that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reserved {
    /// Its number in the thesis.
    pub number: &'static str,
    /// What it is about.
    pub title: &'static str,
    /// What it waits for.
    pub reason: &'static str,
}

const LAWS: &str = "Comes with the control laws: the master is moved by a controller here, not along a given path.";

/// Figures of chapter 4.
pub const RESERVED: &[Reserved] = &[
    Reserved { number: "4.1", title: "Movement under position control", reason: LAWS },
    Reserved { number: "4.3", title: "Feed-forward and friction compensation", reason: LAWS },
    Reserved { number: "4.7", title: "Movement before and after learning", reason: LAWS },
];
