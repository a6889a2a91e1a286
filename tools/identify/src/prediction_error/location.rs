//! The place at which an unmodelled torque enters, from the shares of the residual power that a
//! torque at each place leaves unexplained.

use plant::effects::Site;

use super::nonparametric::Variable;
use super::record::{Record, range};
use super::residual_regression::Dependence;

/// A place is accepted if it leaves less than this share unexplained. Over effects of many kinds in
/// 62 machines, torques at master and slave left 0.01 to 0.22 at their own place, and effects
/// between the two left 0.27 or more at the better side.
const CLEAR: f64 = 0.25;
/// Shares left by the better side with which functions both there and between the sides are tried.
const DOUBTFUL: std::ops::Range<f64> = 0.18..0.36;
/// A sensor error is preferred to a torque on the slave if it leaves at most this much more: it is
/// the more restrictive hypothesis. Errors of sensors left up to 0.09 more, torques 0.5 or more.
const AS_LITTLE: f64 = 0.15;

/// Fewest jumps of an encoder, over all records, that tell where an unlisted effect acts: a single
/// one may be a disturbance of the recording.
const FEWEST_JUMPS: usize = 2;
/// Largest distance between two jumps that count as at the same place: a share of the range of the
/// position. An index restores the count at one place.
const SAME_PLACE: f64 = 0.05;

/// An encoder that loses and regains counts: its position jumps as no machine moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JumpingEncoder {
    /// Whether it is the slave's, else the master's.
    pub of_slave: bool,
    /// Whether all jumps are at one place.
    pub at_one_place: bool,
}

impl JumpingEncoder {
    /// The encoder with the more jumps, if there are enough.
    pub fn of(records: &[Record]) -> Option<Self> {
        let all = |side: usize| records.iter().flat_map(move |record| &record.jumps[side]).copied();
        let side = if all(1).count() > all(0).count() { 1 } else { 0 };
        if all(side).count() < FEWEST_JUMPS {
            return None;
        }
        let positions = records.iter().filter_map(|record| match side {
            1 => record.slave.as_ref(),
            _ => Some(&record.master),
        });
        let whole: Vec<f64> = positions.flatten().copied().collect();
        let places: Vec<f64> = all(side).collect();
        let at_one_place = range(&places) <= SAME_PLACE * range(&whole);
        Some(Self { of_slave: side == 1, at_one_place })
    }

    /// What it is like, in words that complete "it acts like ...".
    pub const fn words(self) -> &'static str {
        match self.of_slave {
            true => "counts that the slave's encoder loses and regains",
            false => "counts that the master's encoder loses and regains",
        }
    }
}

/// A place at which a torque can enter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Location {
    /// The master, with the motor.
    Master,
    /// The slave.
    Slave,
    /// The moving mass in the lines.
    Line,
    /// The torque sensor.
    Cell,
}

impl Location {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Master => "master",
            Self::Slave => "slave",
            Self::Line => "line",
            Self::Cell => "torque cell",
        }
    }
}

/// Unexplained share of the residual power, place by place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Localisation {
    /// Share that no torque at the place explains, 0 to 1. The torque sensor needs records with and
    /// without a hand, and is omitted otherwise.
    pub left: Vec<(Location, f64)>,
    /// What it depends on, where no function of one variable explains it and a regression does.
    pub dependence: Option<Dependence>,
    /// Whether the reading of the torque sensor without a hand is all that shows more than noise.
    pub in_reading_alone: bool,
}

impl Localisation {
    /// The share that a torque at a place leaves.
    fn of(&self, place: Location) -> Option<f64> {
        self.left.iter().find(|(own, _)| *own == place).map(|(_, left)| *left)
    }

    /// The least share that a torque at a side leaves: the smaller, the clearer the place.
    pub(super) fn least_at_a_side(&self) -> f64 {
        let of = |place| self.of(place).unwrap_or(1.0);
        of(Location::Master).min(of(Location::Slave))
    }

    /// Returns the site at which it acts (master for master or drive).
    pub fn site(&self) -> Site {
        let best = [
            (Site::Master, Location::Master),
            (Site::Slave, Location::Slave),
            (Site::Line, Location::Line),
        ]
        .into_iter()
        .filter_map(|(site, place)| Some((site, self.of(place)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1));
        let cell = self.of(Location::Cell).unwrap_or(1.0);
        match best {
            _ if self.in_reading_alone => Site::Sensor,
            Some((site, left)) if left.min(cell) >= CLEAR || site == Site::Line => Site::Line,
            Some((_, left)) if cell <= left + AS_LITTLE => Site::Sensor,
            Some((site, _)) => site,
            None => Site::Line,
        }
    }

    /// Whether an effect at a site is compatible with this localisation. What acts between the
    /// sides is compatible with all.
    pub fn may_be_at(&self, site: Site) -> bool {
        match (self.site(), site) {
            (Site::Line, _) | (_, Site::Line) => true,
            (Site::Master, _) => matches!(site, Site::Master | Site::Drive),
            (Site::Slave, Site::Sensor) => self.of(Location::Cell).is_none(),
            (own, _) => own == site,
        }
    }

    /// The side that explains most, if the share that it leaves does not tell whether the effect
    /// acts there or between the sides.
    fn doubtful_side(&self) -> Option<Location> {
        let of = |place| self.of(place).unwrap_or(1.0);
        let nearest = if of(Location::Master) < of(Location::Slave) {
            Location::Master
        } else {
            Location::Slave
        };
        let left = of(nearest);
        let in_doubt = DOUBTFUL.contains(&left) && left < of(Location::Line);
        (in_doubt && !self.in_reading_alone).then_some(nearest)
    }

    /// Whether a nonparametric function at a site and of a variable is compatible. Where the place
    /// is in doubt, functions at both decide.
    pub fn allows(&self, (site, variable): (Site, Variable)) -> bool {
        // A function of the line's force acts on both of its ends.
        let between = site == Site::Line || variable == Variable::Force;
        let at_side = |side| match side {
            Location::Master => matches!(site, Site::Master | Site::Drive),
            _ => site == Site::Slave,
        };
        match (self.site(), self.doubtful_side()) {
            (Site::Line, side) => between || side.is_some_and(at_side),
            (_, Some(_)) if between => true,
            _ => !between && self.may_be_at(site),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(master: f64, slave: f64, line: f64, cell: Option<f64>) -> Localisation {
        let sides = [(Location::Master, master), (Location::Slave, slave), (Location::Line, line)];
        Localisation {
            left: sides.into_iter().chain(cell.map(|left| (Location::Cell, left))).collect(),
            ..Localisation::default()
        }
    }

    #[test]
    fn the_place_with_the_least_unexplained_power_or_the_line() {
        assert_eq!(shares(0.03, 0.9, 0.4, Some(0.95)).site(), Site::Master);
        assert_eq!(shares(0.8, 0.05, 0.6, Some(0.9)).site(), Site::Slave);
        assert_eq!(shares(0.8, 0.05, 0.6, None).site(), Site::Slave);
        assert_eq!(shares(0.4, 0.5, 0.12, Some(0.9)).site(), Site::Line);
        assert_eq!(shares(0.4, 0.5, 0.45, Some(0.9)).site(), Site::Line);
        // The cell has less to explain with than the slave, and nearly always explains a little
        // less.
        assert_eq!(shares(0.8, 0.05, 0.6, Some(0.08)).site(), Site::Sensor);
        assert_eq!(shares(0.8, 0.19, 0.6, Some(0.13)).site(), Site::Sensor);
    }

    /// A cell that misreads the speed: the slave explains a hand's records nearly as well.
    #[test]
    fn a_reading_without_a_hand_places_the_sensor() {
        let doubtful = shares(0.51, 0.29, 0.49, Some(0.3));
        assert_eq!(doubtful.site(), Site::Line);
        for left in [doubtful.left.clone(), Vec::new()] {
            let reading = Localisation { left, in_reading_alone: true, ..doubtful.clone() };
            assert_eq!(reading.site(), Site::Sensor);
            assert!(reading.may_be_at(Site::Sensor) && !reading.may_be_at(Site::Slave));
            assert!(reading.allows((Site::Sensor, Variable::Velocity)));
            assert!(!reading.allows((Site::Slave, Variable::Torque)));
            assert!(!reading.allows((Site::Line, Variable::Velocity)));
        }
    }

    #[test]
    fn an_encoder_that_jumps_twice_is_told_and_where() {
        let record = |jumps: [&[f64]; 2]| {
            let position = vec![-0.5, 0.0, 0.5];
            Record {
                name: "made.csv".into(),
                start_s: 0.0,
                step_s: 2e-3,
                volts: vec![0.0; 3],
                master: position.clone(),
                slave: Some(position),
                torque: None,
                sign_flipped: Vec::new(),
                role: crate::equation_error::block_roles::Role::Fit,
                count_rad: [1e-3; 2],
                idle: true,
                others: Vec::new(),
                steps: 1,
                jumps: jumps.map(<[f64]>::to_vec),
            }
        };
        let of = |all: &[[&[f64]; 2]]| {
            JumpingEncoder::of(&all.iter().copied().map(record).collect::<Vec<_>>())
                .map(|found| (found.of_slave, found.at_one_place))
        };
        assert_eq!(of(&[[&[], &[]], [&[], &[0.1]]]), None);
        assert_eq!(of(&[[&[], &[0.12]], [&[], &[0.1]]]), Some((true, true)));
        assert_eq!(of(&[[&[], &[0.12]], [&[], &[0.3]]]), Some((true, false)));
        assert_eq!(of(&[[&[0.1, -0.4], &[0.12]]]), Some((false, false)));
    }

    #[test]
    fn functions_are_allowed_at_the_localised_place() {
        let master = shares(0.03, 0.9, 0.4, Some(0.95));
        assert!(
            master.allows((Site::Drive, Variable::Voltage))
                && master.allows((Site::Master, Variable::Velocity))
        );
        assert!(
            !master.allows((Site::Master, Variable::Force))
                && !master.allows((Site::Slave, Variable::Velocity))
        );
        // Between what torques leave at their own place and elsewhere, functions decide.
        for doubtful in [shares(0.25, 0.6, 0.4, None), shares(0.34, 0.6, 0.4, None)] {
            assert!(
                doubtful.allows((Site::Drive, Variable::Voltage))
                    && doubtful.allows((Site::Line, Variable::Deflection))
            );
            assert!(!doubtful.allows((Site::Slave, Variable::Velocity)));
        }
        let between = shares(0.4, 0.5, 0.45, Some(0.9));
        assert!(
            between.allows((Site::Line, Variable::Deflection))
                && between.allows((Site::Slave, Variable::Force))
        );
        assert!(!between.allows((Site::Slave, Variable::Position)));
        let cell = shares(0.8, 0.05, 0.6, Some(0.05));
        assert!(
            cell.allows((Site::Sensor, Variable::Torque))
                && !cell.allows((Site::Slave, Variable::Torque))
        );
    }
}
