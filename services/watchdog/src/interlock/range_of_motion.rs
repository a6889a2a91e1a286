//! Whether the handles stay within the range of motion of their subject.
//!
//! A search for the stops leaves the range on purpose, with nobody at the handle
//! ([`rig::protocol`] lets such a protocol do nothing else). It ends at a stop: the way back into
//! the range belongs to it. The search of one axis exempts all, since commands have one mode.

use ipc_types::{Mode, MotorCommand, Sample};

use super::config::Config;

/// Longest way back from a search into the range (ns).
const WAY_BACK_NS: u64 = 60_000_000_000;
/// Control that is passive for longer has ended the protocol of the search; for the change of the
/// zeros it is passive for 1.1 s at most (ns).
const PASSIVE_NS: u64 = 2_000_000_000;

/// The supervision of all axes.
#[derive(Clone, Debug)]
pub(super) struct RangeMonitor {
    /// Axes whose handle has not come back into its range since a search, one bit each.
    searched: u8,
    /// Scan time of the last sample of a search (ns).
    searched_ns: u64,
    /// Scan time of the last sample of a search or of the way back from it (ns).
    led_ns: u64,
}

/// Axes that have a range of motion, one bit each.
pub(super) fn given(config: &Config) -> u8 {
    let axes = config.axes.iter().enumerate();
    axes.filter(|(_, axis)| axis.range_of_motion.is_some()).fold(0, |bits, (at, _)| bits | 1 << at)
}

impl RangeMonitor {
    pub(super) const fn new() -> Self {
        Self { searched: 0, searched_ns: 0, led_ns: 0 }
    }

    /// Axes whose range is in force: those that have one, are homed, and are neither on a search
    /// for the stops nor on the way back from it, one bit each.
    pub(super) fn in_force(&self, homed: u8, config: &Config) -> u8 {
        given(config) & homed & !self.searched
    }

    /// Takes the newest sample and command; whether a handle has left its range while volts reach
    /// a motor. `powered`: the gate is open with our permission. At 0 V there is nothing to take
    /// away, and a rig whose handle lies beyond its range has to arm to be homed again.
    pub(super) fn observe(
        &mut self,
        sample: &Sample,
        command: Option<&MotorCommand>,
        powered: bool,
        config: &Config,
    ) -> bool {
        if !powered {
            self.searched = 0;
            return false;
        }
        let mode = command
            .filter(|command| command.epoch == sample.epoch)
            .and_then(|command| Mode::from_code(command.mode));
        self.follow_search(sample, mode, config);
        let in_force = self.in_force(sample.homed, config);
        let driven = sample.output_v.iter().any(|&volts| volts != 0.0);
        driven
            && config
                .axes
                .iter()
                .enumerate()
                .any(|(at, axis)| in_force & 1 << at != 0 && axis.leaves_range(at, sample))
    }

    /// Follows a search and the way back from it.
    fn follow_search(&mut self, sample: &Sample, mode: Option<Mode>, config: &Config) {
        let now_ns = sample.scan_time_ns;
        match mode {
            Some(Mode::Initialise) => {
                self.searched = given(config);
                (self.searched_ns, self.led_ns) = (now_ns, now_ns);
                return;
            }
            Some(Mode::Hold | Mode::Position | Mode::Centre) => self.led_ns = now_ns,
            Some(Mode::Passive) | None => {}
            // Those are for a hand at the handle.
            Some(Mode::Impedance | Mode::Rhythm | Mode::Learning) => self.searched = 0,
        }
        let over = now_ns.saturating_sub(self.searched_ns) > WAY_BACK_NS
            || now_ns.saturating_sub(self.led_ns) > PASSIVE_NS;
        if over {
            self.searched = 0;
        }
        for (at, axis) in config.axes.iter().enumerate() {
            if axis.range_excess(at, sample).is_some_and(|excess| excess <= 0.0) {
                self.searched &= !(1 << at);
            }
        }
    }
}
