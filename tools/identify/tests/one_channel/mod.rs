//! What the tests of models of one channel share.
#![allow(dead_code, reason = "each test file uses its part")]

use identify::deadline::{Deadline, NEVER};
use identify::error::IdentifyError;
use identify::input::Series;
use identify::models::{Options, of_kind};
use identify::outcome::{Outcome, Verdict};

/// A generator good enough for noise (xorshift64*), summed to be nearly normal.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

pub(crate) fn series<const N: usize>(file: &str, columns: [(&str, Vec<f64>); N]) -> Series {
    let columns = columns.into_iter().map(|(name, values)| (name.to_owned(), values)).collect();
    Series { file: file.to_owned(), columns, role: None, notes: Vec::new() }
}

pub(crate) fn parameter(
    name: &str,
    value: f64,
    tolerance: f64,
    absolute: Option<f64>,
) -> rig::Parameter {
    let source = rig::ParameterSource::Assumed;
    rig::Parameter { name: name.into(), value, tolerance, tolerance_absolute: absolute, source }
}

pub(crate) fn rig(kind: rig::ModelKind, parameters: Vec<rig::Parameter>) -> rig::Model {
    rig::Model { kind, force: None, parameters, effects: Vec::new(), handle_coupling: Vec::new() }
}

pub(crate) fn run(model: &rig::Model, records: &[Series]) -> Result<Outcome, IdentifyError> {
    run_until(&NEVER, model, records).map(|(outcome, _)| outcome)
}

/// Options of a machine with one axis.
pub(crate) fn options(deadline: &Deadline) -> Options<'_> {
    Options {
        seed: 1,
        gear: 1.0,
        slave_zero_rad: None,
        axis: None,
        others: &[],
        capability: None,
        propose: false,
        calibrate: 0,
        deadline,
    }
}

/// The outcome, and the text of its page, which every outcome must make.
pub(crate) fn run_until(
    deadline: &Deadline,
    model: &rig::Model,
    records: &[Series],
) -> Result<(Outcome, String), IdentifyError> {
    let options = options(deadline);
    let (outcome, page) = of_kind(model.kind).identify("rig.toml", model, records, options)?;
    Ok((outcome, page.render().unwrap()))
}

pub(crate) fn ids(outcome: &Outcome) -> Vec<&str> {
    outcome.effects.iter().map(|e| e.id.as_str()).collect()
}

/// Value and standard deviation of a parameter of an effect.
pub(crate) fn effect(outcome: &Outcome, name: &str) -> (f64, f64) {
    let all = outcome.effects.iter().flat_map(|e| &e.parameters);
    all.filter(|p| p.name == name).map(|p| (p.value, p.std.unwrap_or(f64::NAN))).next().unwrap()
}

/// A parameter of an effect is within this share of the truth.
pub(crate) fn close(outcome: &Outcome, name: &str, truth: f64, share: f64) {
    let (value, std) = effect(outcome, name);
    assert!((value - truth).abs() < share * truth.abs(), "{name}: {value} ± {std}, true {truth}");
}

/// The effect is the only one, and the error that is left in the channel is less than so much.
pub(crate) fn only(outcome: &Outcome, id: &str, (channel, most): (&str, f64)) {
    let (found, rivals) = (ids(outcome), &outcome.ambiguous_with);
    assert_eq!(outcome.verdict, Verdict::Effect, "{found:?} {rivals:?} {:#?}", outcome.candidates);
    assert_eq!(found, [id], "{:#?}", outcome.candidates);
    let error = &outcome.error[channel];
    assert!(error.after < most, "{error:?}");
}

/// A record measured by others, from beside the project; `None`, said loudly, where it is absent.
pub(crate) fn measured(name: &str) -> Option<Series> {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    if !path.exists() {
        eprintln!(
            "SKIPPED: {} is not there; the measured record took no part in this test",
            path.display()
        );
        return None;
    }
    let read = recording::record::from_csv(&path, &recording::record::Options::default()).unwrap();
    let mut columns = vec![("t_s".to_owned(), read.time_s)];
    columns.extend(read.columns);
    Some(Series { file: name.into(), columns, role: None, notes: Vec::new() })
}

/// The model of a shipped rig file.
pub(crate) fn shipped(name: &str) -> rig::Model {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch/rigs").join(name);
    rig::RigFile::load(path).unwrap().model
}
