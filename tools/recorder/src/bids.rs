//! `export --to bids`: a recording's runs as part of a dataset by the Brain Imaging Data Structure
//! (BIDS).
//!
//! Each protocol that was run is one run of the dataset: its events, the torque with the other
//! inputs and the bar (`physio`, `stim`), the positions (`motion`), and the electrodes (`emg`,
//! BDF+). With a scan, onset 0 is the beginning of the first stored volume.

mod continuous;
mod dataset;
mod electrodes;
mod events;
mod motion;
mod names;
mod run;
mod staged;

use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};
use recording::column::Storage;
use recording::mcap_read::{Recording, Selection};

use crate::DATA_LOST;
use crate::args::BidsOptions;
use crate::progress::Progress;
use crate::runs::{Stretch, stretches};
pub use names::FirstRun;
use names::{Names, RunLabels, label};
use run::Run;
use staged::Staged;

/// Adds the runs of a recording to the dataset in `folder`, which is made where it is not there;
/// adds nothing where one of its files is there already.
///
/// # Errors
/// As reading and writing do; where a label cannot be told, a volume was not counted, or `folder`
/// has files but is no dataset.
pub(crate) fn export(
    file: &Path,
    options: &BidsOptions,
    folder: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<i32> {
    let recording = Recording::open(file)?;
    dataset::check(folder)?;
    let mut staged = Staged::new(folder)?;
    let mut code = crate::exit_code_of_tail(&recording);
    let mut labels = RunLabels::from(options.run.as_ref());
    let mut told = Vec::new();
    let mut left_out = Vec::new();
    let stretches = stretches(&recording)?;
    let progress = Progress::of([&recording], &Selection::default(), stretches.len(), false);
    for stretch in stretches {
        let names = names_of(&stretch, options, &mut labels)?;
        // One run that cannot be read keeps no other from being exported.
        let code_of_subject = stretch.subject.trim();
        let storage = Storage::Folder(staged.apart().to_owned());
        let run = match Run::read(&recording, stretch, options.first_volume, &storage) {
            Ok(run) => run,
            Err(error) => {
                left_out.push(format!("{}: NOT exported: {error:#}", names.stem()));
                continue;
            }
        };
        if run.missing() > 0 {
            code = DATA_LOST;
        }
        let line = write_run(&run, &names, &mut staged).with_context(|| names.stem())?;
        told.push(line);
        if options.subject.is_none() && names.subject != code_of_subject {
            told.push(format!("subject \"{code_of_subject}\" is sub-{} here", names.subject));
        }
    }
    drop(progress);
    if told.is_empty() {
        bail!("{}: nothing was exported: {}", file.display(), left_out.join("; "));
    }
    staged.publish()?;
    if !left_out.is_empty() {
        code = DATA_LOST;
    }
    for line in told.iter().chain(&left_out) {
        writeln!(out, "{}: {line}", folder.display())?;
    }
    Ok(code)
}

/// What the files of a run are called.
fn names_of(
    stretch: &Stretch<'_>,
    options: &BidsOptions,
    labels: &mut RunLabels,
) -> anyhow::Result<Names> {
    let subject = match (&options.subject, stretch.subject.trim()) {
        (Some(given), _) => label("--subject", given)?,
        (None, "") => bail!("the recording names no subject: give --subject"),
        (None, recorded) => label("the recording's subject: give --subject", recorded)?,
    };
    let task = match &options.task {
        Some(given) => label("--task", given)?,
        None => label("the protocol's name: give --task", stretch.protocol)?,
    };
    let session = options.session.as_deref().map(|given| label("--session", given));
    let run = labels.next(&task);
    Ok(Names { subject, session: session.transpose()?, task, run })
}

/// Writes the files of a run; returns what is to be told of it.
fn write_run(run: &Run<'_>, names: &Names, staged: &mut Staged) -> anyhow::Result<String> {
    dataset::describe(run, names, staged);
    let with_scan = if run.scan { "func" } else { "beh" };
    events::write(run, &names.file(with_scan, "events"), run.zero_ns, staged)?;
    continuous::write(run, names, with_scan, staged)?;
    let mut datatypes = vec![with_scan];
    if motion::write(run, names, staged)? {
        datatypes.push("motion");
    }
    if electrodes::write(run, names, staged)? {
        datatypes.push("emg");
    }
    let missing = match run.missing() {
        0 => String::new(),
        missing => format!(", {missing} MISSING"),
    };
    Ok(format!("{} ({}): {} samples{missing}", names.stem(), datatypes.join(", "), run.rows()))
}
