//! What the page of a transmission shows: movements, innovations and what they depend on.

use report::Colour::{Black, Green};
use report::{Figure, Page};

use super::page::{Content, page as whole_page};
use super::residual_plots::{ChannelResidual, over_time, plotted};
use super::transmission_study::Study;
use crate::correlation::TestedResidual;
use crate::equation_error::block_roles::Role;
use crate::naming::labels;
use crate::outcome::Outcome;
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::record::Record;
use crate::prediction_error::transmission_model::{Channel, Residual};
use crate::prediction_error::validation::{
    LEAST_T, LEAST_T_FIRST, gain_percent, least_beside, least_over_octaves,
};

/// Slower motion counts as rest; a reversal is the next faster motion in the other direction
/// (rad/s).
const STILL_RAD_S: f64 = 0.1;
/// Longest time since a reversal that is shown (s).
const LONGEST_S: f64 = 1.0;
/// Number of records with figures of their own.
const MOST_FIGURES: usize = 3;

/// The whole page; `None` where a model cannot be simulated.
pub(super) fn page(
    study: &Study<'_>,
    outcome: &Outcome,
    tested: Vec<(Channel, TestedResidual)>,
) -> Option<Page> {
    let model = &study.model;
    let report = model.of_role(Role::Report);
    let dataset = Dataset::of(model, Role::Report);
    let before = dataset.residuals(&study.found.base.setting)?;
    let after = dataset.residuals(&study.found.last().setting)?;
    let with = !outcome.effects.is_empty();
    let records: Vec<&str> = model.records.iter().map(|record| record.name.as_str()).collect();
    let names = labels(records.iter().copied());
    let both = before.iter().zip(&after);
    let shown = report.iter().zip(both).take(MOST_FIGURES);
    let figures =
        shown.flat_map(|(index, both)| figures(study, (names[*index], *index), both, with));
    let channels = tested.into_iter().filter_map(|(channel, tested)| {
        residual_of(study, &report, (channel, tested), (&before, &after), with)
    });
    let accepted = format!(
        "Each candidate is fitted on the fitting records beside all declared parameters, and \
         validated on the selection ones. It is added when the errors of all channels, multiplied, \
         fall by {:.0} % or more (beside one effect by {:.0} %, beside two by {:.0} %), when that \
         is {LEAST_T_FIRST:.1} of its standard errors above zero (beside others {LEAST_T:.1}), \
         when more records get better than worse, and when no channel gets worse by more than 3 % \
         (for a first effect by a fifth of what all gain). An effect that hardly shows in the sum \
         over all frequencies is added when the errors in eight octaves of frequency, averaged, \
         fall by {:.0} % (beside one by {:.0} %, beside two by {:.0} %), in most records, and get \
         worse in none.",
        gain_percent(least_beside(0)),
        gain_percent(least_beside(1)),
        gain_percent(least_beside(2)),
        gain_percent(least_over_octaves(0)),
        gain_percent(least_over_octaves(1)),
        gain_percent(least_over_octaves(2))
    );
    let content = Content {
        declared: "transmission",
        located: true,
        records,
        errors:
            "Root mean square of the innovation (one-step prediction error of the observer) on \
                 the reporting records, averaged over 4 ms. The floor is the rms difference of \
                 repeated records over √2."
                .to_owned(),
        figures: figures.collect(),
        residual: "innovation",
        channels: channels.collect(),
        force_unit: None,
        accepted,
        method: "Residuals are those of the reporting records. These decide nothing; only the \
                 differences of repeated ones enter, as the floor."
            .to_owned(),
    };
    Some(whole_page(outcome, &content))
}

/// The measured movement of a record, and its innovations.
fn figures(
    study: &Study<'_>,
    (label, index): (&str, usize),
    (before, after): (&Residual, &Residual),
    with: bool,
) -> Vec<(Figure, String)> {
    let record = &study.model.records[index];
    let time = record.residual_times();
    let sides = [("master", Black, Some(&record.master)), ("slave", Green, record.slave.as_ref())];
    let position = sides.into_iter().fold(
        Figure::new("Position", "time / s", "position / rad").size(680, 260),
        |figure, (name, colour, side)| match side {
            Some(side) => figure.line(colour, name, &time, &record.averaged(side)[..time.len()]),
            None => figure,
        },
    );
    let mut figures = vec![(position, format!("{label}: measured movement."))];
    for (at, channel) in study.model.channels(index).into_iter().enumerate() {
        let (name, unit) = (channel.column(), channel.unit());
        let curves = plotted(&before.channels[at][..], &after.channels[at][..], with);
        let figure = over_time("Innovation", format!("{name} / {unit}"), &time, curves);
        figures.push((figure, format!("{label}: innovation of {name}.")));
    }
    figures
}

/// Rows of all reporting records, one record after another.
#[derive(Default)]
struct Rows {
    position: Vec<f64>,
    velocity: Vec<f64>,
    torque: Vec<f64>,
    since_reversal: Vec<f64>,
    time: Vec<f64>,
    before: Vec<f64>,
    after: Vec<f64>,
}

/// Time since the velocity last changed its sign, for every row; NaN before the first time.
fn since_reversal(velocity: &[f64], pace_s: f64) -> Vec<f64> {
    let (mut way, mut since) = (0.0, f64::NAN);
    velocity
        .iter()
        .map(|speed| {
            since += pace_s;
            if speed.abs() > STILL_RAD_S && speed.signum() != way {
                since = if way == 0.0 { f64::NAN } else { 0.0 };
                way = speed.signum();
            }
            since
        })
        .collect()
}

impl Rows {
    /// Adds the rows of a record, with the residuals of the declared model and of the final one.
    fn take(
        &mut self,
        study: &Study<'_>,
        record: &Record,
        channel: Channel,
        (before, after): (&[f64], &[f64]),
    ) {
        let column = match (channel, &record.slave) {
            (Channel::Slave | Channel::Torque, Some(slave)) => slave,
            _ => &record.master,
        };
        let (position, pace_s) =
            (record.averaged(column), record.step_s * record.decimation() as f64);
        let inner = 2..record.residual_rows().saturating_sub(2);
        let velocity: Vec<f64> = inner
            .clone()
            .map(|row| (position[row + 2] - position[row - 2]) / (4.0 * pace_s))
            .collect();
        // The torque of the hand if it is measured, else that of the motor.
        let torque = match (channel, &record.torque) {
            (Channel::Slave, Some(torque)) if !record.idle => record.averaged(torque),
            _ => {
                let constants = study.model.constants(&study.found.last().setting);
                let per_volt = constants.map_or(f64::NAN, |own| own.motor_torque_per_volt_nm());
                record.averaged(&record.volts).into_iter().map(|volts| per_volt * volts).collect()
            }
        };
        self.since_reversal.extend(since_reversal(&velocity, pace_s));
        self.velocity.extend(velocity);
        for (out, column) in [
            (&mut self.position, &position[..]),
            (&mut self.torque, &torque),
            (&mut self.time, &record.residual_times()),
            (&mut self.before, before),
            (&mut self.after, after),
        ] {
            out.extend_from_slice(column.get(inner.clone()).unwrap_or_default());
        }
    }
}

/// The innovation of one channel over the reporting records; `None` where none has the channel.
fn residual_of(
    study: &Study<'_>,
    report: &[usize],
    (channel, tested): (Channel, TestedResidual),
    (before, after): (&[Residual], &[Residual]),
    with: bool,
) -> Option<ChannelResidual> {
    let mut rows = Rows::default();
    let (mut of_before, mut of_after) = (Vec::new(), Vec::new());
    let (mut step_s, mut driven) = (0.0, true);
    for (at, index) in report.iter().enumerate() {
        let record = &study.model.records[*index];
        let Some(place) = study.model.channels(*index).iter().position(|own| *own == channel)
        else {
            continue;
        };
        let (before, after) = (&before[at].channels[place], &after[at].channels[place]);
        rows.take(study, record, channel, (before, after));
        of_before.push(before.clone());
        of_after.push(after.clone());
        step_s = record.step_s * record.decimation() as f64;
        driven &= record.torque.is_some() && !record.idle;
    }
    let late = rows.since_reversal.iter_mut().filter(|since| **since > LONGEST_S);
    late.for_each(|since| *since = f64::NAN);
    let torque =
        if channel == Channel::Slave && driven { "hand's torque" } else { "motor's torque" };
    let Rows { position, velocity, torque: torques, since_reversal, time, before, after } = rows;
    (!before.is_empty()).then(|| ChannelResidual {
        name: channel.column(),
        unit: channel.unit(),
        variables: vec![
            ("position", "rad", position),
            ("velocity", "rad/s", velocity),
            (torque, "N·m", torques),
            ("time since the last reversal", "s", since_reversal),
            ("time", "s", time),
        ],
        before,
        after,
        spectra: plotted(of_before, of_after, with),
        step_s,
        with,
        tested,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_at_rest_has_not_reversed() {
        let since = since_reversal(&[0.0, 1.0, 0.0, 1.0, -0.05, -1.0, -1.0, 0.02, -1.0, 1.0], 0.1);
        assert!(since[..5].iter().all(|since| since.is_nan()));
        let expected = [0.0, 0.1, 0.2, 0.3, 0.0];
        assert!(
            since[5..]
                .iter()
                .zip(expected)
                .all(|(since, expected)| (since - expected).abs() < 1e-12),
            "{since:?}"
        );
    }
}
