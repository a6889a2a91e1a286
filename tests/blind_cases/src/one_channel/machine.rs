//! Machines with one channel: constants drawn for a case, and the rig file that declares them.

use std::f64::consts::TAU;
use std::fmt::Write;

use serde::{Deserialize, Serialize};

use super::Kind;
use crate::random::Draw;

/// How dry friction passes through zero speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stick {
    /// It holds: any force up to the level at rest, solved implicitly.
    Rigid,
    /// `tanh(v/v_e)`; the speed `v_e`.
    Tanh(f64),
    /// `(2/π) atan(π v/(2 v_e))`; the speed `v_e`.
    Arctangent(f64),
    /// A bristle (Dahl): the travel over which it builds up.
    Bristle(f64),
}

/// Constants of a machine; units of its kind: N or N·m, m or rad, V for an oscillator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Kind.
    pub kind: Kind,
    /// Whether its position is an angle.
    pub rotary: bool,
    /// Mass or inertia; 0 for an element.
    pub mass: f64,
    /// Viscous friction or damping.
    pub viscous: f64,
    /// Stiffness; 0 for a drive.
    pub stiffness: f64,
    /// Force that holds it at rest at 0.
    pub offset: f64,
    /// Declared Coulomb friction; 0 where there is none.
    pub coulomb: f64,
    /// How dry friction passes through zero speed.
    pub stick: Stick,
    /// Half the travel that movements use.
    pub amplitude: f64,
    /// Highest frequency of the movements, Hz.
    pub top_hz: f64,
    /// Rows per second.
    pub row_hz: f64,
    /// Natural frequency of position control or of the testing machine, rad/s.
    pub control_rad_s: f64,
}

/// A declared constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Declared {
    /// Name in the rig file.
    pub name: String,
    /// Declared value.
    pub value: f64,
    /// Largest difference of the true value.
    pub spread: f64,
}

/// What an effect demands of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demands {
    /// Declared Coulomb friction, which it changes or would imitate.
    pub coulomb: bool,
    /// No declared Coulomb friction.
    pub no_coulomb: bool,
    /// A rotary axis.
    pub rotary: bool,
    /// One long record, on whose time it depends.
    pub single: bool,
    /// Rows per second, so that hum of the mains passes the low-pass.
    pub fast: bool,
}

impl Demands {
    /// Both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            coulomb: self.coulomb || other.coulomb,
            no_coulomb: self.no_coulomb || other.no_coulomb,
            rotary: self.rotary || other.rotary,
            single: self.single || other.single,
            fast: self.fast || other.fast,
        }
    }

    /// Whether one machine can meet both.
    pub fn agrees(self, other: Self) -> bool {
        let all = self.and(other);
        !(all.coulomb && all.no_coulomb)
    }
}

/// Rates of rows, Hz.
const RATES_HZ: [f64; 6] = [100.0, 200.0, 400.0, 500.0, 1000.0, 2000.0];

impl Machine {
    /// Draws a machine of a kind that meets the demands.
    pub fn drawn(kind: Kind, demands: Demands, draw: &mut Draw) -> Self {
        let rotary = kind != Kind::Oscillator && (demands.rotary || draw.below(2) == 0);
        let mut machine = match kind {
            Kind::Drive => drive(rotary, draw),
            Kind::Oscillator => oscillator(draw),
            Kind::Element => element(rotary, draw),
        };
        let dry = draw.uniform(0.15, 0.5);
        // The rig file of a drive cannot declare Coulomb friction.
        let dry_here =
            kind != Kind::Drive && (demands.coulomb || (!demands.no_coulomb && draw.below(2) == 0));
        let scale = machine.force_scale();
        if dry_here {
            machine.coulomb = 0.4 * dry * scale;
        }
        machine.offset = draw.sign() * draw.uniform(0.0, 0.25) * scale;
        let speed = TAU * machine.top_hz * machine.amplitude;
        // A bristle under an imposed movement is presliding friction, which is an effect of the
        // list.
        machine.stick = match draw.below(if kind == Kind::Element { 3 } else { 4 }) {
            0 | 1 => Stick::Rigid,
            2 if draw.below(2) == 0 => Stick::Tanh(draw.log_uniform(1e-3, 1e-2) * speed),
            2 => Stick::Arctangent(draw.log_uniform(5e-4, 3e-3) * speed),
            _ => Stick::Bristle(draw.log_uniform(2e-4, 1e-3) * machine.amplitude),
        };
        let lowest = match kind {
            Kind::Drive => 40.0 * machine.top_hz,
            Kind::Oscillator => 15.0 * machine.natural_hz(),
            Kind::Element => 25.0 * machine.top_hz,
        };
        let lowest = if demands.fast { lowest.max(500.0) } else { lowest };
        let rates: Vec<f64> = RATES_HZ.into_iter().filter(|rate| *rate >= lowest).collect();
        machine.row_hz = if rates.is_empty() { 2000.0 } else { draw.choose(&rates) };
        machine
    }

    /// Natural frequency of an oscillator, Hz.
    pub fn natural_hz(&self) -> f64 {
        (self.stiffness / self.mass.max(1e-12)).sqrt() / TAU
    }

    /// About the force that its movements need.
    pub fn force_scale(&self) -> f64 {
        let rate = 0.6 * TAU * self.top_hz;
        let inertial = self.mass * self.amplitude * rate * rate;
        0.5 * if self.kind == Kind::Drive { inertial } else { self.stiffness * self.amplitude }
    }

    /// Cut-off of the low-pass with which identify evaluates such records, Hz.
    pub fn cut_hz(&self) -> f64 {
        match self.kind {
            Kind::Drive => (0.1 * self.row_hz).min(40.0),
            Kind::Oscillator => (0.2 * self.row_hz).min(4.0 * self.natural_hz()),
            Kind::Element => (0.15 * self.row_hz).min(100.0),
        }
    }

    /// The constants as a laboratory declares them: round numbers with a tolerance that contains
    /// the truth.
    pub fn declare(&self, draw: &mut Draw) -> Vec<Declared> {
        let names: [&str; 5] = match (self.kind, self.rotary) {
            (Kind::Oscillator, _) => {
                ["mass_s2", "damping_s", "stiffness", "coulomb_friction_v", "input_offset_v"]
            }
            // A rotary drive has the same names; its columns tell.
            (Kind::Drive, _) => ["mass_kg", "viscous_friction_n_s_per_m", "", "", "force_offset_n"],
            (Kind::Element, false) => [
                "",
                "viscous_damping_n_s_per_m",
                "stiffness_n_per_m",
                "coulomb_friction_n",
                "force_offset_n",
            ],
            (Kind::Element, true) => [
                "",
                "viscous_damping_nm_s_per_rad",
                "stiffness_nm_per_rad",
                "coulomb_nm",
                "offset_nm",
            ],
        };
        let values = [self.mass, self.viscous, self.stiffness, self.coulomb, self.offset];
        let tolerances = [
            draw.uniform(0.15, 0.35),
            draw.uniform(0.3, 0.8),
            draw.uniform(0.15, 0.35),
            draw.uniform(0.3, 0.6),
        ];
        let mut all = Vec::new();
        for index in 0..5 {
            let (name, value) = (names[index], values[index]);
            let place = draw.uniform(-0.9, 0.9);
            if name.is_empty() || (index == 3 && value == 0.0) {
                continue;
            }
            let (declared, spread) = if index == 4 {
                let reach = (1.5 * value.abs()).max(0.1 * self.force_scale());
                (0.0, round_up(draw.uniform(1.0, 2.0) * reach))
            } else {
                let tolerance = tolerances[index];
                let near = rounded(value / (1.0 + place * tolerance));
                // The spread is at least the difference to the true value.
                let spread = round_up((tolerance * near).max(1.02 * (value - near).abs()));
                (near, spread)
            };
            all.push(Declared { name: name.to_owned(), value: declared, spread });
        }
        all
    }

    /// The rig file of a declaration.
    pub fn rig(&self, name: &str, declared: &[Declared]) -> String {
        let mut text = format!(
            "name = \"{name}\"\ndescription = \"one measured channel\"\n\n\
             # A rig file must have an axis; `farreach identify` reads [model] alone.\n{AXIS}\n\
             [model]\nkind = \"{}\"\n\n[model.parameters]\n",
            self.kind.name()
        );
        if self.kind == Kind::Drive {
            text += "force_per_volt_n = { value = 1.0, tolerance = 0.0, source = \"assumed\" }\n";
        }
        for Declared { name, value, spread } in declared {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{name} = {{ value = {value:?}, tolerance_absolute = {spread:?}, source = \
                 \"assumed\" }}"
            );
        }
        text
    }
}

const AXIS: &str = "[[axes]]
name = \"axis\"
unit = \"m\"
[axes.master]
counts_per_metre = 1.0e6
[axes.limits]
position_min_m = -5.0
position_max_m = 5.0
speed_max_m_s = 10.0
volts_max = 10.0
encoder_jump_counts = 1000000
[axes.control]
p_v_per_count = 0.0
d_v_s_per_count = 0.0
velocity_filter_hz = 100.0
output_limit_v = 10.0
ramp_s = 1.0
";

/// Haptic drives, servo joints and gearboxes where rotary, carriages and voice coils where linear.
fn drive(rotary: bool, draw: &mut Draw) -> Machine {
    let (mass, amplitude) = if rotary {
        (draw.log_uniform(3e-4, 0.3), draw.log_uniform(0.6, 2.5))
    } else {
        (draw.log_uniform(0.3, 100.0), draw.log_uniform(0.01, 0.2))
    };
    let top_hz = draw.log_uniform(0.8, 4.0);
    let viscous = draw.log_uniform(0.1, 0.8) * mass * 0.5 * TAU * top_hz;
    Machine {
        kind: Kind::Drive,
        rotary,
        mass,
        viscous,
        amplitude,
        top_hz,
        control_rad_s: TAU * top_hz * draw.uniform(1.5, 3.0),
        ..nothing(Kind::Drive)
    }
}

/// Levers on springs, resonators, electronic analogues.
fn oscillator(draw: &mut Draw) -> Machine {
    let natural = TAU * draw.log_uniform(4.0, 25.0);
    let stiffness = draw.log_uniform(0.3, 10.0);
    let mass = stiffness / (natural * natural);
    let ratio = draw.log_uniform(0.05, 0.4);
    Machine {
        kind: Kind::Oscillator,
        mass,
        viscous: 2.0 * ratio * (stiffness * mass).sqrt(),
        stiffness,
        amplitude: draw.log_uniform(0.05, 1.0),
        top_hz: natural / TAU * draw.uniform(1.2, 2.0),
        ..nothing(Kind::Oscillator)
    }
}

/// Springs, cables, seals and clamps in a testing machine.
fn element(rotary: bool, draw: &mut Draw) -> Machine {
    let (stiffness, amplitude) = if rotary {
        (draw.log_uniform(0.5, 50.0), draw.log_uniform(0.05, 0.5))
    } else {
        (draw.log_uniform(500.0, 5e4), draw.log_uniform(1e-3, 2e-2))
    };
    let top_hz = draw.log_uniform(0.5, 5.0);
    Machine {
        kind: Kind::Element,
        rotary,
        viscous: draw.log_uniform(0.05, 0.4) * stiffness / (TAU * top_hz),
        stiffness,
        amplitude,
        top_hz,
        control_rad_s: TAU * top_hz * draw.uniform(4.0, 8.0),
        ..nothing(Kind::Element)
    }
}

fn nothing(kind: Kind) -> Machine {
    Machine {
        kind,
        rotary: false,
        mass: 0.0,
        viscous: 0.0,
        stiffness: 0.0,
        offset: 0.0,
        coulomb: 0.0,
        stick: Stick::Rigid,
        amplitude: 1.0,
        top_hz: 1.0,
        row_hz: 1000.0,
        control_rad_s: 1.0,
    }
}

/// Two significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// Two significant digits, not less than the value.
fn round_up(value: f64) -> f64 {
    let near = rounded(value);
    if near >= value { near } else { rounded(1.05 * value).max(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declared_tolerances_contain_the_truth() {
        for seed in 0..200 {
            for kind in Kind::ALL {
                let mut draw = Draw::new(seed);
                let machine = Machine::drawn(kind, Demands::default(), &mut draw);
                let declared = machine.declare(&mut draw);
                let truth = |name: &str| {
                    if name.starts_with("mass") || name.starts_with("inertia") {
                        machine.mass
                    } else if name.starts_with("viscous") || name.starts_with("damping") {
                        machine.viscous
                    } else if name.starts_with("stiffness") {
                        machine.stiffness
                    } else if name.starts_with("coulomb") {
                        machine.coulomb
                    } else {
                        machine.offset
                    }
                };
                for Declared { name, value, spread } in &declared {
                    assert!((truth(name) - value).abs() <= *spread, "{seed} {name}");
                }
                let rig: toml::Table = machine.rig("case", &declared).parse().unwrap();
                assert_eq!(rig["model"]["kind"].as_str(), Some(kind.name()));
                let count = rig["model"]["parameters"].as_table().unwrap().len();
                // A drive's force is given as one newton a volt.
                assert_eq!(count, declared.len() + usize::from(kind == Kind::Drive));
            }
        }
    }

    #[test]
    fn rounding_up_never_goes_below() {
        for value in [0.0123, 0.099, 1.0, 12.3, 9.96e5] {
            let up = round_up(value);
            assert!(up >= value && up <= 1.12 * value, "{value} {up}");
        }
    }
}
