//! The innovations of a transmission's reporting records with the inputs along them, for residual
//! tests.

use super::transmission_study::Study;
use crate::correlation::TestedResidual;
use crate::equation_error::block_roles::Role;
use crate::prediction_error::dataset::Dataset;
use crate::prediction_error::record::repeats;
use crate::prediction_error::transmission_model::{Channel, Residual};
use crate::prediction_error::validation::repeat_differences;

/// The innovations of the final model, channel by channel; `None` where it cannot be simulated.
pub(super) fn tested(study: &Study<'_>) -> Option<Vec<(Channel, TestedResidual)>> {
    let all = Dataset::whole(&study.model).residuals(&study.found.last().setting)?;
    let of = |channel| Some((channel, of_channel(study, &all, channel)?));
    Some([Channel::Master, Channel::Slave, Channel::Torque].into_iter().filter_map(of).collect())
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
