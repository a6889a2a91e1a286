//! A Jacobian completed from known columns is the one computed whole.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use identify::prediction_error::dataset::Dataset;
use identify::prediction_error::free_parameter::FreeParameter;
use identify::prediction_error::known_columns::KnownColumns;
use identify::prediction_error::transmission_model::TransmissionModel;
use two_sides::{COUNT_RAD, record, rig};

mod two_sides;

#[test]
fn known_columns_are_weighted_anew_and_the_others_computed() {
    let records = vec![record(0, Vec::new(), false, 0.0, &|_| 0.0)];
    let model =
        TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(COUNT_RAD)).unwrap();
    let dataset = Dataset::whole(&model);
    let fitted = dataset.evaluate(model.start()).unwrap();
    let all: Vec<FreeParameter> = (0..4).map(FreeParameter::Base).collect();
    // Known are the fourth and the second, in this order.
    let some = [all[3].clone(), all[1].clone()];
    let columns = KnownColumns::at(&dataset, &fitted, &some);
    let weights: Vec<Vec<f64>> = columns
        .weights
        .iter()
        .map(|record| {
            (2..).zip(record).map(|(factor, weight)| f64::from(factor) * weight).collect()
        })
        .collect();
    let whole = dataset.jacobian(&fitted, &all, &weights);
    let completed = columns.jacobian(&dataset, &fitted, &all, &weights);
    assert_eq!(completed.shape(), whole.shape());
    assert!(whole.column_iter().filter(|column| column.norm() > 0.0).count() >= 2, "{whole}");
    let off = (&completed - &whole).norm() / whole.norm();
    assert!(off < 1e-9, "{off}");
}
