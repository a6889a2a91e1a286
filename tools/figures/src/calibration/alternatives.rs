//! Alternative explanations of the measured 8 Hz: each is fitted to it, and predicts the other
//! published numbers.

use anyhow::Result;
use plant::effects::Site;
use rayon::prelude::*;

use super::{Prediction, fit, measured_resonance_hz, near, predict};
use crate::published::{Kind, Published, published};
use crate::simulated_line::{Added, Line};

/// One explanation.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// Name for programs.
    pub id: &'static str,
    /// Name for readers.
    pub short: &'static str,
    /// What it is, in words.
    pub what: &'static str,
    /// Unit of its size.
    pub unit: &'static str,
    /// The size that gives the measured resonance; none where no size does.
    pub size: Option<f64>,
    /// What it predicts with that size.
    pub prediction: Prediction,
}

/// A published row that took no part in the fit, and how to read it off a prediction.
pub type Held = (&'static Published, Read);

/// Reads a value off a prediction.
pub type Read = fn(&Prediction) -> Option<f64>;

/// The rows on which explanations are compared.
///
/// # Errors
/// Where one is missing from the table.
pub fn held_rows() -> Result<Vec<Held>> {
    let rows: [(&'static str, Read); 5] = [
        ("hydrostatic.frequency_response_measured.cutoff_hz", |p| p.cut_off_hz),
        ("hydrostatic.delay_measured.delay_s", |p| p.lag_1hz_s),
        ("hydrostatic.linear_fit_10m.low_frequency_gain", |p| p.low_frequency_gain),
        ("hydrostatic.linear_fit_1m.formula_natural_hz", |p| p.short_peak_hz),
        ("hydrostatic.linear_fit_1m.formula_cutoff_hz", |p| p.short_cut_off_hz),
    ];
    rows.into_iter().map(|(id, read)| Ok((published(id)?, read))).collect()
}

impl Alternative {
    /// Root mean square of `ln(predicted/published)` over the held rows, in percent, of those
    /// measured on the rig or of all; none where something is not predicted at all. Logarithms, so
    /// that half and twice count alike.
    ///
    /// # Errors
    /// Those of [`held_rows`].
    pub fn miss_percent(&self, only_measured: bool) -> Result<Option<f64>> {
        let mut squares = Vec::new();
        for (row, read) in held_rows()? {
            if only_measured && row.kind != Kind::Measured {
                continue;
            }
            match read(&self.prediction) {
                Some(value) if value > 0.0 => squares.push((value / row.value).ln().powi(2)),
                _ => return Ok(None),
            }
        }
        Ok(Some(100.0 * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()))
    }
}

/// Stiffness of the relaxing branch over that of the spring, and its time, s: the effect's own
/// defaults.
const BRANCH: (f64, f64) = (0.5, 0.1);

/// An explanation before it is fitted.
struct Candidate {
    id: &'static str,
    short: &'static str,
    what: &'static str,
    unit: &'static str,
    /// From a size that changes nothing to the strongest that is tried.
    range: (f64, f64),
    make: Box<dyn Fn(f64) -> Line + Sync + Send>,
}

/// Fits each explanation to the measured resonance, with printed friction at the nominal amplitude.
///
/// # Errors
/// Where a constant or an effect is out of range.
pub fn alternatives(
    softening: f64,
    softened: Prediction,
    done: impl Fn() + Sync,
) -> Result<Vec<Alternative>> {
    let relaxing = |line: Line, ratio: f64| {
        let mut branch = Added::new("viscoelastic_line", Site::Line, ratio);
        branch.more.push(("relaxation_s", BRANCH.1));
        line.with(branch)
    };
    let candidates = [
        Candidate {
            id: "viscoelastic_line",
            short: "relaxing line",
            what: "a relaxing branch beside the printed spring; the size is its stiffness over the \
                spring's",
            unit: "1",
            range: (0.01, 10.0),
            make: Box::new(move |size| relaxing(Line::printed(), size)),
        },
        Candidate {
            id: "viscoelastic_line_softened",
            short: "softer, relaxing line",
            what: "a softer line that also relaxes: half of its stiffness again decays in 0.1 s; \
                the size is the factor",
            unit: "1",
            range: (1.0, 1.0 / 100.0),
            make: Box::new(move |size| relaxing(Line::printed().softened(size), BRANCH.0)),
        },
        Candidate {
            id: "transport_delay",
            short: "dead time",
            what: "dead time in the line; the size is its travel time",
            unit: "s",
            range: (5e-3, 0.06),
            make: Box::new(|size| {
                Line::printed().with(Added::new("transport_delay", Site::Line, size))
            }),
        },
        Candidate {
            id: "extra_inertia",
            short: "heavier slave",
            what: "more inertia at the slave",
            unit: "kg·m²",
            range: (1e-4, 10.0),
            make: Box::new(|size| {
                Line::printed().with(Added::new("extra_inertia", Site::Slave, size))
            }),
        },
    ];
    let target = measured_resonance_hz()?;
    let softer = Alternative {
        id: "line_compliance",
        short: "softer line",
        what: "a softer line; the size is the factor on its stiffness",
        unit: "1",
        size: Some(softening),
        prediction: softened,
    };
    let others: Result<Vec<Alternative>> = candidates
        .into_par_iter()
        .map(|Candidate { id, short, what, unit, range: (harmless, strongest), make }| {
            let size = fit(target, harmless, strongest, &make)?.map(|(size, _)| size);
            let prediction = match size {
                Some(size) => predict(&make(size), near(target))?,
                None => Prediction::default(),
            };
            done();
            Ok(Alternative { id, short, what, unit, size, prediction })
        })
        .collect();
    let mut all = vec![softer];
    all.extend(others?);
    Ok(all)
}

/// How many explanations [`alternatives`] fits.
pub const FITTED: usize = 4;
