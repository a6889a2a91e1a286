//! The listed effects that make sense for machines with one channel, with the equations of the list
//! and code of their own.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use super::Kind::{self, Drive, Element, Oscillator};
use super::effect::{Acts, Entry, Law, Setting};
use super::machine::Demands;
use super::simulator::bristle;
use crate::effects::{Site, Values, Variable};

const ANY: Demands =
    Demands { coulomb: false, no_coulomb: false, rotary: false, single: false, fast: false };
const DRY: Demands = Demands { coulomb: true, ..ANY };
const SMOOTH: Demands = Demands { no_coulomb: true, ..ANY };
const LONG: Demands = Demands { single: true, ..ANY };

const SLIDING: &[(Kind, Site)] =
    &[(Drive, Site::Master), (Oscillator, Site::Slave), (Element, Site::Slave)];
/// Where Coulomb friction can be declared, which these effects change.
const DRY_SLIDING: &[(Kind, Site)] = &[(Oscillator, Site::Slave), (Element, Site::Slave)];
const DRIVING: &[(Kind, Site)] = &[(Drive, Site::Drive), (Oscillator, Site::Drive)];
const SPRING: &[(Kind, Site)] = &[(Oscillator, Site::Line), (Element, Site::Line)];

/// No limits but those of a positive size.
fn positive(_: &Setting<'_>) -> (f64, f64) {
    (0.0, f64::INFINITY)
}

/// What most entries have.
const fn entry(id: &'static str, sites: &'static [(Kind, Site)], demands: Demands) -> Entry {
    Entry {
        id,
        sites,
        demands,
        listed: true,
        depends_on: &[Variable::Velocity],
        draw: |_, _| None,
        limits: positive,
        inverse: false,
        build: |_| Law::Mass(0.0),
    }
}

/// All of them.
pub const ENTRIES: &[Entry] = &[
    Entry {
        draw: |_, s| Some(Values::of([("coulomb", 0.2 * s.force_rms, "")])),
        build: |values| {
            let level = values.get("coulomb");
            Law::acts(move |_| Acts::dry(level))
        },
        ..entry("coulomb_friction", SLIDING, SMOOTH)
    },
    Entry {
        draw: |draw, s| {
            let mass = (s.machine.mass + s.machine.stiffness * 1e-9) * draw.uniform(0.5, 1.0);
            let scale = 2.0 * s.force_rms / (s.speed_rms * TAU * s.machine.top_hz);
            let own = if s.machine.kind == Element { 0.3 * scale } else { mass };
            Some(Values::of([("mass_beyond_declared", own, "")]))
        },
        build: |values| Law::Mass(values.get("mass_beyond_declared")),
        ..entry("extra_inertia", SLIDING, ANY)
    },
    Entry {
        draw: |_, s| {
            let per_square = 0.3 * s.force_rms / (s.speed_rms * s.speed_peak);
            Some(Values::of([("coefficient", per_square, "")]))
        },
        build: |values| {
            let coefficient = values.get("coefficient");
            Law::acts(move |now| Acts::force(coefficient * now.velocity.abs() * now.velocity))
        },
        ..entry("quadratic_drag", SLIDING, ANY)
    },
    Entry {
        draw: |draw, s| {
            let size = 0.5 * s.machine.viscous;
            Some(Values::of([("viscous_difference", size, ""), ("side", draw.sign(), "1")]))
        },
        // Friction stays friction.
        limits: |s| (0.0, 0.8 * s.machine.viscous),
        build: |values| {
            let slope = values.get("viscous_difference") * values.get("side");
            Law::acts(move |now| Acts::force(slope * now.velocity.abs()))
        },
        ..entry("asymmetric_friction", SLIDING, ANY)
    },
    Entry {
        draw: |draw, s| {
            let speed = draw.log_uniform(0.03, 0.2) * s.speed_peak;
            Some(Values::of([("stribeck", 0.4 * s.machine.coulomb, ""), ("speed", speed, "")]))
        },
        limits: |s| (0.0, 1.2 * s.machine.coulomb),
        build: |values| {
            let (level, speed) = (values.get("stribeck"), values.get("speed"));
            Law::acts(move |now| Acts::dry(level * (-(now.velocity / speed).powi(2)).exp()))
        },
        ..entry("stribeck_friction", DRY_SLIDING, DRY)
    },
    Entry {
        draw: |_, s| Some(Values::of([("viscous_beyond_declared", 0.6 * s.machine.viscous, "")])),
        build: |values| {
            let slope = values.get("viscous_beyond_declared");
            Law::acts(move |now| Acts::force(slope * now.velocity))
        },
        ..entry("viscous_friction", &[(Drive, Site::Master)], ANY)
    },
    Entry {
        draw: |draw, s| {
            let travel = draw.log_uniform(0.005, 0.05) * s.travel;
            Some(Values::of([("bristle_force", 0.25 * s.force_rms, ""), ("travel", travel, "")]))
        },
        build: |values| {
            let (level, travel) = (values.get("bristle_force"), values.get("travel"));
            let mut state = 0.0;
            Law::acts(move |now| {
                state = bristle(state, now.velocity * now.step_s, travel);
                Acts::force(level * state)
            })
        },
        ..entry("presliding_hysteresis", SLIDING, SMOOTH)
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            let waves = draw.uniform(0.7, 6.0);
            Some(Values::of([
                ("amplitude", 0.5 * s.machine.coulomb, ""),
                ("order", waves * TAU / s.travel, ""),
                ("phase", draw.phase(), "rad"),
            ]))
        },
        limits: |s| (0.0, 0.9 * s.machine.coulomb),
        build: |values| {
            let [size, order, phase] = ["amplitude", "order", "phase"].map(|name| values.get(name));
            Law::acts(move |now| Acts::dry(size * (order * now.position + phase).sin()))
        },
        ..entry("position_dependent_friction", DRY_SLIDING, DRY)
    },
    Entry {
        depends_on: &[Variable::Load],
        draw: |draw, _| Some(Values::of([("coefficient", draw.uniform(0.15, 0.35), "1")])),
        limits: |_| (0.0, 0.6),
        build: |values| {
            let coefficient = values.get("coefficient");
            Law::acts(move |now| Acts::dry(coefficient * now.load.abs()))
        },
        ..entry("load_dependent_friction", SLIDING, ANY)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let warm = draw.uniform(0.06, 0.25) * s.seconds;
            let slope = draw.uniform(0.3, 1.0) * s.machine.viscous / s.machine.coulomb;
            Some(Values::of([
                ("coulomb_excess", s.machine.coulomb, ""),
                ("viscous_per_coulomb", slope, ""),
                ("time_constant", warm, "s"),
            ]))
        },
        limits: |s| (0.0, 2.0 * s.machine.coulomb),
        build: |values| {
            let [size, slope, warm] =
                ["coulomb_excess", "viscous_per_coulomb", "time_constant"].map(|n| values.get(n));
            Law::acts(move |now| {
                let cold = size * (-now.time_s / warm).exp();
                let dry = Acts::dry(cold);
                Acts { force: cold * slope * now.velocity, ..dry }
            })
        },
        ..entry("thermal_drift", DRY_SLIDING, Demands { single: true, ..DRY })
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            Some(Values::of([("amplitude", 0.5 * s.force_rms, ""), ("phase", draw.phase(), "rad")]))
        },
        build: |values| {
            let (size, phase) = (values.get("amplitude"), values.get("phase"));
            Law::acts(move |now| Acts::force(size * ((now.position + phase).sin() - phase.sin())))
        },
        ..entry("gravity_imbalance", &[(Drive, Site::Master)], Demands { rotary: true, ..ANY })
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            let slow = TAU * 0.35 * s.machine.cut_hz() / s.speed_rms;
            let (low, high) = (4.0 * TAU / s.travel, slow.min(25.0 * TAU / s.travel));
            let low = if s.machine.rotary { low.max(4.0) } else { low };
            (low < high).then(|| {
                let order = draw.log_uniform(low, high);
                let order = if s.machine.rotary { order.floor().max(4.0) } else { order };
                Values::of([
                    ("amplitude", 0.25 * s.force_rms, ""),
                    ("order", order, ""),
                    ("phase", draw.phase(), "rad"),
                ])
            })
        },
        build: |values| {
            let [size, order, phase] = ["amplitude", "order", "phase"].map(|name| values.get(name));
            Law::acts(move |now| Acts::force(size * (order * now.position + phase).sin()))
        },
        ..entry("torque_ripple", &[(Drive, Site::Drive)], ANY)
    },
    Entry {
        depends_on: &[Variable::Load],
        draw: |_, s| Some(Values::of([("half_width", 0.25 * s.force_rms, "")])),
        limits: |s| (0.0, 0.8 * s.force_rms),
        build: |values| {
            let half = values.get("half_width");
            Law::delivers(move |force, _| force - force.clamp(-half, half))
        },
        ..entry("amplifier_deadzone", DRIVING, ANY)
    },
    Entry {
        depends_on: &[Variable::Load],
        draw: |draw, s| Some(Values::of([("limit", draw.uniform(0.4, 0.8) * s.force_peak, "")])),
        limits: |s| (0.9 * s.force_rms, 0.95 * s.force_peak),
        inverse: true,
        build: |values| {
            let limit = values.get("limit");
            Law::delivers(move |force, _| force.clamp(-limit, limit))
        },
        ..entry("amplifier_saturation", DRIVING, ANY)
    },
    Entry {
        depends_on: &[Variable::Load],
        draw: |draw, s| {
            let row = 1.0 / s.machine.row_hz;
            let time = (draw.uniform(2.0, 4.0) * row).max(0.1 / rate_of(s));
            Some(Values::of([("time_constant", time, "s")]))
        },
        limits: |s| (2.2 / s.machine.row_hz, 0.35 / rate_of(s)),
        build: |values| {
            let time = values.get("time_constant");
            let mut state: Option<f64> = None;
            Law::delivers(move |force, now| {
                let last = state.unwrap_or(force);
                let next = last + (1.0 - (-now.step_s / time).exp()) * (force - last);
                state = Some(next);
                next
            })
        },
        ..entry("amplifier_lag", DRIVING, ANY)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let row = 1.0 / s.machine.row_hz;
            Some(Values::of([("delay", draw.uniform(2.5, 4.0) * row, "s")]))
        },
        limits: |s| (2.2 / s.machine.row_hz, (0.3 / rate_of(s)).min(0.9 / s.machine.cut_hz())),
        build: |values| Law::delivers(late(values.get("delay"))),
        ..entry("transport_delay", DRIVING, ANY)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let row = 1.0 / s.machine.row_hz;
            Some(Values::of([("delay", draw.uniform(2.5, 4.0) * row, "s")]))
        },
        limits: |s| (2.2 / s.machine.row_hz, 0.9 / s.machine.cut_hz()),
        build: |values| Law::measures(late(values.get("delay"))),
        ..entry("transport_delay", &[(Element, Site::Sensor)], ANY)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let high = 0.7 * s.machine.cut_hz();
            let low = (1.3 * s.machine.top_hz).min(0.5 * high);
            Some(Values::of([
                ("amplitude", 0.3 * s.force_rms, ""),
                ("frequency", draw.log_uniform(low, high), "Hz"),
                ("phase", draw.phase(), "rad"),
            ]))
        },
        build: |values| {
            let [size, frequency, phase] =
                ["amplitude", "frequency", "phase"].map(|name| values.get(name));
            Law::acts(move |now| Acts::force(size * (TAU * frequency * now.time_s + phase).sin()))
        },
        ..entry("periodic_disturbance", SLIDING, LONG)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let rate = draw.sign() * 0.6 * s.force_rms / s.seconds;
            Some(Values::of([("rate", rate, "")]))
        },
        limits: |_| (f64::NEG_INFINITY, f64::INFINITY),
        build: |values| {
            let rate = values.get("rate");
            Law::measures(move |force, now| force + rate * now.time_s)
        },
        ..entry(
            "sensor_drift",
            &[(Drive, Site::Sensor), (Oscillator, Site::Sensor), (Element, Site::Sensor)],
            LONG,
        )
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let mains = draw.choose(&[50.0, 60.0]) + draw.uniform(-0.03, 0.03);
            (s.machine.row_hz >= 500.0).then(|| {
                Values::of([
                    ("amplitude", 0.3 * s.force_rms, ""),
                    ("frequency", mains, "Hz"),
                    ("phase", draw.phase(), "rad"),
                ])
            })
        },
        build: |values| {
            let [size, frequency, phase] =
                ["amplitude", "frequency", "phase"].map(|name| values.get(name));
            Law::measures(move |force, now| {
                force + size * (TAU * frequency * now.time_s + phase).sin()
            })
        },
        ..entry(
            "mains_hum",
            &[(Element, Site::Sensor)],
            Demands { single: true, fast: true, ..ANY },
        )
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            let half = 0.5 * s.travel;
            let even = if draw.below(3) == 0 { draw.uniform(-0.8, 0.8) * half } else { 0.0 };
            Some(Values::of([
                ("cubic", 0.7 * s.machine.stiffness / (half * half), ""),
                ("quadratic_per_cubic", even, ""),
            ]))
        },
        build: |values| {
            let (cubic, even) = (values.get("cubic"), values.get("quadratic_per_cubic"));
            Law::acts(move |now| Acts::force(cubic * now.position.powi(2) * (now.position + even)))
        },
        ..entry("nonlinear_stiffness", SPRING, ANY)
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            let lost = draw.uniform(0.8, 0.98) * s.machine.stiffness;
            Some(Values::of([
                ("gap", 0.25 * s.travel, ""),
                ("centre", draw.uniform(-0.1, 0.1) * s.travel, ""),
                ("stiffness_lost", lost, ""),
            ]))
        },
        limits: |s| (0.02 * s.travel, 0.5 * s.travel),
        build: |values| {
            let [gap, centre, lost] =
                ["gap", "centre", "stiffness_lost"].map(|name| values.get(name));
            Law::acts(move |now| {
                Acts::force(-lost * (now.position - centre).clamp(-0.5 * gap, 0.5 * gap))
            })
        },
        ..entry("backlash", SPRING, ANY)
    },
    Entry {
        depends_on: &[Variable::Time],
        draw: |draw, s| {
            let relaxation = draw.log_uniform(0.7, 5.0) / (TAU * 0.5 * s.machine.top_hz);
            Some(Values::of([
                ("branch_stiffness", 0.6 * s.machine.stiffness, ""),
                ("relaxation", relaxation, "s"),
            ]))
        },
        limits: |s| (0.0, 4.0 * s.machine.stiffness),
        build: |values| {
            let (stiffness, relaxation) =
                (values.get("branch_stiffness"), values.get("relaxation"));
            let mut stretch = 0.0;
            Law::acts(move |now| {
                let kept = (-now.step_s / relaxation).exp();
                stretch = kept * stretch + (1.0 - kept) * relaxation * now.velocity;
                Acts::force(stiffness * stretch)
            })
        },
        ..entry("viscoelastic_line", SPRING, ANY)
    },
    Entry {
        depends_on: &[Variable::Position],
        draw: |draw, s| {
            let factor = if draw.below(2) == 0 { 0.8 } else { -0.45 };
            Some(Values::of([("stiffness_beyond_declared", factor * s.machine.stiffness, "")]))
        },
        limits: |s| (-0.7 * s.machine.stiffness, f64::INFINITY),
        build: |values| {
            let stiffness = values.get("stiffness_beyond_declared");
            Law::acts(move |now| Acts::force(stiffness * now.position))
        },
        ..entry("line_compliance", SPRING, ANY)
    },
    Entry {
        draw: |_, s| Some(Values::of([("damping_beyond_declared", s.machine.viscous, "")])),
        build: |values| {
            let slope = values.get("damping_beyond_declared");
            Law::acts(move |now| Acts::force(slope * now.velocity))
        },
        ..entry("line_damping", SPRING, ANY)
    },
];

/// The fastest rate of the loop that dead time must not disturb, rad/s.
fn rate_of(setting: &Setting<'_>) -> f64 {
    let machine = setting.machine;
    if machine.kind == Drive { machine.control_rad_s } else { TAU * machine.top_hz }
}

/// The signal some time ago.
fn late(delay_s: f64) -> impl FnMut(f64, &super::effect::Now) -> f64 + Send + 'static {
    let mut before: VecDeque<f64> = VecDeque::new();
    move |force, now| {
        let count = (delay_s / now.step_s).round() as usize;
        before.push_back(force);
        if before.len() > count + 1 {
            before.pop_front();
        }
        before.front().copied().unwrap_or(force)
    }
}
