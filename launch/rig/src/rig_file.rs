//! A rig file as a whole: its sections, and what other crates ask of it.

use std::path::Path;

use emg::{Conditioning, Electrode, Group};
use ipc_types::{ANALOG, CardKind, Profile};
use plant::effects::Effect;
use plant::reflected_dynamics::ReflectedDynamics;
use plant::transmission_kinds::Parameters;

use crate::axis::Axis;
use crate::axis_unit::AxisUnit;
use crate::channel::Channel;
use crate::checked_toml::{Keys, Section};
use crate::comedi_card::ComediCard;
use crate::content_hash::identity;
use crate::effect::{ModelEffect, ModelEffectError};
use crate::error::{Problem, RigError};
use crate::grid_ages::{MissedTimeout, missed_timeout};
use crate::model::Model;
use crate::muscles;
use crate::rates::{Phases, Rates};
use crate::safety::Safety;
use crate::scanner_line::ScannerLine;
use crate::simulation::Simulation;
use crate::sync_output::SyncOutput;

/// A rig as a laboratory declares it.
#[derive(Clone, Debug, PartialEq)]
pub struct RigFile {
    /// Name of the rig.
    pub name: String,
    /// Description for people.
    pub description: String,
    /// The card with which it is brought up where no option names one; `None` where the file does
    /// not say.
    pub card: Option<CardKind>,
    /// Rates of the periodic processes.
    pub rates: Rates,
    /// Phase of each process within its period.
    pub phases: Phases,
    /// One to three axes; none in a file that declares a model alone
    /// ([`RigFile::parse_declaration`]).
    pub axes: Vec<Axis>,
    /// Choices of the laboratory that concern safety.
    pub safety: Safety,
    /// Up to sixteen analog inputs.
    pub channels: Vec<Channel>,
    /// How the voltages of electrodes become the activity of muscles.
    pub emg: Conditioning,
    /// The scanner's trigger line; `None` where the rig has none.
    pub scanner: Option<ScannerLine>,
    /// The output that gives a pulse when a session begins; `None` where the rig has none.
    pub sync: Option<SyncOutput>,
    /// The wiring of a comedi card; `None` where the rig has none.
    pub comedi: Option<ComediCard>,
    /// The declared model.
    pub model: Model,
    /// Column names of measured records.
    pub replay: Replay,
    /// Settings of the simulated card.
    pub simulation: Simulation,
    text: String,
    file_name: String,
    identity: u64,
}

const KEYS: Keys = &[
    ("name", "Name of the rig."),
    ("description", "Description for people."),
    ("card", "The card with which `up` brings the rig up where no option names one."),
    ("rates", "Rates of the processes."),
    ("phases_us", "Phases of the processes."),
    ("axes", "One to three axes."),
    ("safety", "Choices of the laboratory that concern safety."),
    ("channels", "Analog inputs, at most 16."),
    ("emg", "How the voltages of electrodes become the activity of muscles."),
    ("scanner", "The scanner's trigger line."),
    ("sync", "The digital output that gives a pulse when a session begins."),
    ("comedi", "Wiring of a card with a Linux comedi driver: see docs/comedi.md."),
    ("model", "The declared model; required."),
    ("replay", "Column names of measured records."),
    ("simulation", "Settings of the simulated card."),
];

/// What a rig file is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To run the rig, or to simulate it.
    Run,
    /// To identify its model, for which a model of one channel needs no axes.
    Identify,
}

impl RigFile {
    /// Reads every section; problems are collected in the section's source.
    pub(crate) fn read(root: Section<'_>, text: &str, file_name: &str, purpose: Purpose) -> Self {
        root.document("The file", KEYS);
        let rates = Rates::read(root.section("rates"));
        let axes: Vec<_> =
            root.sections("axes").into_iter().map(|section| Axis::read(section, &rates)).collect();
        let unit = axes.first().map_or(AxisUnit::Radian, |axis| axis.unit);
        let channels: Vec<_> = root.sections("channels").into_iter().map(Channel::read).collect();
        if channels.len() > ANALOG {
            let expected = format!("at most {ANALOG} channels");
            root.problem("channels", expected, channels.len(), "take some out");
        }
        let phases = Phases::read(root.section("phases_us"));
        let model = Model::read(root.section("model"));
        let one_channel = !model.kind.is_transmission();
        let alone = axes.is_empty() && one_channel && purpose == Purpose::Identify;
        if axes.is_empty() && !alone || axes.len() > ipc_types::AXES {
            let expected = format!("1 to {} axes", ipc_types::AXES);
            let advice = match axes.is_empty() && one_channel {
                true => "a file without axes is for `farreach identify`; write each as [[axes]]",
                false => "write each as [[axes]]",
            };
            root.problem("axes", expected, axes.len(), advice);
        }
        let name = match alone {
            true => root.text_or_none("name").unwrap_or_else(|| stem(file_name)),
            false => root.text("name"),
        };
        let emg = muscles::read(root.section("emg"));
        let scanner = ScannerLine::read(root.section("scanner"), &channels);
        let sync = SyncOutput::read(root.section("sync"));
        let cards = [CardKind::Simulated, CardKind::Null, CardKind::Comedi];
        let card = root.word_or_none("card", &cards.map(|kind| (kind.text(), kind)));
        let comedi = ComediCard::read(root.section("comedi"));
        Self {
            name,
            description: root.text_or_none("description").unwrap_or_default(),
            card,
            rates,
            phases,
            axes,
            safety: Safety::read(root.section("safety")),
            channels,
            emg,
            scanner,
            sync,
            comedi,
            model,
            replay: Replay::read(root.section("replay"), unit),
            simulation: Simulation::read(root.section("simulation"), unit),
            text: text.to_owned(),
            file_name: file_name.to_owned(),
            identity: identity(text),
        }
    }

    /// The electrodes whose muscles belong to a group.
    pub fn electrodes(&self) -> Vec<Electrode> {
        muscles::electrodes(&self.channels)
    }

    /// Unit of the activity of a group of muscles; `None` where no electrode belongs to it.
    pub fn muscle_unit(&self, group: Group) -> Option<&str> {
        muscles::unit(&self.channels, group)
    }

    /// Constants of one axis's transmission: [`Model::parameters`], overridden by `axes.model`.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission.
    pub fn axis_parameters(&self, axis: &Axis) -> Result<Parameters, RigError> {
        self.model.of_axis(&axis.model, &self.file_name)
    }

    /// The channel at an input of the card; `None` where the file has none.
    pub fn channel_at(&self, input: usize) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.index == input)
    }

    /// Declared model of one axis: that of the file, overridden by `axes.model`.
    pub fn axis_model(&self, axis: &Axis) -> Model {
        self.model.with(&axis.model)
    }

    /// Unit of the first axis's positions; without axes that of the declared parameters.
    pub fn unit(&self) -> AxisUnit {
        let of_parameters = || self.model.unit();
        self.axes.first().map_or_else(of_parameters, |axis| axis.unit)
    }

    /// The declared effects of every axis, for a plant.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where an effect cannot be made, which a checked file rules out.
    pub fn model_effects(&self) -> Result<Vec<Box<dyn Effect>>, RigError> {
        self.each_effect(None, ModelEffect::make)
    }

    /// The declared effects of an axis, those of every axis first, for its plant.
    ///
    /// # Errors
    /// As [`RigFile::model_effects`].
    pub fn axis_effects(&self, axis: &Axis) -> Result<Vec<Box<dyn Effect>>, RigError> {
        self.each_effect(Some(axis), ModelEffect::make)
    }

    /// Constants of one axis's transmission for control laws: [`RigFile::axis_parameters`] with the
    /// declared effects absorbed ([`Parameters::absorb`]).
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission, or constants and effects together
    /// are beyond its range.
    pub fn control_parameters(&self, axis: &Axis) -> Result<Parameters, RigError> {
        let mut constants = self.axis_parameters(axis)?;
        self.each_effect(Some(axis), |effect| Ok(constants.absorb(&*effect.make()?)?))?;
        Ok(constants)
    }

    fn each_effect<T>(
        &self,
        axis: Option<&Axis>,
        mut act: impl FnMut(&ModelEffect) -> Result<T, ModelEffectError>,
    ) -> Result<Vec<T>, RigError> {
        let own = axis.map_or(&[][..], |axis| &axis.effects);
        let act = |effect: &ModelEffect| {
            act(effect).map_err(|error| {
                let expected = format!("an effect {} within the model's range", effect.id);
                RigError::wrong_model(&self.file_name, "model.effects", expected, error.to_string())
            })
        };
        self.model.effects.iter().chain(own).map(act).collect()
    }

    /// Dynamics of an axis reflected to its motor, for control laws; `None` where the model is no
    /// transmission, or there is no such axis.
    pub fn reflected_dynamics(&self, axis: usize) -> Option<ReflectedDynamics> {
        let axis = self.axes.get(axis)?;
        let (gear, speed_max) = (axis.master.turns_per_handle_turn, axis.limits.speed_max);
        Some(ReflectedDynamics::new(&*self.control_parameters(axis).ok()?, gear, speed_max))
    }

    /// The first timeout of a timing profile that rates and phases cannot keep, even where no loop
    /// is late: the rig cannot be armed in that profile, or trips when the motor has power. `None`
    /// where all are kept.
    pub fn missed_timeout(&self, profile: Profile) -> Option<MissedTimeout> {
        missed_timeout(&self.rates, &self.phases, profile)
    }

    /// Whether every axis says how it finds the zero of its positions, as a rig must whose motors
    /// get power.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with the axes that do not.
    pub fn check_homing(&self) -> Result<(), RigError> {
        let problems: Vec<Problem> = self
            .axes
            .iter()
            .enumerate()
            .filter(|(_, axis)| axis.homing.is_none())
            .map(|(at, axis)| {
                Problem::new(
                    &self.file_name,
                    1,
                    &format!("axes.{at}.homing"),
                    "how the axis finds the zero of its positions".to_owned(),
                    format!("nothing for \"{}\"", axis.name),
                    "add [axes.homing] with method = \"stops\" and the positions of its stops, or \
                     with method = \"absolute\" if its encoders keep their zero",
                )
            })
            .collect();
        if problems.is_empty() { Ok(()) } else { Err(RigError::Invalid { problems }) }
    }

    /// Bit set of the axes that satisfy a condition.
    pub fn axis_bits(&self, wanted: impl Fn(&Axis) -> bool) -> u8 {
        self.axes
            .iter()
            .enumerate()
            .filter(|(_, axis)| wanted(axis))
            .fold(0, |bits, (index, _)| bits | 1 << index)
    }

    /// Bit set of the declared analog inputs.
    pub fn channel_bits(&self) -> u16 {
        self.channels.iter().fold(0, |bits, channel| bits | 1 << channel.index)
    }

    /// The text as read, for recordings.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The name under which the file was read.
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Identity of the text ([`identity`]).
    pub fn identity(&self) -> u64 {
        self.identity
    }
}

/// Name of a file without folder and extension.
fn stem(file_name: &str) -> String {
    let stem = Path::new(file_name).file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Column names of a measured record, for `--replay` and `identify`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replay {
    /// Time (s).
    pub time: String,
    /// Position of the master (rad or m).
    pub position: String,
    /// Motor voltage (V).
    pub motor_v: String,
    /// Position of the slave (rad or m); optional in the record.
    pub slave_position: String,
    /// Torque of the hand at the slave (N·m or N); optional in the record.
    pub torque: String,
}

const REPLAY_KEYS: Keys = &[
    ("time", "Column of the time, in s; `t_s`, if left out."),
    ("position", "Column of the master's position; `master_rad` or `position_m`."),
    ("motor_v", "Column of the motor voltage; `motor_v`."),
    ("slave_position", "Column of the slave's position; `slave_rad` or `slave_m`."),
    ("torque", "Column of the hand's torque; `slave_torque_nm` or `slave_force_n`."),
];

impl Replay {
    fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        section.document("[replay]", REPLAY_KEYS);
        let column =
            |key, default: &str| section.text_or_none(key).unwrap_or_else(|| default.to_owned());
        let (position, slave, torque) = unit.choose(
            ("master_rad", "slave_rad", "slave_torque_nm"),
            ("position_m", "slave_m", "slave_force_n"),
        );
        Self {
            time: column("time", "t_s"),
            position: column("position", position),
            motor_v: column("motor_v", "motor_v"),
            slave_position: column("slave_position", slave),
            torque: column("torque", torque),
        }
    }
}
