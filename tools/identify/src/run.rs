//! The thin edge: reads files, asks the model, writes files.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use recording::record::{ColumnNames, SampleColumns};

use crate::Args;
use crate::error::{IdentifyError, Result};
use crate::input::Series;
use crate::inverse::split::Role;
use crate::models::{ALL, Options};
use crate::outcome::Outcome;
use crate::page::{short, what_is_left};

/// Runs the command: prints the verdict, writes what was asked for. 0 when done whatever the verdict, 1 when the data or the
/// rig file cannot be used (the reason goes to stderr).
///
/// # Errors
/// Where the page or the JSON file cannot be written.
pub fn run(args: Args) -> anyhow::Result<i32> {
    let started = std::time::Instant::now();
    let (mut outcome, page, told) = match study(&args) {
        Ok(result) => result,
        Err(error) => {
            eprintln!("error: {error:#}");
            return Ok(1);
        }
    };
    outcome.seconds = started.elapsed().as_secs_f64();
    let json = serde_json::to_string_pretty(&outcome)?;
    print_outcome(&outcome, told);
    if let Some(path) = &args.json {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be created", folder.display()))?;
        }
        std::fs::write(path, &json).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    if let Some(folder) = &args.report {
        let path = folder.join("index.html");
        let page = page
            .details("The result as written by --json", &json)
            .footer(concat!("farreach identify ", env!("CARGO_PKG_VERSION")));
        page.write(&path)?;
        println!("page: {}", path.display());
    }
    Ok(0)
}

/// The outcome, its page, and the verdict in two sentences.
fn study(args: &Args) -> anyhow::Result<(Outcome, report::Page, (String, String))> {
    let rig = rig::RigFile::load(&args.rig)?;
    if rig.axes.len() != 1 {
        let file = args.rig.display().to_string();
        return Err(IdentifyError::Axes { file, axes: rig.axes.len() }.into());
    }
    let model = ALL.iter().find(|m| m.kind() == rig.model.kind).ok_or_else(|| IdentifyError::Kind {
        file: args.rig.display().to_string(),
        kind: rig.model.kind.name().to_owned(),
        known: ALL.iter().map(|m| m.kind().name()).collect::<Vec<_>>().join(", "),
    })?;
    let names = if rig.model.kind.is_transmission() { ColumnNames::rotary() } else { ColumnNames::one_mass_linear() };
    let records = records(args, &names)?;
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let gear = rig.axes[0].master.turns_per_handle_turn;
    let slave_count_rad = rig.axes[0].slave.map(|encoder| 1.0 / encoder.counts_per_unit);
    let options = Options { jobs: args.jobs.unwrap_or(processors), seed: args.seed, gear, slave_count_rad };
    let (outcome, page) = model.identify(&args.rig.display().to_string(), &rig.model, &records, options)?;
    let told = model.sentences(&outcome);
    Ok((outcome, page, told))
}

/// All records with the roles that the command line fixes.
fn records(args: &Args, names: &ColumnNames) -> Result<Vec<Series>> {
    let mut asked: Vec<(&PathBuf, Option<Role>)> = Vec::new();
    for (paths, role) in [(&args.fit, Role::Fit), (&args.select, Role::Select), (&args.report_on, Role::Report)] {
        asked.extend(paths.iter().map(|p| (p, Some(role))));
    }
    for (i, (path, _)) in asked.iter().enumerate() {
        if asked[..i].iter().any(|(other, _)| other == path) {
            return Err(IdentifyError::Roles {
                what: format!("{} plays two parts", path.display()),
                advice: "a record that fits or selects must not report: give each record one part",
            });
        }
    }
    let fixed = !asked.is_empty();
    for path in &args.records {
        if asked.iter().all(|(other, _)| *other != path) {
            asked.push((path, None));
        }
    }
    if fixed {
        share_out(&mut asked)?;
    }
    asked.into_iter().map(|(path, role)| Ok(Series { role, ..read(path, names)? })).collect()
}

/// Gives the records without a part the parts that nobody plays: fit first, then report, then select.
fn share_out(asked: &mut [(&PathBuf, Option<Role>)]) -> Result<()> {
    let played = |role| asked.iter().any(|(_, r)| *r == Some(role));
    let missing: Vec<Role> =
        [Role::Select, Role::Report, Role::Fit].into_iter().filter(|role| !played(*role)).collect();
    let free = asked.iter().filter(|(_, r)| r.is_none()).count();
    if free < missing.len() {
        let names: Vec<String> = missing.iter().map(|r| format!("{r:?}").to_lowercase()).collect();
        return Err(IdentifyError::Roles {
            what: format!("no record is left to {}", names.join(", ")),
            advice: "name records with --fit, --select and --report-on, or give more of them",
        });
    }
    let mut left = free;
    for slot in asked.iter_mut().filter(|(_, r)| r.is_none()) {
        // The last ones take the rarer parts; the others fit.
        let from_end = left;
        left -= 1;
        slot.1 = Some(missing.get(from_end - 1).copied().unwrap_or(Role::Fit));
    }
    Ok(())
}

/// Reads a recording of farreach's (`.mcap`) or a CSV file. The reader refuses holes, gaps and time that runs
/// backwards; what it merely finds odd goes into the notes.
fn read(path: &Path, names: &ColumnNames) -> Result<Series> {
    let file = path.display().to_string();
    let options = recording::record::Options::default();
    let mcap = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let record = if mcap {
        let columns = SampleColumns::new(names.clone());
        recording::record::from_mcap(path, &columns, &options)
    } else {
        recording::record::from_csv(path, &options)
    };
    let record = record.map_err(|e| IdentifyError::Read(e.to_string()))?;
    let notes = record.findings.iter().map(|f| format!("{file}: {}", f.text)).collect();
    let mut columns = vec![(recording::record::TIME.to_owned(), record.time_s)];
    columns.extend(record.columns);
    Ok(Series { file, columns, role: None, notes })
}

fn print_outcome(outcome: &Outcome, (sentence, detail): (String, String)) {
    println!("{sentence}\n{detail}");
    for s in &outcome.steps {
        println!("  {:32} {:6.2} % held out, {:6.2} % all rows", s.model, s.report_percent, s.all_rows_percent);
    }
    for p in &outcome.parameters {
        let std = p.std.map_or("–".to_owned(), short);
        println!("  {:32} {:>10} ± {std} {}", p.name, short(p.fitted), p.unit);
    }
    for (effect, p) in outcome.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p))) {
        let name = format!("{}: {}", effect.id, p.name);
        println!("  {name:32} {:>10} ± {} {}", short(p.value), p.std.map_or("–".to_owned(), short), p.unit);
    }
    for l in &outcome.left {
        let (what, size) = (what_is_left(l), short(l.size));
        println!("  left: {what:32} {size:>10} {} rms, {:.1} % of the error", l.unit, l.gain_percent);
    }
    println!("next: {}", outcome.next_experiment.what);
}
