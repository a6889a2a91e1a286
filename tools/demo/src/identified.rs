//! The recording held against the declared model: `farreach identify` on what the demo recorded, as
//! a call.

use std::path::Path;

use identify::outcome::{FoundEffect, Outcome};
use identify::study::{Identification, StudyOptions, read, study};
use report::{Page, Table};
use rig::RigFile;

/// What identify says of the demo's recording.
#[derive(Debug)]
pub enum Identified {
    /// It ran.
    Said {
        /// The result, as `farreach identify --json`.
        outcome: Box<Outcome>,
        /// The verdict as a sentence.
        sentence: String,
        /// How far it holds.
        detail: String,
    },
    /// It could not, for this reason.
    Refused(String),
    /// Nobody asked for it.
    LeftOut,
}

impl Identified {
    /// Of a recording of this rig, on all processors: nothing else runs any more.
    pub fn of(recording: &Path, rig: &RigFile) -> Self {
        match read(recording, rig).and_then(|series| study(rig, &[series], StudyOptions::default()))
        {
            Ok(Identification { outcome, sentence, detail, .. }) => {
                Self::Said { outcome: Box::new(outcome), sentence, detail }
            }
            Err(error) => Self::Refused(error.to_string()),
        }
    }

    /// For `summary.json`: the result, or `null`.
    pub fn value(&self) -> Option<serde_json::Value> {
        match self {
            Self::Said { outcome, .. } => serde_json::to_value(outcome).ok(),
            Self::Refused(_) | Self::LeftOut => None,
        }
    }

    /// For `summary.json`: why it could not be run.
    pub fn refused(&self) -> Option<String> {
        match self {
            Self::Refused(reason) => Some(reason.clone()),
            Self::Said { .. } | Self::LeftOut => None,
        }
    }

    /// A line for the console.
    pub(crate) fn line(&self) -> Option<String> {
        match self {
            Self::Said { outcome, sentence, .. } => {
                Some(format!("{sentence} ({:.0} s)", outcome.seconds))
            }
            Self::Refused(reason) => Some(format!("could not be run: {reason}")),
            Self::LeftOut => None,
        }
    }

    /// A section of the page.
    pub(crate) fn section(&self, page: Page) -> Page {
        match self {
            Self::Said { outcome, sentence, detail } => {
                let page = page
                    .heading("What the declared model lacks")
                    .paragraph(sentence)
                    .paragraph(detail);
                let page = match outcome.effects.is_empty() {
                    true => page,
                    false => page.table(
                        effects(&outcome.effects),
                        "As farreach identify found it in this recording, which it cut into \
                            stretches that fit, select and report. The whole \
                         result stands in summary.json under identify.",
                    ),
                };
                page.paragraph(&outcome.notes.join(". "))
            }
            Self::Refused(reason) => page.heading("What the declared model lacks").paragraph(
                &format!("farreach identify could not be run on this recording: {reason}."),
            ),
            Self::LeftOut => page,
        }
    }
}

fn effects(found: &[FoundEffect]) -> Table {
    let short = |value: f64| if value == 0.0 { "0".to_owned() } else { format!("{value:.4}") };
    let rows = found.iter().flat_map(|effect| {
        effect.parameters.iter().enumerate().map(move |(at, parameter)| {
            let name =
                if at == 0 { format!("{}@{}", effect.id, effect.site) } else { String::new() };
            let std = parameter.std.map_or("–".to_owned(), short);
            [name, parameter.name.clone(), short(parameter.value), std, parameter.unit.clone()]
        })
    });
    rows.fold(Table::new(["effect", "parameter", "value", "±", "unit"]), Table::row)
}
