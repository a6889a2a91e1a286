//! Hold-out effects in the instruments.

use super::{Entry, Site, Values, Variable};
use crate::deviation::{Deviation, Instruments};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "lost_counts",
        site: Site::Sensor,
        depends_on: &[Variable::Velocity, Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("share", draw.uniform(0.1, 0.25), "1"),
                ("speed", draw.uniform(2.5, 4.0), "rad/s"),
                ("index", draw.uniform(-0.15, 0.15), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(LostCounts {
                share: values.get("share"),
                speed: values.get("speed"),
                index: values.get("index"),
                lost_rad: 0.0,
                last: None,
            })
        },
    },
    Entry {
        id: "cell_creep",
        site: Site::Sensor,
        depends_on: &[Variable::Load, Variable::Time],
        draw: |draw, _| {
            Values::of([
                ("share", draw.uniform(0.25, 0.5), "1"),
                ("time_constant", draw.log_uniform(0.3, 1.5), "s"),
            ])
        },
        build: |values, _| {
            let (share, time_constant) = (values.get("share"), values.get("time_constant"));
            Box::new(CellCreep { share, time_constant, crept_nm: 0.0, last_s: None })
        },
    },
    Entry {
        id: "cell_cable_pull",
        site: Site::Sensor,
        depends_on: &[Variable::Position],
        draw: |draw, _| {
            Values::of([
                ("stiffness", draw.uniform(0.5, 1.5), "N m/rad"),
                ("angle", draw.sign() * draw.uniform(0.1, 0.35), "rad"),
            ])
        },
        build: |values, _| {
            Box::new(CablePull { stiffness: values.get("stiffness"), angle: values.get("angle") })
        },
    },
];

/// A counter of the slave that is too slow: above a speed, a share of the counts is lost, until the
/// index of the disc corrects the count.
#[derive(Debug)]
struct LostCounts {
    share: f64,
    speed: f64,
    /// Angle of the index, rad.
    index: f64,
    lost_rad: f64,
    /// Time (s) and angle (rad) of the sample before.
    last: Option<(f64, f64)>,
}

impl Deviation for LostCounts {
    fn sense_angles(&mut self, seen: &mut Instruments) {
        let angle = seen.position[1];
        if let Some((time_s, before)) = self.last {
            let way = angle - before;
            let countable = self.speed * (seen.time_s - time_s);
            self.lost_rad += self.share * (way.abs() - countable).max(0.0).copysign(way);
            if (angle < self.index) != (before < self.index) {
                self.lost_rad = 0.0;
            }
        }
        self.last = Some((seen.time_s, angle));
        seen.position[1] -= self.lost_rad;
    }
}

/// A cell that creeps under load: its reading adds `s z`, `T ż = τ - z`.
#[derive(Debug)]
struct CellCreep {
    share: f64,
    time_constant: f64,
    crept_nm: f64,
    last_s: Option<f64>,
}

impl Deviation for CellCreep {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        let elapsed = self.last_s.map_or(0.0, |last| seen.time_s - last);
        self.last_s = Some(seen.time_s);
        // Exact for a torque that is held.
        self.crept_nm +=
            (1.0 - (-elapsed / self.time_constant).exp()) * (seen.torque_nm - self.crept_nm);
        seen.torque_nm += self.share * self.crept_nm;
    }
}

/// A cable across the cell that is taut beyond an angle of the handle: the cell reads its pull,
/// `-k (q - a)`.
#[derive(Debug)]
struct CablePull {
    stiffness: f64,
    angle: f64,
}

impl Deviation for CablePull {
    fn sense_torque(&mut self, seen: &mut Instruments) {
        let side = self.angle.signum();
        seen.torque_nm -= self.stiffness * side * (side * (seen.position[1] - self.angle)).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_lost_at_speed_only_and_until_the_index() {
        let mut counter =
            LostCounts { share: 0.2, speed: 4.0, index: -0.1, lost_rad: 0.0, last: None };
        let (mut time_s, mut angle) = (0.0, 0.0);
        let mut turn = |speed: f64, seconds: f64| {
            let mut read = 0.0;
            for _ in 0..(seconds / 0.5e-3) as usize {
                (time_s, angle) = (time_s + 0.5e-3, angle + speed * 0.5e-3);
                let mut seen =
                    Instruments { time_s, position: [0.0, angle], ..Instruments::default() };
                counter.sense_angles(&mut seen);
                assert_eq!(seen.position[0], 0.0, "the master's counts all");
                read = seen.position[1] - angle;
            }
            read
        };
        assert_eq!(turn(3.9, 0.2), 0.0);
        // A fifth of what is above 4 rad/s, for a tenth of a second.
        assert!((turn(9.0, 0.1) + 0.1).abs() < 1e-3);
        assert!((turn(-3.0, 0.2) + 0.1).abs() < 1e-3, "stays lost");
        assert!(turn(-9.0, 0.1).abs() < 1e-3, "the other way about on the way back");
        assert!((turn(9.0, 0.1) + 0.1).abs() < 1e-3);
        assert_eq!(turn(-3.0, 1.0), 0.0, "the index has passed");
    }

    #[test]
    fn a_cell_creeps_under_load_and_recovers() {
        let mut cell = CellCreep { share: 0.3, time_constant: 0.5, crept_nm: 0.0, last_s: None };
        let mut read = |torque_nm: f64, from_s: f64, to_s: f64| {
            let mut last = 0.0;
            for index in 0..=((to_s - from_s) / 0.5e-3) as usize {
                let mut seen = Instruments {
                    time_s: from_s + index as f64 * 0.5e-3,
                    torque_nm,
                    ..Instruments::default()
                };
                cell.sense_torque(&mut seen);
                last = seen.torque_nm;
            }
            last
        };
        let half = read(1.0, 0.0, 0.5);
        assert!((half - 1.0 - 0.3 * (1.0 - (-1.0_f64).exp())).abs() < 1e-3, "{half}");
        assert!((read(1.0, 0.5, 6.0) - 1.3).abs() < 1e-3);
        assert!(read(0.0, 6.0, 12.0).abs() < 1e-3);
    }

    #[test]
    fn a_taut_cable_pulls_back() {
        for angle in [0.2, -0.2] {
            let mut cable = CablePull { stiffness: 1.5, angle };
            let mut at = |slave: f64| {
                let mut seen = Instruments { position: [0.0, slave], ..Instruments::default() };
                cable.sense_torque(&mut seen);
                seen.torque_nm
            };
            assert_eq!([at(-angle), at(0.5 * angle)], [0.0; 2]);
            assert!((at(2.0 * angle) + 1.5 * angle).abs() < 1e-12);
        }
    }
}
