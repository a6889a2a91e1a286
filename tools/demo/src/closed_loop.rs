//! The second part of the demo: what the model lacks is found, added, and the control tuned by it.

use identify::outcome::{ChannelError, Outcome, Verdict};
use identify::write_rig::Provenance;
use operator::Up;
use report::{Page, Tone};
use serde::Serialize;
use tune::live::Movement;
use tune::proposal::propose;
use tune::{Protocols, Tuning, TuningSummary};

use crate::IdentifyResult;
use crate::folder::Folder;
use crate::session::{Interrupted, Session};
use crate::terminal::Terminal;

/// How the loop was closed.
#[derive(Debug)]
pub enum ClosedLoop {
    /// With a rig file that the rig went on with.
    Closed(Box<Tuning>),
    /// It could not be, for this reason.
    Failed(String),
    /// It was not asked for (`--no-identify`).
    Skipped,
}

/// Whether what was found is what was hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Naming {
    /// The hidden effect was named, alone; or, where none was hidden, none was.
    Right,
    /// It is among those that the records cannot distinguish.
    Ambiguous,
    /// Something is missing, and no listed effect was said to be it.
    Unlisted,
    /// The declared parameters within their tolerances explain the records.
    WithinTolerances,
    /// Another effect was named.
    Wrong,
}

impl Naming {
    /// Compares an outcome with what was hidden (`ID@SITE=SIZE`; `None` for nothing).
    pub fn of(outcome: &Outcome, hidden: Option<&str>) -> Self {
        let (named, rivals) = (outcome.named(), outcome.rivals());
        Self::judge(&named, &rivals, (outcome.verdict, outcome.remains), hidden)
    }

    /// The same from the effects that were named, those that the records cannot distinguish from
    /// them (`ID@SITE`), the verdict, and whether a residual remains.
    pub fn judge(
        named: &[String],
        rivals: &[String],
        (verdict, remains): (Verdict, bool),
        hidden: Option<&str>,
    ) -> Self {
        let Some(hidden) = hidden.map(|text| text.split('=').next().unwrap_or(text)) else {
            return if named.is_empty() && !remains { Self::Right } else { Self::Wrong };
        };
        let is_hidden = |name: &String| name == hidden;
        match (named.iter().any(is_hidden), named.len(), verdict) {
            (true, 1, Verdict::Ambiguous) => Self::Ambiguous,
            (true, 1, _) => Self::Right,
            _ if rivals.iter().any(is_hidden) => Self::Ambiguous,
            (_, 0, Verdict::None) => Self::WithinTolerances,
            (_, 0, _) => Self::Unlisted,
            _ => Self::Wrong,
        }
    }

    fn text(self) -> &'static str {
        match self {
            Self::Right => "named rightly",
            Self::Ambiguous => "among those that the records cannot distinguish",
            Self::Unlisted => "not named: something unlisted is missing",
            Self::WithinTolerances => {
                "not named: the declared parameters explain it within their tolerances"
            }
            Self::Wrong => "NOT named: another effect was",
        }
    }
}

/// A rig that is up, and what the loop is closed with.
pub(crate) struct Closing<'a> {
    pub(crate) up: &'a Up,
    pub(crate) folder: &'a Folder,
    pub(crate) terminal: &'a Terminal,
    pub(crate) movements: &'a Protocols,
    pub(crate) revision: &'a str,
}

impl Closing<'_> {
    /// Measures how the handle follows, identifies, proposes, has the rig go on with the proposal,
    /// and measures again. What cannot be done is told, not an error; an interruption is one.
    pub(crate) fn close(
        &self,
        session: &mut Session<'_>,
        identified: &mut IdentifyResult,
    ) -> anyhow::Result<ClosedLoop> {
        match self.attempt(session, identified) {
            Ok(tuning) => Ok(ClosedLoop::Closed(Box::new(tuning))),
            Err(error) if error.is::<Interrupted>() => Err(error),
            Err(error) => {
                let told = format!("{error:#}");
                self.terminal.warn(&format!("the loop could not be closed: {told}"));
                Ok(ClosedLoop::Failed(told))
            }
        }
    }

    fn attempt(
        &self,
        session: &mut Session<'_>,
        identified: &mut IdentifyResult,
    ) -> anyhow::Result<Tuning> {
        let (rig, terminal) = (&self.up.rig, self.terminal);
        let Protocols { movement, excitation } = self.movements;
        let before = self.follow(session, self.folder.before())?;
        session.record(excitation, &self.folder.excitation())?;
        terminal.progress("identify: what does the declared model lack?");
        let (file, declared) = (self.folder.excitation(), rig.clone());
        *identified = session.compute(move || IdentifyResult::of(&file, &declared))?;
        let (outcome, sentence) = match &*identified {
            IdentifyResult::Completed { outcome, sentence, .. } => {
                ((**outcome).clone(), sentence.clone())
            }
            IdentifyResult::Failed(reason) => anyhow::bail!("identify: {reason}"),
            IdentifyResult::Skipped => anyhow::bail!("identify was left out"),
        };
        terminal.print(&format!("identify: {sentence} ({:.0} s)", outcome.seconds));
        terminal.progress("simulating the control with the model that was identified");
        let proposal = propose(rig, &outcome, movement, &Provenance::today(self.revision))?;
        let unit = rig.axes.first().map(|axis| axis.unit).unwrap_or(rig::AxisUnit::Radian);
        let text_before = rig.text().to_owned();
        let mut tuning =
            Tuning { unit, before, outcome, sentence, proposal, text_before, after: None };
        let path = self.folder.rig_file();
        files::replace(&path, tuning.proposal.control.rig.text())?;
        terminal.print(&format!(
            "rig file with the effect and {}: {} predicted",
            tuning.proposal.control.chosen.name,
            tuning.shown(tuning.proposal.control.error.rms)
        ));
        terminal.progress("the processes that read it start again with the new rig file");
        let name = self.up.running.status.rig_name.parse()?;
        operator::change_rig_file(&name, &path, &tuning.proposal.control.rig)?;
        tuning.after = Some(self.follow(session, self.folder.after())?);
        Ok(tuning)
    }

    /// Plays the movement into a recording, and measures how the handle followed.
    fn follow(
        &self,
        session: &mut Session<'_>,
        recording: std::path::PathBuf,
    ) -> anyhow::Result<Movement> {
        let movement = &self.movements.movement;
        session.record(movement, &recording)?;
        Movement::read(&recording, movement)
    }
}

/// The loop in numbers, for `summary.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClosedLoopSummary {
    /// Whether the hidden effect was named.
    pub naming: Naming,
    /// As `farreach tune --json`.
    #[serde(flatten)]
    pub tuning: TuningSummary,
}

impl ClosedLoop {
    /// In numbers; `None` where it was not closed.
    pub fn summary(&self, hidden: Option<&str>) -> Option<ClosedLoopSummary> {
        let Self::Closed(tuning) = self else { return None };
        let naming = Naming::of(&tuning.outcome, hidden);
        Some(ClosedLoopSummary { naming, tuning: tuning.summary() })
    }

    /// Lines for the terminal.
    pub(crate) fn lines(&self, hidden: Option<&str>) -> Vec<String> {
        let tuning = match self {
            Self::Closed(tuning) => tuning,
            Self::Failed(reason) => return vec![format!("tuning      failed: {reason}")],
            Self::Skipped => return Vec::new(),
        };
        let mut lines = vec![
            format!("hidden      {}", hidden.unwrap_or("nothing")),
            format!(
                "found       {} ({})",
                match tuning.outcome.named().as_slice() {
                    [] => "no listed effect".to_owned(),
                    names => names.join(", "),
                },
                Naming::of(&tuning.outcome, hidden).text()
            ),
        ];
        lines.push(format!("prediction  {}", held_out(&tuning.outcome)));
        if let Some(after) = &tuning.after {
            lines.push(format!(
                "tracking    rms error of the handle {} before, {} after ({} predicted)",
                tuning.shown(tuning.before.error.rms),
                tuning.shown(after.error.rms),
                tuning.shown(tuning.proposal.control.error.rms)
            ));
        }
        lines.extend(tuning.uncompensated_lines());
        lines
    }

    /// Adds what was gained to the page.
    pub(crate) fn section(&self, page: Page) -> Page {
        match self {
            Self::Closed(tuning) => tune::section(page, tuning),
            Self::Failed(reason) => page
                .heading("Tracking before and after")
                .paragraph(&format!("The loop could not be closed: {reason}.")),
            Self::Skipped => page,
        }
    }

    /// The loop in two sentences, for the head of the page.
    pub(crate) fn verdict(&self, hidden: Option<&str>) -> Option<(Tone, String, String)> {
        let Self::Closed(tuning) = self else { return None };
        let after = tuning.after.as_ref()?;
        let naming = Naming::of(&tuning.outcome, hidden);
        let better = after.error.rms < tuning.before.error.rms;
        let tone = if better && naming != Naming::Wrong { Tone::Good } else { Tone::Warning };
        let hidden = hidden.map_or("Nothing was hidden in the machine".to_owned(), |hidden| {
            format!("Hidden in the machine, and told to no model: {hidden}")
        });
        let sentence = format!(
            "{} The handle follows with an error of {}; before, {}.",
            tuning.sentence,
            tuning.shown(after.error.rms),
            tuning.shown(tuning.before.error.rms)
        );
        let detail = format!(
            "{hidden}. It was {}. Root-mean-square prediction error on stretches that took no \
             part in the fit: {}. The rig file with what was found is rig.toml; the rig went on \
             with it.",
            naming.text(),
            held_out(&tuning.outcome)
        );
        Some((tone, sentence, detail))
    }
}

/// Errors on the reporting stretches, channel by channel: as declared, with the effects.
fn held_out(outcome: &Outcome) -> String {
    let told = |(channel, error): (&String, &ChannelError)| {
        let declared = error.declared.unwrap_or(error.before);
        let unit = error.unit.as_str();
        let scaled = |value: f64| match unit {
            "rad" | "m" => format!("{:.2}", 1e3 * value),
            _ => format!("{value:.4}"),
        };
        let unit = match unit {
            "rad" | "m" => format!("m{unit}"),
            other => other.to_owned(),
        };
        let channel = channel.replace('_', " ").replace(" rad", "").replace(" m", "");
        format!("{channel} {} → {} {unit}", scaled(declared), scaled(error.after))
    };
    outcome.error.iter().map(told).collect::<Vec<_>>().join(", ")
}
