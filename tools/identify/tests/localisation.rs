//! Where something enters that is no function of one variable: torques that jump, put into the
//! plant at one place after another.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::f64::consts::TAU;

use identify::equation_error::block_roles::Role;
use identify::prediction_error::dataset::Dataset;
use identify::prediction_error::localisation::localise;
use identify::prediction_error::location::{Localisation, Location};
use identify::prediction_error::nonparametric::Variable;
use identify::prediction_error::record::share_out;
use identify::prediction_error::refit::fit_base;
use identify::prediction_error::transmission_model::TransmissionModel;
use plant::ParameterSet;
use plant::effects::{Effect, Identity, Link, Moment, SideLoad, Site};
use two_sides::{COUNT_RAD, RECORD_S, record, rig};

mod two_sides;

/// What else goes on at the motor, at random: no two records are alike (V).
const PUSH_V: f64 = 0.05;

/// Jumps from one value to the other at odd moments, the same ones in each record.
fn jumps(time_s: f64) -> f64 {
    let t = time_s % RECORD_S;
    ((TAU * 1.3 * t).sin() + (TAU * 3.1 * t + 1.0).sin() + 0.7 * (TAU * 7.7 * t).sin()).signum()
}

/// A torque that jumps, at a side; at the line a force on what moves in it.
#[derive(Clone, Debug)]
struct Jumps {
    site: Site,
    size: f64,
}

impl Identity for Jumps {
    fn id(&self) -> &'static str {
        "jumps"
    }

    fn site(&self) -> Site {
        self.site
    }
}

impl Effect for Jumps {
    fn side(&mut self, load: &mut SideLoad, moment: &Moment) {
        load.load.force += self.size * jumps(moment.time_s);
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        if self.site == Site::Line {
            link.fluid_force_n += self.size * jumps(moment.time_s);
        }
    }
}

impl ParameterSet for Jumps {}

/// What is told of a machine with something at a site, once the declared model is fitted; at the
/// sensor it is the cell that jumps.
fn told(site: Option<Site>, size: f64, hands: &[usize]) -> Option<Localisation> {
    let mut records: Vec<_> = (0..6)
        .map(|turn| {
            let of_plant = site.filter(|site| *site != Site::Sensor);
            let effects = of_plant
                .map(|site| Box::new(Jumps { site, size }) as Box<dyn Effect>)
                .into_iter()
                .collect();
            let hand = hands.contains(&turn);
            let cell = |time_s: f64| {
                if hand && site == Some(Site::Sensor) { size * jumps(time_s) } else { 0.0 }
            };
            record(turn, effects, hand, PUSH_V, &cell)
        })
        .collect();
    share_out(&mut records, false);
    let model =
        TransmissionModel::new("hydrostatic.toml", &rig().model, records, Some(COUNT_RAD)).unwrap();
    let (fit, select) = (Dataset::of(&model, Role::Fit), Dataset::of(&model, Role::Select));
    let base = fit_base((&fit, &select)).unwrap();
    localise((&fit, &select), &base.setting)
}

const HANDS: [usize; 2] = [4, 5];

#[test]
fn a_torque_is_found_where_it_acts() {
    for (site, size) in
        [(Site::Master, 1.0), (Site::Slave, 0.2), (Site::Line, 4.0), (Site::Sensor, 0.4)]
    {
        let localisation = told(Some(site), size, &HANDS).unwrap();
        println!("{site}: {:?}", localisation.left);
        assert_eq!(localisation.site(), site, "{:?}", localisation.left);
    }
}

#[test]
fn without_records_of_both_kinds_cell_and_slave_are_not_distinguished() {
    let localisation = told(Some(Site::Slave), 0.2, &[]).unwrap();
    assert_eq!(localisation.site(), Site::Slave, "{:?}", localisation.left);
    assert!(localisation.left.iter().all(|(place, _)| *place != Location::Cell));
    assert!(
        localisation.allows((Site::Sensor, Variable::Torque))
            && localisation.allows((Site::Slave, Variable::Torque))
    );
    assert!(
        !localisation.allows((Site::Master, Variable::Torque))
            && !localisation.allows((Site::Slave, Variable::Force))
    );
}
