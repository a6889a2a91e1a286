//! The interlock's configuration.

use ipc_types::{AXES, Profile, Timeouts};
use rig::{Axis, ComediCard, Rates, RigFile, WithoutLogger};

use super::torque_input::TorqueInput;

/// What the interlock needs to know about its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Session of the rig.
    pub session: u64,
    /// Incarnation of this watchdog.
    pub incarnation: u64,
    /// Profile that this watchdog was granted.
    pub profile: Profile,
    /// Life of a token; also the longest time between two steps of the watchdog itself (ns).
    pub token_life_ns: u64,
    /// Silence after which acquisition or control is lost (ns).
    pub peer_lost_ns: u64,
    /// The enable line toggles only while the newest sample is younger than this, so that the motor
    /// loses power before a dead acquisition counts as lost (ns).
    pub enable_line_pause_ns: u64,
    /// Silence of the enable line that trips; shorter than the card's timeout, so that the card
    /// never drops and restores motor power without a trip (ns).
    pub enable_line_gap_ns: u64,
    /// Time that the gate has to open after `enable` (ns).
    pub gate_open_ns: u64,
    /// Oldest token that a sample or a command may echo, and oldest sample that a command may
    /// answer (ns).
    pub echo_lost_ns: u64,
    /// How long a momentary fault (a backward step, an encoder jump) counts as active (ns).
    pub hold_ns: u64,
    /// Window over which speed is estimated (ns); `speed_window_ns`.
    pub speed_window_ns: u64,
    /// How far ahead of our clock a message's time may be (ns).
    pub future_ns: u64,
    /// Axes of the rig; beyond any of their limits, those of homing while unhomed, the motor loses
    /// power.
    pub axes: Vec<Axis>,
    /// Inputs of the torque cells, by axis.
    pub torque_inputs: [Option<TorqueInput>; AXES],
    /// Rates of samples and commands.
    pub rates: Rates,
    /// Whether the rig file says who cuts the motor's power where the card does not.
    pub power_cut_otherwise: bool,
    /// Whether the rig file wires a comedi card to drive the motor and to see its power.
    pub comedi_reports_power: bool,
    /// What happens without a logger.
    pub without_logger: WithoutLogger,
}

impl Config {
    /// That of a rig, with the timeouts of a profile: token 5 ms, peer 8 ms (realtime), or 40 and
    /// 60 ms (best-effort).
    pub fn for_profile(profile: Profile, session: u64, incarnation: u64, rig: &RigFile) -> Self {
        let timeouts = Timeouts::of(profile);
        let Timeouts { token_ns: token_life_ns, peer_lost_ns, enable_line_pause_ns, .. } = timeouts;
        Self {
            session,
            incarnation,
            profile,
            token_life_ns,
            peer_lost_ns,
            enable_line_pause_ns,
            enable_line_gap_ns: timeouts.enable_line_gap_ns(),
            gate_open_ns: timeouts.gate_open_ns(),
            echo_lost_ns: timeouts.echo_lost_ns(),
            hold_ns: 2 * peer_lost_ns,
            speed_window_ns: speed_window_ns(&rig.rates),
            future_ns: 1_000_000,
            axes: rig.axes.iter().take(AXES).cloned().collect(),
            torque_inputs: TorqueInput::of_rig(rig),
            rates: rig.rates,
            power_cut_otherwise: !rig.safety.power_cut_by.is_empty(),
            comedi_reports_power: rig.comedi.as_ref().is_some_and(ComediCard::reports_power),
            without_logger: rig.safety.without_logger,
        }
    }
}

/// Window over which speed is estimated (ns): 8 ms, or two periods and a half of acquisition where
/// that is longer, so that two samples within it are always half a window apart or more.
fn speed_window_ns(rates: &Rates) -> u64 {
    (rates.acquisition_period_ns() * 5 / 2).max(8_000_000)
}

/// Limits of an axis at a time: those of the rig file, or those of homing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LimitsNow {
    /// Lowest and highest position (rad or m).
    pub(super) position: (f64, f64),
    /// Highest speed (rad/s or m/s).
    pub(super) speed: f64,
    /// Largest magnitude of the volts (V).
    pub(super) volts: f64,
}

impl LimitsNow {
    /// The limits of an axis, homed or not. Positions of an unhomed axis count from power-up.
    pub(super) fn of(axis: &Axis, homed: bool) -> Self {
        let limits = &axis.limits;
        let own = Self {
            position: (limits.position_min, limits.position_max),
            speed: limits.speed_max,
            volts: limits.volts_max,
        };
        match axis.stop_search() {
            Some(search) if !homed => Self {
                position: search.range(),
                speed: search.speed_max.min(own.speed),
                volts: search.volts_max.min(own.volts),
            },
            _ => own,
        }
    }
}

/// Longest time for which the rig may have power while these axes are unhomed (ns).
pub(super) fn homing_time_ns(axes: &[Axis], homed: u8) -> Option<u64> {
    axes.iter()
        .enumerate()
        .filter(|(at, _)| homed & 1 << at == 0)
        .filter_map(|(_, axis)| axis.stop_search())
        .map(|search| (search.time_max_s * 1e9) as u64)
        .min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_is_estimated_over_8_ms_or_two_periods_and_a_half() {
        let mut rates = rig::load_rig("hydrostatic".as_ref()).unwrap().rates;
        for (acquisition_hz, window_ns) in [(2_000, 8_000_000), (100, 25_000_000)] {
            rates.acquisition_hz = acquisition_hz;
            assert_eq!(speed_window_ns(&rates), window_ns, "{acquisition_hz} Hz");
        }
    }

    #[test]
    fn power_is_cut_otherwise_where_the_rig_file_says_by_whom() {
        let mut rig = rig::load_rig("hydrostatic".as_ref()).unwrap();
        for (by, otherwise) in [("", false), ("relay K1 in the amplifier", true)] {
            by.clone_into(&mut rig.safety.power_cut_by);
            let config = Config::for_profile(Profile::Realtime, 1, 2, &rig);
            assert_eq!(config.power_cut_otherwise, otherwise);
        }
    }

    #[test]
    fn a_comedi_card_reports_the_power_of_a_motor_that_it_drives_and_whose_relay_it_sees() {
        let text = include_str!("../../../../launch/rig/tests/comedi.toml");
        let reports = |change: fn(&mut ComediCard)| {
            let mut rig = RigFile::parse(text, "rig.toml").unwrap();
            change(rig.comedi.as_mut().unwrap());
            Config::for_profile(Profile::Realtime, 1, 2, &rig).comedi_reports_power
        };
        assert!(reports(|_| {}));
        assert!(!reports(|card| card.motor_power = None));
        assert!(!reports(|card| card.axes[0].output = None));
    }
}
