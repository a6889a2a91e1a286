//! What the monitor publishes: the model beside the machine. Messages are of one axis each.

use crate::message::messages;

/// Cumulative sum ([`ModelState::cusum`]) above which the machine has departed from the model.
pub const MODEL_DEPARTURE_SUM: f64 = 2.5;
/// Score of the listed changes ([`ModelState::score`]) above which it has departed, too.
pub const MODEL_DEPARTURE_SCORE: f64 = 5.0;

messages! {
    /// Measured less modelled positions of the model beside the machine: 250 Hz an axis while
    /// samples come.
    Innovation v1 {
        /// tick of the first sample in it
        tick: u64,
        /// tick of the first sample since which the monitor has taken each
        began_tick: u64,
        /// of the master, at the motor (rad)
        master: f64,
        /// of the slave; 0 where it has no encoder (rad)
        slave: f64,
        /// index of the axis
        axis: u8,
        /// 1 where the slave has an encoder
        slave_present: u8,
        /// none
        reserved: [u8; 6],
    }

    /// Whether the machine is as the model beside it: after each half second in which the axis
    /// moved, and once a second.
    ModelState v2 {
        /// tick of the newest sample
        tick: u64,
        /// that of the departure's first half second; 0 where there is none
        departed_tick: u64,
        /// half seconds of movement so far
        blocks: u64,
        /// amplitude of the master's innovation over that of the baseline, in the newest half
        /// second of movement; 0 while the baseline is learnt
        master_ratio: f64,
        /// the same of the slave
        slave_ratio: f64,
        /// the larger cumulative sum of the two; above 2.5 the machine has departed
        cusum: f64,
        /// how much the newest four seconds of movement look like one of the listed changes; above
        /// 5 the machine has departed; 0 where nothing is scored
        score: f64,
        /// share of the baseline that is learnt, 0 to 1
        learnt: f64,
        /// largest deviation of a declared parameter, in tolerances
        deviation: f64,
        /// size of the effect that explains most of the departure, in its default size
        size: f64,
        /// share of the departure that it explains, 0 to 1
        explains: f64,
        /// share that the best effect at another side explains
        elsewhere: f64,
        /// gaps in the samples, after each of which the model began anew
        restarts: u64,
        /// index of the axis
        axis: u8,
        /// MonitorState
        state: u8 = MonitorState,
        /// ModelSite: where the machine departed
        site: u8 = ModelSite,
        /// none
        reserved: [u8; 5],
    }
}
