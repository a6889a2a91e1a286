//! A rig file as a whole.

use std::path::Path;

use crate::axis::{Axis, AxisUnit};
use crate::channel::{ANALOG, Channel};
use crate::error::RigError;
use crate::identity::identity;
use crate::model::Model;
use crate::rates::{Phases, Rates};
use crate::read::{Section, Source};
use crate::simulation::Simulation;
use crate::stability;

/// Most axes that one rig has (as in the messages).
const AXES: usize = 3;

/// A machine, as a laboratory declares it.
#[derive(Clone, Debug, PartialEq)]
pub struct RigFile {
    /// Name of the rig.
    pub name: String,
    /// What it is, for people.
    pub description: String,
    /// How often each process runs.
    pub rates: Rates,
    /// When within its period each process runs.
    pub phases: Phases,
    /// One to three.
    pub axes: Vec<Axis>,
    /// Up to sixteen analog inputs.
    pub channels: Vec<Channel>,
    /// The declared model.
    pub model: Model,
    /// Which column of a measured record is what.
    pub replay: Replay,
    /// Defaults for the virtual card.
    pub simulation: Simulation,
    text: String,
    file_name: String,
    identity: u64,
}

impl RigFile {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`] where there is no such file or it is no UTF-8, else as
    /// [`RigFile::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path)
            .map_err(|source| RigError::Unreadable { path: path.to_owned(), source })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Checks the text of a rig file; `file_name` appears in messages only.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with every problem that was found. Checks that compare sections
    /// (rates, phases, channels against axes) follow when each section by itself is in order.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, RigError> {
        let source = Source::new(text, file_name);
        let table = source.parse()?;
        let rig = Self::read(source.root(table.get_ref()), text, file_name);
        if source.is_clean() {
            rig.check(&source);
        }
        if source.is_clean() {
            stability::check_gains(&rig, &source);
        }
        source.finish()?;
        Ok(rig)
    }

    fn read(root: Section<'_>, text: &str, file_name: &str) -> Self {
        let rates = Rates::read(root.section("rates"));
        let axes: Vec<_> =
            root.sections("axes").into_iter().map(|section| Axis::read(section, &rates)).collect();
        let unit = axes.first().map_or(AxisUnit::Radian, |axis| axis.unit);
        if axes.is_empty() || axes.len() > AXES {
            root.problem("axes", format!("1 to {AXES} axes"), axes.len(), "write each as [[axes]]");
        }
        let channels: Vec<_> = root.sections("channels").into_iter().map(Channel::read).collect();
        if channels.len() > ANALOG {
            root.problem(
                "channels",
                format!("at most {ANALOG} channels"),
                channels.len(),
                "take some out",
            );
        }
        let rig = Self {
            name: root.text("name"),
            description: root.text_or_none("description").unwrap_or_default(),
            rates,
            phases: Phases::read(root.section("phases_us")),
            axes,
            channels,
            model: Model::read(root.section("model")),
            replay: Replay::read(root.section("replay"), unit),
            simulation: Simulation::read(root.section("simulation"), unit),
            text: text.to_owned(),
            file_name: file_name.to_owned(),
            identity: identity(text),
        };
        root.finish();
        rig
    }

    fn check(&self, source: &Source<'_>) {
        self.rates.check(source);
        if source.is_clean() {
            self.phases.check(&self.rates, source);
        }
        Channel::check_all(&self.channels, source);
        self.model.check(&self.axes, source);
        self.simulation.check(&self.channels, &self.rates, source);
        for (at, axis) in self.axes.iter().enumerate() {
            axis.check(at, &self.channels, &self.rates, source);
            if let Some(key) = axis.control.options.needs_transmission()
                && !self.model.kind.is_transmission()
            {
                let found = format!("the model \"{}\"", self.model.kind.name());
                let advice = "take the key out, or declare the transmission in [model]";
                source.problem(
                    &format!("axes.{at}.{key}"),
                    "the declared model of a transmission",
                    found,
                    advice,
                );
            }
            if let Some(before) = self.axes[..at].iter().position(|other| other.name == axis.name) {
                let expected = format!("a name of its own (axes.{before} has it already)");
                let found = format!("the text \"{}\"", axis.name);
                source.problem(
                    &format!("axes.{at}.name"),
                    expected,
                    found,
                    "names tell axes apart on screens",
                );
            }
        }
    }

    /// The declared constants of the hydrostatic transmission; those that the file leaves out are
    /// as printed.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is of another kind.
    pub fn hydrostatic_parameters(&self) -> Result<plant::hydrostatic::Parameters, RigError> {
        self.model.hydrostatic(&self.file_name)
    }

    /// The declared constants of the cable transmission; those that the file leaves out are as
    /// printed.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is of another kind.
    pub fn cable_parameters(&self) -> Result<plant::cable::Parameters, RigError> {
        self.model.cable(&self.file_name)
    }

    /// The declared constants of the transmission, whichever kind it is; those that the file leaves
    /// out are as printed.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission
    /// ([`crate::ModelKind::is_transmission`]).
    pub fn transmission_parameters(&self) -> Result<plant::any::Parameters, RigError> {
        self.model.transmission(&self.file_name)
    }

    /// The axes that are wanted, one bit each.
    pub fn axis_bits(&self, wanted: impl Fn(&Axis) -> bool) -> u8 {
        self.axes
            .iter()
            .enumerate()
            .filter(|(_, axis)| wanted(axis))
            .fold(0, |bits, (index, _)| bits | 1 << index)
    }

    /// The analog channels that there are, one bit each.
    pub fn channel_bits(&self) -> u16 {
        self.channels.iter().fold(0, |bits, channel| bits | 1 << channel.index)
    }

    /// The declared constants of one axis's transmission: those of [`Model::parameters`], but for
    /// what `axes.model` says of it.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is no transmission
    /// ([`crate::ModelKind::is_transmission`]).
    pub fn axis_parameters(&self, axis: &Axis) -> Result<plant::any::Parameters, RigError> {
        self.model.of_axis(&axis.model, &self.file_name)
    }

    /// The declared model of one axis: that of the file, but for what `axes.model` says of its
    /// transmission.
    pub fn axis_model(&self, axis: &Axis) -> Model {
        self.model.with(&axis.model)
    }

    /// The declared constants of the one-mass drive; those that the file leaves out are those of
    /// EMPS.
    ///
    /// # Errors
    /// [`RigError::Invalid`] where the model is of another kind.
    pub fn drive_parameters(&self) -> Result<plant::drive::Parameters, RigError> {
        self.model.drive(&self.file_name)
    }

    /// Force of a drive's motor per volt (N/V); `None` where the model is of another kind.
    pub fn force_per_volt(&self) -> Option<f64> {
        let drive = self.model.kind == crate::ModelKind::Drive;
        self.model.parameter("force_per_volt_n").filter(|_| drive).map(|parameter| parameter.value)
    }

    /// The text as it was read, for recordings.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The name under which it was read.
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Identity of the text ([`identity`]).
    pub fn identity(&self) -> u64 {
        self.identity
    }
}

/// Which column of a measured record is what, for `--replay` and `identify`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replay {
    /// Time (s).
    pub time: String,
    /// Position of the master (rad or m).
    pub position: String,
    /// Motor volts (V).
    pub motor_v: String,
    /// Position of the slave (rad or m); need not be in the record.
    pub slave_position: String,
    /// Torque of the hand at the slave (N·m or N); need not be in the record.
    pub torque: String,
}

impl Replay {
    fn read(section: Section<'_>, unit: AxisUnit) -> Self {
        let column =
            |key, default: &str| section.text_or_none(key).unwrap_or_else(|| default.to_owned());
        let (position, slave, torque) = match unit {
            AxisUnit::Radian => ("master_rad", "slave_rad", "slave_torque_nm"),
            AxisUnit::Metre => ("position_m", "slave_m", "slave_force_n"),
        };
        let replay = Self {
            time: column("time", "t_s"),
            position: column("position", position),
            motor_v: column("motor_v", "motor_v"),
            slave_position: column("slave_position", slave),
            torque: column("torque", torque),
        };
        section.finish();
        replay
    }
}
