//! Guided movement (§ 4.1) under each law of position control, on the lock-step rig: from feedback
//! alone to learning.
//!
//! The line is as traced, and nobody is at the handle. The handle is to follow a sine of
//! ±[`AMPLITUDE_DEG`]; the master's reference is that same sine but where a loop on the slave or
//! learning changes it. By the ratio of the pistons a master that follows perfectly moves the slave
//! by 0.854 of that.

use anyhow::Result;
use learning::LearningLaw;
use lock_step::guided::{Quality, Sine, guided};
use lock_step::ilc::{IlcTask, PUBLISHED, Trace, feedback_only};
use plant::hydrostatic::Parameters;
use rayon::prelude::*;
use report::{Page, Table};
use rig::{CompensationKind, HandKind, Observer, RigFile, SlaveLoop};

use crate::learning::{BLOCKS, Course, Learning, MODEL_BASED_BLOCKS, by_model, rigs};
use crate::table_row::{Row, short};

/// Amplitude of the sine, which the thesis does not print (°).
pub const AMPLITUDE_DEG: f64 = 40.0;
/// Frequencies (Hz).
pub const HERTZ: [f64; 5] = [0.2, 0.5, 1.0, 2.0, 3.0];
/// The frequency at which movements are kept for figures (Hz).
pub const FIGURE_HZ: f64 = 1.0;
/// Time in which the laws settle, and time over which they are measured, both in whole cycles (s).
const SETTLE_S: f64 = 4.0;
const KEEP_S: f64 = 2.0;
/// The case of the learning study at this amplitude.
const LEARNING_CASE: &str = "amplitude_40deg";

/// A law of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LawKind {
    /// Proportional feedback alone.
    Proportional,
    /// Proportional and derivative feedback.
    Feedback,
    /// With the feed-forward of fig. 4.3A: the thesis's law.
    Printed,
    /// With the compensation from the identified model in its place.
    Identified,
    /// That with the disturbance observer.
    Observer,
    /// The identified compensation with the loop on the slave.
    Slave,
    /// All three.
    All,
    /// Feedback, and the reference learnt by the published law.
    Learnt,
    /// Feedback, and the reference learnt by the model-based law.
    LearntByModel,
}

impl LawKind {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 9] = {
        use LawKind::*;
        [Proportional, Feedback, Printed, Identified, Observer, Slave, All, Learnt, LearntByModel]
    };

    /// Name in rows, name for a reader, compensation of the rig file's law.
    const fn table_row(self) -> (&'static str, &'static str, CompensationKind) {
        use CompensationKind::{Identified, None, Printed};
        match self {
            Self::Proportional => ("p", "P", None),
            Self::Feedback => ("pd", "PD", None),
            Self::Printed => ("pd_printed", "PD + printed feed-forward", Printed),
            Self::Identified => ("pd_identified", "PD + identified compensation", Identified),
            Self::Observer => ("pd_identified_observer", "… + disturbance observer", Identified),
            Self::Slave => ("pd_identified_slave", "PD + identified + slave loop", Identified),
            Self::All => ("pd_identified_observer_slave", "… + disturbance observer", Identified),
            Self::Learnt => ("pd_ilc", "PD + learning, published law", None),
            Self::LearntByModel => ("pd_ilc_model_based", "PD + learning, model-based law", None),
        }
    }

    /// Its name in rows.
    pub const fn id(self) -> &'static str {
        self.table_row().0
    }

    /// Its name for a reader.
    pub const fn name(self) -> &'static str {
        self.table_row().1
    }

    /// The rig under this law, nobody at the handle.
    fn rig(self, mut rig: RigFile) -> RigFile {
        rig.simulation.hand.kind = HandKind::Absent;
        let control = &mut rig.axes[0].control;
        let options = &mut control.options;
        options.compensation.kind = self.table_row().2;
        if matches!(self, Self::Observer | Self::All) {
            options.observer = Some(Observer::default());
        }
        if matches!(self, Self::Slave | Self::All) {
            options.slave = Some(SlaveLoop::default());
        }
        if self == Self::Proportional {
            control.velocity_gain = 0.0;
        }
        rig
    }
}

/// A law at a frequency.
#[derive(Clone, Debug)]
pub struct SweepPoint {
    /// Which law.
    pub law: LawKind,
    /// Which frequency (Hz).
    pub hertz: f64,
    /// What it came to; `None` where the movement cannot be learnt.
    pub quality: Option<Quality>,
    /// The movement.
    pub trace: Trace,
}

/// The comparison.
#[derive(Clone, Debug, Default)]
pub struct Guided {
    /// Each law at each frequency, law by law.
    pub cells: Vec<SweepPoint>,
}

/// How many times [`laws`] calls `done`.
pub const PARTS: usize = LawKind::ALL.len();

/// Moves the lock-step rig under each law; calls `done` after each law. The learnt reference of the
/// published law, and at 1 Hz that of the model-based law, come from the learning study:
/// [`Guided::with_learnt`].
///
/// # Errors
/// Where the built-in rig file is invalid.
pub fn laws(done: impl Fn() + Sync) -> Result<Guided> {
    let [_, rig] = rigs()?;
    let of_law = |law: LawKind| -> Result<Vec<SweepPoint>> {
        let cells = HERTZ
            .into_par_iter()
            .map(|hertz| {
                let trace = match law {
                    LawKind::Learnt => Trace::default(),
                    // A cycle of 3 Hz is no whole number of control steps at 500 Hz.
                    LawKind::LearntByModel if hertz == FIGURE_HZ || hertz == 3.0 => {
                        Trace::default()
                    }
                    LawKind::LearntByModel => learnt(&rig, hertz)?,
                    law => {
                        let amplitude = AMPLITUDE_DEG.to_radians();
                        let sine = Sine { amplitude, hertz, settle_s: SETTLE_S, keep_s: KEEP_S };
                        guided(&law.rig(rig.clone()), &[], &sine)?
                    }
                };
                Ok(SweepPoint { law, hertz, quality: Quality::of(&trace), trace })
            })
            .collect();
        done();
        cells
    };
    let cells: Vec<Vec<SweepPoint>> =
        LawKind::ALL.into_par_iter().map(of_law).collect::<Result<_>>()?;
    Ok(Guided { cells: cells.into_iter().flatten().collect() })
}

/// The last cycle of a movement that the model-based law learns.
fn learnt(rig: &RigFile, hertz: f64) -> Result<Trace> {
    let law = LearningLaw::Published(PUBLISHED);
    let amplitude = AMPLITUDE_DEG.to_radians();
    let task = IlcTask { amplitude, hertz, ..IlcTask::of_the_thesis(law) };
    let [.., last] = by_model(&feedback_only(rig.clone()), &task)?.cycles;
    Ok(last)
}

impl Guided {
    /// With what was learnt at 1 Hz and this amplitude.
    #[must_use]
    pub fn with_learnt(mut self, learning: &Learning) -> Self {
        let Some(case) = learning.case(LEARNING_CASE) else { return self };
        let last = |course: &Course| course.cycles[2].clone();
        for cell in self.cells.iter_mut().filter(|cell| cell.hertz == FIGURE_HZ) {
            cell.trace = match cell.law {
                LawKind::Learnt => last(&case.published),
                LawKind::LearntByModel => case.model_based.as_ref().map(last).unwrap_or_default(),
                _ => continue,
            };
            cell.quality = Quality::of(&cell.trace);
        }
        self
    }

    /// A law at a frequency (Hz).
    pub fn cell(&self, law: LawKind, hertz: f64) -> Option<&SweepPoint> {
        self.cells.iter().find(|cell| cell.law == law && cell.hertz == hertz)
    }

    /// The table as rows.
    pub fn rows(&self) -> Vec<Row> {
        let mut rows = Vec::new();
        for SweepPoint { law, hertz, quality, .. } in &self.cells {
            let Some(quality) = quality else { continue };
            let note = format!(
                "{}, ±{AMPLITUDE_DEG:.0}° at {hertz} Hz, nobody at the handle",
                match law {
                    LawKind::All => "PD + identified + slave loop + observer",
                    law => law.name(),
                }
            );
            for (name, unit, value, what) in values(quality) {
                let id = format!("hydrostatic.guided.{hertz}hz.{}.{name}", law.id());
                let row = Row::own(id, "4.1", unit, [None, Some(value)]);
                rows.push(row.note(format!("{what}; {note}")));
            }
        }
        rows
    }
}

/// What is told of a movement: name, unit, value, what it is.
fn values(quality: &Quality) -> [(&'static str, &'static str, f64, &'static str); 5] {
    [
        (
            "error_deg",
            "°",
            quality.slave_error.to_degrees(),
            "root mean square of desired less slave",
        ),
        (
            "master_error_deg",
            "°",
            quality.master_error.to_degrees(),
            "root mean square of desired less master",
        ),
        ("plateau_s", "s", quality.plateau_s, "longest time for which the slave stands still"),
        (
            "jerk_deg_s3",
            "°/s³",
            quality.jerk.to_degrees(),
            "root mean square of the slave's jerk over 10 ms",
        ),
        ("effort_v", "V", quality.effort_v, "root mean square of the motor's volts"),
    ]
}

/// A measure of the tables: what it is called, and what of a movement it says.
type Measure = (&'static str, fn(&Quality) -> String);

/// The tables on the page, one a measure.
const MEASURES: [Measure; 4] = [
    ("Error of the slave, root mean square in ° (of the master)", |quality| {
        let [slave, master] =
            [quality.slave_error, quality.master_error].map(|error| short(error.to_degrees()));
        format!("{slave} ({master})")
    }),
    ("Longest time for which the slave stands still, ms", |quality| {
        format!("{:.0}", 1e3 * quality.plateau_s)
    }),
    ("Jerk of the slave, root mean square over 10 ms in 10⁶ °/s³", |quality| {
        short(1e-6 * quality.jerk.to_degrees())
    }),
    ("Effort: volts of the motor, root mean square", |quality| short(quality.effort_v)),
];

/// The tables on the page.
pub fn on_page(page: Page, study: &Guided) -> Page {
    let own = Parameters::calibrated();
    let ratio = own.master_displacement_m_per_rad() / own.slave_displacement_m_per_rad();
    let mut page = page.heading("Guided movement under each law of position \
        control").paragraph(&format!(
        "A sine of ±{AMPLITUDE_DEG:.0}°, traced line, nobody at the handle. A master that follows \
            perfectly leaves the slave {:.1}° of error by the ratio of the pistons alone; only the \
            loop on the slave and learning do something about that, by moving the master's \
            reference, so their master's error is meant. Learning: feedback alone, after {BLOCKS} \
            blocks of three cycles by the published law (learnt at 1 Hz alone) and \
            {MODEL_BASED_BLOCKS} by the model-based one; 3 Hz is no whole number of control steps. \
            Settled for {SETTLE_S} s or more, measured over {KEEP_S} s or more.",
        (1.0 - ratio) * AMPLITUDE_DEG * std::f64::consts::FRAC_1_SQRT_2,
    ));
    for (title, told) in MEASURES {
        let head = ["law".to_owned()].into_iter().chain(HERTZ.map(|hertz| format!("{hertz} Hz")));
        let table = Table::new(head).rows(LawKind::ALL.map(|law| {
            let cell = |hertz| study.cell(law, hertz).and_then(|cell| cell.quality);
            let cells = HERTZ
                .map(|hertz| cell(hertz).map_or_else(|| "–".to_owned(), |quality| told(&quality)));
            std::iter::once(law.name().to_owned()).chain(cells)
        }));
        page = page.table(table, title);
    }
    page
}
