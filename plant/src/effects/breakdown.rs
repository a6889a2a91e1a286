//! What a breakdown is at, and what it leaves behind.

/// State of a breakdown ([`super::breakdowns`]). It outlasts a change of the machine, by its
/// number, and its end: a belt that slipped does not spring back, and a line that was filled anew
/// transmits from where master and slave then were.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Breakdown {
    /// Number that its user gave it.
    pub number: u64,
    /// Whether it is over: what it did ends, what it left behind stays.
    pub over: bool,
    /// Time of the machine when it began (s).
    pub begun_s: Option<f64>,
    /// Deflection of each link, by line and end, at which it now carries no force (m).
    pub offset_m: [[f64; 2]; 2],
    /// Links that were filled anew after a rupture, by line and end.
    pub refilled: [[bool; 2]; 2],
}
