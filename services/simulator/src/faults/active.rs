//! The faults in force, and what they do between plant and sample. Allocates nothing.

use std::collections::VecDeque;

use ipc_types::{ABSENT_COUNT, ANALOG, AXES};

use super::fault::At;
use super::kinds::Action;

/// Most faults in force at a time.
pub const MOST_FAULTS: usize = 16;

/// A fault for the card to begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Number by which it is ended, and told of.
    pub number: u64,
    /// What the card does.
    pub action: Action,
    /// Index of its axis.
    pub axis: usize,
    /// Where it is.
    pub at: At,
    /// Its size, in its unit (of `adc_rail`: V).
    pub size: f64,
    /// Card ticks until it ends by itself.
    pub ticks: Option<u64>,
}

impl Injection {
    /// Whether two faults are the same but for their size and time: the newer takes the place of
    /// the other.
    fn replaces(&self, other: &Self) -> bool {
        (self.action, self.axis, self.at) == (other.action, other.axis, other.at)
    }
}

/// A fault has begun, or is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultNotice {
    /// Its number.
    pub number: u64,
    /// Tick of the first scan with it, or without it.
    pub tick: u64,
    /// Whether it is over.
    pub over: bool,
}

#[derive(Clone, Copy, Debug)]
struct Active {
    injection: Injection,
    /// Ticks of the first scan with it, and of the first without.
    begun: Option<u64>,
    until: Option<u64>,
    /// Of a stuck relay: whether it has closed.
    closed: bool,
}

/// The faults in force.
#[derive(Debug)]
pub(crate) struct ActiveFaults {
    slots: [Option<Active>; MOST_FAULTS],
    notices: VecDeque<FaultNotice>,
}

impl ActiveFaults {
    pub(crate) fn new() -> Self {
        // All of them end, and as many begin, in one period.
        Self { slots: [None; MOST_FAULTS], notices: VecDeque::with_capacity(2 * MOST_FAULTS) }
    }

    /// Begins a fault with the next scan; `false` where too many are in force.
    pub(crate) fn begin(&mut self, injection: Injection) -> bool {
        let free = self.slots.iter().position(Option::is_none);
        let Some(free) = free else { return false };
        for active in self.slots.iter_mut().flatten() {
            if injection.replaces(&active.injection) {
                active.until = Some(0);
            }
        }
        self.slots[free] = Some(Active { injection, begun: None, until: None, closed: false });
        true
    }

    /// Ends the fault of that number with the next scan.
    pub(crate) fn end(&mut self, number: u64) {
        for active in self.slots.iter_mut().flatten() {
            if active.injection.number == number {
                active.until = Some(0);
            }
        }
    }

    /// Begins and ends what is due with the scan of this tick; `ended` is called with the number of
    /// each fault that is over.
    pub(crate) fn advance(&mut self, tick: u64, mut ended: impl FnMut(u64)) {
        for slot in &mut self.slots {
            let Some(active) = slot else { continue };
            let number = active.injection.number;
            if active.begun.is_none() {
                active.begun = Some(tick);
                // One that was replaced or ended before its first scan lasts one period.
                let until = active.injection.ticks.map(|ticks| tick.saturating_add(ticks));
                active.until = active.until.or(until);
                self.notices.push_back(FaultNotice { number, tick, over: false });
            } else if active.until.is_some_and(|until| until <= tick) {
                *slot = None;
                ended(number);
                self.notices.push_back(FaultNotice { number, tick, over: true });
            }
        }
    }

    /// What has begun or ended since the last call, oldest first.
    pub(crate) fn notice(&mut self) -> Option<FaultNotice> {
        self.notices.pop_front()
    }

    fn of(&self, action: Action) -> impl Iterator<Item = &Injection> {
        self.slots
            .iter()
            .flatten()
            .map(|active| &active.injection)
            .filter(move |it| it.action == action)
    }

    fn on(&self, action: Action, axis: usize) -> Option<&Injection> {
        self.of(action).find(|injection| injection.axis == axis)
    }

    /// Whether a fault of this kind is in force.
    pub(crate) fn any(&self, action: Action) -> bool {
        self.of(action).next().is_some()
    }

    /// Whether the DAC of an axis is stuck.
    pub(crate) fn dac_stuck(&self, axis: usize) -> bool {
        self.on(Action::DacStuck, axis).is_some()
    }

    /// Whether the motors have power, where the enable line is alive or not.
    pub(crate) fn relay(&mut self, alive: bool) -> bool {
        let relays = self.slots.iter_mut().flatten();
        relays.filter(|active| active.injection.action == Action::RelayStuck).fold(
            alive,
            |closed, active| {
                active.closed |= alive;
                closed || active.closed
            },
        )
    }

    /// Volts that act on the motor of an axis, where `volts` are at its amplifier (V).
    pub(crate) fn drive(&self, axis: usize, volts: f64, powered: bool) -> f64 {
        if !powered || self.on(Action::AmplifierDead, axis).is_some() {
            return 0.0;
        }
        let volts = self.on(Action::AmplifierRail, axis).map_or(volts, |rail| rail.size);
        if self.on(Action::MotorReversed, axis).is_some() { -volts } else { volts }
    }

    /// What an encoder (0: master, 1: slave) reads where it would count to `raw`.
    pub(crate) fn encoder(
        &self,
        counter: &mut EncoderCounter,
        (axis, encoder): (usize, usize),
        raw: i64,
    ) -> i64 {
        let has = |action: Action| {
            self.of(action).any(|it| it.axis == axis && it.at.encoder() == encoder)
        };
        let absent = has(Action::EncoderDropout);
        let direction = match (absent || has(Action::EncoderStuck), has(Action::EncoderReversed)) {
            (true, _) => 0,
            (false, true) => -1,
            (false, false) => 1,
        };
        let count = counter.count(raw, direction);
        if absent { ABSENT_COUNT } else { count }
    }

    /// Changes what the analog inputs read; `before` is what they read one scan earlier (V).
    pub(crate) fn analog(&self, volts: &mut [f64; ANALOG], before: &[f64; ANALOG]) {
        for active in self.slots.iter().flatten() {
            let At::Channel(channel) = active.injection.at else { continue };
            let Some(value) = volts.get_mut(channel) else { continue };
            match active.injection.action {
                Action::AdcStuck => *value = before[channel],
                Action::AdcRail => *value = active.injection.size,
                Action::AdcInvalid => *value = f64::NAN,
                _ => {}
            }
        }
    }
}

/// The counter of an encoder: it follows the changes of the true count, so that a fault that comes
/// or goes makes no jump.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EncoderCounter {
    raw: Option<i64>,
    count: i64,
}

/// Counters of masters and slaves.
pub(crate) type Counters = [[EncoderCounter; 2]; AXES];

impl EncoderCounter {
    /// Counts to `raw`, in a direction (1, -1, or 0: held).
    fn count(&mut self, raw: i64, direction: i64) -> i64 {
        match self.raw.replace(raw) {
            None => self.count = self.count.wrapping_add(raw),
            Some(before) => {
                let step = direction.wrapping_mul(raw.wrapping_sub(before));
                self.count = self.count.wrapping_add(step);
            }
        }
        self.count
    }

    /// Lets it jump.
    pub(crate) const fn jump(&mut self, counts: i64) {
        self.count = self.count.wrapping_add(counts);
    }
}
