//! A known torque at a known place: how residuals answer it tells what they would look like if an
//! unknown one acted there.

use std::sync::Arc;

use plant::ParameterSet;
use plant::effects::{Effect, Link, Moment, SideLoad, Site};

/// Which way a torque goes next is drawn by this generator's highest bit (multiplier and increment
/// of Knuth's MMIX).
const MULTIPLIER: u64 = 6_364_136_223_846_793_005;
/// See there.
const INCREMENT: u64 = 1_442_695_040_888_963_407;

/// A torque on a side (N·m), or a force on what moves in the lines (N), over time: one size, both
/// signs, changing at random.
#[derive(Clone, Debug)]
pub struct Stimulus {
    /// On the master, the slave, or the line.
    site: Site,
    /// When it begins (s).
    start_s: f64,
    /// How long each value is held (s).
    hold_s: f64,
    values: Arc<[f64]>,
}

/// Signs that change at random, the same ones each time.
pub fn signs(count: usize) -> Arc<[f64]> {
    let mut state = 0u64;
    (0..count)
        .map(|_| {
            state = state.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
            if state >> 63 == 1 { 1.0 } else { -1.0 }
        })
        .collect()
}

impl Stimulus {
    /// At a site, from a time on (s), each value held as long (s).
    pub const fn new(site: Site, start_s: f64, hold_s: f64, values: Arc<[f64]>) -> Self {
        Self { site, start_s, hold_s, values }
    }

    fn value(&self, moment: &Moment) -> f64 {
        let at = ((moment.time_s - self.start_s) / self.hold_s).max(0.0) as usize;
        self.values.get(at).copied().unwrap_or(0.0)
    }
}

impl Effect for Stimulus {
    fn id(&self) -> &'static str {
        "stimulus"
    }

    fn site(&self) -> Site {
        self.site
    }

    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        load.load.force += self.value(moment);
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        if self.site == Site::Line {
            link.fluid_force_n += self.value(moment);
        }
    }
}

/// Nothing of it is free.
impl ParameterSet for Stimulus {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_held_and_end() {
        let stimulus = Stimulus::new(Site::Slave, 10.0, 0.1, Arc::from([1.0, -2.0]));
        let at = |time_s: f64| stimulus.value(&Moment { time_s, ..Moment::default() });
        assert_eq!([9.0, 10.05, 10.15, 10.25].map(at), [1.0, 1.0, -2.0, 0.0]);
    }

    #[test]
    fn signs_change_at_random_and_are_the_same_each_time() {
        let signs = signs(4000);
        let sum: f64 = signs.iter().sum();
        let turns = signs.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(sum.abs() < 200.0 && (1800..2200).contains(&turns), "{sum}, {turns}");
        assert_eq!(signs[..100], super::signs(100)[..]);
    }
}
