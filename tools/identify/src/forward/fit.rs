//! Levenberg-Marquardt on all records at once, every record and channel with a variance of its own.
//!
//! The likelihood is that of independent residuals whose variance nobody knows: `Σ ½ M ln(mean e²)` over records and channels. Weights
//! are taken from the last residual and held while the fit moves. Tolerances are held by a transformation that no step leaves; what the
//! data do not see, each by itself or several together, is kept near its declared value by one row each.

use std::cell::Cell;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::catalogue::Candidate;
use super::machine::{Machine, Residual, Setting};

/// Nearest to an end of its range that a fit begins, as a share of half of it: there the free number hardly moves the value.
const EDGE: f64 = 0.98;
/// A value this far out, as a share of half its range, stands at its end.
pub const AT_EDGE: f64 = 0.97;

/// Weight of a declared value at the end of its tolerance (1). Neighbouring rows of a residual are not independent: some tens of them
/// weigh as much as one that is.
const DECLARED: f64 = 5.0;

/// One number of a setting that a fit moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Knob {
    /// A declared parameter.
    Base(usize),
    /// A parameter of an effect.
    Effect {
        /// Index of the effect.
        placed: usize,
        /// Name of the parameter.
        name: &'static str,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
        /// Whether it is searched by its logarithm.
        logarithmic: bool,
    },
    /// Cosine (0) or sine (1) part of an effect with amplitude and phase.
    Wave {
        /// Index of the effect.
        placed: usize,
        /// Name of the amplitude.
        name: &'static str,
        /// Its greatest value.
        most: f64,
        /// Which part.
        part: usize,
    },
}

/// The knobs of an effect that stands at `placed`.
pub fn knobs_of(candidate: &Candidate, placed: usize) -> Vec<Knob> {
    let free = candidate.free.iter().map(|free| Knob::Effect {
        placed,
        name: free.name,
        low: free.low,
        high: free.high,
        logarithmic: free.logarithmic,
    });
    let waves = candidate
        .wave
        .iter()
        .flat_map(|(name, most)| [0, 1].map(|part| Knob::Wave { placed, name, most: *most, part }));
    free.chain(waves).collect()
}

impl Knob {
    fn range(&self, machine: &Machine) -> (f64, f64, bool) {
        match self {
            Self::Base(index) => {
                let parameter = &machine.base[*index];
                (parameter.low, parameter.high, parameter.logarithmic)
            }
            Self::Effect { low, high, logarithmic, .. } => (*low, *high, *logarithmic),
            Self::Wave { most, .. } => (-most, *most, false),
        }
    }

    /// Its value in a setting.
    pub fn value(&self, setting: &Setting) -> f64 {
        match self {
            Self::Base(index) => setting.base[*index],
            Self::Effect { placed, name, .. } => setting.placed[*placed].value(name).unwrap_or_default(),
            Self::Wave { placed, name, part, .. } => {
                let placed = &setting.placed[*placed];
                let phase = placed.value("phase").unwrap_or_default();
                placed.value(name).unwrap_or_default() * if *part == 0 { phase.cos() } else { phase.sin() }
            }
        }
    }

    /// Puts a value into a setting.
    pub fn put(&self, setting: &mut Setting, value: f64) {
        let into = |setting: &mut Setting, placed: usize, name: &'static str, value: f64| {
            let values = &mut setting.placed[placed].values;
            match values.iter_mut().find(|(own, _)| *own == name) {
                Some((_, old)) => *old = value,
                None => values.push((name, value)),
            }
        };
        match self {
            Self::Base(index) => setting.base[*index] = value,
            Self::Effect { placed, name, .. } => into(setting, *placed, name, value),
            Self::Wave { placed, name, most, part } => {
                let other = Self::Wave { placed: *placed, name, most: *most, part: 1 - part }.value(setting);
                let (cosine, sine) = if *part == 0 { (value, other) } else { (other, value) };
                into(setting, *placed, name, cosine.hypot(sine).min(*most));
                into(setting, *placed, "phase", sine.atan2(cosine));
            }
        }
    }

    /// The same knob once an effect is taken away; `None` for its own.
    pub fn without(&self, gone: usize) -> Option<Self> {
        let mut knob = self.clone();
        if let Self::Effect { placed, .. } | Self::Wave { placed, .. } = &mut knob {
            if *placed == gone {
                return None;
            }
            *placed -= usize::from(*placed > gone);
        }
        Some(knob)
    }

    /// Where the value stands in its range, -1 to 1.
    pub fn place(&self, machine: &Machine, setting: &Setting) -> f64 {
        let (low, high, logarithmic) = self.range(machine);
        let scale = |value: f64| if logarithmic { value.max(f64::MIN_POSITIVE).ln() } else { value };
        let (low, high) = (scale(low), scale(high));
        (2.0 * scale(self.value(setting)) - low - high) / (high - low)
    }

    /// The value at a place.
    fn at_place(&self, machine: &Machine, place: f64) -> f64 {
        let (low, high, logarithmic) = self.range(machine);
        let within = |low: f64, high: f64| 0.5 * (low + high + place * (high - low));
        if logarithmic { within(low.ln(), high.ln()).exp() } else { within(low, high) }
    }

    /// The number that the fit moves freely.
    fn open(&self, machine: &Machine, setting: &Setting) -> f64 {
        self.place(machine, setting).clamp(-EDGE, EDGE).asin()
    }

    fn close(&self, machine: &Machine, setting: &mut Setting, open: f64) {
        self.put(setting, self.at_place(machine, open.sin()));
    }

    /// The free number a little off, for a slope.
    fn aside(&self, machine: &Machine, setting: &Setting) -> f64 {
        let place = self.place(machine, setting).clamp(-EDGE, EDGE);
        let step = if matches!(self, Self::Wave { .. }) { 4e-3 } else { 0.02 };
        let moved = if place > 0.0 { place - step } else { place + step };
        moved.asin()
    }
}

/// Records and how they are looked at.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// Model and records.
    pub machine: &'a Machine,
    /// Those that take part.
    pub records: Vec<usize>,
    /// Bandwidth of the observer (rad/s).
    pub observer_rad_s: f64,
}

/// A setting with what it leaves.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The setting.
    pub setting: Setting,
    /// Residuals of the records of the view, in its order.
    pub residuals: Vec<Residual>,
    /// Negative logarithm of the likelihood, up to a constant.
    pub objective: f64,
}

impl View<'_> {
    /// Residuals of all its records; `None` where one cannot be simulated.
    pub fn residuals(&self, setting: &Setting) -> Option<Vec<Residual>> {
        self.records.par_iter().map(|record| self.machine.residual(setting, *record, self.observer_rad_s)).collect()
    }

    /// A setting as it stands.
    pub fn evaluate(&self, setting: Setting) -> Option<Fitted> {
        let residuals = self.residuals(&setting)?;
        let objective = objective(&residuals) + self.prior(&setting);
        Some(Fitted { setting, residuals, objective })
    }

    fn prior(&self, setting: &Setting) -> f64 {
        (0..self.machine.base.len()).map(|index| 0.5 * self.off(setting, index).powi(2)).sum()
    }

    /// How far a declared parameter stands off its declared value, over its tolerance, as a row.
    fn off(&self, setting: &Setting, index: usize) -> f64 {
        let parameter = &self.machine.base[index];
        parameter.declared.map_or(0.0, |declared| {
            DECLARED * 2.0 * (setting.base[index] - declared) / (parameter.high - parameter.low)
        })
    }

    /// Slope of that row by the knob's free number; 0 for what is not declared.
    fn off_slope(&self, knob: &Knob, setting: &Setting) -> f64 {
        match knob {
            // Place by free number; a declared parameter stands in the middle of its range, or nearly.
            Knob::Base(index) if self.machine.base[*index].declared.is_some() => {
                DECLARED * knob.open(self.machine, setting).cos()
            }
            _ => 0.0,
        }
    }

    /// Weights of every record and channel: 1 over the root mean square.
    pub fn weights(residuals: &[Residual]) -> Vec<Vec<f64>> {
        let weight = |channel: &Vec<f64>| 1.0 / super::record::rms(channel.iter().copied()).max(1e-9);
        residuals.iter().map(|residual| residual.channels.iter().map(weight).collect()).collect()
    }

    /// Residuals, weighted, in one column.
    pub fn stack(residuals: &[Residual], weights: &[Vec<f64>]) -> DVector<f64> {
        let rows = residuals.iter().zip(weights).flat_map(|(residual, weights)| {
            residual
                .channels
                .iter()
                .zip(weights)
                .flat_map(|(channel, weight)| channel.iter().map(move |row| weight * row))
        });
        DVector::from_vec(rows.collect())
    }

    /// Slopes of the weighted residual by the free number of each knob; `None` where one cannot be simulated.
    pub fn slopes(&self, fitted: &Fitted, knobs: &[Knob], weights: &[Vec<f64>]) -> Option<DMatrix<f64>> {
        let here = Self::stack(&fitted.residuals, weights);
        let moved: Vec<(Setting, f64)> = knobs
            .iter()
            .map(|knob| {
                let mut setting = fitted.setting.clone();
                let (from, to) = (knob.open(self.machine, &setting), knob.aside(self.machine, &setting));
                knob.close(self.machine, &mut setting, to);
                (setting, to - from)
            })
            .collect();
        let jobs: Vec<(usize, usize)> =
            (0..knobs.len()).flat_map(|knob| self.records.iter().map(move |record| (knob, *record))).collect();
        let residuals: Vec<Residual> = jobs
            .par_iter()
            .map(|(knob, record)| self.machine.residual(&moved[*knob].0, *record, self.observer_rad_s))
            .collect::<Option<_>>()?;
        let mut slopes = DMatrix::zeros(here.len(), knobs.len());
        for (knob, residuals) in residuals.chunks(self.records.len()).enumerate() {
            slopes.set_column(knob, &((Self::stack(residuals, weights) - &here) / moved[knob].1));
        }
        Some(slopes)
    }

    /// One step of Gauss and Newton with slopes that were taken before, at another place perhaps: as far as it leads down. Weights are those of
    /// the slopes. `None` where it does not.
    pub fn step(&self, from: &Fitted, knobs: &[Knob], slopes: &DMatrix<f64>, weights: &[Vec<f64>]) -> Option<Fitted> {
        let rows = Self::stack(&from.residuals, weights);
        let (mut normal, mut gradient) = (slopes.transpose() * slopes, slopes.transpose() * rows);
        for (at, knob) in knobs.iter().enumerate() {
            let Knob::Base(index) = knob else { continue };
            let slope = self.off_slope(knob, &from.setting);
            normal[(at, at)] += slope * slope;
            gradient[at] += slope * self.off(&from.setting, *index);
        }
        let damped = &normal + DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-3 * entry + 1e-9));
        let whole = -damped.cholesky()?.solve(&gradient);
        [1.0, 0.4, 0.1].iter().find_map(|part| {
            let mut setting = from.setting.clone();
            for (knob, change) in knobs.iter().zip(whole.iter()) {
                let open = knob.open(self.machine, &setting);
                // No further than an end of the range.
                let open = (open + (part * change).clamp(-0.7, 0.7)).clamp(-1.4, 1.4);
                knob.close(self.machine, &mut setting, open);
            }
            self.evaluate(setting).filter(|fitted| fitted.objective < from.objective)
        })
    }

    /// Steps along slopes taken once, until one does not lead down.
    pub fn follow(&self, from: &Fitted, knobs: &[Knob], steps: usize) -> Option<Fitted> {
        let weights = Self::weights(&from.residuals);
        let slopes = self.slopes(from, knobs, &weights)?;
        let mut now = from.clone();
        for _ in 0..steps {
            match self.step(&now, knobs, &slopes, &weights) {
                Some(better) => now = better,
                None => break,
            }
        }
        Some(now)
    }

    /// Fits from a setting: so many rounds of weights, in each at most so many slopes. `None` where the start cannot be simulated.
    pub fn fit(&self, start: &Setting, knobs: &[Knob], rounds: usize, slopes: usize) -> Option<Fitted> {
        let mut best = self.evaluate(start.clone())?;
        for _ in 0..rounds {
            let before = best.objective;
            let problem = Problem {
                view: self,
                knobs,
                weights: Self::weights(&best.residuals),
                open: DVector::from_iterator(
                    knobs.len(),
                    knobs.iter().map(|knob| knob.open(self.machine, &best.setting)),
                ),
                now: Some(best.clone()),
                before: None,
                template: best.setting.clone(),
                left: Cell::new(slopes),
            };
            let (mut problem, _) =
                LevenbergMarquardt::new().with_ftol(1e-4).with_xtol(1e-4).with_stepbound(3.0).minimize(problem);
            // It may end on a step that was none.
            let kept = problem.before.take().and_then(|(_, fitted)| fitted);
            let now =
                [problem.now.take(), kept].into_iter().flatten().min_by(|a, b| a.objective.total_cmp(&b.objective));
            match now {
                Some(now) if now.objective < best.objective => best = now,
                _ => break,
            }
            // Less than one row's worth in a thousand is none.
            let rows: usize = best.residuals.iter().flat_map(|residual| &residual.channels).map(Vec::len).sum();
            if before - best.objective < 2e-4 * rows as f64 {
                break;
            }
        }
        Some(best)
    }
}

/// `Σ ½ M ln(mean e²)`.
pub fn objective(residuals: &[Residual]) -> f64 {
    let one = |channel: &Vec<f64>| channel.len() as f64 * super::record::rms(channel.iter().copied()).max(1e-9).ln();
    residuals.iter().flat_map(|residual| &residual.channels).map(one).sum()
}

/// One round of a fit, the weights held.
struct Problem<'a, 'b> {
    view: &'a View<'b>,
    knobs: &'a [Knob],
    weights: Vec<Vec<f64>>,
    open: DVector<f64>,
    now: Option<Fitted>,
    /// What stood before the last step: it comes back where the step was none.
    before: Option<(DVector<f64>, Option<Fitted>)>,
    template: Setting,
    /// Slopes that may still be taken.
    left: Cell<usize>,
}

impl Problem<'_, '_> {
    fn rows(&self) -> usize {
        let machine = self.view.machine;
        let of = |record: &usize| machine.channels(*record).len() * machine.records[*record].residual_rows();
        self.view.records.iter().map(of).sum::<usize>() + self.declared().count()
    }

    fn declared(&self) -> impl Iterator<Item = usize> {
        self.knobs.iter().filter_map(|knob| match knob {
            Knob::Base(index) => Some(*index),
            _ => None,
        })
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, '_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, open: &DVector<f64>) {
        if *open == self.open {
            return;
        }
        let left = (std::mem::replace(&mut self.open, open.clone()), self.now.take());
        match self.before.replace(left) {
            Some((known, fitted)) if known == *open => {
                self.now = fitted;
                return;
            }
            _ => {}
        }
        let mut setting = self.template.clone();
        for (knob, open) in self.knobs.iter().zip(open.iter()) {
            knob.close(self.view.machine, &mut setting, *open);
        }
        self.now = self.view.evaluate(setting);
    }

    fn params(&self) -> DVector<f64> {
        self.open.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        // A step to where nothing can be simulated is a bad one, not the end.
        let Some(now) = self.now.as_ref() else { return Some(DVector::from_element(self.rows(), 1e6)) };
        let rows = View::stack(&now.residuals, &self.weights);
        let off: Vec<f64> = self.declared().map(|index| self.view.off(&now.setting, index)).collect();
        let data = rows.len();
        let mut all = rows.resize_vertically(data + off.len(), 0.0);
        for (row, off) in off.into_iter().enumerate() {
            all[data + row] = off;
        }
        Some(all)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        if self.left.get() == 0 {
            return None;
        }
        self.left.set(self.left.get() - 1);
        let now = self.now.as_ref()?;
        let slopes = self.view.slopes(now, self.knobs, &self.weights)?;
        let data = slopes.nrows();
        let mut all = slopes.resize_vertically(data + self.declared().count(), 0.0);
        let of_declared = self.knobs.iter().enumerate().filter(|(_, knob)| matches!(knob, Knob::Base(_)));
        for (row, (column, knob)) in of_declared.enumerate() {
            all[(data + row, column)] = self.view.off_slope(knob, &now.setting);
        }
        Some(all)
    }
}

impl View<'_> {
    /// Standard deviation of each knob's value, by blocks: neighbours in a residual are not independent. Infinite where the records do
    /// not see it.
    pub fn deviations(&self, fitted: &Fitted, knobs: &[Knob], block: usize) -> Option<Vec<f64>> {
        let weights = Self::weights(&fitted.residuals);
        let slopes = self.slopes(fitted, knobs, &weights)?;
        let rows = Self::stack(&fitted.residuals, &weights);
        let normal = slopes.transpose() * &slopes;
        let ridge = DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-9 * entry + 1e-12));
        let inverse = (normal + ridge).cholesky()?.inverse();
        let mut spread = DMatrix::zeros(knobs.len(), knobs.len());
        let mut from = 0;
        for channel in fitted.residuals.iter().flat_map(|residual| &residual.channels) {
            for at in (0..channel.len()).step_by(block.max(1)) {
                let count = block.min(channel.len() - at);
                let part = slopes.rows(from + at, count).transpose() * rows.rows(from + at, count);
                spread += &part * part.transpose();
            }
            from += channel.len();
        }
        let covariance = &inverse * spread * &inverse;
        let by_value = |(index, knob): (usize, &Knob)| {
            // From the free number to the value.
            let mut moved = fitted.setting.clone();
            let (open, aside) = (knob.open(self.machine, &moved), knob.aside(self.machine, &moved));
            let before = knob.value(&moved);
            knob.close(self.machine, &mut moved, aside);
            let slope = (knob.value(&moved) - before) / (aside - open);
            covariance[(index, index)].max(0.0).sqrt() * slope.abs()
        };
        Some(knobs.iter().enumerate().map(by_value).collect())
    }
}
