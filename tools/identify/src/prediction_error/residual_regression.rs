//! Regression of the residual on recorded signals: on what an unmodelled torque depends that is no
//! function of one variable.
//!
//! At the localised place, a torque is added to the model that is linear in a few columns computed
//! from the records alone: a function of a signal times the direction of motion (friction that
//! depends on it), or times the acceleration (an inertia that depends on it); first-order lags of a
//! signal (creep); masses on springs. The response of the residual to each column is simulated, and
//! the residual is regressed on the responses, with the sensitivities to the declared parameters
//! projected out. The regression with the largest share of the squared residual on the selecting
//! records, which took no part in it, is reported if that share is large enough.

use std::f64::consts::TAU;
use std::sync::Arc;

use plant::effects::{Effect, Site};
use rayon::prelude::*;

use super::dataset::{Dataset, Fitted};
use super::nonparametric::Variable;
use super::probe_torque::{Action, ProbeTorque};
use super::record::rms;
use super::recorded_signals::{RecordedSignals, Signal};
use super::screening::Projection;
use super::transmission_model::{Residual, Setting, TransmissionModel};

/// Nodes of a function of a signal.
const NODES: usize = 9;
/// Part of a signal's values beyond each end of its function, which is constant there.
const BEYOND: f64 = 0.01;
/// rms of an added torque relative to the motor's: small, since friction responds nonlinearly.
const SIZE: f64 = 0.02;
/// Time constants of the lags (s).
const LAGS_S: [f64; 6] = [0.05, 0.15, 0.4, 1.0, 2.5, 6.0];
/// Natural frequencies of the masses on springs (Hz).
const RESONANCES_HZ: [f64; 7] = [2.0, 3.0, 4.5, 6.5, 10.0, 15.0, 22.0];
/// Their damping ratio.
const RESONANCE_DAMPING: f64 = 0.15;
/// Least share of the squared residual of the selecting records that a reported regression
/// explains.
const LEAST_SHARE: f64 = 0.1;

/// How the torque is linear in columns computed from a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// A piecewise linear function of the signal.
    Function,
    /// A function times the direction of motion.
    Friction,
    /// A function times the direction in which the signal changes.
    Hysteresis,
    /// A function times another signal.
    Times(Signal),
    /// First-order lags of the signal, with the time constants [`LAGS_S`].
    Lags,
    /// Masses on springs, with the frequencies [`RESONANCES_HZ`].
    Resonances,
}

/// A torque, and what it is linear in.
#[derive(Clone, Copy, Debug)]
struct Regressor {
    action: Action,
    variable: Variable,
    signal: Signal,
    form: Form,
}

const fn regressor(action: Action, variable: Variable, signal: Signal, form: Form) -> Regressor {
    Regressor { action, variable, signal, form }
}

/// What a torque on master or slave may depend on.
const fn of_side(site: Site) -> [Regressor; 13] {
    use Form::{Friction, Function, Hysteresis, Resonances, Times};
    let action = Action::Torque(site);
    [
        regressor(action, Variable::Position, Signal::Position, Function),
        regressor(action, Variable::Position, Signal::Position, Friction),
        regressor(action, Variable::Position, Signal::Position, Times(Signal::Acceleration)),
        regressor(action, Variable::Velocity, Signal::Velocity, Function),
        regressor(action, Variable::Acceleration, Signal::Acceleration, Function),
        regressor(action, Variable::Acceleration, Signal::Acceleration, Friction),
        regressor(action, Variable::Acceleration, Signal::Acceleration, Resonances),
        regressor(action, Variable::Torque, Signal::Twist, Function),
        regressor(action, Variable::Torque, Signal::Twist, Friction),
        regressor(action, Variable::Torque, Signal::Twist, Hysteresis),
        regressor(action, Variable::Time, Signal::Time, Function),
        regressor(action, Variable::Time, Signal::Time, Friction),
        regressor(action, Variable::Time, Signal::Rest, Friction),
    ]
}

/// What a force of the lines may depend on.
const OF_LINE: [Regressor; 9] = {
    use Action::{MovingMass, Spring};
    use Form::{Function, Hysteresis, Lags, Times};
    [
        regressor(MovingMass, Variable::Position, Signal::Position, Function),
        regressor(MovingMass, Variable::Position, Signal::Position, Times(Signal::Velocity)),
        regressor(MovingMass, Variable::Velocity, Signal::Velocity, Function),
        regressor(Spring, Variable::Deflection, Signal::Twist, Function),
        regressor(Spring, Variable::Deflection, Signal::Twist, Hysteresis),
        regressor(Spring, Variable::Deflection, Signal::Twist, Lags),
        regressor(Spring, Variable::Position, Signal::Position, Times(Signal::Twist)),
        regressor(Spring, Variable::Velocity, Signal::Velocity, Function),
        regressor(Spring, Variable::Time, Signal::Time, Times(Signal::Twist)),
    ]
};

/// What an error of the torque sensor may depend on.
const OF_SENSOR: [Regressor; 7] = {
    use Form::{Function, Hysteresis, Lags};
    let action = Action::Torque(Site::Sensor);
    [
        regressor(action, Variable::Torque, Signal::Torque, Function),
        regressor(action, Variable::Torque, Signal::Torque, Hysteresis),
        regressor(action, Variable::Torque, Signal::Torque, Lags),
        regressor(action, Variable::Position, Signal::Position, Function),
        regressor(action, Variable::Velocity, Signal::Velocity, Function),
        regressor(action, Variable::Acceleration, Signal::Acceleration, Function),
        regressor(action, Variable::Time, Signal::Time, Function),
    ]
};

/// What an effect localised at a site may depend on. A force of the springs acts on both sides, so
/// that one of them may be found in its place.
fn regressors(site: Site) -> Vec<Regressor> {
    let of_springs = OF_LINE.into_iter().filter(|own| own.action == Action::Spring);
    match site {
        Site::Line => OF_LINE.to_vec(),
        Site::Sensor => OF_SENSOR.to_vec(),
        side => of_side(side).into_iter().chain(of_springs).collect(),
    }
}

/// What an unmodelled torque depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dependence {
    /// The variable.
    pub variable: Variable,
    /// How it depends on it, in words that complete "it acts like ...".
    pub words: &'static str,
    /// Share of the squared residual of the selecting records that the regression explains, 0 to 1.
    pub share: f64,
}

impl Regressor {
    const fn words(self) -> &'static str {
        match (self.form, self.variable) {
            (Form::Function, Variable::Position) => "a torque that depends on position",
            (Form::Function, Variable::Velocity) => "a torque that depends on speed",
            (Form::Function, Variable::Acceleration) => "a torque that depends on acceleration",
            (Form::Function, Variable::Time) => "a torque that depends on time",
            (Form::Function, _) => "a torque that depends on the load",
            (Form::Friction, Variable::Position) => "friction that depends on position",
            (Form::Friction, Variable::Acceleration) => "friction that depends on acceleration",
            (Form::Friction, Variable::Time) if matches!(self.signal, Signal::Rest) => {
                "friction that depends on the time at rest"
            }
            (Form::Friction, Variable::Time) => "friction that depends on time",
            (Form::Friction, _) => "friction that depends on the load",
            (Form::Hysteresis, _) => "a hysteresis over the load",
            (Form::Lags, _) => "a creep under load",
            (Form::Resonances, _) => "a mass on a spring",
            (Form::Times(Signal::Acceleration), _) => "an inertia that depends on position",
            (Form::Times(Signal::Velocity), _) => "damping that depends on position",
            (Form::Times(_), Variable::Time) => "a stiffness that depends on time",
            (Form::Times(_), _) => "a stiffness that depends on position",
        }
    }

    /// The site whose signals it takes.
    const fn site(self) -> Site {
        match self.action {
            Action::Torque(site) => site,
            Action::MovingMass | Action::Spring => Site::Line,
        }
    }

    /// Its columns along a record; `range` is that of the signal.
    fn columns(self, signals: &RecordedSignals, range: (f64, f64)) -> Vec<Vec<f64>> {
        let column = signals.column(self.signal, self.site());
        let factor = match self.form {
            Form::Lags => return LAGS_S.map(|lag_s| signals.lagged(&column, lag_s)).to_vec(),
            Form::Resonances => {
                let of = |hz: &f64| signals.resonance(self.site(), TAU * hz, RESONANCE_DAMPING);
                return RESONANCES_HZ.iter().flat_map(of).collect();
            }
            Form::Function => vec![1.0; column.len()],
            Form::Friction => signals.direction(self.site()),
            Form::Hysteresis => signals.change(&column),
            Form::Times(other) => signals.column(other, self.site()),
        };
        hats(&column, range)
            .map(|hat| hat.iter().zip(&factor).map(|(hat, factor)| hat * factor).collect())
            .collect()
    }
}

/// The basis of the piecewise linear functions of a column: one hat per node.
fn hats(column: &[f64], (low, high): (f64, f64)) -> impl Iterator<Item = Vec<f64>> {
    let last = (NODES - 1) as f64;
    let per_unit = last / (high - low).max(f64::MIN_POSITIVE);
    let places: Vec<f64> =
        column.iter().map(|value| ((value - low) * per_unit).clamp(0.0, last)).collect();
    (0..NODES).map(move |node| {
        places.iter().map(|place| (1.0 - (place - node as f64).abs()).max(0.0)).collect()
    })
}

/// The records of one role with their signals and residuals.
struct Part<'a> {
    dataset: &'a Dataset<'a>,
    signals: Vec<RecordedSignals>,
    residuals: &'a [Residual],
    setting: &'a Setting,
    projection: Projection,
}

impl<'a> Part<'a> {
    fn new(dataset: &'a Dataset<'a>, fitted: &'a Fitted) -> Option<Self> {
        let model = dataset.model;
        let zero = model.slave_zero_rad(&fitted.setting);
        let signals = dataset.records.iter();
        let signals = signals.map(|record| RecordedSignals::of(&model.records[*record], zero));
        Some(Self {
            dataset,
            signals: signals.collect::<Option<_>>()?,
            residuals: &fitted.residuals,
            setting: &fitted.setting,
            projection: Projection::new(dataset, fitted),
        })
    }

    /// Range of a signal, without the outermost values.
    fn range(&self, of: Regressor) -> Option<(f64, f64)> {
        let mut values: Vec<f64> = Vec::new();
        self.signals.iter().for_each(|own| values.extend(own.column(of.signal, of.site())));
        values.sort_by(f64::total_cmp);
        let outside = (values.len() as f64 * BEYOND) as usize;
        Some((*values.get(outside)?, *values.get(values.len() - 1 - outside)?))
    }

    /// Columns of a regressor, by column and record.
    fn columns(&self, of: Regressor, range: (f64, f64)) -> Vec<Vec<Vec<f64>>> {
        let mut by_column: Vec<Vec<Vec<f64>>> = Vec::new();
        for signals in &self.signals {
            for (index, column) in of.columns(signals, range).into_iter().enumerate() {
                match by_column.get_mut(index) {
                    Some(own) => own.push(column),
                    None => by_column.push(vec![column]),
                }
            }
        }
        by_column
    }

    /// The residuals with each column added as a torque, of the given size; `None` if one cannot be
    /// simulated, or after the deadline.
    fn responses(
        &self,
        of: Regressor,
        columns: &[Vec<Vec<f64>>],
        sizes: &[f64],
    ) -> Option<Vec<Vec<Residual>>> {
        let count = self.signals.len();
        let jobs: Vec<(usize, usize)> =
            (0..columns.len()).flat_map(|column| (0..count).map(move |at| (column, at))).collect();
        let one = |(column, at): &(usize, usize)| {
            let values = columns[*column][*at].iter().map(|value| sizes[*column] * value);
            self.response(of.action, *at, values.collect())
        };
        let flat: Vec<Residual> = jobs.par_iter().map(one).collect::<Option<_>>()?;
        Some(flat.chunks(count).map(<[Residual]>::to_vec).collect())
    }

    fn response(&self, action: Action, at: usize, values: Arc<[f64]>) -> Option<Residual> {
        let Dataset { model, records, deadline } = self.dataset;
        if deadline.has_passed() {
            return None;
        }
        let record = &model.records[records[at]];
        let of_sensor = action == Action::Torque(Site::Sensor);
        if of_sensor && record.idle {
            // Without a hand, an error of the sensor shows as such and moves nothing.
            let mut shown = self.residuals[at].clone();
            if let Some(torque) = shown.channels.last_mut().filter(|_| record.torque.is_some()) {
                let errors = record.averaged(&values);
                torque.iter_mut().zip(errors).for_each(|(shown, error)| *shown += error);
            }
            return Some(shown);
        }
        let action = if of_sensor { Action::Torque(Site::Slave) } else { action };
        let torque = ProbeTorque::new(action, record.start_s, record.step_s, values);
        let beside = vec![Box::new(torque) as Box<dyn Effect>];
        model.residual_beside(self.setting, records[at], beside)
    }
}

/// rms of the torque that is added (N·m), or of the force in the lines (N).
fn size(model: &TransmissionModel, records: &[usize], action: Action) -> f64 {
    let volts = records.iter().flat_map(|record| &model.records[*record].volts);
    let torque_nm = SIZE * model.declared.motor_torque_per_volt_nm() * rms(volts.copied());
    action.size_of(torque_nm, &model.declared)
}

/// Share of the squared residual of the selecting records that a regression on the fitting ones
/// explains.
fn share((fit, select): (&Part<'_>, &Part<'_>), of: Regressor) -> Option<f64> {
    let range = fit.range(of)?;
    let columns = fit.columns(of, range);
    let size = size(fit.dataset.model, &fit.dataset.records, of.action);
    let sizes: Vec<f64> = columns
        .iter()
        .map(|column| size / rms(column.iter().flatten().copied()).max(f64::MIN_POSITIVE))
        .map(|size| if size.is_finite() { size } else { 0.0 })
        .collect();
    let factors = fit.projection.regress(&fit.responses(of, &columns, &sizes)?)?;
    let there = select.responses(of, &select.columns(of, range), &sizes)?;
    Some(select.projection.explained(&there, &factors))
}

/// Returns what an unmodelled torque at a site depends on, if a regression explains enough of the
/// residual of `now` on the selecting records.
pub fn regress(
    (fit, select): (&Dataset<'_>, &Dataset<'_>),
    now: &Fitted,
    site: Site,
) -> Option<Dependence> {
    let selected = select.evaluate(now.setting.clone())?;
    let selected = Fitted { parameters: now.parameters.clone(), ..selected };
    let parts = (&Part::new(fit, now)?, &Part::new(select, &selected)?);
    let shares = regressors(site).into_iter().filter_map(|of| Some((share(parts, of)?, of)));
    let (share, of) = shares.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if share < LEAST_SHARE || fit.deadline.has_passed() {
        return None;
    }
    Some(Dependence { variable: of.variable, words: of.words(), share })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hats_sum_to_one_and_are_constant_beyond_the_ends() {
        let column = [-5.0, -1.0, 0.3, 1.0, 7.0];
        let hats: Vec<Vec<f64>> = hats(&column, (-1.0, 1.0)).collect();
        for row in 0..column.len() {
            assert!((hats.iter().map(|hat| hat[row]).sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert_eq!((hats[0][0], hats[0][1], hats[NODES - 1][4]), (1.0, 1.0, 1.0));
        assert!(hats.iter().flatten().all(|value| (0.0..=1.0).contains(value)));
    }

    #[test]
    fn regressors_of_one_place_have_words_of_their_own() {
        let master = of_side(Site::Master);
        let slave = of_side(Site::Slave);
        let lists: [&[Regressor]; 4] = [&master, &slave, &OF_LINE, &OF_SENSOR];
        for all in lists {
            for (index, one) in all.iter().enumerate() {
                for other in &all[index + 1..] {
                    let same = (one.words(), one.action) == (other.words(), other.action);
                    assert!(!same, "{one:?} {other:?}");
                }
            }
        }
    }
}
