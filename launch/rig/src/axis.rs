//! Axes: encoders, torque channel, limits and control gains.

use ipc_types::Sample;

use crate::axis_control::AxisControl;
use crate::axis_unit::AxisUnit;
use crate::checked_toml::{Keys, Section};
use crate::effect::ModelEffect;
use crate::encoder::Encoder;
use crate::homing::{Homing, StopSearch};
use crate::limits::Limits;
use crate::parameter::Parameter;
use crate::plausibility::Plausibility;
use crate::range_of_motion::RangeOfMotion;
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
    /// Range of motion of the subject; `None` where the file gives none, and the limits are all.
    pub range_of_motion: Option<RangeOfMotion>,
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
    (
        "range_of_motion",
        "Range in which the handle may move while a person holds it, for a subject or a study, \
         where it is smaller than the limits.",
    ),
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
        let range_of_motion = RangeOfMotion::read(section.section("range_of_motion"), unit);
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
            range_of_motion,
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

    /// Ends of the handle's movement while a person holds it (rad or m): those of the range of
    /// motion where the file gives one, else the position limits.
    pub const fn movement_range(&self) -> (f64, f64) {
        match &self.range_of_motion {
            Some(range) => (range.min, range.max),
            None => (self.limits.position_min, self.limits.position_max),
        }
    }

    /// How far the handle of this axis, the rig's with this index, is beyond its range of motion in
    /// a sample (rad or m); 0 within it. The position of an axis without an encoder at the handle
    /// is the motor's. `None` where the file gives no range, while the axis is unhomed, and where
    /// the position is not finite.
    pub fn range_excess(&self, index: usize, sample: &Sample) -> Option<f64> {
        let range = self.range_of_motion?;
        let positions = match self.slave {
            Some(_) => &sample.slave_position,
            None => &sample.master_position,
        };
        let position = positions.get(index).filter(|position| position.is_finite())?;
        (sample.homed & 1 << index != 0).then(|| range.excess(*position))
    }

    /// Whether the handle is beyond its range of motion by more than the tolerance; as
    /// [`Axis::range_excess`], and false where that says nothing.
    pub fn leaves_range(&self, index: usize, sample: &Sample) -> bool {
        let tolerance = self.range_of_motion.map_or(f64::INFINITY, |range| range.tolerance);
        self.range_excess(index, sample).is_some_and(|excess| excess > tolerance)
    }
}
