//! How an effect is looked for beside a running machine, as the effect's own file declares it.

/// How an effect is looked for by a monitor, which adds it to the declared model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Monitoring {
    /// Whether it may begin suddenly. One that begins from nothing as the clock runs is no
    /// candidate.
    pub sudden: bool,
    /// Whether its share in the innovations is about proportional to its size; otherwise several
    /// sizes are tried.
    pub proportional: bool,
    /// Whether it acts by the torque of the hand: no candidate where that is measured.
    pub of_the_hand: bool,
}

impl Monitoring {
    /// Sudden, proportional, and not of the hand.
    pub const USUAL: Self = Self { sudden: true, proportional: true, of_the_hand: false };
}
