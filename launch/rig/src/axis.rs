//! Axes: encoders, torque channel, limits, the control law's gains.

use crate::channel::{ANALOG, Channel, ChannelKind};
use crate::compensation::ControlOptions;
use crate::force::ForceControl;
use crate::model::Parameter;
use crate::rates::Rates;
use crate::read::{Bounds, Section, Source, bounds};

/// One degree of freedom: a motor with its master encoder, and the handle that it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name on screens.
    pub name: String,
    /// Unit of its positions.
    pub unit: AxisUnit,
    /// Encoder at the motor.
    pub master: Encoder,
    /// Encoder at the handle, if there is one.
    pub slave: Option<Encoder>,
    /// Sensor of the torque that the hand applies, if there is one.
    pub torque: Option<TorqueChannel>,
    /// What the watchdog enforces.
    pub limits: Limits,
    /// Gains of the control law.
    pub control: AxisControl,
    /// What this axis's transmission has otherwise than [`crate::Model::parameters`] say.
    pub model: Vec<Parameter>,
}

/// Unit of an axis's positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisUnit {
    /// Turns: positions in rad, torques in N·m. Files say degrees.
    Radian,
    /// Slides: positions in m, forces in N.
    Metre,
}

impl AxisUnit {
    /// The unit's symbol.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Radian => "rad",
            Self::Metre => "m",
        }
    }

    /// SI per unit of the file: degrees become rad, m stays.
    pub(crate) const fn si_per_file_unit(self) -> f64 {
        match self {
            Self::Radian => std::f64::consts::PI / 180.0,
            Self::Metre => 1.0,
        }
    }
}

/// An incremental encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Counts per rad or per m of the axis, positive (1/rad or 1/m).
    pub counts_per_unit: f64,
    /// Turns of what the encoder sits on per turn of the handle, positive; 1 where there is no
    /// gear.
    pub turns_per_handle_turn: f64,
    /// Whether it counts down when the axis moves positive.
    pub inverted: bool,
}

impl Encoder {
    fn sign(&self) -> f64 {
        if self.inverted { -1.0 } else { 1.0 }
    }

    /// Position of a reading (rad or m).
    pub fn position(&self, counts: i64) -> f64 {
        self.sign() * counts as f64 / self.counts_per_unit
    }

    /// Reading at a position, not rounded (counts).
    pub fn counts(&self, position: f64) -> f64 {
        self.sign() * position * self.counts_per_unit
    }
}

/// The sensor of the torque (or force) that the hand applies to the slave, positive when it drives
/// the slave positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueChannel {
    /// Analog input, index into `Sample::analog_v`.
    pub channel: usize,
    /// Sensitivity, with its sign (V/(N·m) or V/N).
    pub volts_per_unit: f64,
    /// Reading at no torque (V).
    pub offset_v: f64,
}

impl TorqueChannel {
    /// Torque of a reading (N·m or N).
    pub fn torque(&self, volts: f64) -> f64 {
        (volts - self.offset_v) / self.volts_per_unit
    }

    /// Reading at a torque (V).
    pub fn volts(&self, torque: f64) -> f64 {
        torque * self.volts_per_unit + self.offset_v
    }
}

/// What the watchdog and the gate enforce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least position of master and slave (rad or m).
    pub position_min: f64,
    /// Greatest position (rad or m).
    pub position_max: f64,
    /// Greatest speed, either way (rad/s or m/s).
    pub speed_max: f64,
    /// Greatest motor volts, either way (V).
    pub volts_max: f64,
    /// Greatest torque of the hand, either way (N·m or N); `None` without a torque channel.
    pub torque_max: Option<f64>,
    /// Most counts that the master encoder can move between two scans (counts).
    pub encoder_jump_counts: i64,
}

/// Gains and limits of the control law (§ 4.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisControl {
    /// Volts per position error: P of § 4.1 times the encoder's counts (V/rad or V/m).
    pub position_gain: f64,
    /// Volts per velocity error: D of § 4.1 times the encoder's counts (V·s/rad or V·s/m).
    pub velocity_gain: f64,
    /// Cut-off of the velocity estimate's low pass (Hz).
    pub velocity_filter_hz: f64,
    /// Control stays within ± this, at most the limit on volts (V).
    pub output_limit_v: f64,
    /// Feed-forward for guided movements.
    pub feedforward: Feedforward,
    /// Time in which control passes from the measured position to the setpoint (s).
    pub ramp_s: f64,
    /// Whether gains are taken that are not stable at the declared transmission.
    pub accept_unstable: bool,
    /// Force control, where the hand's torque is measured.
    pub force: Option<ForceControl>,
    /// Compensation, observer, loop on the slave.
    pub options: ControlOptions,
}

/// Feed-forward of § 4.1, fig. 4.3A: a triangle against friction, a term against inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedforward {
    /// Friction compensation where the movement turns (V).
    pub friction_peak_v: f64,
    /// Friction compensation at peak speed (V).
    pub friction_floor_v: f64,
    /// Volts per acceleration (V·s²/rad or V·s²/m).
    pub inertia_v: f64,
}

/// Keys whose names carry the axis's unit.
struct Keys {
    counts: &'static str,
    position_min: &'static str,
    position_max: &'static str,
    speed: &'static str,
    torque: &'static str,
    sensitivity: &'static str,
    inertia: &'static str,
}

const RADIAN: Keys = Keys {
    counts: "counts_per_turn",
    position_min: "position_min_deg",
    position_max: "position_max_deg",
    speed: "speed_max_deg_s",
    torque: "torque_max_nm",
    sensitivity: "volts_per_nm",
    inertia: "inertia_v_per_rad_s2",
};
const METRE: Keys = Keys {
    counts: "counts_per_metre",
    position_min: "position_min_m",
    position_max: "position_max_m",
    speed: "speed_max_m_s",
    torque: "force_max_n",
    sensitivity: "volts_per_n",
    inertia: "inertia_v_per_m_s2",
};

/// The keys of an axis, and those of the other unit that it must not have.
struct Unit {
    unit: AxisUnit,
    keys: Keys,
    other: Keys,
}

impl Unit {
    fn new(unit: AxisUnit) -> Self {
        match unit {
            AxisUnit::Radian => Self { unit, keys: RADIAN, other: METRE },
            AxisUnit::Metre => Self { unit, keys: METRE, other: RADIAN },
        }
    }

    fn choose(&self, radian: Bounds, metre: Bounds) -> Bounds {
        match self.unit {
            AxisUnit::Radian => radian,
            AxisUnit::Metre => metre,
        }
    }

    /// Notes a key of the other unit, and returns the right one.
    fn key(&self, section: &Section<'_>, of: impl Fn(&Keys) -> &'static str) -> &'static str {
        let (right, wrong) = (of(&self.keys), of(&self.other));
        if section.has(wrong) {
            let expected = format!("`{right}`, as the axis's unit is \"{}\"", self.unit.symbol());
            section.misplaced(wrong, &expected, "convert the value, or change the axis's unit");
        }
        right
    }
}

const COUNTS_PER_TURN: Bounds =
    bounds(100.0, 1e7, "counts of one whole turn, all four edges of each line");
const GEAR: Bounds = bounds(0.05, 50.0, "how often the motor turns while the handle turns once");
const COUNTS_PER_METRE: Bounds = bounds(1e3, 1e10, "counts of one metre; 5e-8 m per count are 2e7");
const POSITION_DEG: Bounds =
    bounds(-120.0, 120.0, "the thesis moves within ±120° (§ 4.2); the value is in degrees");
const POSITION_M: Bounds = bounds(-5.0, 5.0, "the value is in m");
const SPEED_DEG: Bounds = bounds(
    30.0,
    2262.0,
    "3 Hz over ±120° (§ 4.2) peaks at 2262 °/s; the value is in °/s, and less than 30 looks like rad/s",
);
const SPEED_M: Bounds = bounds(1e-3, 10.0, "the value is in m/s");
const VOLTS: Bounds = bounds(0.1, 10.0, "the card puts out ±10 V");
const TORQUE: Bounds =
    bounds(0.1, 20.0, "the value is in N·m; a hand at the handle stays below 20 N·m");
const FORCE: Bounds = bounds(0.1, 5000.0, "the value is in N");
const SENSITIVITY: Bounds = bounds(-100.0, 100.0, "volts per N·m or N, with the sensor's sign");

impl Axis {
    pub(crate) fn read(section: Section<'_>, rates: &Rates) -> Self {
        let name = section.text("name");
        let words = &[("rad", AxisUnit::Radian), ("m", AxisUnit::Metre)];
        let unit = Unit::new(section.word("unit", words).unwrap_or(AxisUnit::Radian));
        if !section.has("master") {
            section.problem(
                "master",
                "the encoder at the motor",
                "nothing",
                "control needs the master's position",
            );
        }
        let master = Encoder::read(section.section("master"), &unit, true);
        let slave = section.section("slave");
        let slave = if slave.exists() { Some(Encoder::read(slave, &unit, false)) } else { None };
        let torque = section.section("torque");
        let torque = if torque.exists() { Some(TorqueChannel::read(torque, &unit)) } else { None };
        if !section.has("limits") {
            section.problem(
                "limits",
                "the limits that the watchdog enforces",
                "nothing",
                "no axis runs without limits",
            );
        }
        let limits = Limits::read(section.section("limits"), &unit, torque.is_some());
        let control = AxisControl::read(
            section.section("control"),
            &unit,
            (&master, slave.as_ref()),
            torque.as_ref(),
            &limits,
            rates,
        );
        let model = Parameter::read_all(&section.section("model"));
        section.finish();
        Self { name, unit: unit.unit, master, slave, torque, limits, control, model }
    }

    /// What can only be seen with the other sections at hand; `at` is the axis's index.
    pub(crate) fn check(
        &self,
        at: usize,
        channels: &[Channel],
        rates: &Rates,
        source: &Source<'_>,
    ) {
        let path = |key: &str| format!("axes.{at}.{key}");
        let (limits, unit) = (&self.limits, Unit::new(self.unit));
        let file = |si: f64| si / self.unit.si_per_file_unit();
        if limits.position_min >= limits.position_max {
            let expected = format!(
                "more than {} ({})",
                unit.keys.position_min,
                file(limits.position_min).round()
            );
            let found =
                format!("limits the wrong way round: {}", file(limits.position_max).round());
            source.problem(
                &path(&format!("limits.{}", unit.keys.position_max)),
                expected,
                found,
                "swap the two",
            );
        } else if self.unit == AxisUnit::Radian
            && file(limits.position_max - limits.position_min) < 5.0
        {
            let key = path(&format!("limits.{}", unit.keys.position_max));
            let span = file(limits.position_max - limits.position_min);
            let advice = "limits this close look like radians; the values are in degrees";
            source.problem(
                &key,
                "a range of at least 5 degrees",
                format!("{span:.2} degrees"),
                advice,
            );
        }
        // The watchdog holds both encoders to it.
        let finest = self
            .slave
            .as_ref()
            .map_or(0.0, |slave| slave.counts_per_unit)
            .max(self.master.counts_per_unit);
        let per_scan = limits.speed_max * finest / f64::from(rates.acquisition_hz);
        if (limits.encoder_jump_counts as f64) < 2.0 * per_scan {
            let expected = format!(
                "at least {:.0}, twice what the speed limit allows in one scan",
                (2.0 * per_scan).ceil()
            );
            let advice = "a lower value takes a fast movement for a broken encoder";
            source.problem(
                &path("limits.encoder_jump_counts"),
                expected,
                limits.encoder_jump_counts,
                advice,
            );
        }
        if self.control.output_limit_v > limits.volts_max {
            let expected = format!("at most limits.volts_max ({} V)", limits.volts_max);
            let advice = "control must stay below where the watchdog trips";
            source.problem(
                &path("control.output_limit_v"),
                expected,
                self.control.output_limit_v,
                advice,
            );
        }
        let Some(torque) = &self.torque else { return };
        let key = path("torque.channel");
        let Some((index, channel)) =
            channels.iter().enumerate().find(|(_, channel)| channel.index == torque.channel)
        else {
            let present: Vec<_> =
                channels.iter().map(|channel| channel.index.to_string()).collect();
            let expected = format!("the index of one of [[channels]] ({})", present.join(", "));
            let advice = format!("add [[channels]] with index = {}", torque.channel);
            source.problem(
                &key,
                expected,
                format!("the missing channel {}", torque.channel),
                advice,
            );
            return;
        };
        if channel.kind != ChannelKind::Torque {
            let found = format!("channels.{index} (\"{}\") of another kind", channel.name);
            source.problem(
                &key,
                "a channel of kind \"torque\"",
                found,
                "point to the torque sensor, or mend its kind",
            );
        }
        let full_scale = (channel.range_v - torque.offset_v.abs()) / torque.volts_per_unit.abs();
        if limits.torque_max.is_some_and(|most| most > full_scale) {
            let expected =
                format!("at most {full_scale:.2}, where the channel's ±{} V end", channel.range_v);
            let advice = "the sensor saturates before the limit acts";
            let key = path(&format!("limits.{}", unit.keys.torque));
            source.problem(&key, expected, limits.torque_max.unwrap_or_default(), advice);
        }
    }
}

impl Encoder {
    /// `geared`: whether there may be a gear between the encoder and the handle.
    fn read(section: Section<'_>, unit: &Unit, geared: bool) -> Self {
        let key = unit.key(&section, |keys| keys.counts);
        let counts = section.number(key, unit.choose(COUNTS_PER_TURN, COUNTS_PER_METRE));
        let inverted = section.flag_or("inverted", false);
        let turns = match unit.unit {
            AxisUnit::Radian if geared => section.number_or("turns_per_handle_turn", 1.0, GEAR),
            _ => 1.0,
        };
        section.finish();
        let turn = match unit.unit {
            AxisUnit::Radian => std::f64::consts::TAU,
            AxisUnit::Metre => 1.0,
        };
        Self { counts_per_unit: turns * counts / turn, turns_per_handle_turn: turns, inverted }
    }
}

impl TorqueChannel {
    fn read(section: Section<'_>, unit: &Unit) -> Self {
        let channel =
            section.whole("channel", 0, ANALOG as u64 - 1, "an index of [[channels]]") as usize;
        let key = unit.key(&section, |keys| keys.sensitivity);
        let volts_per_unit = section.number(key, SENSITIVITY);
        if volts_per_unit.abs() < 1e-6 {
            section.problem(
                key,
                "a sensitivity",
                volts_per_unit,
                "a sensor without sensitivity measures nothing",
            );
        }
        let offset_v =
            section.number_or("offset_v", 0.0, bounds(-10.0, 10.0, "the reading at no torque"));
        section.finish();
        Self { channel, volts_per_unit, offset_v }
    }
}

impl Limits {
    fn read(section: Section<'_>, unit: &Unit, torque: bool) -> Self {
        let (position, speed) =
            (unit.choose(POSITION_DEG, POSITION_M), unit.choose(SPEED_DEG, SPEED_M));
        let scale = unit.unit.si_per_file_unit();
        let (min, max) =
            (unit.key(&section, |k| k.position_min), unit.key(&section, |k| k.position_max));
        let torque_key = unit.key(&section, |k| k.torque);
        let torque_bounds = unit.choose(TORQUE, FORCE);
        if !torque && section.has(torque_key) {
            let advice = "add the axis's torque channel, or take the limit out";
            section.problem(torque_key, "no limit where nothing is measured", "a limit", advice);
        }
        let limits = Self {
            position_min: section.number(min, position) * scale,
            position_max: section.number(max, position) * scale,
            speed_max: section.number(unit.key(&section, |k| k.speed), speed) * scale,
            volts_max: section.number("volts_max", VOLTS),
            torque_max: if torque {
                Some(section.number(torque_key, torque_bounds))
            } else {
                section.number_or_none(torque_key, torque_bounds)
            },
            encoder_jump_counts: section.whole(
                "encoder_jump_counts",
                2,
                1_000_000_000,
                "some times what the speed limit allows in one scan",
            ) as i64,
        };
        section.finish();
        limits
    }
}

impl AxisControl {
    fn read(
        section: Section<'_>,
        unit: &Unit,
        (master, slave): (&Encoder, Option<&Encoder>),
        torque: Option<&TorqueChannel>,
        limits: &Limits,
        rates: &Rates,
    ) -> Self {
        let way = limits.position_max - limits.position_min;
        let gain = |key, printed| {
            let bounds = bounds(0.0, 1.0, "volts per count: § 4.1 has P = 4.5e-3 and D = 7e-4");
            match unit.unit {
                AxisUnit::Radian => {
                    section.number_or(key, printed, bounds) * master.counts_per_unit
                }
                // the thesis's gains belong to its encoder, and no axis in m has that
                AxisUnit::Metre => section.number(key, bounds) * master.counts_per_unit,
            }
        };
        let nyquist = f64::from(rates.control_hz) / 2.0;
        let filter =
            bounds(1.0, nyquist, "at most half the rate of control, or it does not filter");
        let control = Self {
            position_gain: gain("p_v_per_count", 4.5e-3),
            velocity_gain: gain("d_v_s_per_count", 7e-4),
            velocity_filter_hz: section.number_or(
                "velocity_filter_hz",
                40.0_f64.min(nyquist),
                filter,
            ),
            output_limit_v: section.number_or("output_limit_v", limits.volts_max, VOLTS),
            feedforward: Feedforward::read(section.section("feedforward"), unit),
            ramp_s: section.number_or("ramp_s", 1.0, bounds(0.1, 10.0, "in seconds")),
            accept_unstable: section.flag_or("accept_unstable", false),
            force: torque.map(|torque| {
                let force = section.section("force");
                let control =
                    ForceControl::read(&force, master, torque, way, unit.unit.si_per_file_unit());
                force.finish();
                control
            }),
            options: ControlOptions::read(&section, unit.unit, slave, way),
        };
        if torque.is_none() {
            let advice = "add the axis's torque channel, or take the section out";
            section.misplaced("force", "no force control where no torque is measured", advice);
        }
        section.finish();
        control
    }
}

impl Feedforward {
    fn read(section: Section<'_>, unit: &Unit) -> Self {
        let inertia = unit.key(&section, |keys| keys.inertia);
        let (peak, floor) = match unit.unit {
            AxisUnit::Radian => (1.5, 1.2),
            AxisUnit::Metre => (0.0, 0.0),
        };
        let peak = section.number_or(
            "friction_peak_v",
            peak,
            bounds(0.0, 5.0, "ch. 4 measured 1.5 ± 0.3 V"),
        );
        let floor = section.number_or(
            "friction_floor_v",
            f64::min(floor, peak),
            bounds(0.0, peak, "at most friction_peak_v: friction falls with speed (§ 4.1)"),
        );
        let inertia_v = section.number_or(
            inertia,
            0.0,
            bounds(0.0, 10.0, "inertia divided by torque per volt"),
        );
        section.finish();
        Self { friction_peak_v: peak, friction_floor_v: floor, inertia_v }
    }
}
