//! Runs `farreach identify` on the recording of the demo.

use std::path::Path;

use identify::four_digits;
use identify::models::machine_picture;
use identify::outcome::{FoundEffect, Outcome};
use identify::study::{Identification, StudyOptions, read, study};
use report::{Page, Table};
use rig::RigFile;

/// The result of identify on the recording of the demo.
#[derive(Debug)]
pub enum IdentifyResult {
    /// Identification completed.
    Completed {
        /// The result, as `farreach identify --json`.
        outcome: Box<Outcome>,
        /// The verdict as a sentence.
        sentence: String,
        /// The qualification of the verdict.
        detail: String,
        /// The page of identify.
        page: Box<Page>,
    },
    /// Identification failed, for this reason.
    Failed(String),
    /// Identification was not requested (`--no-identify`).
    Skipped,
}

impl IdentifyResult {
    /// Identifies a recording of this rig, using all processors.
    pub fn of(recording: &Path, rig: &RigFile) -> Self {
        match read(recording, rig).and_then(|series| study(rig, &[series], StudyOptions::default()))
        {
            Ok(Identification { outcome, sentence, detail, page }) => Self::Completed {
                outcome: Box::new(outcome),
                sentence,
                detail,
                page: Box::new(page),
            },
            Err(error) => Self::Failed(error.to_string()),
        }
    }

    /// Returns the result for `summary.json`, or `None` (`null`).
    pub fn value(&self) -> Option<serde_json::Value> {
        let Self::Completed { outcome, .. } = self else { return None };
        serde_json::to_value(outcome).ok()
    }

    /// Adds the section on identification to the page.
    pub(crate) fn section(&self, page: Page) -> Page {
        match self {
            Self::Completed { outcome, sentence, detail, page: whole } => {
                let page = page
                    .heading("What the declared model lacks")
                    .paragraph(sentence)
                    .paragraph(detail);
                let page = match machine_picture(outcome) {
                    Some(svg) => page
                        .picture(svg, "The machine, and where it departs from the declared model."),
                    None => page,
                };
                let page = match outcome.effects.is_empty() {
                    true => page,
                    false => page.table(
                        effects(&outcome.effects),
                        "Found by farreach identify, which divides the recording into fit, \
                            selection and report segments. The complete result is in summary.json \
                            under identify.",
                    ),
                };
                page.paragraph(&outcome.notes.join(". ")).folded(
                    "The whole identification: residual over time, its spectrum, what it depends \
                     on, candidates, parameters, the next experiment",
                    whole,
                )
            }
            Self::Failed(reason) => page.heading("What the declared model lacks").paragraph(
                &format!("farreach identify could not be run on this recording: {reason}."),
            ),
            Self::Skipped => page,
        }
    }
}

fn effects(found: &[FoundEffect]) -> Table {
    let rows = found.iter().flat_map(|effect| {
        effect.parameters.iter().enumerate().map(move |(at, parameter)| {
            let name =
                if at == 0 { format!("{}@{}", effect.id, effect.site) } else { String::new() };
            let std = parameter.std.map_or("–".to_owned(), four_digits);
            [
                name,
                parameter.name.clone(),
                four_digits(parameter.value),
                std,
                parameter.unit.clone(),
            ]
        })
    });
    Table::new(["effect", "parameter", "value", "±", "unit"]).rows(rows)
}
