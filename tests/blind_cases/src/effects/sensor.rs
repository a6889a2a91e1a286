//! Listed effects in the instruments.

use std::collections::VecDeque;

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Instruments};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "encoder_eccentricity",
        site: Site::Sensor,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("amplitude", draw.uniform(0.008, 0.03), "rad"),
                ("order", draw.choose(&[1.0, 2.0]), "1"),
                ("phase", draw.phase(), "rad"),
                ("on_master", draw.choose(&[0.0, 1.0]), "1"),
            ])
        },
        build: |values, _| {
            Box::new(Eccentricity {
                amplitude: values.get("amplitude"),
                order: values.get("order"),
                phase: values.get("phase"),
                side: if values.get("on_master") > 0.5 { 0 } else { 1 },
            })
        },
    },
    Entry {
        id: "sensor_offset",
        site: Site::Sensor,
        depends_on: &[Variable::Load, Variable::Time],
        draw: |draw, _| Values::of([("offset", draw.sign() * draw.uniform(0.1, 0.4), "N m")]),
        build: |values, _| Box::new(Offset(values.get("offset"))),
    },
    Entry {
        id: "sensor_gain",
        site: Site::Sensor,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("error", draw.sign() * draw.uniform(0.25, 0.45), "1")]),
        build: |values, _| Box::new(Gain(values.get("error"))),
    },
    Entry {
        id: "sensor_drift",
        site: Site::Sensor,
        depends_on: &[Variable::Time],
        draw: |draw, _| Values::of([("rate", draw.sign() * draw.log_uniform(1e-3, 5e-3), "N m/s")]),
        build: |values, _| Box::new(Drift(values.get("rate"))),
    },
    Entry {
        id: "sensor_crosstalk",
        site: Site::Sensor,
        depends_on: &[Variable::Volts],
        draw: |draw, _| Values::of([("coupling", draw.sign() * draw.uniform(0.04, 0.15), "N m/V")]),
        build: |values, _| Box::new(Crosstalk(values.get("coupling"))),
    },
    Entry {
        id: "mains_hum",
        site: Site::Sensor,
        depends_on: &[Variable::Time],
        draw: |draw, _| {
            Values::of([
                ("amplitude", draw.uniform(0.03, 0.15), "N m"),
                ("frequency_hz", draw.choose(&[50.0, 60.0]) + draw.uniform(-0.05, 0.05), "Hz"),
                ("phase", draw.phase(), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(Hum {
                amplitude: values.get("amplitude"),
                rate: std::f64::consts::TAU * values.get("frequency_hz"),
                phase: values.get("phase"),
            })
        },
    },
    Entry {
        id: "rectified_sensor",
        site: Site::Sensor,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("part", draw.uniform(0.25, 1.0), "1")]),
        build: |values, _| Box::new(Rectified(values.get("part"))),
    },
    Entry {
        id: "transport_delay",
        site: Site::Sensor,
        depends_on: &[Variable::Time],
        draw: |draw, _| Values::of([("delay_s", draw.uniform(4e-3, 12e-3), "s")]),
        build: |values, _| {
            Box::new(Delay {
                delay_s: values.get("delay_s"),
                angles: VecDeque::new(),
                torques: VecDeque::new(),
            })
        },
    },
];

/// `q → q + a sin(n q + φ)`.
#[derive(Debug)]
struct Eccentricity {
    amplitude: f64,
    order: f64,
    phase: f64,
    side: usize,
}

impl Deviation for Eccentricity {
    fn sense_angles(&mut self, seen: &mut Instruments) {
        let angle = seen.position[self.side];
        seen.position[self.side] += self.amplitude * (self.order * angle + self.phase).sin();
    }
}

#[derive(Debug)]
struct Offset(f64);

impl Deviation for Offset {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm += self.0;
    }
}

#[derive(Debug)]
struct Gain(f64);

impl Deviation for Gain {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm *= 1.0 + self.0;
    }
}

/// Since the start of the run.
#[derive(Debug)]
struct Drift(f64);

impl Deviation for Drift {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm += self.0 * seen.time_s;
    }
}

#[derive(Debug)]
struct Crosstalk(f64);

impl Deviation for Crosstalk {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm += self.0 * seen.motor_v;
    }
}

#[derive(Debug)]
struct Hum {
    amplitude: f64,
    rate: f64,
    phase: f64,
}

impl Deviation for Hum {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm += self.amplitude * (self.rate * seen.time_s + self.phase).sin();
    }
}

/// `τ → (1 - r) τ + r |τ|`.
#[derive(Debug)]
struct Rectified(f64);

impl Deviation for Rectified {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm = (1.0 - self.0) * seen.torque_nm + self.0 * seen.torque_nm.abs();
    }
}

/// All channels lag by `T`, interpolated linearly between samples; before the record, the first
/// sample.
#[derive(Debug)]
struct Delay {
    delay_s: f64,
    angles: VecDeque<(f64, [f64; 2])>,
    torques: VecDeque<(f64, [f64; 1])>,
}

impl Deviation for Delay {
    fn sense_angles(&mut self, seen: &mut Instruments) {
        seen.position = past(&mut self.angles, self.delay_s, seen.time_s, seen.position);
    }

    fn sense_torque(&mut self, seen: &mut Instruments) {
        [seen.torque_nm] = past(&mut self.torques, self.delay_s, seen.time_s, [seen.torque_nm]);
    }
}

fn past<const N: usize>(
    known: &mut VecDeque<(f64, [f64; N])>,
    delay_s: f64,
    time_s: f64,
    now: [f64; N],
) -> [f64; N] {
    known.push_back((time_s, now));
    let wanted = time_s - delay_s;
    // Keeps the last sample before the wanted time as the oldest.
    while known.len() > 2 && known[1].0 <= wanted {
        known.pop_front();
    }
    match (known.front(), known.get(1)) {
        (Some(&(from, a)), Some(&(to, b))) if to > from && wanted > from => {
            let part = ((wanted - from) / (to - from)).min(1.0);
            std::array::from_fn(|index| a[index] + part * (b[index] - a[index]))
        }
        (Some(&(_, oldest)), _) => oldest,
        (None, _) => now,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_interpolates_between_samples() {
        let mut known = VecDeque::new();
        for index in 0..1000 {
            let time = f64::from(index) * 0.5e-3;
            let [late] = past(&mut known, 7.3e-3, time, [2.0 * time]);
            assert!((late - (2.0 * (time - 7.3e-3)).max(0.0)).abs() < 1e-12, "{time}: {late}");
        }
    }
}
