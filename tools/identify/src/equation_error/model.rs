//! A linear model with a few nonlinear shapes, and its columns.

use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::block_roles::Block;
use super::signals::{ForceBalance, Signals};
use crate::effects::{Axis, Declared, Regressor, Shape, Term, Units, View};
use crate::regression::{Bound, Fit, Gram};

/// A declared parameter as a column of the regression.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Name, as in the rig file.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Declared value.
    pub declared: f64,
    /// Half the width of the range in which the value is believed to lie.
    pub spread: f64,
    /// What it multiplies.
    pub column: Column,
}

/// What a declared parameter multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Acceleration: mass or inertia.
    Acceleration,
    /// Velocity: viscous friction.
    Velocity,
    /// Position: stiffness.
    Position,
    /// Smoothed sign of the velocity: Coulomb friction, where the rig file declares it.
    Sign,
    /// One: a constant force.
    One,
}

impl Column {
    /// The column whose parameter an effect would change.
    pub const fn of(which: Declared) -> Self {
        match which {
            Declared::Mass => Self::Acceleration,
            Declared::Viscous => Self::Velocity,
            Declared::Stiffness => Self::Position,
            Declared::Coulomb => Self::Sign,
        }
    }

    /// Unit of the parameter that multiplies it.
    pub const fn unit(self, units: &Units) -> &'static str {
        match self {
            Self::Acceleration => units.mass,
            Self::Velocity => units.damping,
            Self::Position => units.stiffness,
            Self::Sign | Self::One => units.force,
        }
    }

    /// Its values along a record at the full rate, low-passed, given the smoothed sign of the
    /// velocity.
    fn values<'a>(self, signals: &'a Signals, sign: &[f64]) -> Cow<'a, [f64]> {
        Cow::Borrowed(match self {
            Self::Acceleration => &signals.acceleration,
            Self::Velocity => &signals.velocity,
            Self::Position => &signals.position,
            Self::Sign => return Cow::Owned(signals.low_passed(sign)),
            Self::One => return Cow::Owned(vec![1.0; signals.time.len()]),
        })
    }
}

/// The machine and its records, before any effect.
pub struct RegressionModel {
    /// Records, ready for regression.
    pub balances: Vec<ForceBalance>,
    /// Declared parameters.
    pub parameters: Vec<Parameter>,
    /// Units and scales of the axis.
    pub axis: Axis,
    /// Sites at which effects are searched; an effect with several of them is placed at the first.
    pub sites: &'static [&'static str],
}

/// The declared model with the effects that were added to it.
#[derive(Clone, Default)]
pub struct Structure<'a> {
    /// In the order in which they were added.
    pub effects: Vec<&'a dyn Regressor>,
    /// The force that a model predicts, per record at the full rate, from which some columns are
    /// computed.
    pub model: Arc<Vec<Vec<f64>>>,
}

/// A fitted structure.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Amplitudes: declared parameters first, then the effects' terms.
    pub fit: Fit,
    /// Their standard deviations.
    pub std: Vec<f64>,
    /// Correlation of each with each.
    pub correlation: DMatrix<f64>,
    /// Smoothing speed first, then the effects' shapes.
    pub shapes: Vec<f64>,
    /// Columns by record, at these shapes; none where the output is simulated.
    pub columns: Vec<Vec<Vec<f64>>>,
    /// Simulated output of each record, row by row, where it is simulated.
    pub outputs: Vec<Vec<f64>>,
}

/// Time shift of a force that sampling, computing and zero-order hold may cause, in sampling
/// periods.
const HELD: f64 = 1.5;
/// A shape within this share of its range from an end is at that end.
const END_OF_RANGE: f64 = 0.01;

impl RegressionModel {
    /// Whether the declared model has that column.
    pub fn declares(&self, column: Column) -> bool {
        self.parameters.iter().any(|p| p.column == column)
    }

    /// Whether an effect frees a declared parameter instead of having a column of its own.
    pub fn frees(&self, effect: &dyn Regressor) -> bool {
        effect.declaration().lifts.is_some_and(|which| self.declares(Column::of(which)))
    }

    /// Whether anything in the structure depends on the smoothed sign.
    pub fn uses_sign(&self, structure: &Structure<'_>) -> bool {
        structure.effects.iter().any(|e| e.declaration().uses_sign) || self.declares(Column::Sign)
    }

    /// The smoothing speed of the sign, then the shapes of the effects.
    pub fn shapes(&self, structure: &Structure<'_>) -> Vec<Shape> {
        let range = (1e-3 * self.axis.velocity_rms, 0.3 * self.axis.velocity_rms);
        let points = if self.uses_sign(structure) { 7 } else { 1 };
        let mut shapes =
            vec![Shape::by_factors("smoothing_speed", self.axis.units.velocity, range, points)];
        shapes.extend(structure.effects.iter().flat_map(|e| (e.declaration().shapes)(&self.axis)));
        shapes
    }

    /// The terms of one effect that have columns of their own.
    pub fn terms_of(&self, effect: &dyn Regressor) -> Vec<Term> {
        if self.frees(effect) { Vec::new() } else { effect.terms(&self.axis) }
    }

    /// The effects' terms in order.
    pub fn terms(&self, structure: &Structure<'_>) -> Vec<Term> {
        structure.effects.iter().flat_map(|e| self.terms_of(*e)).collect()
    }

    /// Bounds of all amplitudes: of declared parameters their tolerances, unless an effect lifts
    /// them; of effects their physical limits.
    pub fn bounds(&self, structure: &Structure<'_>) -> Vec<Bound> {
        let lifted = |column| {
            structure.effects.iter().any(|e| e.declaration().lifts.map(Column::of) == Some(column))
        };
        let declared = self.parameters.iter().map(|p| match p.column {
            // Mass, damping and stiffness cannot be negative, whatever the tolerance.
            Column::One => (p.declared - p.spread, p.declared + p.spread),
            // Mass beyond its tolerance is more of it: a motor cannot weigh less than declared.
            Column::Acceleration if lifted(Column::Acceleration) => {
                ((p.declared - p.spread).max(0.0), f64::INFINITY)
            }
            column if lifted(column) => (0.0, f64::INFINITY),
            _ => ((p.declared - p.spread).max(0.0), p.declared + p.spread),
        });
        declared.chain(self.terms(structure).into_iter().map(|t| t.bound)).collect()
    }

    /// The smoothed sign along a record, if the structure needs it; else empty.
    pub(super) fn sign(
        &self,
        structure: &Structure<'_>,
        smoothing: f64,
        balance: &ForceBalance,
    ) -> Vec<f64> {
        if self.uses_sign(structure) { balance.signals.sign(smoothing) } else { Vec::new() }
    }

    /// Rows of the declared parameters' columns.
    pub(super) fn declared_columns(&self, sign: &[f64], balance: &ForceBalance) -> Vec<Vec<f64>> {
        let signals = &balance.signals;
        self.parameters.iter().map(|p| signals.rows(&p.column.values(signals, sign))).collect()
    }

    /// An effect's columns at the full rate, low-passed.
    fn full_columns(
        &self,
        effect: &dyn Regressor,
        (signals, view): (&Signals, &View<'_>),
        shapes: &[f64],
    ) -> Vec<Vec<f64>> {
        if self.frees(effect) {
            return Vec::new();
        }
        let columns = effect.columns(view, shapes);
        match effect.declaration().linear {
            true => columns,
            false => columns.iter().map(|c| signals.low_passed(c)).collect(),
        }
    }

    /// The columns of a record for the effects of a structure from index `first` on, at the rows of
    /// the balance.
    pub(super) fn columns_from(
        &self,
        first: usize,
        structure: &Structure<'_>,
        (record, sign): (usize, &[f64]),
        shapes: &[f64],
    ) -> Vec<Vec<f64>> {
        let signals = &self.balances[record].signals;
        let model = structure.model.get(record).map_or(&[][..], Vec::as_slice);
        let view = View { signals, sign, model, axis: &self.axis };
        let effects = structure.effects.iter().zip(self.places(structure)).skip(first);
        effects
            .flat_map(|(effect, place)| {
                self.full_columns(*effect, (signals, &view), &shapes[place])
            })
            .map(|column| signals.rows(&column))
            .collect()
    }

    /// The range of each effect's shapes in the list of all, of which the smoothing speed is the
    /// first.
    pub fn places(&self, structure: &Structure<'_>) -> Vec<std::ops::Range<usize>> {
        let mut next = 1;
        let place = |effect: &&dyn Regressor| {
            let from = next;
            next += (effect.declaration().shapes)(&self.axis).len();
            from..next
        };
        structure.effects.iter().map(place).collect()
    }

    /// All columns of all records.
    pub fn columns(&self, structure: &Structure<'_>, shapes: &[f64]) -> Vec<Vec<Vec<f64>>> {
        let of = |(record, balance): (usize, &ForceBalance)| {
            let sign = self.sign(structure, shapes[0], balance);
            let mut columns = self.declared_columns(&sign, balance);
            columns.extend(self.columns_from(0, structure, (record, &sign), shapes));
            columns
        };
        self.balances.iter().enumerate().map(of).collect()
    }

    /// The force that a fitted model predicts, per record at the full rate, low-passed. Effects
    /// that are computed from this force are left out.
    pub fn force(&self, structure: &Structure<'_>, fitted: &Fitted) -> Vec<Vec<f64>> {
        let places = self.places(structure);
        let of = |balance: &ForceBalance| {
            let signals = &balance.signals;
            let mut force = vec![0.0; signals.time.len()];
            let mut add = |amplitude: f64, column: &[f64]| {
                force.iter_mut().zip(column).for_each(|(f, x)| *f += amplitude * x);
            };
            let sign = self.sign(structure, fitted.shapes[0], balance);
            for (p, amplitude) in self.parameters.iter().zip(fitted.fit.coefficients.iter()) {
                add(*amplitude, &p.column.values(signals, &sign));
            }
            let mut at = self.parameters.len();
            for (effect, place) in structure.effects.iter().zip(&places) {
                let terms = self.terms_of(*effect);
                // A clipped command is not a force required by the motion.
                if !effect.declaration().uses_model && !terms.iter().any(Term::is_given) {
                    let view = View { signals, sign: &sign, model: &[], axis: &self.axis };
                    let shapes = &fitted.shapes[place.clone()];
                    let columns = self.full_columns(*effect, (signals, &view), shapes);
                    for (i, column) in columns.iter().enumerate() {
                        add(fitted.fit.coefficients[at + i], column);
                    }
                }
                at += terms.len();
            }
            force
        };
        self.balances.iter().map(of).collect()
    }

    /// Sums of products over some rows.
    pub(super) fn gram(&self, columns: &[Vec<Vec<f64>>], blocks: &[Block]) -> Gram {
        let mut gram = Gram::empty(columns.first().map_or(0, Vec::len));
        for block in blocks {
            gram.add(
                &columns[block.record],
                &self.balances[block.record].force,
                block.rows.clone(),
            );
        }
        gram
    }

    /// Variance of the force that is left to be explained, as a share of the variance of the
    /// measured force, over some rows: less than 1 where an effect takes a part of it away.
    pub fn target_share(
        &self,
        structure: &Structure<'_>,
        fitted: &Fitted,
        blocks: &[Block],
    ) -> f64 {
        let terms = self.terms(structure);
        let from = self.parameters.len();
        let given: Vec<usize> =
            (from..).zip(&terms).filter(|t| t.1.is_given()).map(|t| t.0).collect();
        if given.is_empty() {
            return 1.0;
        }
        let (mut whole, mut kept) = (Vec::new(), Vec::new());
        for block in blocks {
            let columns = &fitted.columns[block.record];
            for row in block.rows.clone() {
                let force = self.balances[block.record].force[row];
                let taken = given.iter().map(|at| fitted.fit.coefficients[*at] * columns[*at][row]);
                whole.push(force);
                kept.push(force - taken.sum::<f64>());
            }
        }
        (variance(&kept) / variance(&whole).max(f64::MIN_POSITIVE)).max(1e-9)
    }

    /// Residual of a fitted structure over some rows.
    pub fn residual(&self, fitted: &Fitted, block: &Block) -> Vec<f64> {
        residual(
            &fitted.columns[block.record],
            &self.balances[block.record].force,
            &fitted.fit.coefficients,
            block,
        )
    }

    /// The time shift (s) of the last effect, if that does nothing else.
    pub fn time_shift(&self, structure: &Structure<'_>, fitted: &Fitted) -> Option<f64> {
        let effect = *structure.effects.last()?;
        let amplitudes = fitted.fit.coefficients.as_slice();
        let own = &amplitudes[amplitudes.len() - self.terms_of(effect).len()..];
        let place = self.places(structure).pop()?;
        (effect.declaration().shift)(own, &fitted.shapes[place])
    }

    /// The time shift (s) of the last effect, if it is one that sampling and zero-order hold may
    /// cause.
    pub fn sampling_delay(&self, structure: &Structure<'_>, fitted: &Fitted) -> Option<f64> {
        let sampling = self.balances.iter().map(|b| b.sampling).fold(0.0, f64::max);
        self.time_shift(structure, fitted).filter(|shift| shift.abs() < HELD * sampling)
    }

    /// Whether a shape of the last effect ended at an end of its range: beyond it the effect is
    /// another one. Frequencies are taken from the spectrum instead.
    pub fn shape_at_end(&self, structure: &Structure<'_>, fitted: &Fitted) -> bool {
        let (Some(effect), Some(place)) = (structure.effects.last(), self.places(structure).pop())
        else {
            return false;
        };
        let shapes = self.shapes(structure);
        let at_end = |at: usize| {
            let share = shapes[at].share(fitted.shapes[at]);
            !(END_OF_RANGE..=1.0 - END_OF_RANGE).contains(&share)
        };
        !effect.declaration().is_tone && place.into_iter().any(at_end)
    }

    /// Root mean square over some rows of the contribution of the last `terms` columns of a fit.
    pub fn size_of_last(&self, fitted: &Fitted, terms: usize, blocks: &[Block]) -> f64 {
        let (mut sum, mut rows) = (0.0, 0usize);
        for block in blocks {
            let columns = &fitted.columns[block.record];
            let from = columns.len() - terms;
            for row in block.rows.clone() {
                let put: f64 = (from..columns.len())
                    .map(|c| fitted.fit.coefficients[c] * columns[c][row])
                    .sum();
                sum += put * put;
            }
            rows += block.rows.len();
        }
        (sum / rows.max(1) as f64).sqrt()
    }
}

/// Mean square about the mean.
fn variance(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n
}

/// Force minus the columns times their coefficients, over some rows.
pub(super) fn residual(
    columns: &[Vec<f64>],
    force: &[f64],
    coefficients: &DVector<f64>,
    block: &Block,
) -> Vec<f64> {
    let mut e = force[block.rows.clone()].to_vec();
    for (column, amplitude) in columns.iter().zip(coefficients.iter()) {
        for (e, x) in e.iter_mut().zip(&column[block.rows.clone()]) {
            *e -= amplitude * x;
        }
    }
    e
}
