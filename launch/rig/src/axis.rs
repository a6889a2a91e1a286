//! Axes: encoders, torque channel, limits and control gains.

use crate::axis_control::AxisControl;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Keys, Section};
use crate::effect::ModelEffect;
use crate::encoder::Encoder;
use crate::homing::{Homing, StopSearch};
use crate::limits::Limits;
use crate::parameter::Parameter;
use crate::plausibility::Plausibility;
use crate::rates::Rates;
use crate::torque_channel::TorqueChannel;

/// One degree of freedom: a motor with the master encoder, and the handle that it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name on screens.
    pub name: String,
    /// Unit of its positions.
    pub unit: AxisUnit,
    /// Encoder at the motor.
    pub master: Encoder,
    /// Encoder at the handle; `None` where there is none.
    pub slave: Option<Encoder>,
    /// Sensor of the hand's torque; `None` where there is none.
    pub torque: Option<TorqueChannel>,
    /// Limits that the watchdog enforces.
    pub limits: Limits,
    /// Limits on how the machine may answer its control, which the watchdog enforces as well.
    pub plausibility: Plausibility,
    /// How it finds the zero of its positions; `None` where the file does not say, and the axis
    /// never gets power ([`crate::RigFile::check_homing`]).
    pub homing: Option<Homing>,
    /// Gains of the control law.
    pub control: AxisControl,
    /// Parameters of this axis's transmission that differ from [`crate::Model::parameters`].
    pub model: Vec<Parameter>,
    /// Effects that measured records showed beyond the equations of this axis's transmission,
    /// beside those of every axis ([`crate::Model::effects`]).
    pub effects: Vec<ModelEffect>,
}

const KEYS: Keys = &[
    ("name", "Name on screens."),
    ("unit", "Unit of its positions: rotary (rad; the file has degrees) or linear (m)."),
    ("master", "Encoder at the motor; required."),
    ("slave", "Encoder at the handle, if there is one."),
    ("torque", "Sensor of the hand's torque, if there is one."),
    ("limits", "Limits that the watchdog enforces; required."),
    ("plausibility", "Limits on how the machine may answer its control, also of the watchdog."),
    ("homing", "How it finds the zero of its positions; required to run the rig."),
    ("control", "Gains of the control law."),
    ("model", "Parameters of this axis that differ from [model.parameters]."),
    ("effects", "Effects of this axis alone, beside [[model.effects]] of every axis."),
];

impl Axis {
    pub(crate) fn read(section: Section<'_>, rates: &Rates) -> Self {
        section.document("[[axes]]", KEYS);
        let name = section.text("name");
        let words = &[("rad", AxisUnit::Radian), ("m", AxisUnit::Metre)];
        let unit = section.word("unit", words).unwrap_or(AxisUnit::Radian);
        if !section.has("master") {
            let advice = "control needs the master's position";
            section.problem("master", "the encoder at the motor", "nothing", advice);
        }
        let master = Encoder::read(section.section("master"), unit, true);
        let slave = section.section("slave");
        let slave = slave.exists().then(|| Encoder::read(slave, unit, false));
        let torque = section.section("torque");
        let torque = torque.exists().then(|| TorqueChannel::read(torque, unit));
        if !section.has("limits") {
            let advice = "no axis runs without limits";
            section.problem("limits", "the limits that the watchdog enforces", "nothing", advice);
        }
        let limits = Limits::read(section.section("limits"), unit, torque.is_some());
        let plausibility = Plausibility::read(section.section("plausibility"), unit, &limits);
        let homing = Homing::read(section.section("homing"), unit);
        let control = AxisControl::read(
            section.section("control"),
            unit,
            (&master, slave.as_ref()),
            torque.as_ref(),
            &limits,
            rates,
        );
        let model = Parameter::read_all(&section.section("model"));
        let effects = ModelEffect::read_all(&section, "[[axes.effects]]");
        Self {
            name,
            unit,
            master,
            slave,
            torque,
            limits,
            plausibility,
            homing,
            control,
            model,
            effects,
        }
    }

    /// The search for its stops; `None` where its encoders are absolute, or the file does not say.
    pub const fn stop_search(&self) -> Option<&StopSearch> {
        match &self.homing {
            Some(Homing::Stops(search)) => Some(search),
            Some(Homing::Absolute) | None => None,
        }
    }
}
