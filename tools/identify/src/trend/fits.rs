//! Each recording identified by itself.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rig::RigFile;

use super::folder::{self, LeftOut};
use crate::error::{IdentifyError, Result};
use crate::naming::labels;
use crate::outcome::{ChannelError, FittedParameter, FoundEffect};
use crate::study::{StudyOptions, fit_declared, read_mapped, study};

/// What a recording tells.
#[derive(Clone, Debug)]
pub struct RecordingFit {
    /// File.
    pub file: String,
    /// When it began (s since 1970), where it says so.
    pub began_s: Option<f64>,
    /// Parameters as fitted.
    pub parameters: Vec<FittedParameter>,
    /// Errors on the reporting rows, per channel.
    pub error: BTreeMap<String, ChannelError>,
    /// Effects that the model lacks; `None` if they were not searched.
    pub effects: Option<Vec<FoundEffect>>,
    /// What its search says, as a sentence.
    pub sentence: Option<String>,
    /// Wall time of reading and fitting (s).
    pub seconds: f64,
}

/// How recordings are fitted.
#[derive(Clone, Debug)]
pub struct Fitting {
    /// How they are read.
    pub reading: recording::record::Options,
    /// Axis, threads, seed and time limit of each.
    pub how: StudyOptions,
    /// Whether effects are searched.
    pub effects: bool,
}

/// Fits every recording; `progress` is told the index of each before it begins. Returns them in the
/// order in which they were made, and those that cannot be used.
///
/// # Errors
/// [`IdentifyError::Usage`] if the command line fits no recording; otherwise if none can be used.
pub fn fit_all(
    rig: &RigFile,
    paths: &[PathBuf],
    fitting: &Fitting,
    progress: &mut dyn FnMut(usize),
) -> Result<(Vec<RecordingFit>, Vec<LeftOut>)> {
    let (mut fits, mut left_out) = (Vec::new(), Vec::new());
    let shown: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    let names = labels(shown.iter().map(String::as_str));
    for (index, (path, name)) in paths.iter().zip(names).enumerate() {
        progress(index);
        match fit(rig, path, fitting) {
            Ok(fit) => fits.push(RecordingFit { file: name.to_owned(), ..fit }),
            Err(IdentifyError::Usage(message)) => return Err(IdentifyError::Usage(message)),
            Err(IdentifyError::Unusable(message)) => {
                // The message begins with the file, which stands beside it already.
                let begins = path.display().to_string();
                let reason = message.strip_prefix(&begins).unwrap_or(&message);
                let reason = reason.trim_start_matches([':', ',', ' ']).to_owned();
                left_out.push(LeftOut { file: name.to_owned(), reason });
            }
        }
    }
    let of = |fit: &RecordingFit| fit.began_s;
    let (fits, undated) = folder::in_order(fits, of, |fit| fit.file.clone());
    left_out.extend(undated);
    if fits.is_empty() {
        let why: Vec<String> =
            left_out.iter().map(|own| format!("\n  {}: {}", own.file, own.reason)).collect();
        return Err(IdentifyError::Unusable(format!(
            "--trend: none of the {} recordings can be used:{}",
            paths.len(),
            why.concat()
        )));
    }
    Ok((fits, left_out))
}

fn fit(rig: &RigFile, path: &Path, fitting: &Fitting) -> Result<RecordingFit> {
    let started = Instant::now();
    let series = read_mapped(path, rig, fitting.how.axis, &fitting.reading)?;
    let began_s = folder::began_s(path, &series);
    let records = [series];
    let file = path.display().to_string();
    let empty = RecordingFit {
        file,
        began_s,
        parameters: Vec::new(),
        error: BTreeMap::new(),
        effects: None,
        sentence: None,
        seconds: 0.0,
    };
    let told = match fitting.effects {
        true => {
            let studied = study(rig, &records, fitting.how)?;
            let outcome = studied.outcome;
            RecordingFit {
                parameters: outcome.parameters,
                error: outcome.error,
                effects: Some(outcome.effects),
                sentence: Some(studied.sentence),
                ..empty
            }
        }
        false => {
            let fit = fit_declared(rig, &records, fitting.how)?;
            RecordingFit { parameters: fit.parameters, error: fit.error, ..empty }
        }
    };
    Ok(RecordingFit { seconds: started.elapsed().as_secs_f64(), ..told })
}
