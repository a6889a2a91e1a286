//! Effects that are on no list, of machines with one channel.

use std::f64::consts::TAU;

use super::Kind::{self, Drive, Element, Oscillator};
use super::effect::{Acts, Entry, Law, Now};
use super::machine::Demands;
use super::simulator::bristle;
use crate::effects::{Site, Values, Variable};
use crate::random::Draw;

const ANY: Demands =
    Demands { coulomb: false, no_coulomb: false, rotary: false, single: false, fast: false };

const AT_DRIVE: &[(Kind, Site)] = &[(Drive, Site::Master)];
const MOVING: &[(Kind, Site)] = &[(Drive, Site::Master), (Oscillator, Site::Slave)];
const EVERY: &[(Kind, Site)] =
    &[(Drive, Site::Master), (Oscillator, Site::Slave), (Element, Site::Slave)];
const SPRINGS: &[(Kind, Site)] = &[(Oscillator, Site::Line), (Element, Site::Line)];
const GAUGE: &[(Kind, Site)] = &[(Drive, Site::Sensor), (Element, Site::Sensor)];

const fn entry(
    id: &'static str,
    sites: &'static [(Kind, Site)],
    depends_on: &'static [Variable],
) -> Entry {
    Entry {
        id,
        sites,
        demands: ANY,
        listed: false,
        depends_on,
        draw: |_, _| None,
        limits: |_| (0.0, f64::INFINITY),
        inverse: false,
        build: |_| Law::Mass(0.0),
    }
}

/// All of them.
pub const ENTRIES: &[Entry] = &[
    // A spring that holds the axis.
    Entry {
        draw: |_, s| Some(Values::of([("stiffness", s.force_rms / s.travel, "")])),
        build: |values| {
            let stiffness = values.get("stiffness");
            Law::acts(move |now| Acts::force(stiffness * now.position))
        },
        ..entry("environment_spring", AT_DRIVE, &[Variable::Position])
    },
    // A wall on one side, with damping.
    Entry {
        draw: |draw, s| {
            let from = draw.uniform(0.05, 0.25) * s.travel;
            Some(Values::of([("stiffness", 3.0 * s.force_rms / s.travel, ""), ("from", from, "")]))
        },
        build: |values| {
            let (stiffness, from) = (values.get("stiffness"), values.get("from"));
            Law::acts(move |now| Acts::force(stiffness * (now.position - from).max(0.0)))
        },
        ..entry("wall", EVERY, &[Variable::Position])
    },
    // Foam: progressive, and it gives less back than it took.
    Entry {
        draw: |draw, s| {
            let from = draw.uniform(-0.1, 0.15) * s.travel;
            let loss = draw.uniform(0.2, 0.5);
            let size = 10.0 * s.force_rms / (s.travel * s.travel);
            Some(Values::of([("square", size, ""), ("from", from, ""), ("loss", loss, "1")]))
        },
        build: |values| {
            let [square, from, loss] = ["square", "from", "loss"].map(|name| values.get(name));
            let mut state = 0.0;
            Law::acts(move |now| {
                let depth = (now.position - from).max(0.0);
                let travel = (0.1 * depth).max(1e-9);
                state = bristle(state, now.velocity * now.step_s, travel);
                Acts::force(square * depth * depth * (1.0 + loss * state))
            })
        },
        ..entry("foam", AT_DRIVE, &[Variable::Position])
    },
    // A hand that holds the handle and moves.
    Entry {
        draw: |draw, s| {
            let reach = draw.uniform(0.1, 0.4) * s.travel;
            let rate = TAU * draw.uniform(0.15, 0.4);
            Some(Values::of([
                ("stiffness", s.force_rms / s.travel, ""),
                ("reach", reach, ""),
                ("rate", rate, "rad/s"),
                ("phase", draw.phase(), "rad"),
            ]))
        },
        build: |values| {
            let [stiffness, reach, rate, phase] =
                ["stiffness", "reach", "rate", "phase"].map(|name| values.get(name));
            Law::acts(move |now| {
                let angle = rate * now.time_s + phase;
                let place = reach * (angle.sin() + 0.6 * (2.3 * angle).sin());
                Acts::force(stiffness * (now.position - place + 0.05 * now.velocity))
            })
        },
        ..entry("moving_hand", AT_DRIVE, &[Variable::Position, Variable::Time])
    },
    Entry {
        draw: |_, s| {
            let usual = TAU * s.machine.top_hz * s.speed_rms;
            Some(Values::of([("per_acceleration", 0.4 * s.force_rms / usual, "")]))
        },
        build: |values| {
            let size = values.get("per_acceleration");
            let mut smoothed = 0.0;
            Law::acts(move |now: &Now| {
                smoothed += (now.step_s / 3e-3) * (now.acceleration - smoothed);
                Acts::dry(size * smoothed.abs())
            })
        },
        ..entry("acceleration_friction", EVERY, &[Variable::Acceleration, Variable::Velocity])
    },
    Entry {
        draw: |draw, s| {
            let order = draw.uniform(1.0, 4.0) * TAU / s.travel;
            Some(Values::of([
                ("part", 0.25, "1"),
                ("order", order, ""),
                ("phase", draw.phase(), ""),
            ]))
        },
        limits: |_| (0.0, 0.6),
        build: |values| {
            let [part, order, phase] = ["part", "order", "phase"].map(|name| values.get(name));
            Law::delivers(move |force, now| {
                force * (1.0 + part * (order * now.position + phase).sin())
            })
        },
        ..entry(
            "gain_over_position",
            &[(Drive, Site::Drive), (Oscillator, Site::Drive)],
            &[Variable::Position, Variable::Load],
        )
    },
    Entry {
        draw: |draw, s| {
            let width = draw.uniform(0.1, 0.5) * s.force_peak;
            Some(Values::of([("size", 0.2 * s.force_rms, ""), ("width", width, "")]))
        },
        build: |values| {
            let (size, width) = (values.get("size"), values.get("width"));
            let (mut state, mut last) = (0.0, None::<f64>);
            Law::measures(move |force, _| {
                state = bristle(state, force - last.unwrap_or(force), width);
                last = Some(force);
                force - size * state
            })
        },
        ..entry("gauge_hysteresis", GAUGE, &[Variable::Load])
    },
    // A second inertia on an elastic shaft, or a tuned mass.
    Entry {
        draw: |draw, s| {
            let rate = TAU * s.machine.top_hz * draw.uniform(0.8, 2.0);
            Some(Values::of([("mass", 0.5 * s.machine.mass, ""), ("rate", rate, "rad/s")]))
        },
        limits: |s| (0.0, 3.0 * s.machine.mass),
        build: |values| {
            let (mass, rate) = (values.get("mass"), values.get("rate"));
            let (mut place, mut speed) = (0.0, 0.0);
            Law::acts(move |now| {
                let force = mass
                    * (rate * rate * (now.position - place) + 0.1 * rate * (now.velocity - speed));
                speed += now.step_s * force / mass.max(1e-12);
                place += now.step_s * speed;
                Acts::force(force)
            })
        },
        ..entry("elastic_shaft", MOVING, &[Variable::Acceleration, Variable::Position])
    },
    // A mass that is carried along by two stops with play between them.
    Entry {
        draw: |draw, s| {
            let play = draw.uniform(0.03, 0.12) * s.travel;
            let rate = TAU * 20.0 * s.machine.top_hz.max(1.0);
            Some(Values::of([
                ("mass", 0.6 * s.machine.mass, ""),
                ("play", play, ""),
                ("rate", rate, "rad/s"),
            ]))
        },
        limits: |s| (0.0, 3.0 * s.machine.mass),
        build: |values| {
            let [mass, play, rate] = ["mass", "play", "rate"].map(|name| values.get(name));
            let (mut place, mut speed) = (0.0, 0.0);
            Law::acts(move |now| {
                let apart = now.position - place;
                let pressed = apart - apart.clamp(-0.5 * play, 0.5 * play);
                let damped = if pressed == 0.0 { 0.0 } else { now.velocity - speed };
                let force = mass * (rate * rate * pressed + 0.8 * rate * damped);
                speed += now.step_s * force / mass.max(1e-12);
                place += now.step_s * speed;
                Acts::force(force)
            })
        },
        ..entry(
            "loose_mass",
            MOVING,
            &[Variable::Acceleration, Variable::Position, Variable::Velocity],
        )
    },
    // Friction of a load that comes and goes and is not measured.
    Entry {
        draw: |draw, s| {
            Some(Values::of([
                ("size", 0.5 * s.force_rms, ""),
                ("rate", TAU * draw.uniform(0.1, 0.3), "rad/s"),
                ("phase", draw.phase(), "rad"),
            ]))
        },
        build: |values| {
            let [size, rate, phase] = ["size", "rate", "phase"].map(|name| values.get(name));
            Law::acts(move |now| {
                let angle = rate * now.time_s + phase;
                Acts::dry(size * (angle.sin() + (1.7 * angle).cos()).max(0.0))
            })
        },
        ..entry("unmeasured_load", EVERY, &[Variable::Time, Variable::Velocity])
    },
    // Counts that are lost above a speed.
    Entry {
        draw: |draw, s| {
            let above = draw.uniform(0.3, 0.6) * s.speed_peak;
            Some(Values::of([("part", 0.1, "1"), ("above", above, "")]))
        },
        limits: |_| (0.0, 0.9),
        build: |values| {
            let (part, above) = (values.get("part"), values.get("above"));
            let (mut lost, mut last) = (0.0, None::<f64>);
            Law::counts(move |place, now| {
                let moved = place - last.unwrap_or(place);
                last = Some(place);
                if now.velocity > above {
                    lost += part * moved;
                }
                place - lost
            })
        },
        ..entry(
            "lost_counts",
            &[(Drive, Site::Sensor), (Element, Site::Sensor)],
            &[Variable::Velocity, Variable::Position],
        )
    },
    // Bursts of friction at random times.
    Entry {
        draw: |draw, s| {
            let seed = draw.uniform(0.0, 1e9).floor();
            Some(Values::of([("size", s.force_rms, ""), ("seed", seed, "1")]))
        },
        build: |values| {
            let size = values.get("size");
            let mut draw = Draw::new(values.get("seed") as u64);
            let (mut from, mut until) = (draw.uniform(0.1, 1.5), 0.0);
            Law::acts(move |now| {
                if now.time_s > from && until < from {
                    until = from + draw.uniform(0.05, 0.4);
                }
                if until > from && now.time_s > until {
                    from = until + draw.uniform(0.1, 1.5);
                }
                let on = now.time_s > from && now.time_s < until;
                Acts::dry(if on { size } else { 0.0 })
            })
        },
        ..entry("friction_bursts", EVERY, &[Variable::Time, Variable::Velocity])
    },
    // A spring whose stiffness wanders.
    Entry {
        draw: |draw, s| {
            Some(Values::of([
                ("stiffness", 0.4 * s.machine.stiffness, ""),
                ("rate", TAU * draw.uniform(0.1, 0.4), "rad/s"),
                ("phase", draw.phase(), "rad"),
            ]))
        },
        limits: |s| (0.0, 0.7 * s.machine.stiffness),
        build: |values| {
            let [size, rate, phase] = ["stiffness", "rate", "phase"].map(|name| values.get(name));
            Law::acts(move |now| {
                Acts::force(size * (rate * now.time_s + phase).sin() * now.position)
            })
        },
        ..entry("wandering_spring", SPRINGS, &[Variable::Time, Variable::Position])
    },
];
