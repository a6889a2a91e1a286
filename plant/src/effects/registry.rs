//! Effects by name.

use super::{Effect, Site};
use crate::ParameterError;

/// A site of an effect, with the size that is used where none is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The site.
    pub site: Site,
    /// Default size.
    pub size: f64,
    /// Unit of the size.
    pub unit: &'static str,
}

/// One effect of [`LIST`].
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name.
    pub id: &'static str,
    /// Where it may act; the first is meant where none is named.
    pub sites: &'static [Place],
    /// What it is.
    pub what: &'static str,
    build: fn(Site) -> Box<dyn Effect>,
}

/// `ID[@SITE][=SIZE]` could not be understood.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// No such effect.
    #[error("no effect `{id}`; known: {known}")]
    Unknown {
        /// What was asked for.
        id: String,
        /// All names.
        known: String,
    },
    /// The effect does not act there.
    #[error("effect `{id}` does not act at `{site}`; expected one of: {allowed}")]
    WrongSite {
        /// The effect.
        id: &'static str,
        /// What was asked for.
        site: String,
        /// Where it may act.
        allowed: String,
    },
    /// The size is no number.
    #[error("size of effect `{id}`: expected a number in {unit}, found `{found}`")]
    NotANumber {
        /// The effect.
        id: &'static str,
        /// What was found.
        found: String,
        /// The unit of the size.
        unit: &'static str,
    },
    /// The size is out of range.
    #[error("size of effect `{id}`: {error}")]
    Size {
        /// The effect.
        id: &'static str,
        /// What is wrong.
        error: ParameterError,
    },
}

macro_rules! list {
    ($($id:literal $type:path [$($site:ident $size:literal $unit:literal),+] $what:literal;)+) => {
        /// Every effect, in the order of its kind. Names and sites are an interface.
        pub const LIST: &[Entry] = &[$(Entry {
            id: $id,
            sites: &[$(Place { site: Site::$site, size: $size, unit: $unit }),+],
            what: $what,
            build: |site| Box::new(<$type>::at(site)),
        }),+];
    };
}

list! {
    "line_compliance" super::line_compliance::LineCompliance [Line 1.0 "1"]
        "more compliance in series than the fluid's (hose bulging, belts)";
    "nonlinear_stiffness" super::nonlinear_stiffness::NonlinearStiffness [Line 0.5 "1", Slave 0.5 "1"]
        "stiffening or softening of the line";
    "viscoelastic_line" super::viscoelastic_line::ViscoelasticLine [Line 0.5 "1"]
        "a relaxing branch (Maxwell): stiffness that decays with time";
    "leakage" super::leakage::Leakage [Line 1e-12 "m^3/(s Pa)"]
        "flow past the seals: slow creep under load";
    "backlash" super::backlash::Backlash [Line 1e-3 "m", Master 0.02 "rad", Slave 0.02 "rad"]
        "lost motion";
    "transport_delay" super::transport_delay::TransportDelay [Line 5e-3 "s", Drive 5e-3 "s", Sensor 5e-3 "s"]
        "dead time";
    "line_damping" super::line_damping::LineDamping [Line 20.0 "N s/m"]
        "damping beyond the declared";
    "coulomb_friction" super::coulomb_friction::CoulombFriction [Master 0.3 "N m", Slave 0.3 "N m"]
        "constant friction beyond the declared";
    "viscous_friction" super::viscous_friction::ViscousFriction [Master 0.05 "N m s/rad", Slave 0.05 "N m s/rad"]
        "friction proportional to speed";
    "quadratic_drag" super::quadratic_drag::QuadraticDrag [Master 0.005 "N m s^2/rad^2", Slave 0.005 "N m s^2/rad^2"]
        "drag with the square of speed";
    "stribeck_friction" super::stribeck_friction::StribeckFriction [Master 0.5 "N m", Slave 0.5 "N m"]
        "friction that is higher at rest and falls with speed";
    "asymmetric_friction" super::asymmetric_friction::AsymmetricFriction [Master 0.2 "N m", Slave 0.2 "N m"]
        "friction that differs by direction";
    "position_dependent_friction" super::position_dependent_friction::PositionDependentFriction [Master 0.3 "1", Slave 0.3 "1"]
        "friction that varies along the stroke";
    "load_dependent_friction" super::load_dependent_friction::LoadDependentFriction [Master 0.1 "1", Slave 0.1 "1"]
        "friction that grows with the transmitted torque";
    "presliding_hysteresis" super::presliding_hysteresis::PreslidingHysteresis [Master 0.5 "1", Slave 0.5 "1"]
        "bristles: friction that builds up over a small travel";
    "gravity_imbalance" super::gravity_imbalance::GravityImbalance [Master 0.2 "N m", Slave 0.2 "N m"]
        "a centre of mass off the axis";
    "extra_inertia" super::extra_inertia::ExtraInertia [Master 1e-3 "kg m^2", Slave 1e-3 "kg m^2"]
        "inertia beyond the declared";
    "hand_impedance" super::hand_impedance::HandImpedance [Slave 1.0 "N m/rad"]
        "spring, damper and mass of a hand that the model leaves out";
    "torque_ripple" super::torque_ripple::TorqueRipple [Drive 0.1 "N m"]
        "torque that varies with the motor's angle (cogging)";
    "amplifier_saturation" super::amplifier_saturation::AmplifierSaturation [Drive 2.0 "V"]
        "an amplifier that clips";
    "amplifier_deadzone" super::amplifier_deadzone::AmplifierDeadzone [Drive 0.1 "V"]
        "an amplifier that does nothing for small volts";
    "amplifier_lag" super::amplifier_lag::AmplifierLag [Drive 5e-3 "s"]
        "an amplifier that follows late";
    "thermal_drift" super::thermal_drift::ThermalDrift [Master 0.5 "1", Slave 0.5 "1", Line 0.5 "1"]
        "friction or viscosity that drifts with time on the run";
    "periodic_disturbance" super::periodic_disturbance::PeriodicDisturbance [Slave 0.2 "N m", Master 0.2 "N m"]
        "a vibration of fixed frequency";
    "encoder_eccentricity" super::encoder_eccentricity::EncoderEccentricity [Sensor 0.01 "rad"]
        "an encoder disc that does not run true";
    "sensor_offset" super::sensor_offset::SensorOffset [Sensor 0.1 "N m"]
        "a torque cell whose zero is off";
    "sensor_gain" super::sensor_gain::SensorGain [Sensor 0.1 "1"]
        "a torque cell whose scale is off";
    "sensor_drift" super::sensor_drift::SensorDrift [Sensor 0.01 "N m/s"]
        "a torque cell whose zero wanders";
    "sensor_crosstalk" super::sensor_crosstalk::SensorCrosstalk [Sensor 0.05 "N m/V"]
        "motor volts in the torque channel";
    "mains_hum" super::mains_hum::MainsHum [Sensor 0.05 "N m"]
        "mains frequency in the torque channel";
    "rectified_sensor" super::rectified_sensor::RectifiedSensor [Sensor 0.5 "1"]
        "a torque channel that loses its sign";
}

/// Makes an effect from `ID`, `ID@SITE`, `ID=SIZE` or `ID@SITE=SIZE`.
///
/// # Errors
/// [`EffectError`], which names what is known or allowed.
pub fn parse(text: &str) -> Result<Box<dyn Effect>, EffectError> {
    let (name, size) = match text.split_once('=') {
        Some((name, size)) => (name, Some(size.trim())),
        None => (text, None),
    };
    let (id, site) = match name.split_once('@') {
        Some((id, site)) => (id.trim(), Some(site.trim())),
        None => (name.trim(), None),
    };
    let entry = find(id)?;
    let place = match site {
        None => entry.sites[0],
        Some(site) => Site::from_name(site)
            .and_then(|site| entry.sites.iter().find(|place| place.site == site).copied())
            .ok_or_else(|| wrong_site(entry, site))?,
    };
    let size = match size {
        None => place.size,
        Some(size) => size.parse::<f64>().map_err(|_| EffectError::NotANumber {
            id: entry.id,
            found: size.to_owned(),
            unit: place.unit,
        })?,
    };
    build(entry, place.site, size)
}

/// Makes an effect at a site with a size in its own main unit.
///
/// # Errors
/// [`EffectError::Unknown`], [`EffectError::WrongSite`], [`EffectError::Size`].
pub fn make(id: &str, site: Site, size: f64) -> Result<Box<dyn Effect>, EffectError> {
    let entry = find(id)?;
    if !entry.sites.iter().any(|place| place.site == site) {
        return Err(wrong_site(entry, site.name()));
    }
    build(entry, site, size)
}

fn build(entry: &Entry, site: Site, size: f64) -> Result<Box<dyn Effect>, EffectError> {
    let mut effect = (entry.build)(site);
    let name = effect.infos()[0].name;
    effect.set(name, size).map_err(|error| EffectError::Size { id: entry.id, error })?;
    Ok(effect)
}

fn find(id: &str) -> Result<&'static Entry, EffectError> {
    LIST.iter().find(|entry| entry.id == id).ok_or_else(|| EffectError::Unknown {
        id: id.to_owned(),
        known: LIST.iter().map(|entry| entry.id).collect::<Vec<_>>().join(", "),
    })
}

fn wrong_site(entry: &Entry, site: &str) -> EffectError {
    EffectError::WrongSite {
        id: entry.id,
        site: site.to_owned(),
        allowed: entry.sites.iter().map(|place| place.site.name()).collect::<Vec<_>>().join(", "),
    }
}
