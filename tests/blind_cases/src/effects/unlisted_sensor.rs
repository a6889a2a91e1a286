//! Unlisted effects in the instruments.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Instruments};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "cell_hysteresis",
        site: Site::Sensor,
        depends_on: &[Variable::Load],
        draw: |draw, _| {
            Values::of([
                ("torque", draw.uniform(0.25, 0.5), "N m"),
                ("span", draw.uniform(0.3, 0.8), "N m"),
            ])
        },
        build: |values, _| {
            let (torque, span) = (values.get("torque"), values.get("span"));
            Box::new(CellHysteresis { torque, span, share: 0.0, last_nm: None })
        },
    },
    Entry {
        id: "cell_inertia",
        site: Site::Sensor,
        depends_on: &[Variable::Acceleration],
        draw: |draw, _| Values::of([("inertia", draw.uniform(5e-4, 2e-3), "kg m^2")]),
        build: |values, _| {
            Box::new(CellInertia { inertia: values.get("inertia"), reading_nm: 0.0 })
        },
    },
    Entry {
        id: "cell_compression",
        site: Site::Sensor,
        depends_on: &[Variable::Load],
        draw: |draw, _| Values::of([("torque", draw.uniform(0.9, 1.5), "N m")]),
        build: |values, _| Box::new(CellCompression { torque: values.get("torque") }),
    },
    Entry {
        id: "cell_speed_error",
        site: Site::Sensor,
        depends_on: &[Variable::Velocity],
        draw: |draw, _| {
            Values::of([("coefficient", draw.sign() * draw.uniform(2e-3, 8e-3), "N m s^2/rad^2")])
        },
        build: |values, _| Box::new(CellSpeedError { coefficient: values.get("coefficient") }),
    },
];

/// A cell with hysteresis: its reading adds `h z`, `dz = dτ/w - |dτ| z/w`.
#[derive(Debug)]
struct CellHysteresis {
    torque: f64,
    span: f64,
    share: f64,
    last_nm: Option<f64>,
}

impl Deviation for CellHysteresis {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        let change = (seen.torque_nm - self.last_nm.unwrap_or(0.0)) / self.span;
        self.last_nm = Some(seen.torque_nm);
        // Exact for a change along a straight line.
        let kept = (-change.abs()).exp();
        self.share = self.share * kept + (1.0 - kept).copysign(change);
        seen.torque_nm += self.torque * self.share;
    }
}

/// A cell with the mass of the grip on its far side: it also reads `-J q̈`, low-passed.
#[derive(Debug)]
struct CellInertia {
    inertia: f64,
    reading_nm: f64,
}

impl Deviation for CellInertia {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        let inertial = -self.inertia * seen.slave_acceleration_rad_s2;
        self.reading_nm += 0.3 * (inertial - self.reading_nm);
        seen.torque_nm += self.reading_nm;
    }
}

/// A compressive reading: `τ_c tanh(τ/τ_c)`.
#[derive(Debug)]
struct CellCompression {
    torque: f64,
}

impl Deviation for CellCompression {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm = self.torque * (seen.torque_nm / self.torque).tanh();
    }
}

/// An error that depends on speed: `c q̇²`, the same way in both directions.
#[derive(Debug)]
struct CellSpeedError {
    coefficient: f64,
}

impl Deviation for CellSpeedError {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        seen.torque_nm += self.coefficient * seen.slave_velocity_rad_s.powi(2);
    }
}
