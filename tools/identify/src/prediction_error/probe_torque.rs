//! A known torque at a known place, to which the residuals' response is measured.

use std::sync::Arc;

use plant::effects::{Effect, Identity, Link, Moment, Side, SideLoad, Site};
use plant::{ParameterSet, transmission_kinds};

/// Multiplier of the linear congruential generator (Knuth's MMIX) whose highest bit is the sign.
const MULTIPLIER: u64 = 6_364_136_223_846_793_005;
/// Its increment.
const INCREMENT: u64 = 1_442_695_040_888_963_407;

/// Where it acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// A torque on master or slave (N·m).
    Torque(Site),
    /// A force on the moving mass in the lines (N).
    MovingMass,
    /// A force of the springs of the lines (N), which drives the slave forward and the master
    /// backward.
    Spring,
}

impl Action {
    /// The size of what it adds, in its own unit, that has about the effect of a torque (N·m).
    pub fn size_of(self, torque_nm: f64, declared: &transmission_kinds::Parameters) -> f64 {
        match self {
            Self::Torque(_) => torque_nm,
            Self::MovingMass | Self::Spring => torque_nm / declared.master_displacement_m_per_rad(),
        }
    }
}

/// A known torque, held from sample to sample.
#[derive(Clone, Debug)]
pub struct ProbeTorque {
    action: Action,
    /// Start (s).
    start_s: f64,
    /// Hold time of each value (s).
    hold_s: f64,
    values: Arc<[f64]>,
}

/// Returns a reproducible pseudo-random binary sequence.
pub fn random_signs(count: usize) -> Arc<[f64]> {
    let mut state = 0u64;
    (0..count)
        .map(|_| {
            state = state.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
            if state >> 63 == 1 { 1.0 } else { -1.0 }
        })
        .collect()
}

impl ProbeTorque {
    /// From `start_s` on, each value held for `hold_s`.
    pub const fn new(action: Action, start_s: f64, hold_s: f64, values: Arc<[f64]>) -> Self {
        Self { action, start_s, hold_s, values }
    }

    fn value(&self, moment: &Moment) -> f64 {
        let at = ((moment.time_s - self.start_s) / self.hold_s).max(0.0) as usize;
        self.values.get(at).copied().unwrap_or(0.0)
    }
}

impl Identity for ProbeTorque {
    fn id(&self) -> &'static str {
        "probe_torque"
    }

    fn site(&self) -> Site {
        match self.action {
            Action::Torque(site) => site,
            Action::MovingMass | Action::Spring => Site::Line,
        }
    }
}

impl Effect for ProbeTorque {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        load.load.force += self.value(moment);
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        let value = self.value(moment);
        match self.action {
            Action::Torque(_) => {}
            Action::MovingMass => link.fluid_force_n += value,
            Action::Spring => {
                let force = if link.end == Side::Slave { value } else { -value };
                link.force_n += force;
                link.fluid_force_n += force;
            }
        }
    }
}

/// It has no parameters.
impl ParameterSet for ProbeTorque {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_held_and_end() {
        let probe_torque =
            ProbeTorque::new(Action::Torque(Site::Slave), 10.0, 0.1, Arc::from([1.0, -2.0]));
        let at = |time_s: f64| probe_torque.value(&Moment { time_s, ..Moment::default() });
        assert_eq!([9.0, 10.05, 10.15, 10.25].map(at), [1.0, 1.0, -2.0, 0.0]);
    }

    #[test]
    fn signs_change_at_random_and_are_the_same_each_time() {
        let random_signs = random_signs(4000);
        let sum: f64 = random_signs.iter().sum();
        let turns = random_signs.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(sum.abs() < 200.0 && (1800..2200).contains(&turns), "{sum}, {turns}");
        assert_eq!(random_signs[..100], super::random_signs(100)[..]);
    }
}
