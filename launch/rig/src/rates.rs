//! Rates of the periodic processes and their phases within each period.

use ipc_types::Process;

use crate::checked_toml::{Keys, Section, Source};

const SECOND_NS: u64 = 1_000_000_000;

/// Least distance of two loops' phases; the shortest loop takes that long (ns).
pub(crate) const PHASE_GAP_NS: u64 = 20_000;

/// Rates of the periodic processes. Each rate divides 1e9, and of any two the slower divides the
/// faster, so that `tick = CLOCK_MONOTONIC ns / period` is a whole grid that needs no common
/// origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// Scans of the card, and the gate (Hz).
    pub acquisition_hz: u32,
    /// The control law (Hz).
    pub control_hz: u32,
    /// The interlocks and the enable line (Hz).
    pub watchdog_hz: u32,
    /// Setpoints (Hz).
    pub experiment_hz: u32,
}

const RATE_KEYS: Keys = &[
    ("acquisition_hz", "Scans of the card, and the gate."),
    ("control_hz", "The control law."),
    ("watchdog_hz", "The interlocks and the enable line."),
    ("experiment_hz", "Setpoints."),
];

impl Rates {
    /// Period of acquisition and of the simulated card (ns).
    pub const fn acquisition_period_ns(&self) -> u64 {
        SECOND_NS / self.acquisition_hz as u64
    }

    /// Period of control (ns).
    pub const fn control_period_ns(&self) -> u64 {
        SECOND_NS / self.control_hz as u64
    }

    /// Period of the watchdog (ns).
    pub const fn watchdog_period_ns(&self) -> u64 {
        SECOND_NS / self.watchdog_hz as u64
    }

    /// Period of the experiment runner (ns).
    pub const fn experiment_period_ns(&self) -> u64 {
        SECOND_NS / self.experiment_hz as u64
    }

    /// The shortest of these periods, in which all phases lie (ns).
    pub(crate) fn shortest_period_ns(&self) -> u64 {
        let fastest = self.named().iter().map(|(_, rate)| *rate).max().unwrap_or(1);
        SECOND_NS / u64::from(fastest.max(1))
    }

    pub(crate) fn read(section: Section<'_>) -> Self {
        section.document("[rates]", RATE_KEYS);
        let rate = |key, process: Process, least, most, advice| {
            let default = process.real_time().map_or(0, |own| own.rate_hz);
            section.whole_or(key, default.into(), least, most, advice) as u32
        };
        let at_2000 = "§ 2.2 acquires at 2000 Hz";
        let printed = "§ 2.2 controls at 500 Hz and wants 1000 Hz";
        let in_time = "at 1000 Hz the enable line toggles in time";
        let enough = "the rate of control is enough";
        Self {
            acquisition_hz: rate("acquisition_hz", Process::Acquisition, 100, 10_000, at_2000),
            control_hz: rate("control_hz", Process::Control, 50, 2_000, printed),
            watchdog_hz: rate("watchdog_hz", Process::Watchdog, 100, 5_000, in_time),
            experiment_hz: rate("experiment_hz", Process::Experiment, 50, 2_000, enough),
        }
    }

    /// The rate of a key with its section (Hz).
    pub(crate) fn of_key(&self, key: &str) -> u32 {
        self.named().into_iter().find(|(name, _)| *name == key).map_or(0, |(_, rate)| rate)
    }

    fn named(&self) -> [(&'static str, u32); 4] {
        [
            ("rates.acquisition_hz", self.acquisition_hz),
            ("rates.control_hz", self.control_hz),
            ("rates.watchdog_hz", self.watchdog_hz),
            ("rates.experiment_hz", self.experiment_hz),
        ]
    }

    /// Whether of any two rates the slower divides the faster; reports the first pair only, as the
    /// others mostly follow from it.
    fn check_division(&self, source: &Source<'_>) {
        let named = self.named();
        for (index, (key_a, a)) in named.iter().enumerate() {
            for (key_b, b) in &named[index + 1..] {
                if b > a && !b.is_multiple_of(*a) {
                    let expected = format!("a multiple of {key_a} ({a} Hz)");
                    let (least, most) = (b / a * a, (b / a + 1) * a);
                    source.problem(key_b, expected, b, format!("take {least} or {most}"));
                    return;
                } else if b <= a && !a.is_multiple_of(*b) {
                    let expected = format!("a rate that divides {key_a} ({a} Hz)");
                    source.problem(key_b, expected, b, format!("take {}", divisors_near(*a, *b)));
                    return;
                }
            }
        }
    }

    pub(crate) fn check(&self, source: &Source<'_>) {
        for (key, rate) in self.named() {
            if !SECOND_NS.is_multiple_of(u64::from(rate)) {
                let advice =
                    "a period must be a whole number of ns: take 250, 500, 1000, 2000 or the like";
                source.problem(key, "a rate that divides 1e9", rate, advice);
            }
        }
        if !source.is_clean() {
            return;
        }
        self.check_division(source);
        if self.control_hz > self.acquisition_hz {
            let expected = format!("at most rates.acquisition_hz ({} Hz)", self.acquisition_hz);
            let advice = "a command answers a sample";
            source.problem("rates.control_hz", expected, self.control_hz, advice);
        }
        if self.watchdog_hz < self.control_hz {
            let expected = format!("at least rates.control_hz ({} Hz)", self.control_hz);
            let advice = "the watchdog must see every command before it is old";
            source.problem("rates.watchdog_hz", expected, self.watchdog_hz, advice);
        }
    }
}

/// The nearest rates to `wrong` on either side that divide `rate` and 1e9 (Hz).
fn divisors_near(rate: u32, wrong: u32) -> String {
    let fits = |hz: &u32| rate.is_multiple_of(*hz) && SECOND_NS.is_multiple_of(u64::from(*hz));
    let below = (1..wrong).rev().find(fits);
    let above = (wrong + 1..=rate).find(fits);
    let near: Vec<_> = [below, above].into_iter().flatten().map(|hz| hz.to_string()).collect();
    near.join(" or ")
}

/// Phase of each process within its own period (ns).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Phases {
    /// The simulated card (ns).
    pub simulator_ns: u64,
    /// Acquisition (ns).
    pub acquisition_ns: u64,
    /// Control (ns).
    pub control_ns: u64,
    /// Watchdog (ns).
    pub watchdog_ns: u64,
    /// Experiment runner (ns).
    pub experiment_ns: u64,
}

const PHASE_KEYS: Keys = &[
    ("simulator", "Start of the simulated card within its period, in µs."),
    ("acquisition", "Start of acquisition, in µs."),
    ("control", "Start of control, in µs."),
    ("watchdog", "Start of the watchdog, in µs."),
    ("experiment", "Start of the experiment process, in µs."),
];

impl Phases {
    pub(crate) fn read(section: Section<'_>) -> Self {
        section.document("[phases_us]", PHASE_KEYS);
        let phase = |process: Process| {
            let default = process.real_time().map_or(0, |own| own.phase_us.into());
            let advice = "whole µs, within the loop's own period";
            section.whole_or(process.text(), default, 0, 20_000, advice) * 1000
        };
        Self {
            simulator_ns: phase(Process::Simulator),
            acquisition_ns: phase(Process::Acquisition),
            control_ns: phase(Process::Control),
            watchdog_ns: phase(Process::Watchdog),
            experiment_ns: phase(Process::Experiment),
        }
    }

    /// Each phase with its key (ns).
    pub(crate) fn named(&self) -> [(&'static str, u64); 5] {
        [
            ("simulator", self.simulator_ns),
            ("acquisition", self.acquisition_ns),
            ("control", self.control_ns),
            ("watchdog", self.watchdog_ns),
            ("experiment", self.experiment_ns),
        ]
    }

    /// Each phase lies within its loop's period; simulator, acquisition and control follow in the
    /// order of the data flow; and no two loops begin within 20 µs of each other, with phases taken
    /// modulo the shortest period, as the loops coincide there in some period.
    pub(crate) fn check(&self, rates: &Rates, source: &Source<'_>) {
        let loops = [
            ("phases_us.simulator", self.simulator_ns, rates.acquisition_period_ns()),
            ("phases_us.acquisition", self.acquisition_ns, rates.acquisition_period_ns()),
            ("phases_us.control", self.control_ns, rates.control_period_ns()),
            ("phases_us.watchdog", self.watchdog_ns, rates.watchdog_period_ns()),
            ("phases_us.experiment", self.experiment_ns, rates.experiment_period_ns()),
        ];
        for (key, phase, period) in loops {
            if phase >= period {
                let expected = format!("less than the loop's period ({} µs)", period / 1000);
                let advice = "shift the loop forward";
                source.problem(key, expected, format!("{} µs", phase / 1000), advice);
            }
        }
        for pair in loops[..3].windows(2) {
            let ((before, earlier, _), (after, later, _)) = (pair[0], pair[1]);
            if later <= earlier {
                let expected = format!("later than {before} ({} µs)", earlier / 1000);
                let advice = "data flow from the card through acquisition to control";
                source.problem(after, expected, format!("{} µs", later / 1000), advice);
            }
        }
        let shortest = rates.shortest_period_ns();
        for (index, (key_a, a, _)) in loops.iter().enumerate() {
            for (key_b, b, _) in &loops[index + 1..] {
                let apart = (a % shortest).abs_diff(b % shortest);
                if apart.min(shortest - apart) < PHASE_GAP_NS {
                    let expected = format!(
                        "at least {} µs from {key_a} ({} µs)",
                        PHASE_GAP_NS / 1000,
                        a / 1000
                    );
                    let found = format!("overlapping phases: {} µs", b / 1000);
                    let advice = format!(
                        "phases repeat every {} µs, the shortest period; move one",
                        shortest / 1000
                    );
                    source.problem(key_b, expected, found, advice);
                }
            }
        }
    }
}
