//! Levenberg-Marquardt on all records at once, every record and channel with a variance of its own.
//!
//! The likelihood is that of independent residuals whose variance nobody knows: `Σ ½ M ln(mean e²)`
//! over records and channels. Weights are taken from the last residual and held while the fit
//! moves. Tolerances are held by a transformation that no step leaves; what the data do not see,
//! each by itself or several together, is kept near its declared value by one row each.

use std::cell::RefCell;
use std::f64::consts::FRAC_PI_2;

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::knob::Knob;
use super::machine::{Machine, Residual, Setting};
use crate::inverse::split::Role;

/// A slope below this, as a mean over all weighted rows, is none.
const UNSEEN: f64 = 1e-6;
/// Weight of a declared value at the end of its tolerance (1). Neighbouring rows of a residual are
/// not independent: some tens of them weigh as much as one that is.
const DECLARED: f64 = 5.0;

/// Steps after which slopes are worth taking afresh.
const STEPS_KEPT: usize = 8;
/// The same: gain of a step, for every row.
const LEAST_KEPT: f64 = 1e-3;

/// Of several starts so many go on after a brief fit.
const LEADING: usize = 3;

/// Records and how they are looked at.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// Model and records.
    pub machine: &'a Machine,
    /// Those that take part.
    pub records: Vec<usize>,
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

impl Fitted {
    /// Rows of its residuals, all channels together.
    pub fn rows(&self) -> usize {
        self.residuals.iter().flat_map(|residual| &residual.channels).map(Vec::len).sum()
    }
}

impl<'a> View<'a> {
    /// Of the records of a role.
    pub fn of(machine: &'a Machine, role: Role) -> Self {
        Self { machine, records: machine.of_role(role) }
    }

    /// Of all records.
    pub fn whole(machine: &'a Machine) -> Self {
        Self { machine, records: (0..machine.records.len()).collect() }
    }
}

impl View<'_> {
    /// The same without some of them.
    #[must_use]
    pub fn without(mut self, records: &[usize]) -> Self {
        self.records.retain(|record| !records.contains(record));
        self
    }

    /// Residuals of all its records; `None` where one cannot be simulated.
    pub fn residuals(&self, setting: &Setting) -> Option<Vec<Residual>> {
        self.records.par_iter().map(|record| self.machine.residual(setting, *record)).collect()
    }

    /// A setting with knobs that stand at an end of their range as near to it as fits come: they
    /// would leap there with the first step.
    pub fn inside(&self, mut setting: Setting, knobs: &[Knob]) -> Setting {
        for knob in knobs {
            let open = knob.open(self.machine, &setting);
            knob.close(self.machine, &mut setting, open);
        }
        setting
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
            // Place by free number; a declared parameter stands in the middle of its range, or
            // nearly.
            Knob::Base(index) if self.machine.base[*index].declared.is_some() => {
                DECLARED * knob.open(self.machine, setting).cos()
            }
            _ => 0.0,
        }
    }

    /// Weights of every record and channel: 1 over the root mean square.
    pub fn weights(residuals: &[Residual]) -> Vec<Vec<f64>> {
        let weight =
            |channel: &Vec<f64>| 1.0 / super::record::rms(channel.iter().copied()).max(1e-9);
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

    /// Slopes of the weighted residual by the free number of each knob; 0 of one that cannot be
    /// moved without losing a record, which then stays where it is.
    pub fn slopes(&self, fitted: &Fitted, knobs: &[Knob], weights: &[Vec<f64>]) -> DMatrix<f64> {
        let here = Self::stack(&fitted.residuals, weights);
        let moved: Vec<(Setting, f64)> = knobs
            .iter()
            .map(|knob| {
                let mut setting = fitted.setting.clone();
                let (from, to) =
                    (knob.open(self.machine, &setting), knob.aside(self.machine, &setting));
                knob.close(self.machine, &mut setting, to);
                (setting, to - from)
            })
            .collect();
        let jobs: Vec<(usize, usize)> = (0..knobs.len())
            .flat_map(|knob| self.records.iter().map(move |record| (knob, *record)))
            .collect();
        let mut residuals = jobs
            .par_iter()
            .map(|(knob, record)| self.machine.residual(&moved[*knob].0, *record))
            .collect::<Vec<Option<Residual>>>()
            .into_iter();
        let mut slopes = DMatrix::zeros(here.len(), knobs.len());
        for (knob, (_, aside)) in moved.iter().enumerate() {
            let of_knob: Vec<Option<Residual>> =
                residuals.by_ref().take(self.records.len()).collect();
            if let Some(of_knob) = of_knob.into_iter().collect::<Option<Vec<Residual>>>() {
                slopes.set_column(knob, &((Self::stack(&of_knob, weights) - &here) / *aside));
            }
        }
        slopes
    }

    /// One step of Gauss and Newton with slopes that were taken before, at another place perhaps:
    /// as far as it leads down. Weights are those of the slopes. `None` where it does not.
    pub fn step(
        &self,
        from: &Fitted,
        knobs: &[Knob],
        slopes: &DMatrix<f64>,
        weights: &[Vec<f64>],
    ) -> Option<Fitted> {
        let rows = Self::stack(&from.residuals, weights);
        let (mut normal, mut gradient) = (slopes.transpose() * slopes, slopes.transpose() * rows);
        for (at, knob) in knobs.iter().enumerate() {
            let Knob::Base(index) = knob else { continue };
            let slope = self.off_slope(knob, &from.setting);
            normal[(at, at)] += slope * slope;
            gradient[at] += slope * self.off(&from.setting, *index);
        }
        let damped =
            &normal + DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-3 * entry + 1e-9));
        let whole = -damped.cholesky()?.solve(&gradient);
        [1.0, 0.4, 0.1].iter().find_map(|part| {
            let mut setting = from.setting.clone();
            for (knob, change) in knobs.iter().zip(whole.iter()) {
                let open = knob.open(self.machine, &setting);
                // No further than an end of the range.
                let open = (open + (part * change).clamp(-0.7, 0.7)).clamp(-FRAC_PI_2, FRAC_PI_2);
                knob.close(self.machine, &mut setting, open);
            }
            self.evaluate(setting).filter(|fitted| fitted.objective < from.objective)
        })
    }

    /// Fits from a setting: so many rounds, each with weights and slopes taken where it begins.
    /// `None` where the start cannot be simulated.
    pub fn fit(&self, start: &Setting, knobs: &[Knob], rounds: usize) -> Option<Fitted> {
        let mut best = self.evaluate(self.inside(start.clone(), knobs))?;
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
                known: RefCell::new(None),
            };
            let (mut problem, _) = LevenbergMarquardt::new()
                .with_ftol(1e-4)
                .with_xtol(1e-9)
                .with_stepbound(3.0)
                .minimize(problem);
            // It may end on a step that was none.
            let kept = problem.before.take().and_then(|(_, fitted)| fitted);
            let now = [problem.now.take(), kept]
                .into_iter()
                .flatten()
                .min_by(|a, b| a.objective.total_cmp(&b.objective));
            match now {
                Some(now) if now.objective < best.objective => best = now,
                _ => break,
            }
            // Less than one row's worth in a thousand is none.
            if before - best.objective < 2e-4 * best.rows() as f64 {
                break;
            }
        }
        Some(best)
    }

    /// Those of some starts that lead furthest in a brief fit, the foremost first: how a start
    /// looks says little of where it leads, a round or two say most of it.
    pub fn leading(&self, starts: &[Setting], knobs: &[Knob], rounds: usize) -> Vec<Fitted> {
        let mut begun: Vec<Fitted> =
            starts.par_iter().filter_map(|start| self.fit(start, knobs, rounds)).collect();
        begun.sort_by(|a, b| a.objective.total_cmp(&b.objective));
        begun.truncate(LEADING);
        begun
    }
}

/// `Σ ½ M ln(mean e²)`.
pub fn objective(residuals: &[Residual]) -> f64 {
    let one = |channel: &Vec<f64>| {
        channel.len() as f64 * super::record::rms(channel.iter().copied()).max(1e-9).ln()
    };
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
    /// The slopes in use.
    known: RefCell<Option<Known>>,
}

/// Slopes that were taken once and are kept up to date by what every step since has shown
/// (Broyden): a step costs one simulation of every record, slopes one for every knob.
struct Known {
    /// Where they hold.
    open: DVector<f64>,
    /// The rows there.
    rows: DVector<f64>,
    /// The objective there.
    objective: f64,
    slopes: DMatrix<f64>,
    /// Steps since they were taken.
    steps: usize,
}

impl Known {
    /// Brings them up to date, or says that they lead no further: too many steps ago, or the last
    /// one gained too little.
    fn update(&mut self, open: &DVector<f64>, rows: DVector<f64>, objective: f64) -> bool {
        let step = open - &self.open;
        let length = step.norm_squared();
        let gained = (self.objective - objective) / rows.len() as f64;
        if self.steps >= STEPS_KEPT || gained < LEAST_KEPT || length <= f64::MIN_POSITIVE {
            return false;
        }
        let beyond = &rows - &self.rows - &self.slopes * &step;
        self.slopes.ger(1.0 / length, &beyond, &step, 1.0);
        (self.open, self.rows, self.objective) = (open.clone(), rows, objective);
        self.steps += 1;
        true
    }
}

impl Problem<'_, '_> {
    fn rows(&self) -> usize {
        let machine = self.view.machine;
        let of = |record: &usize| {
            machine.channels(*record).len() * machine.records[*record].residual_rows()
        };
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
        let Some(now) = self.now.as_ref() else {
            return Some(DVector::from_element(self.rows(), 1e6));
        };
        let rows = View::stack(&now.residuals, &self.weights);
        let off: Vec<f64> =
            self.declared().map(|index| self.view.off(&now.setting, index)).collect();
        let data = rows.len();
        let mut all = rows.resize_vertically(data + off.len(), 0.0);
        for (row, off) in off.into_iter().enumerate() {
            all[data + row] = off;
        }
        Some(all)
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let now = self.now.as_ref()?;
        let rows = self.residuals()?;
        let mut known = self.known.borrow_mut();
        if let Some(known) = known.as_mut() {
            return known.update(&self.open, rows, now.objective).then(|| known.slopes.clone());
        }
        let slopes = self.view.slopes(now, self.knobs, &self.weights);
        let data = slopes.nrows();
        let mut all = slopes.resize_vertically(data + self.declared().count(), 0.0);
        let of_declared = self.knobs.iter().enumerate().filter(|(_, knob)| knob.is_base());
        for (row, (column, knob)) in of_declared.enumerate() {
            all[(data + row, column)] = self.view.off_slope(knob, &now.setting);
        }
        *known = Some(Known {
            open: self.open.clone(),
            rows,
            objective: now.objective,
            slopes: all.clone(),
            steps: 0,
        });
        Some(all)
    }
}

impl View<'_> {
    /// Standard deviation of each knob's value, by blocks: neighbours in a residual are not
    /// independent. Infinite where the records do not see it, or one cannot be told at all.
    pub fn deviations(&self, fitted: &Fitted, knobs: &[Knob], block: usize) -> Vec<f64> {
        let weights = Self::weights(&fitted.residuals);
        let slopes = self.slopes(fitted, knobs, &weights);
        let rows = Self::stack(&fitted.residuals, &weights);
        let normal = slopes.transpose() * &slopes;
        let unseen = UNSEEN * UNSEEN * slopes.nrows() as f64;
        let seen: Vec<bool> = normal.diagonal().iter().map(|entry| *entry > unseen).collect();
        let ridge = DMatrix::from_diagonal(&normal.diagonal().map(|entry| 1e-9 * entry + 1e-12));
        let Some(factors) = (normal + ridge).cholesky() else {
            return vec![f64::INFINITY; knobs.len()];
        };
        let inverse = factors.inverse();
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
            // A number that few blocks see has no spread among them: then it is known no better
            // than if rows were independent.
            let variance = covariance[(index, index)].max(inverse[(index, index)]);
            if seen[index] { variance.max(0.0).sqrt() * slope.abs() } else { f64::INFINITY }
        };
        knobs.iter().enumerate().map(by_value).collect()
    }
}
