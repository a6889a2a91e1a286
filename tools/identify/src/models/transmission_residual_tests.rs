//! The innovations of a transmission's reporting records with the inputs along them, for residual
//! tests.

use super::transmission_study::Study;
use crate::correlation::{OctaveError, TestedResidual};
use crate::equation_error::block_roles::Role;
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::noise_floor::{OctaveRatios, octave_ratios, repeat_differences};
use crate::prediction_error::record::repeats;
use crate::prediction_error::transmission_model::{Channel, Residual};
use crate::spectral::OCTAVES;

/// The innovations of the final model, channel by channel; `None` where it cannot be simulated.
pub(super) fn tested(study: &Study<'_>) -> Option<Vec<(Channel, TestedResidual)>> {
    let all = Dataset::whole(&study.model).residuals(&study.found.last().setting)?;
    let ratios = octave_ratios(&study.model, &study.model.of_role(Role::Select), &all);
    let of = |channel| {
        let mut tested = of_channel(study, &all, channel)?;
        let own = ratios.iter().find(|own| own.channel == channel);
        tested.octaves = own.map_or_else(Vec::new, |own| octaves(own, tested.step_s));
        Some((channel, tested))
    };
    Some(Channel::ALL.into_iter().filter_map(of).collect())
}

/// The octaves of a channel whose rows are `step_s` apart (s).
fn octaves(of: &OctaveRatios, step_s: f64) -> Vec<OctaveError> {
    let edge = |octave: usize| 0.5 / step_s / f64::from(1u32 << octave);
    let from = |octave: usize| if octave + 1 == OCTAVES { 0.0 } else { edge(octave + 1) };
    let ratios = of.ratios.iter().enumerate();
    ratios
        .map(|(octave, over_floor)| OctaveError {
            from_hz: from(octave),
            to_hz: edge(octave),
            over_floor: *over_floor,
        })
        .collect()
}

/// Those of one channel, from those of all records; `None` where no reporting record has it.
fn of_channel(study: &Study<'_>, all: &[Residual], channel: Channel) -> Option<TestedResidual> {
    let model = &study.model;
    let mut tested = TestedResidual::default();
    let (mut volts, mut hands, mut driven) = (Vec::new(), Vec::new(), false);
    for index in model.of_role(Role::Report) {
        let record = &model.records[index];
        let Some(rows) = model.channel_of(index, &all[index], channel) else { continue };
        let along = |column: &[f64]| {
            let mut averaged = record.averaged(column);
            averaged.resize(rows.len(), 0.0);
            averaged
        };
        tested.step_s = record.step_s * record.decimation() as f64;
        tested.residual.push(rows.clone());
        volts.push(along(&record.volts));
        let hand = record.torque.as_deref().filter(|_| !record.idle);
        driven |= hand.is_some();
        hands.push(hand.map_or_else(|| vec![0.0; rows.len()], along));
    }
    tested.inputs.push(("motor_v", volts));
    if driven {
        tested.inputs.push(("slave_torque_nm", hands));
    }
    tested.repeats = repeat_differences(model, &repeats(&model.records), all, channel);
    (!tested.residual.is_empty()).then_some(tested)
}
