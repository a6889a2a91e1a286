//! Where the machine departed from the model: the listed effect whose direction explains most of
//! what has come since, and its side of the torque balances.

use nalgebra::DVector;
use plant::effects::Site;

use crate::bank::{CHANNELS, Change};
use crate::calibration::{normal, weights};
use crate::sums::Sums;

/// Precision of the parameters during a departure (per square tolerance): they change by a
/// thousandth of a tolerance at the same moment, not more.
const STEADY: f64 = 1e6;

/// What explains a departure best.
#[derive(Clone, Debug, PartialEq)]
pub struct Origin {
    /// The effect.
    pub id: &'static str,
    /// Where it acts.
    pub site: Site,
    /// Its size, in default sizes.
    pub size: f64,
    /// Share of what the departure added to the innovations that it explains, 0 to 1.
    pub explains: f64,
    /// The same share of the best effect at another site.
    pub elsewhere: f64,
}

/// The effect that explains most of the innovations of a departure beyond the calibrated
/// parameters; `None` where nothing does.
///
/// `shares` are the calibrated parameters (tolerances), `changes` those of the bank, `deviations`
/// the standard deviations of the innovation before (rad).
pub fn origin(
    sums: &Sums,
    shares: &DVector<f64>,
    changes: &[Change],
    deviations: [f64; CHANNELS],
) -> Option<Origin> {
    let weights = weights(deviations);
    let parameters = shares.len();
    let factors = normal(sums, parameters, weights, STEADY)?;
    // What remains of the products with the innovation once the calibrated shares are taken out.
    let left = |direction: usize| {
        let known = |(at, share): (usize, &f64)| share * sums.product(direction, at, weights);
        sums.with(direction, weights) - shares.iter().enumerate().map(known).sum::<f64>()
    };
    let of_parameters = factors.solve(&DVector::from_fn(parameters, |at, _| left(at)));
    let energies = sums.energy_less(shares);
    let added: f64 = energies
        .iter()
        .zip(deviations)
        .zip(weights)
        .map(|((energy, own), weight)| {
            weight * f64::from(sums.rows()) * (energy - own * own).max(0.0)
        })
        .sum();
    let mut found: Vec<Origin> = Vec::with_capacity(changes.len());
    for (direction, change) in changes.iter().enumerate().skip(parameters) {
        let Change::Effect { id, site, factor } = change else { continue };
        let between = DVector::from_fn(parameters, |at, _| sums.product(direction, at, weights));
        let power = sums.product(direction, direction, weights);
        let alone = power - between.dot(&factors.solve(&between));
        let with = left(direction) - between.dot(&of_parameters);
        // A direction that the parameters span shows nothing of its own.
        if alone > 1e-6 * power && added > 0.0 {
            let explains = (with * with / alone / added).clamp(0.0, 1.0);
            let (size, elsewhere) = (factor * with / alone, 0.0);
            found.push(Origin { id, site: *site, size, explains, elsewhere });
        }
    }
    let best = found.iter().max_by(|a, b| a.explains.total_cmp(&b.explains))?.clone();
    let others = found.iter().filter(|other| side(other.site) != side(best.site));
    let elsewhere = others.map(|other| other.explains).fold(0.0, f64::max);
    Some(Origin { elsewhere, ..best })
}

/// Sites that the torque balances cannot tell apart: motor and amplifier act at the master.
pub const fn side(site: Site) -> Site {
    match site {
        Site::Drive => Site::Master,
        other => other,
    }
}
