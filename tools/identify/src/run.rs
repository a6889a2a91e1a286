//! Reads files, runs the identification, writes files.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};

use rig::RigFile;

use crate::Args;
use crate::chosen_axis::chosen_axis;
use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::outcome::{Outcome, RefusalKind};
use crate::outcome_tables::{short, what_is_left};
use crate::result_files::{kind_of, print, refuse, save, write_new};
use crate::study::{Identification, StudyOptions, read_mapped, study};
use crate::trend;
use crate::write_rig::{Provenance, fitted};

/// How often the spinner turns.
const TICK: std::time::Duration = std::time::Duration::from_millis(120);

/// Runs the command: prints the verdict, writes what was asked for. 0 when done whatever the
/// verdict, 1 when the data or the rig file cannot be used, 2 when the command line cannot (the
/// reason goes to stderr, and into the JSON file). A rig file that is written names `revision`,
/// that of the program.
///
/// # Errors
/// Where the page or the JSON file cannot be written.
pub fn run(args: Args, revision: &str) -> anyhow::Result<i32> {
    if let Some(folder) = &args.trend {
        return trend::run::run(&args, folder);
    }
    let asked =
        [("--write-rig", &args.write_rig), ("--propose-experiment", &args.propose_experiment)];
    let taken = asked
        .iter()
        .filter_map(|(option, path)| Some((option, path.as_ref()?)))
        .find(|(_, path)| path.exists());
    if let Some((option, path)) = taken {
        // Checked before the long computation.
        let why = "exists already and is not overwritten: name another file";
        let message = format!("{option}: {}: {why}", path.display());
        return Ok(refuse(args.json.as_deref(), RefusalKind::Unusable, message));
    }
    let (rig, studied) = match whole(&args) {
        Ok(result) => result,
        Err(error) => {
            return Ok(refuse(args.json.as_deref(), kind_of(&error), format!("{error:#}")));
        }
    };
    let Identification { outcome, page, sentence, detail } = studied;
    let json = serde_json::to_string_pretty(&outcome)?;
    // The result is saved before anything is printed, since the reader of the pipe may close it
    // (`| head`).
    save(args.json.as_deref(), &json)?;
    // Files are independent: if one cannot be written the others are.
    let (mut failed, mut told) = (None, Vec::new());
    if let Some(folder) = &args.report {
        let path = folder.join("index.html");
        let page = page
            .details("The result as written by --json", &json)
            .footer(concat!("farreach identify ", env!("CARGO_PKG_VERSION")));
        match page.write(&path) {
            Ok(()) => told.push(format!("page: {}", path.display())),
            Err(error) => failed = Some(error),
        }
    }
    if let Some(path) = &args.propose_experiment {
        failed = propose(path, &rig, &outcome, &mut told).err().or(failed);
    }
    let mut code = 0;
    if let Some(path) = &args.write_rig {
        let provenance = Provenance::today(revision);
        match write_rig(path, &rig, (&outcome, &provenance), &mut told) {
            Ok(wrote) => code = wrote,
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    let text = outcome_text(&outcome, &sentence, &detail) + &told.join("\n");
    print(args.json.as_deref(), &json, text.trim_end())?;
    for note in &outcome.notes {
        eprintln!("note: {note}");
    }
    failed.map_or(Ok(code), Err)
}

fn whole(args: &Args) -> anyhow::Result<(RigFile, Identification)> {
    let rig = rig::load_declaration(&args.rig)?;
    let axis = chosen_axis(&rig, args.axis.as_deref())?;
    let records = records(args, &rig, axis)?;
    // A spinner shows progress; nothing is drawn in a pipe.
    let bar = ProgressBar::new_spinner()
        .with_style(ProgressStyle::with_template("{spinner} {msg} {elapsed}")?)
        .with_message(format!("searching {} records for what the model lacks", records.len()));
    bar.enable_steady_tick(TICK);
    let how = StudyOptions {
        propose: args.propose_experiment.is_some(),
        calibrate: args.calibrate,
        ..args.study(axis)
    };
    let studied = study(&rig, &records, how);
    bar.finish_and_clear();
    Ok((rig, studied?))
}

/// Writes the protocol of the next experiment, or says why there is none.
fn propose(
    path: &Path,
    rig: &RigFile,
    outcome: &Outcome,
    told: &mut Vec<String>,
) -> anyhow::Result<()> {
    let Some(text) = &outcome.next_experiment.protocol else {
        let why = match rig.model.kind.is_transmission() {
            true if outcome.early => "the time limit passed before one was designed",
            true => "no movement that the rig can play by itself tells more; see next",
            false => "a rig of this kind plays no protocols here; see next",
        };
        told.push(format!("not written: no protocol: {why}"));
        return Ok(());
    };
    let protocol = rig::protocol::Protocol::parse(text, &path.display().to_string())?;
    protocol.check_against(rig)?;
    write_new(path, text).with_context(|| format!("{}: cannot be written", path.display()))?;
    let (file, seconds) = (path.display(), protocol.duration_s());
    told.push(format!("protocol: {file} ({seconds:.0} s; farreach run {file})"));
    Ok(())
}

/// Writes the rig file whole or not at all, never over another.
fn write_rig(
    path: &Path,
    rig: &RigFile,
    (outcome, provenance): (&Outcome, &Provenance),
    told: &mut Vec<String>,
) -> anyhow::Result<i32> {
    let written = match fitted(rig.text(), rig.file_name(), outcome, provenance) {
        Ok(written) => written,
        Err(error) => {
            eprintln!("error: --write-rig: {error}");
            return Ok(1);
        }
    };
    if let Some(text) = &written.text {
        write_new(path, text).with_context(|| format!("{}: cannot be written", path.display()))?;
        told.push(format!("rig file: {} ({})", path.display(), written.told));
    }
    told.extend(written.left_out.iter().map(|what| format!("not written: {what}")));
    Ok(0)
}

/// All records with the roles fixed on the command line.
fn records(args: &Args, rig: &RigFile, axis: usize) -> Result<Vec<Series>> {
    let mut asked: Vec<(&PathBuf, Option<Role>)> = Vec::new();
    for (paths, role) in
        [(&args.fit, Role::Fit), (&args.select, Role::Select), (&args.report_on, Role::Report)]
    {
        asked.extend(paths.iter().map(|p| (p, Some(role))));
    }
    // Two paths of the same file count as one; missing files are reported when they are read.
    let real = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    for (i, (path, _)) in asked.iter().enumerate() {
        if asked[..i].iter().any(|(other, _)| real(other) == real(path)) {
            return Err(IdentifyError::Unusable(format!(
                "{} has two roles; a record that fits or selects must not report: give each record \
                 one role",
                path.display()
            )));
        }
    }
    let fixed = !asked.is_empty();
    for path in &args.records {
        if asked.iter().all(|(other, _)| real(other) != real(path)) {
            asked.push((path, None));
        }
    }
    if fixed {
        share_out(&mut asked)?;
    }
    let options = args.reading();
    asked
        .into_iter()
        .map(|(path, role)| Ok(Series { role, ..read_mapped(path, rig, axis, &options)? }))
        .collect()
}

/// Assigns the roles that are not taken to records without one.
fn share_out(asked: &mut [(&PathBuf, Option<Role>)]) -> Result<()> {
    let played = |role| asked.iter().any(|(_, r)| *r == Some(role));
    let missing: Vec<Role> =
        [Role::Select, Role::Report, Role::Fit].into_iter().filter(|role| !played(*role)).collect();
    let free = asked.iter().filter(|(_, r)| r.is_none()).count();
    if free < missing.len() {
        let names: Vec<String> = missing.iter().map(|r| format!("{r:?}").to_lowercase()).collect();
        return Err(IdentifyError::Unusable(format!(
            "no record is left to {}; name records with --fit, --select and --report-on, or give \
             more of them",
            names.join(", ")
        )));
    }
    let mut left = free;
    for slot in asked.iter_mut().filter(|(_, r)| r.is_none()) {
        // The last records take the missing roles; the others fit.
        let from_end = left;
        left -= 1;
        slot.1 = Some(missing.get(from_end - 1).copied().unwrap_or(Role::Fit));
    }
    Ok(())
}

/// The result as text for a reader.
fn outcome_text(outcome: &Outcome, sentence: &str, detail: &str) -> String {
    let mut text = format!("{sentence}\n{detail}\n");
    for s in &outcome.steps {
        text += &format!(
            "  {:32} {:6.2} % held out, {:6.2} % all rows\n",
            s.model, s.report_percent, s.all_rows_percent
        );
    }
    for p in &outcome.parameters {
        let std = p.std.map_or("–".to_owned(), short);
        let remark = match p.remark() {
            remark if remark.is_empty() => remark,
            remark => format!(" ({remark})"),
        };
        text += &format!("  {:32} {:>10} ± {std} {}{remark}\n", p.name, short(p.fitted), p.unit);
    }
    for (effect, p) in outcome.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)))
    {
        let name = format!("{}: {}", effect.id, p.name);
        text += &format!(
            "  {name:32} {:>10} ± {} {}\n",
            short(p.value),
            p.std.map_or("–".to_owned(), short),
            p.unit
        );
    }
    for l in &outcome.left {
        let (what, size) = (what_is_left(l), short(l.size));
        text += &format!(
            "  left: {what:32} {size:>10} {} rms, {:.1} % of the error\n",
            l.unit, l.gain_percent
        );
    }
    text += &format!("next: {}\n", outcome.next_experiment.what);
    text
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn arguments(rig: PathBuf) -> Args {
        Args {
            rig,
            records: Vec::new(),
            axis: None,
            map: Vec::new(),
            resample: None,
            report: None,
            json: None,
            write_rig: None,
            propose_experiment: None,
            calibrate: 0,
            limit_s: None,
            jobs: None,
            seed: 1,
            fit: Vec::new(),
            select: Vec::new(),
            report_on: Vec::new(),
            trend: None,
            effects: false,
        }
    }

    #[test]
    fn a_refusal_is_written_for_programs() {
        let folder = tempfile::tempdir().unwrap();
        let json = folder.path().join("deep").join("identify.json");
        let record = folder.path().join("short.csv");
        std::fs::write(&record, "t_s,force_n,position_m\n0,0,0\n").unwrap();
        let emps = || PathBuf::from("emps");
        let refused = |args: Args| {
            let args = Args { json: Some(json.clone()), ..args };
            let code = run(args, "1a2b3c4").unwrap();
            let text = std::fs::read_to_string(&json).unwrap();
            let said: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert!(said["verdict"].is_null(), "{text}");
            let refused = &said["refused"];
            let word = |key: &str| refused[key].as_str().unwrap().to_owned();
            (code, word("kind"), word("message"))
        };

        let (code, kind, message) =
            refused(Args { records: vec![record.clone()], ..arguments(emps()) });
        assert_eq!((code, kind.as_str()), (1, "unusable"));
        assert!(message.contains("short.csv"), "{message}");

        // It replaces what an earlier run wrote.
        let (code, kind, message) =
            refused(Args { records: vec![record.clone()], ..arguments(PathBuf::from("nowhere")) });
        assert_eq!((code, kind.as_str()), (2, "usage"));
        assert!(message.contains("nowhere"), "{message}");

        let taken = Some(record.clone());
        let (code, kind, message) =
            refused(Args { records: vec![record], write_rig: taken, ..arguments(emps()) });
        assert_eq!((code, kind.as_str()), (1, "unusable"));
        assert!(message.starts_with("--write-rig"), "{message}");
        // Nothing else is left beside it.
        assert_eq!(std::fs::read_dir(json.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn one_file_by_two_paths_does_not_have_two_roles() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let rows: String = (0..20).map(|row| format!("{row},{},{}\n", row % 3, row % 5)).collect();
        std::fs::write(&path, format!("t_s,force_n,position_m\n{rows}")).unwrap();
        let other = folder.path().join(".").join("a.csv");
        let rig =
            PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/rigs/emps.toml"));
        let args = Args {
            fit: vec![path.clone()],
            report_on: vec![other.clone()],
            ..arguments(rig.clone())
        };
        let rig = RigFile::load(rig).unwrap();
        let text = records(&args, &rig, 0).unwrap_err().to_string();
        assert!(text.contains("has two roles"), "{text}");
        // Given twice without a role it is one record.
        let args =
            Args { fit: Vec::new(), report_on: Vec::new(), records: vec![path, other], ..args };
        assert_eq!(records(&args, &rig, 0).unwrap().len(), 1);
    }
}
