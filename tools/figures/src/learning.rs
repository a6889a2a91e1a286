//! Iterative learning on the lock-step rig (§ 4.3), for fig. 4.5 and 4.6: with the printed
//! constants, with the traced line, and over what the thesis leaves open.

use std::fmt::Write;

use anyhow::Result;
use learning::{LearningLaw, Published};
use lock_step::ilc::{IlcSimulation, IlcTask, PUBLISHED, Trace, ended, feedback_only, model_based};
use rayon::prelude::*;
use rig::{HandKind, RigFile};

/// Blocks of fig. 4.6.
pub const BLOCKS: usize = 83;
/// Error that the thesis's learning came to (°).
pub const GOAL_DEG: f64 = 1.0;
/// Blocks that the model-based law gets: half as many again as a tenth of the thesis's.
pub const MODEL_BASED_BLOCKS: usize = 12;
/// The block of fig. 4.5, in the middle of the learning.
pub const MIDDLE: usize = 20;

/// The rig files of the printed constants and of the traced line, without what the thesis does not
/// simulate.
///
/// # Errors
/// Where a built-in rig file is invalid.
pub(crate) fn rigs() -> Result<[RigFile; 2]> {
    let rig = |name: &str, text: &str| RigFile::parse(text, name).map(lock_step::simplified);
    Ok([
        rig(
            "hydrostatic-printed.toml",
            include_str!("../../../launch/rigs/hydrostatic-printed.toml"),
        )?,
        rig("hydrostatic.toml", include_str!("../../../launch/rigs/hydrostatic.toml"))?,
    ])
}

/// How a learning went.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// Mean magnitude of the slave's error over each block (°).
    pub errors_deg: Vec<f64>,
    /// Whether the error grew, so that learning ended before the last block.
    pub ended: bool,
    /// First, middle ([`MIDDLE`]) and last block, each by its last cycle.
    pub cycles: [Trace; 3],
}

impl Course {
    /// First block, from 1, whose error is [`GOAL_DEG`] or less.
    pub fn blocks_to_goal(&self) -> Option<f64> {
        self.errors_deg.iter().position(|error| *error <= GOAL_DEG).map(|at| at as f64 + 1.0)
    }

    /// Error of the first block (°).
    pub fn first_deg(&self) -> Option<f64> {
        self.errors_deg.first().copied()
    }

    /// Error of the last block (°).
    pub fn last_deg(&self) -> Option<f64> {
        self.errors_deg.last().copied()
    }
}

/// The published law's course with one setting changed.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name in rows.
    pub id: &'static str,
    /// What was changed.
    pub what: &'static str,
    /// The published law.
    pub published: Course,
    /// The model-based law, where the change concerns it.
    pub model_based: Option<Course>,
}

/// All that was learnt. Pairs are: printed constants, traced line.
#[derive(Clone, Debug)]
pub struct Learning {
    /// The published law.
    pub published: [Course; 2],
    /// The model-based law.
    pub model_based: [Course; 2],
    /// The published law on the traced line, over what the thesis leaves open.
    pub cases: Vec<Case>,
}

impl Learning {
    /// A case by its name in rows.
    pub fn case(&self, id: &str) -> Option<&Case> {
        self.cases.iter().find(|case| case.id == id)
    }

    /// Error per block (°), one row each.
    pub fn csv(&self) -> String {
        let mut text = "block,published_law_traced_deg,model_based_law_traced_deg,\
                        published_law_printed_constants_deg,\
                        model_based_law_printed_constants_deg\n"
            .to_owned();
        let columns =
            [&self.published[1], &self.model_based[1], &self.published[0], &self.model_based[0]];
        for block in 0..BLOCKS {
            let cells = columns.map(|course| {
                course.errors_deg.get(block).map_or_else(String::new, |error| format!("{error:.4}"))
            });
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{},{}", block + 1, cells.join(","));
        }
        text
    }
}

/// A setting that is changed.
#[derive(Clone, Copy)]
struct Change {
    id: &'static str,
    what: &'static str,
    amplitude_deg: Option<f64>,
    law: Published,
    hand: bool,
    feedforward: bool,
}

const fn change(id: &'static str, what: &'static str) -> Change {
    Change { id, what, amplitude_deg: None, law: PUBLISHED, hand: false, feedforward: false }
}

/// The published law with its gains times a factor.
const fn gains(factor: f64) -> Published {
    let (gamma_p, gamma_d) = (factor * PUBLISHED.gamma_p, factor * PUBLISHED.gamma_d);
    Published { gamma_p, gamma_d, ..PUBLISHED }
}

const CHANGES: [Change; 9] = [
    Change { amplitude_deg: Some(30.0), ..change("amplitude_30deg", "amplitude 30°") },
    Change { amplitude_deg: Some(40.0), ..change("amplitude_40deg", "amplitude 40°") },
    Change { law: gains(0.5), ..change("gains_half", "half the learning gains") },
    Change { law: gains(2.0), ..change("gains_twice", "twice the learning gains") },
    Change {
        law: Published { cutoff_hz: 5.0, ..PUBLISHED },
        ..change("cutoff_5hz", "cut-off of the filter 5 Hz")
    },
    Change {
        law: Published { cutoff_hz: 12.0, ..PUBLISHED },
        ..change("cutoff_12hz", "cut-off of the filter 12 Hz")
    },
    Change { hand: true, ..change("passive_hand", "a passive hand at the handle") },
    Change {
        amplitude_deg: Some(30.0),
        feedforward: true,
        ..change("feedforward_30deg", "feed-forward of § 4.1, amplitude 30°")
    },
    Change {
        amplitude_deg: Some(60.0),
        feedforward: true,
        ..change("feedforward_60deg", "feed-forward of § 4.1, amplitude 60°")
    },
];

/// How many times [`learn`] calls `done`.
pub const PARTS: usize = 4 + CHANGES.len();

/// Lets the lock-step rig learn; calls `done` after each part.
///
/// # Errors
/// Where a built-in rig file is invalid.
pub fn learn(done: impl Fn() + Sync) -> Result<Learning> {
    let rigs = rigs()?;
    let benches = rigs.clone().map(feedback_only);
    let plain = IlcTask::of_the_thesis(LearningLaw::Published(PUBLISHED));
    let base = |at: usize| -> Result<Course> {
        let rig = &benches[at % 2];
        let course = if at < 2 { course(rig, &plain, BLOCKS)? } else { by_model(rig, &plain)? };
        done();
        Ok(course)
    };
    let (bases, cases) = rayon::join(
        || (0..4).into_par_iter().map(base).collect::<Result<Vec<Course>>>(),
        || {
            let one = |change: &Change| {
                let case = case(&rigs[1], &plain, change);
                done();
                case
            };
            CHANGES.par_iter().map(one).collect::<Result<Vec<Case>>>()
        },
    );
    let mut bases = bases?.into_iter();
    let mut next = || bases.next().unwrap_or_default();
    Ok(Learning { published: [next(), next()], model_based: [next(), next()], cases: cases? })
}

fn case(rig: &RigFile, plain: &IlcTask, change: &Change) -> Result<Case> {
    let mut changed = feedback_only(rig.clone());
    if change.hand {
        changed.simulation.hand.kind = HandKind::Passive;
    }
    if change.feedforward {
        changed.axes[0].control.feedforward = rig.axes[0].control.feedforward;
    }
    let task = IlcTask {
        amplitude: change.amplitude_deg.map_or(plain.amplitude, f64::to_radians),
        law: LearningLaw::Published(change.law),
        ..plain.clone()
    };
    let concerned = change.law == PUBLISHED;
    Ok(Case {
        id: change.id,
        what: change.what,
        published: course(&changed, &task, BLOCKS)?,
        model_based: concerned.then(|| by_model(&changed, &task)).transpose()?,
    })
}

pub(crate) fn by_model(rig: &RigFile, task: &IlcTask) -> Result<Course> {
    let law = LearningLaw::ModelBased(model_based(rig, &[], task)?);
    course(rig, &IlcTask { law, ..task.clone() }, MODEL_BASED_BLOCKS)
}

fn course(rig: &RigFile, task: &IlcTask, blocks: usize) -> Result<Course> {
    let mut simulation = IlcSimulation::new(rig, &[], task)?;
    let mut course = Course::default();
    let kept = [1, MIDDLE, blocks];
    for block in 1..=blocks {
        let mut trace = kept.contains(&block).then(Trace::default);
        let report = simulation.block(trace.as_mut())?;
        course.errors_deg.push(report.error.map_or(f64::NAN, f64::to_degrees));
        course.ended |= ended(&report);
        if let Some(trace) = trace {
            let cycle = trace.last(simulation.learner().steps_per_cycle());
            for (place, kept) in course.cycles.iter_mut().zip(kept) {
                if kept == block {
                    place.clone_from(&cycle);
                }
            }
        }
    }
    Ok(course)
}
