//! Deviations of a machine from the declared model: listed effects and unlisted ones.
//!
//! Listed effects have the equations and parameter names of the plant, so that sizes can be
//! compared, but separate code. One entry is one effect at one site; its size is drawn such that a
//! good method finds it.

mod drive;
mod friction;
mod holdout_drive;
mod holdout_line;
mod holdout_sensor;
mod holdout_side;
mod line;
mod sensor;
mod torque;
mod unlisted_drive;
mod unlisted_line;
mod unlisted_sensor;
mod unlisted_side;

use serde::{Deserialize, Serialize};

use crate::deviation::Deviation;
use crate::random::Draw;

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Site {
    /// Amplifier and motor.
    Drive,
    /// Master side.
    Master,
    /// Between master and slave.
    Line,
    /// Slave side.
    Slave,
    /// Instruments.
    Sensor,
}

impl Site {
    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::Master => "master",
            Self::Line => "line",
            Self::Slave => "slave",
            Self::Sensor => "sensor",
        }
    }

    /// Which side a master's or slave's effect acts on.
    fn side(self) -> usize {
        usize::from(self == Self::Slave)
    }
}

/// Kinds of variables on which effects depend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variable {
    /// An angle or displacement.
    Position,
    /// A speed or flow.
    Velocity,
    /// An acceleration.
    Acceleration,
    /// A torque, force or pressure.
    Load,
    /// Volts.
    Volts,
    /// Time.
    Time,
}

/// A parameter of an effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// Name.
    pub name: String,
    /// Value in its unit.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// Parameters of an effect; the first is its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Values(pub Vec<Value>);

impl Values {
    pub(crate) fn of<const N: usize>(values: [(&str, f64, &str); N]) -> Self {
        Self(
            values
                .map(|(name, value, unit)| Value {
                    name: name.to_owned(),
                    value,
                    unit: unit.to_owned(),
                })
                .into(),
        )
    }

    /// The parameter of that name; NaN if there is none.
    pub fn get(&self, name: &str) -> f64 {
        self.0.iter().find(|value| value.name == name).map_or(f64::NAN, |value| value.value)
    }
}

/// An effect with its parameters, as in `truth.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Id.
    pub id: String,
    /// Site.
    pub site: Site,
    /// Parameters.
    pub parameters: Values,
    /// Variables on any of which a function may be said to describe it.
    pub depends_on: Vec<Variable>,
    /// Whether it is of the catalogue.
    pub listed: bool,
}

/// One effect at one site, before its parameters are drawn.
pub struct Entry {
    /// Id.
    pub id: &'static str,
    /// Site.
    pub site: Site,
    /// Variables on any of which a function may be said to describe it.
    pub depends_on: &'static [Variable],
    draw: fn(&mut Draw, Site) -> Values,
    build: fn(&Values, Site) -> Box<dyn Deviation>,
}

impl Entry {
    /// Whether it is of the catalogue.
    pub fn listed(&self) -> bool {
        LISTED.iter().any(|rows| rows.iter().any(|entry| entry.id == self.id))
    }

    /// Draws its parameters.
    pub fn draw(&self, draw: &mut Draw) -> Effect {
        Effect {
            id: self.id.to_owned(),
            site: self.site,
            parameters: (self.draw)(draw, self.site),
            depends_on: self.depends_on.to_vec(),
            listed: self.listed(),
        }
    }
}

const LISTED: [&[Entry]; 5] =
    [line::ENTRIES, friction::ENTRIES, torque::ENTRIES, drive::ENTRIES, sensor::ENTRIES];
const UNLISTED: [&[Entry]; 4] = [
    unlisted_drive::ENTRIES,
    unlisted_side::ENTRIES,
    unlisted_line::ENTRIES,
    unlisted_sensor::ENTRIES,
];
const HOLDOUT: [&[Entry]; 4] =
    [holdout_drive::ENTRIES, holdout_side::ENTRIES, holdout_line::ENTRIES, holdout_sensor::ENTRIES];

/// The unlisted effects from which a campaign draws. The numbers drawn for a case do not depend on
/// it, so that a case of the old kinds is the same whether there are new ones or not.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Kinds {
    /// Those of earlier campaigns.
    Old,
    /// The hold-out: those that were not in earlier campaigns.
    New,
    /// First the old ones, then the new ones.
    #[default]
    All,
}

impl Kinds {
    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Old => "old",
            Self::New => "new",
            Self::All => "all",
        }
    }
}

/// All listed entries: first every id at its first site, then the further sites.
pub fn listed() -> Vec<&'static Entry> {
    let all = || LISTED.into_iter().flatten();
    let first = |entry: &&Entry| {
        all().find(|other| other.id == entry.id).is_some_and(|other| other.site == entry.site)
    };
    all().filter(first).chain(all().filter(|entry| !first(entry))).collect()
}

/// Listed entries that may be combined with others: another effect at another site.
pub fn beside(chosen: &[&Entry]) -> Vec<&'static Entry> {
    let apart = |other: &&Entry| {
        chosen.iter().all(|entry| other.site != entry.site && other.id != entry.id)
    };
    listed().into_iter().filter(apart).collect()
}

/// All unlisted entries of these kinds, sites mixed.
pub fn unlisted(kinds: Kinds) -> Vec<&'static Entry> {
    match kinds {
        Kinds::Old => mixed(UNLISTED),
        Kinds::New => mixed(HOLDOUT),
        Kinds::All => [mixed(UNLISTED), mixed(HOLDOUT)].concat(),
    }
}

fn mixed(rows: [&'static [Entry]; 4]) -> Vec<&'static Entry> {
    let longest = rows.iter().map(|rows| rows.len()).max().unwrap_or(0);
    (0..longest)
        .flat_map(|index| rows.into_iter().filter_map(move |rows| rows.get(index)))
        .collect()
}

/// The entry of a name `ID@SITE`, or the first one of `ID`.
pub fn find(name: &str) -> Option<&'static Entry> {
    let (id, site) = name.split_once('@').map_or((name, None), |(id, site)| (id, Some(site)));
    let of_name =
        |entry: &&Entry| entry.id == id && site.is_none_or(|site| entry.site.name() == site);
    listed().into_iter().chain(unlisted(Kinds::All)).find(of_name)
}

impl Effect {
    /// Its deviation; `None` if the effect is unknown or a parameter is missing.
    pub fn build(&self) -> Option<Box<dyn Deviation>> {
        let entry = LISTED
            .into_iter()
            .chain(UNLISTED)
            .chain(HOLDOUT)
            .flatten()
            .find(|entry| entry.id == self.id && entry.site == self.site)?;
        let whole = self.parameters.0.iter().all(|value| value.value.is_finite());
        whole.then(|| (entry.build)(&self.parameters, self.site))
    }

    /// `ID@SITE`.
    pub fn name(&self) -> String {
        format!("{}@{}", self.id, self.site.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of the interface.
    const TABLE: &[(&str, &[&str])] = &[
        ("line_compliance", &["line"]),
        ("nonlinear_stiffness", &["line", "slave"]),
        ("viscoelastic_line", &["line"]),
        ("leakage", &["line"]),
        ("backlash", &["line", "master", "slave"]),
        ("transport_delay", &["line", "drive", "sensor"]),
        ("line_damping", &["line"]),
        ("coulomb_friction", &["master", "slave"]),
        ("viscous_friction", &["master", "slave"]),
        ("quadratic_drag", &["master", "slave"]),
        ("stribeck_friction", &["master", "slave"]),
        ("asymmetric_friction", &["master", "slave"]),
        ("position_dependent_friction", &["master", "slave"]),
        ("load_dependent_friction", &["master", "slave"]),
        ("presliding_hysteresis", &["master", "slave"]),
        ("gravity_imbalance", &["master", "slave"]),
        ("extra_inertia", &["master", "slave"]),
        ("hand_impedance", &["slave"]),
        ("torque_ripple", &["drive"]),
        ("amplifier_saturation", &["drive"]),
        ("amplifier_deadzone", &["drive"]),
        ("amplifier_lag", &["drive"]),
        ("thermal_drift", &["master", "slave", "line"]),
        ("periodic_disturbance", &["slave", "master"]),
        ("encoder_eccentricity", &["sensor"]),
        ("sensor_offset", &["sensor"]),
        ("sensor_gain", &["sensor"]),
        ("sensor_drift", &["sensor"]),
        ("sensor_crosstalk", &["sensor"]),
        ("mains_hum", &["sensor"]),
        ("rectified_sensor", &["sensor"]),
    ];

    #[test]
    fn every_listed_effect_at_every_site_once() {
        let mut found: Vec<String> =
            listed().iter().map(|entry| format!("{}@{}", entry.id, entry.site.name())).collect();
        let mut expected: Vec<String> = TABLE
            .iter()
            .flat_map(|(id, sites)| sites.iter().map(move |site| format!("{id}@{site}")))
            .collect();
        found.sort();
        expected.sort();
        assert_eq!(found, expected);
        let first: std::collections::BTreeSet<&str> =
            listed()[..TABLE.len()].iter().map(|entry| entry.id).collect();
        assert_eq!(first.len(), TABLE.len(), "each id once before any second site");
    }

    #[test]
    fn unlisted_effects_are_not_listed_and_cover_every_site() {
        for kinds in [Kinds::Old, Kinds::New] {
            let entries = unlisted(kinds);
            assert!(entries.len() >= 8);
            for site in ["drive", "master", "line", "slave", "sensor"] {
                assert!(entries.iter().any(|entry| entry.site.name() == site), "{kinds:?}: {site}");
            }
            for entry in entries {
                assert!(
                    TABLE.iter().all(|(id, _)| *id != entry.id) && !entry.listed(),
                    "{}",
                    entry.id
                );
                assert!(!entry.depends_on.is_empty(), "{}", entry.id);
            }
        }
        let ids: std::collections::BTreeSet<&str> =
            unlisted(Kinds::All).iter().map(|entry| entry.id).collect();
        assert_eq!(ids.len(), unlisted(Kinds::All).len(), "each id once");
    }

    #[test]
    fn every_effect_can_be_drawn_and_built() {
        for entry in listed().into_iter().chain(unlisted(Kinds::All)) {
            for seed in 0..20 {
                let effect = entry.draw(&mut Draw::new(seed));
                assert!(effect.build().is_some(), "{} {:?}", effect.name(), effect.parameters);
                let again: Effect =
                    serde_json::from_str(&serde_json::to_string(&effect).unwrap()).unwrap();
                assert_eq!(again, effect);
            }
            let name = format!("{}@{}", entry.id, entry.site.name());
            assert_eq!(find(&name).unwrap().site, entry.site);
        }
        assert!(find("no_such_effect").is_none());
    }
}
