//! From a rig file and records to the verdict: the entry point of the command line and of other
//! programs.

use std::collections::BTreeSet;
use std::path::Path;

use recording::mcap_read::Recording;
use recording::mcap_write::{START_RECORD, key};
use recording::record::{self, ColumnNames, Mapping, SampleColumns};
use report::Page;
use rig::{Axis, AxisUnit, Encoder, Model as Declared, ModelEffect, RigFile};

use crate::chosen_axis::own_columns;
use crate::deadline::Deadline;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::models::{DeclaredFit, Options, RigCapability, of_kind, sentences};
use crate::outcome::Outcome;
use crate::prediction_error::other_axes::OtherAxis;

/// Result of an identification with its page.
#[derive(Debug)]
pub struct Identification {
    /// The result.
    pub outcome: Outcome,
    /// Its page.
    pub page: Page,
    /// The verdict as a sentence.
    pub sentence: String,
    /// A sentence on the errors.
    pub detail: String,
}

/// Options of an identification.
#[derive(Clone, Copy, Debug)]
pub struct StudyOptions {
    /// Threads.
    pub jobs: usize,
    /// Seed of the split into blocks, and of simulated machines.
    pub seed: u64,
    /// Whether the next experiment is designed by simulation.
    pub propose: bool,
    /// Replicates of the parametric bootstrap.
    pub calibrate: usize,
    /// Time after which the best answer so far is given (s); `None` for no limit.
    pub limit_s: Option<f64>,
    /// Index of the axis that is identified, from 0 ([`chosen_axis`]).
    ///
    /// [`chosen_axis`]: crate::chosen_axis::chosen_axis
    pub axis: usize,
}

impl Default for StudyOptions {
    /// The first axis, on all processors, without a proposal, replicates and time limit.
    fn default() -> Self {
        let jobs = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { jobs, seed: 1, propose: false, calibrate: 0, limit_s: None, axis: 0 }
    }
}

/// Identifies the model that a rig file declares from records.
///
/// Effects that the file declares are ignored: they are selected from these records alone.
///
/// # Errors
/// If the data cannot be used.
pub fn study(rig: &RigFile, records: &[Series], how: StudyOptions) -> Result<Identification> {
    let started = std::time::Instant::now();
    let file = name_of(rig, how.axis);
    let (mut outcome, page) = with_model(rig, records, how, |file, declared, records, options| {
        of_kind(rig.model.kind).identify(file, declared, records, options)
    })?;
    let (_, sentence, detail) = sentences(&outcome, of_kind(rig.model.kind).is_located());
    let axis = rig.axes.get(how.axis);
    let declared: Vec<&ModelEffect> =
        rig.model.effects.iter().chain(axis.iter().flat_map(|axis| &axis.effects)).collect();
    if !declared.is_empty() {
        let names: Vec<String> =
            declared.iter().map(|own| format!("{}@{}", own.id, own.site)).collect();
        outcome.notes.push(format!(
            "{file} declares {} already: it is not used, since identify selects effects from these \
             records alone",
            names.join(", ")
        ));
    }
    outcome.seconds = started.elapsed().as_secs_f64();
    Ok(Identification { outcome, page, sentence, detail })
}

/// Fits the parameters that a rig file declares to records, without a search for effects.
///
/// # Errors
/// If the data cannot be used.
pub fn fit_declared(rig: &RigFile, records: &[Series], how: StudyOptions) -> Result<DeclaredFit> {
    with_model(rig, records, how, |file, declared, records, options| {
        of_kind(rig.model.kind).fit_declared(file, declared, records, options)
    })
}

/// The rig file as named in messages, with the axis if it has several.
fn name_of(rig: &RigFile, axis: usize) -> String {
    match rig.axes.get(axis).filter(|_| rig.axes.len() > 1) {
        Some(axis) => format!("{}, axis \"{}\"", rig.file_name(), axis.name),
        None => rig.file_name().to_owned(),
    }
}

/// Largest error of the slave encoder's zero against the master's (rad of the slave): a search for
/// the stops finds either to within one of its own counts.
fn slave_zero_error(rig: &RigFile, axis: &Axis) -> Option<f64> {
    let gear = axis.master.turns_per_handle_turn;
    let ratio = rig.model.transmission(rig.file_name()).map_or(1.0, |it| it.transmission_ratio());
    let counts = |encoder: &Encoder| 1.0 / encoder.counts_per_unit;
    Some(counts(axis.slave.as_ref()?) + gear * ratio * counts(&axis.master))
}

/// Passes name, declared model, records from time 0 and options to `work`, which runs on the
/// threads of `how`.
fn with_model<T: Send>(
    rig: &RigFile,
    records: &[Series],
    how: StudyOptions,
    work: impl FnOnce(&str, &Declared, &[Series], Options<'_>) -> Result<T> + Send,
) -> Result<T> {
    let started = std::time::Instant::now();
    let axis = rig.axes.get(how.axis);
    let several = axis.filter(|_| rig.axes.len() > 1).map(|axis| axis.name.as_str());
    let file = name_of(rig, how.axis);
    let gear = axis.map_or(1.0, |axis| axis.master.turns_per_handle_turn);
    let slave_zero_rad = axis.and_then(|axis| slave_zero_error(rig, axis));
    let capability = RigCapability::of(rig, how.axis);
    let others = OtherAxis::beside(rig, how.axis);
    if how.calibrate > 0 && capability.is_none() {
        return Err(IdentifyError::Unusable(format!(
            "{file}: --calibrate: expected a transmission with an axis in rad, found a model of \
             kind \"{}\" with an axis in {}; records of others are not simulated: leave \
             --calibrate out",
            rig.model.kind.name(),
            rig.unit().symbol()
        )));
    }
    let deadline = how.limit_s.map_or(Deadline::when(|| false), |limit_s| {
        Deadline::after(move || started.elapsed().as_secs_f64() / limit_s)
    });
    let options = Options {
        seed: how.seed,
        gear,
        slave_zero_rad,
        axis: several,
        others: &others,
        capability,
        propose: how.propose,
        calibrate: how.calibrate,
        deadline: &deadline,
    };
    let begun = from_the_first(records);
    let records = begun.as_deref().unwrap_or(records);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(how.jobs)
        .build()
        .map_err(|error| IdentifyError::Unusable(format!("no threads: {error}")))?;
    let declared = axis.map_or_else(|| rig.model.clone(), |axis| rig.axis_model(axis));
    pool.install(|| work(&file, &declared, records, options))
}

/// Refuses mappings to columns that the model does not have: they would leave out the intended one.
fn check_mapping(rig: &RigFile, others: &[OtherAxis], mapping: &[Mapping]) -> Result<()> {
    let model = of_kind(rig.model.kind);
    let mut columns: Vec<String> = model.columns().iter().map(|&name| name.to_owned()).collect();
    columns.extend(others.iter().map(OtherAxis::column));
    let unknown = mapping.iter().find(|own| !columns.contains(&own.column));
    unknown.map_or(Ok(()), |own| {
        Err(IdentifyError::Usage(format!(
            "--map {}=...: expected one of the columns {} of a model of kind \"{}\"; correct the \
             name on the left of the equals sign",
            own.column,
            columns.join(", "),
            rig.model.kind.name()
        )))
    })
}

/// A machine as described in messages; without axes its unit is that of its parameters.
fn machine(rig: &RigFile) -> String {
    let units: BTreeSet<&str> = match rig.axes.as_slice() {
        [] => [rig.unit().symbol()].into(),
        axes => axes.iter().map(|axis| axis.unit.symbol()).collect(),
    };
    let units: Vec<&str> = units.into_iter().collect();
    format!("`{}` (a model of kind {}, in {})", rig.name, rig.model.kind.name(), units.join(", "))
}

/// Checks that a recording of farreach was made on the machine of the rig file: its start records
/// hold the rig's name and file. Recordings of other programs and older rig files that can no
/// longer be read are not checked any further.
fn check_machine(path: &Path, rig: &RigFile) -> Result<()> {
    let recording =
        Recording::open(path).map_err(|error| IdentifyError::Unusable(error.to_string()))?;
    let starts = recording.metadata_records.iter().filter(|(name, _)| name == START_RECORD);
    for (_, start) in starts {
        let text = start.get(key::RIG_FILE).and_then(|text| RigFile::parse(text, "rig_file").ok());
        let found = match (&text, start.get(key::RIG)) {
            (Some(recorded), _) => machine(recorded),
            (None, Some(name)) if *name != rig.name => format!("`{name}`"),
            _ => continue,
        };
        if found != machine(rig) {
            return Err(IdentifyError::Unusable(format!(
                "{}: expected a recording of {} (by {}), found one of {found}; give the rig file \
                 of the machine that was recorded, or, if it is the same machine, give both rig \
                 files the same name, kind and unit",
                path.display(),
                machine(rig),
                rig.file_name()
            )));
        }
    }
    Ok(())
}

/// Shifts the records' time to begin with the first of them, since drifts are relative to the start
/// of recording. `None` if it begins at 0 already.
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

/// Reads a recording of farreach's (`.mcap`) or a CSV file for a rig. The reader refuses missing
/// values, gaps and time that runs backwards; its remarks go into the notes.
///
/// # Errors
/// [`IdentifyError::Unusable`], with file, row and column.
pub fn read(path: &Path, rig: &RigFile) -> Result<Series> {
    read_mapped(path, rig, 0, &record::Options::default())
}

/// As [`read`] for an axis of the rig, for files with other column names and for recordings of
/// other programs; rows may be resampled.
///
/// Of the other axes, the positions of the slaves are read where they were recorded.
///
/// # Errors
/// As [`read`].
pub fn read_mapped(
    path: &Path,
    rig: &RigFile,
    axis: usize,
    options: &record::Options,
) -> Result<Series> {
    let names = match (rig.model.kind.is_transmission(), rig.unit()) {
        (true, _) => ColumnNames::rotary(),
        (false, AxisUnit::Radian) => ColumnNames::one_mass_rotary(),
        (false, AxisUnit::Metre) => ColumnNames::one_mass_linear(),
    };
    let others = OtherAxis::beside(rig, axis);
    check_mapping(rig, &others, &options.mapping)?;
    let file = path.display().to_string();
    let mcap = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    if mcap {
        check_machine(path, rig)?;
    }
    let read = match (mcap, options.mapping.is_empty()) {
        (false, _) => record::from_csv(path, options),
        (true, true) => {
            let slave = |other: &OtherAxis| (other.index, ColumnNames::slave_only(other.column()));
            let others = others.iter().map(slave);
            let columns =
                SampleColumns { axis, others: others.collect(), ..SampleColumns::new(names) };
            record::from_mcap(path, &columns, options)
        }
        (true, false) => record::from_topics(path, options),
    };
    let record = read.map_err(|e| IdentifyError::Unusable(e.to_string()))?;
    let notes = record
        .findings
        .iter()
        .map(|f| format!("{file}, from row {}, column `{}`: {}", f.first_row, f.column, f.text))
        .collect();
    let mut columns = vec![(record::TIME.to_owned(), record.time_s)];
    columns.extend(record.columns);
    if let Some(axis) = rig.axes.get(axis) {
        own_columns(&file, &axis.name, of_kind(rig.model.kind).columns(), &mut columns)?;
    }
    Ok(Series { file, columns, role: None, notes })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use recording::mcap_write::{Start, Writer};

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
    fn the_slaves_zero_may_err_by_a_count_of_each_encoder() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/hydrostatic.toml");
        let mut rig = RigFile::load(path).unwrap();
        // 4000 counts a turn at either side; the slave turns 0.85 times as far as the master.
        let count_rad = std::f64::consts::TAU / 4000.0;
        let ratio = rig.model.transmission("").unwrap().transmission_ratio();
        let error = slave_zero_error(&rig, &rig.axes[0]).unwrap();
        assert!((error - count_rad * (1.0 + ratio)).abs() < 1e-12, "{error} rad, ratio {ratio}");
        rig.axes[0].slave = None;
        assert!(slave_zero_error(&rig, &rig.axes[0]).is_none());
    }

    #[test]
    fn remarks_of_the_reader_have_row_and_column() {
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

    fn rig(name: &str) -> RigFile {
        let path = format!("{}/../../launch/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        RigFile::load(path).unwrap()
    }

    #[test]
    fn a_recording_of_another_machine_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let hydrostatic = rig("hydrostatic");
        let start = Start::default()
            .with(key::RIG, &hydrostatic.name)
            .with(key::RIG_FILE, hydrostatic.text());
        Writer::create(&path, &start, 0).unwrap().finish(&[]).unwrap();
        let error = read(&path, &rig("emps")).unwrap_err().to_string();
        for part in ["run.mcap", "emps.toml", "kind drive, in m", "kind hydrostatic, in rad"] {
            assert!(error.contains(part), "{part}: {error}");
        }
        // The same machine by another name is another one, too.
        let text = hydrostatic.text().replacen("name = \"hydrostatic\"", "name = \"second\"", 1);
        let second = RigFile::parse(&text, "second.toml").unwrap();
        assert!(read(&path, &second).unwrap_err().to_string().contains("`second`"));
        assert!(check_machine(&path, &hydrostatic).is_ok());
    }

    #[test]
    fn a_mapping_to_an_unknown_column_is_refused_with_the_known_ones() {
        let options = record::Options {
            mapping: vec!["slave_tourqe_nm=torque".parse().unwrap()],
            ..record::Options::default()
        };
        let error =
            read_mapped(Path::new("run.csv"), &rig("hydrostatic"), 0, &options).unwrap_err();
        assert!(matches!(error, IdentifyError::Usage(_)), "{error}");
        let text = error.to_string();
        assert!(text.contains("slave_tourqe_nm") && text.contains("slave_torque_nm"), "{text}");
    }

    #[test]
    fn only_rotary_transmissions_are_simulated_for_calibrate() {
        for kind in ["emps", "silverbox", "element"] {
            let path = format!("{}/../../launch/rigs/{kind}.toml", env!("CARGO_MANIFEST_DIR"));
            let rig = RigFile::load(path).unwrap();
            let error = study(&rig, &[], StudyOptions { calibrate: 19, ..StudyOptions::default() })
                .unwrap_err()
                .to_string();
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
