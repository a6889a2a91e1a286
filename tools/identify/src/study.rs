//! From a rig file and records to the verdict: what the command line and other programs call.

use std::path::Path;

use recording::record::{self, ColumnNames, SampleColumns};
use report::Page;
use rig::{AxisUnit, RigFile};

use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::models::{Options, RigCapability, of_kind};
use crate::outcome::Outcome;

/// What an identification says.
#[derive(Debug)]
pub struct Studied {
    /// The result.
    pub outcome: Outcome,
    /// Its page.
    pub page: Page,
    /// The verdict as a sentence.
    pub sentence: String,
    /// How far it holds.
    pub detail: String,
}

/// How the work is done.
#[derive(Clone, Copy, Debug)]
pub struct How {
    /// Candidates fitted at a time.
    pub jobs: usize,
    /// Seed of the split into blocks, and of simulated machines.
    pub seed: u64,
    /// Whether the next experiment is to be found by simulating what the rig can play.
    pub propose: bool,
    /// Simulated machines that are searched to tell what is found from chance.
    pub calibrate: usize,
}

impl Default for How {
    /// On all processors, without a proposal or simulated machines.
    fn default() -> Self {
        let jobs = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { jobs, seed: 1, propose: false, calibrate: 0 }
    }
}

/// Holds the model that a rig file declares against records.
///
/// Effects that the file declares take no part: which there are is asked anew of these records.
///
/// # Errors
/// Where the rig file has several axes or a model of no such kind, or the data cannot be used.
pub fn study(rig: &RigFile, records: &[Series], how: How) -> Result<Studied> {
    let started = std::time::Instant::now();
    let file = rig.file_name().to_owned();
    let [axis] = rig.axes.as_slice() else {
        return Err(IdentifyError::Axes { file, axes: rig.axes.len() });
    };
    let model = of_kind(rig.model.kind);
    let gear = axis.master.turns_per_handle_turn;
    let slave_count_rad = axis.slave.map(|encoder| 1.0 / encoder.counts_per_unit);
    let capability = RigCapability::of(rig);
    if how.calibrate > 0 && capability.is_none() {
        let (kind, unit) = (rig.model.kind.name().to_owned(), axis.unit.symbol());
        return Err(IdentifyError::NotSimulated { file, kind, unit });
    }
    let options = Options {
        jobs: how.jobs,
        seed: how.seed,
        gear,
        slave_count_rad,
        capability,
        propose: how.propose,
        calibrate: how.calibrate,
    };
    let begun = from_the_first(records);
    let records = begun.as_deref().unwrap_or(records);
    let (mut outcome, page) = model.identify(&file, &rig.axis_model(axis), records, options)?;
    let (sentence, detail) = model.sentences(&outcome);
    if !rig.model.effects.is_empty() {
        let names: Vec<String> =
            rig.model.effects.iter().map(|own| format!("{}@{}", own.id, own.site)).collect();
        outcome.notes.push(format!(
            "{file} declares {} already: it took no part, since which effects there are is asked anew of these records",
            names.join(", ")
        ));
    }
    outcome.seconds = started.elapsed().as_secs_f64();
    Ok(Studied { outcome, page, sentence, detail })
}

/// Records whose time begins with the first of them: what drifts begins when somebody starts to
/// record, not when a clock did. `None` where it does already.
fn from_the_first(records: &[Series]) -> Option<Vec<Series>> {
    let times = records.iter().filter_map(|record| record.column(record::TIME)?.first().copied());
    let first =
        times.filter(|first| first.is_finite()).reduce(f64::min).filter(|first| *first != 0.0)?;
    let mut records = records.to_vec();
    let columns = records.iter_mut().flat_map(|record| &mut record.columns);
    for (_, time) in columns.filter(|(name, _)| name == record::TIME) {
        time.iter_mut().for_each(|time| *time -= first);
    }
    Some(records)
}

/// Reads a recording of farreach's (`.mcap`) or a CSV file for a rig. The reader refuses holes,
/// gaps and time that runs backwards; what it merely finds odd goes into the notes.
///
/// # Errors
/// [`IdentifyError::Read`], with file, row and column.
pub fn read(path: &Path, rig: &RigFile) -> Result<Series> {
    read_mapped(path, rig, &record::Options::default())
}

/// The same of a file that names its columns otherwise, or of another program's recording; its rows
/// may be brought to another rate.
///
/// # Errors
/// As [`read`].
pub fn read_mapped(path: &Path, rig: &RigFile, options: &record::Options) -> Result<Series> {
    let turns = rig.axes.first().is_some_and(|axis| axis.unit == AxisUnit::Radian);
    let names = match (rig.model.kind.is_transmission(), turns) {
        (true, _) => ColumnNames::rotary(),
        (false, true) => ColumnNames::one_mass_rotary(),
        (false, false) => ColumnNames::one_mass_linear(),
    };
    let file = path.display().to_string();
    let mcap = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let read = match (mcap, options.mapping.is_empty()) {
        (false, _) => record::from_csv(path, options),
        (true, true) => record::from_mcap(path, &SampleColumns::new(names), options),
        (true, false) => record::from_topics(path, options),
    };
    let record = read.map_err(|e| IdentifyError::Read(e.to_string()))?;
    let notes = record
        .findings
        .iter()
        .map(|f| format!("{file}, from row {}, column `{}`: {}", f.first_row, f.column, f.text))
        .collect();
    let mut columns = vec![(record::TIME.to_owned(), record.time_s)];
    columns.extend(record.columns);
    Ok(Series { file, columns, role: None, notes })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn time_begins_with_the_first_record() {
        let series = |from: f64| Series {
            columns: vec![
                ("t_s".to_owned(), vec![from, from + 0.5]),
                ("force_n".to_owned(), vec![7.0, 8.0]),
            ],
            ..Series::default()
        };
        let shifted = from_the_first(&[series(1.7e9 + 20.0), series(1.7e9)]).unwrap();
        let of = |index: usize, name: &str| shifted[index].column(name).unwrap().to_vec();
        assert_eq!((of(0, "t_s"), of(1, "t_s")), (vec![20.0, 20.5], vec![0.0, 0.5]));
        assert_eq!(of(0, "force_n"), [7.0, 8.0]);
        assert!(from_the_first(&[series(0.0), series(3.0)]).is_none(), "it begins at 0 already");
    }

    #[test]
    fn what_the_reader_finds_odd_is_told_with_row_and_column() {
        let rig =
            RigFile::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/emps.toml"))
                .unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dead.csv");
        let rows: String = (0..200)
            .map(|row| format!("{},1.5,{}\n", f64::from(row) * 1e-3, (f64::from(row) * 0.1).sin()))
            .collect();
        std::fs::write(&path, format!("t_s,force_n,position_m\n{rows}")).unwrap();
        let series = read(&path, &rig).unwrap();
        let [note] = &series.notes[..] else { panic!("{:?}", series.notes) };
        assert!(
            note.contains("dead.csv, from row") && note.contains("`force_n`: never changes: 1.5"),
            "{note}"
        );
    }

    #[test]
    fn machines_are_simulated_of_transmissions_that_turn() {
        for kind in ["emps", "silverbox", "element"] {
            let path = format!("{}/../../launch/rigs/{kind}.toml", env!("CARGO_MANIFEST_DIR"));
            let rig = RigFile::load(path).unwrap();
            let error =
                study(&rig, &[], How { calibrate: 19, ..How::default() }).unwrap_err().to_string();
            assert!(
                error.contains("--calibrate") && error.contains("leave --calibrate out"),
                "{error}"
            );
            assert!(
                error.contains(rig.file_name()) && error.contains(rig.model.kind.name()),
                "{error}"
            );
        }
    }
}
