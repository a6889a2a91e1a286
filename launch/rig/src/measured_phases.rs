//! Phases that suit a computer: the time between card, acquisition and control follows how late
//! its loops wake.

use toml_edit::{DocumentMut, Item, Table, Value};

use crate::error::{Problem, RigError};
use crate::rates::{PHASE_GAP_NS, Phases, Rates};
use crate::rig_file::RigFile;

/// From the wake of the simulated card to its scan in shared memory (ns).
const CARD_NS: u64 = 30_000;
/// From the wake of acquisition to its sample in shared memory (ns).
const ACQUISITION_NS: u64 = 40_000;
const MICROSECOND_NS: u64 = 1000;

impl Phases {
    /// Phases for loops that wake up to `late_ns` late: acquisition begins when a card that woke so
    /// late has given its scan, control when an acquisition that woke so late has given its sample.
    /// The less, the younger the sample of a command; the more, the rarer a command of the sample
    /// before. Both leads together take at most three fifths of the shortest period, and leave the
    /// watchdog and the experiment their places behind.
    ///
    /// Phases are whole µs, as a rig file has them, and valid for all valid rates.
    pub fn for_lateness(rates: &Rates, late_ns: u64) -> Self {
        let shortest = rates.shortest_period_ns();
        // More cannot be waited for within it.
        let wanted = [CARD_NS, ACQUISITION_NS].map(|own| own + late_ns.min(shortest));
        let both = wanted[0] + wanted[1];
        let most = (shortest / 5 * 3).min(shortest.saturating_sub(3 * PHASE_GAP_NS));
        let [first, second] = if both <= most {
            wanted
        } else {
            let first = (most * wanted[0] / both).max(PHASE_GAP_NS);
            [first, most.saturating_sub(first)]
        };
        let whole = |ns: u64| ns / MICROSECOND_NS * MICROSECOND_NS;
        let acquisition_ns = whole(first);
        let control_ns = acquisition_ns + whole(second);
        let gap = whole(shortest.saturating_sub(control_ns) / 3);
        Self {
            simulator_ns: 0,
            acquisition_ns,
            control_ns,
            watchdog_ns: control_ns + gap,
            experiment_ns: control_ns + 2 * gap,
        }
    }
}

impl RigFile {
    /// The same rig with other phases, in its text as well; comments and all else stay.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the phases do not fit its rates.
    pub fn with_phases(&self, phases: &Phases) -> Result<Self, RigError> {
        let parsed = self.text().parse::<DocumentMut>();
        let mut document = parsed.map_err(|error| {
            let found = error.message().to_owned();
            Problem::new(self.file_name(), 1, "", "valid TOML", found, "correct the file")
        })?;
        let section = document.entry("phases_us").or_insert_with(|| Item::Table(Table::new()));
        let Some(section) = section.as_table_like_mut() else {
            let (expected, found) = ("a section", "a single value");
            return Err(Problem::new(
                self.file_name(),
                1,
                "phases_us",
                expected,
                found,
                "write it as [phases_us]",
            )
            .into());
        };
        for (key, ns) in phases.named() {
            let value = Value::from((ns / MICROSECOND_NS) as i64);
            match section.get_mut(key) {
                Some(Item::Value(old)) => {
                    let decor = old.decor().clone();
                    *old = value;
                    *old.decor_mut() = decor;
                }
                _ => {
                    section.insert(key, Item::Value(value));
                }
            }
        }
        Self::parse(&document.to_string(), self.file_name())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use std::path::Path;

    use ipc_types::Profile;

    use super::*;
    use crate::checked_toml::Source;
    use crate::grid_ages::missed_timeout;

    fn shipped() -> RigFile {
        crate::load_rig(Path::new("hydrostatic")).unwrap()
    }

    /// Every combination of rates that a rig file may have, with the experiment at control's.
    fn all_rates() -> Vec<Rates> {
        let of = |range: std::ops::RangeInclusive<u32>| {
            range.filter(|rate| 1_000_000_000 % rate == 0).collect::<Vec<u32>>()
        };
        let mut all = Vec::new();
        for acquisition_hz in of(100..=10_000) {
            for control_hz in of(50..=2_000) {
                for watchdog_hz in of(100..=5_000) {
                    let experiment_hz = control_hz;
                    let rates = Rates { acquisition_hz, control_hz, watchdog_hz, experiment_hz };
                    let source = Source::new("", "rates.toml");
                    rates.check(&source);
                    all.extend(source.is_clean().then_some(rates));
                }
            }
        }
        all
    }

    #[test]
    fn leads_follow_the_lateness_up_to_three_fifths_of_the_period() {
        let rates = shipped().rates;
        let leads = |late_us: u64| {
            let phases = Phases::for_lateness(&rates, late_us * MICROSECOND_NS);
            let us = |ns: u64| ns / MICROSECOND_NS;
            (us(phases.acquisition_ns), us(phases.control_ns - phases.acquisition_ns))
        };
        assert_eq!(leads(0), (30, 40));
        assert_eq!(leads(20), (50, 60));
        assert_eq!(leads(100), (130, 140));
        let (first, second) = leads(100_000);
        assert_eq!(first + second, 299);
        assert!(second >= first);
    }

    #[test]
    fn the_text_has_the_phases_and_keeps_the_rest() {
        let rig = shipped();
        let phases = Phases::for_lateness(&rig.rates, 55_400);
        let other = rig.with_phases(&phases).unwrap();
        assert_eq!(other.phases, phases);
        assert_ne!(other.identity(), rig.identity());
        assert_eq!((other.rates, &other.name), (rig.rates, &rig.name));
        assert!(other.text().contains("\nacquisition = 85\ncontrol = 180\n"), "{}", other.text());
        let changed = |a: &str, b: &str| a.lines().zip(b.lines()).filter(|(a, b)| a != b).count();
        assert_eq!(rig.text().lines().count(), other.text().lines().count());
        assert_eq!(changed(rig.text(), other.text()), 4);
    }

    #[test]
    fn a_file_without_the_section_gets_one() {
        let rig = shipped();
        let mut document: DocumentMut = rig.text().parse().unwrap();
        document.remove("phases_us");
        let bare = RigFile::parse(&document.to_string(), "bare.toml").unwrap();
        let phases = Phases::for_lateness(&bare.rates, 10_000);
        assert_eq!(bare.with_phases(&phases).unwrap().phases, phases);
    }

    #[test]
    fn phases_that_do_not_fit_are_refused() {
        let rig = shipped();
        let phases = Phases { control_ns: 85_000, ..rig.phases };
        let error = rig.with_phases(&phases).unwrap_err().to_string();
        assert!(error.contains("phases_us.control"), "{error}");
    }

    /// With the timeouts of the profiles, too: what they keep on a computer that is never late they
    /// keep on every other one.
    #[test]
    fn all_rates_have_valid_phases_for_every_lateness() {
        let all = all_rates();
        assert!(all.len() > 900, "{}", all.len());
        for rates in &all {
            let kept = |phases: &Phases| {
                [Profile::Realtime, Profile::BestEffort]
                    .map(|profile| missed_timeout(rates, phases, profile).is_none())
            };
            let never_late = kept(&Phases::for_lateness(rates, 0));
            for late_ns in [1, 4_999, 20_000, 60_000, 150_000, 1_000_000, u64::MAX] {
                let phases = Phases::for_lateness(rates, late_ns);
                let source = Source::new("", "phases.toml");
                phases.check(rates, &source);
                assert!(source.is_clean(), "{rates:?} {phases:?}: {:?}", source.finish());
                assert_eq!(kept(&phases), never_late, "{rates:?} {late_ns} {phases:?}");
            }
        }
    }
}
