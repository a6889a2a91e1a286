//! The monitor of one axis: rows, observers, calibration, baseline, departure and its origin.

use std::collections::VecDeque;

use ipc_types::Sample;
use rig::{Axis, RigFile};

use crate::bank::{BankError, CHANNELS, Change, Innovations, ObserverBank};
use crate::calibration::Calibration;
use crate::departure::{Baseline, Detector, Verdict};
use crate::origin::{Origin, origin};
use crate::row::{Row, RowFilter, Taken};
use crate::score::{Score, WINDOW, Window};
use crate::sums::Sums;

/// Rows of innovations in a block: half a second of movement.
pub const BLOCK_ROWS: u32 = 125;
/// Blocks from which the baseline is learnt: 20 s of movement.
pub const LEARNING_BLOCKS: usize = 40;
/// Blocks that are kept: those of the baseline, later those in which the origin of a departure is
/// found.
const KEPT: usize = LEARNING_BLOCKS;
/// Blocks after which the model is linearised at the calibrated parameters while the baseline is
/// learnt. What was calibrated along the directions before is then forgotten: they were those of
/// other parameters.
const FIRST_LINEARISED: [usize; 3] = [8, 16, 24];
/// Blocks of a machine as it should be after which it is linearised anew: two minutes of movement.
const LINEARISED_EVERY: usize = 240;
/// A calibrated model whose innovations have so many times the mean square of the declared one's is
/// not used.
const WORSE: f64 = 4.0;
/// Slower, the master stands still (rad/s).
const SLOW_RAD_S: f64 = 0.05;
/// Rows after the master was last faster for which it counts as moving: friction is seen best where
/// a movement stops and turns.
const STOPPING_ROWS: u32 = 60;
/// Standard deviation of the innovation until the baseline is known (rad).
const ASSUMED_RAD: f64 = 3e-4;

/// What a sample has brought about.
#[derive(Clone, Debug, PartialEq)]
pub enum Seen<'a> {
    /// Nothing yet.
    Nothing,
    /// A row of innovations.
    Row(&'a Innovations),
    /// A row that ends a block.
    Block(&'a Innovations, Verdict),
}

/// The monitor of one axis. Pure: time comes with the samples.
#[derive(Clone, Debug)]
pub struct AxisMonitor {
    filter: RowFilter,
    bank: ObserverBank,
    /// The bank as it was at the beginning, until it is compared with the linearised one.
    original: Option<ObserverBank>,
    block: Sums,
    calibration: Calibration,
    /// The calibrations before each of the newest blocks, the last one at the back.
    before: VecDeque<Calibration>,
    window: Window,
    /// Tick of the row with which the block begins.
    block_tick: u64,
    /// The newest blocks with the ticks of their beginnings, the last one at the back.
    kept: VecDeque<(u64, Sums)>,
    /// Energies of the newest block (rad²).
    energy: [f64; CHANNELS],
    score: Score,
    baseline: Option<Baseline>,
    detector: Detector,
    origin: Option<Origin>,
    departed_tick: u64,
    learnt: usize,
    /// Blocks since the model was linearised.
    linear: usize,
    /// Sums of the squares of the innovations since, of the declared and the calibrated model
    /// (rad²).
    squares: [f64; 2],
    /// The slave and the torque of the hand are measured.
    measured: bool,
    /// The calibrated model was worse than the declared, which is kept.
    keeps_declared: bool,
    stopping: u32,
    restarts: u64,
}

impl AxisMonitor {
    /// The monitor of an axis, by its index and its entry in the rig file.
    ///
    /// # Errors
    /// [`BankError`] where the declared model cannot be simulated.
    pub fn new(rig: &RigFile, at: usize, axis: &Axis) -> Result<Self, BankError> {
        let rate_hz = rig.rates.acquisition_hz;
        let filter = RowFilter::new(at, axis.master.turns_per_handle_turn, rate_hz);
        let bank = ObserverBank::new(rig, axis, filter.step_s(rate_hz))?;
        let declared = |change: &&Change| matches!(change, Change::Parameter { .. });
        let parameters = bank.changes().iter().filter(declared).count();
        let directions = bank.changes().len();
        Ok(Self {
            filter,
            bank,
            original: None,
            block: Sums::new(directions),
            calibration: Calibration::new(parameters),
            before: (0..WINDOW).map(|_| Calibration::new(parameters)).collect(),
            window: Window::new(parameters, directions),
            kept: (0..KEPT).map(|_| (0, Sums::new(directions))).collect(),
            block_tick: 0,
            energy: [0.0; CHANNELS],
            score: Score::default(),
            baseline: None,
            detector: Detector::default(),
            origin: None,
            departed_tick: 0,
            learnt: 0,
            linear: 0,
            squares: [0.0; 2],
            measured: axis.slave.is_some() && axis.torque.is_some(),
            keeps_declared: false,
            stopping: 0,
            restarts: 0,
        })
    }

    /// Takes the next sample; `torque_nm` is what other axes exert on the slave through a shared
    /// handle (N·m).
    pub fn see(&mut self, sample: &Sample, torque_nm: f64) -> Seen<'_> {
        let mut row = match self.filter.take(sample) {
            Taken::Nothing => return Seen::Nothing,
            Taken::Restart => {
                self.restarts += 1;
                self.bank.restart();
                if let Some(original) = &mut self.original {
                    original.restart();
                }
                return Seen::Nothing;
            }
            Taken::Row(row) => row,
        };
        row.input.hand_torque_nm += torque_nm;
        self.see_row(&row)
    }

    /// Takes the next row.
    pub fn see_row(&mut self, row: &Row) -> Seen<'_> {
        if let Some(original) = &mut self.original {
            original.take(row);
        }
        let Some(innovations) = self.bank.take(row) else { return Seen::Nothing };
        if !innovations.settled {
            return Seen::Row(self.bank.newest());
        }
        if innovations.speed_rad_s > SLOW_RAD_S {
            self.stopping = STOPPING_ROWS;
        }
        if self.stopping == 0 {
            return Seen::Row(self.bank.newest());
        }
        self.stopping -= 1;
        if self.block.rows() == 0 {
            self.block_tick = innovations.tick;
        }
        self.block.add(innovations);
        let models = [innovations.declared, innovations.calibrated];
        for (sum, model) in self.squares.iter_mut().zip(models) {
            *sum += model.iter().map(|own| own * own).sum::<f64>();
        }
        if self.block.rows() < BLOCK_ROWS {
            return Seen::Row(self.bank.newest());
        }
        let verdict = self.judge();
        Seen::Block(self.bank.newest(), verdict)
    }

    /// Ends a block.
    fn judge(&mut self) -> Verdict {
        self.energy = self.block.energy_less(self.calibration.shares());
        let expected = self.calibration.expected(&self.block);
        if let Some((_, mut oldest)) = self.kept.pop_front() {
            std::mem::swap(&mut oldest, &mut self.block);
            self.block.clear();
            self.kept.push_back((self.block_tick, oldest));
        }
        let Some(baseline) = self.baseline else {
            self.learn();
            return Verdict::Steady;
        };
        if !self.detector.departed()
            && let Some(mut before) = self.before.pop_front()
        {
            before.copy_from(&self.calibration);
            self.before.push_back(before);
        }
        let score = self.score_of_newest(baseline.deviation_rad);
        self.score = score;
        let verdict = self.detector.take(self.energy, expected, score, &baseline);
        match verdict {
            Verdict::Steady => {
                self.calibrate(baseline.deviation_rad);
                self.linear += 1;
                if self.linear >= LINEARISED_EVERY {
                    self.linearise();
                }
            }
            Verdict::Suspicious => {}
            Verdict::Departs => {
                // What was taken for parameters since is part of the departure.
                if let Some(before) = self.before.front() {
                    self.calibration.copy_from(before);
                }
                self.find_origin(&baseline);
            }
            Verdict::Departed => self.find_origin(&baseline),
            Verdict::Returns => (self.origin, self.departed_tick) = (None, 0),
        }
        verdict
    }

    fn score_of_newest(&mut self, deviations: [f64; CHANNELS]) -> Score {
        // Directions across whole tolerances are too coarse for it.
        let scored = self.measured && !self.keeps_declared;
        let Some((_, newest)) = self.kept.back().filter(|_| scored) else {
            return Score::default();
        };
        self.window.take(newest, deviations);
        self.before.front().map_or_else(Score::default, |before| self.window.score(before))
    }

    fn calibrate(&mut self, deviations: [f64; CHANNELS]) {
        if let Some((_, newest)) = self.kept.back() {
            self.calibration.take(newest, deviations);
        }
    }

    fn linearise(&mut self) {
        if !self.keeps_declared {
            self.bank.linearise(self.calibration.shares());
        }
        (self.linear, self.squares) = (0, [0.0; 2]);
    }

    fn learn(&mut self) {
        self.calibrate([ASSUMED_RAD; CHANNELS]);
        self.learnt += 1;
        self.linear += 1;
        let [declared, calibrated] = self.squares;
        let last = self.learnt == FIRST_LINEARISED[2];
        if last
            && let Some(original) = self.original.take()
            && calibrated > WORSE * declared
        {
            // Where friction remembers how a movement began, or parameters cannot explain what the
            // model lacks, observers that begun anew are worse than those there were.
            self.bank = original;
            self.keeps_declared = true;
        }
        if self.learnt == LEARNING_BLOCKS {
            let shares = self.calibration.shares();
            // Along the newest directions alone.
            let newest = self.kept.iter().rev().take(self.linear);
            let energies: Vec<_> = newest.map(|(_, block)| block.energy_less(shares)).collect();
            self.baseline = Baseline::of(&energies);
            self.before.iter_mut().for_each(|before| before.copy_from(&self.calibration));
        } else if FIRST_LINEARISED.contains(&self.learnt) {
            if self.learnt == FIRST_LINEARISED[0] {
                self.original = Some(self.bank.clone());
            }
            self.linearise();
            self.calibration = Calibration::new(self.calibration.shares().len());
        }
    }

    fn find_origin(&mut self, baseline: &Baseline) {
        let since = (self.detector.blocks() as usize).min(KEPT);
        let mut sums = Sums::new(self.bank.changes().len());
        self.kept.iter().rev().take(since).for_each(|(_, block)| sums.add_sums(block));
        let shares = self.calibration.shares();
        if self.departed_tick == 0 {
            let first = self.kept.get(KEPT.saturating_sub(since));
            self.departed_tick = first.map_or(0, |(tick, _)| *tick);
        }
        self.origin = origin(&sums, shares, self.bank.changes(), baseline.deviation_rad);
    }

    /// The baseline; `None` while it is learnt.
    pub const fn baseline(&self) -> Option<&Baseline> {
        self.baseline.as_ref()
    }

    /// Share of the baseline that is learnt, 0 to 1.
    pub fn learnt(&self) -> f64 {
        self.learnt as f64 / LEARNING_BLOCKS as f64
    }

    /// Energy of the newest block beyond the calibration (rad²).
    pub const fn energy(&self) -> [f64; CHANNELS] {
        self.energy
    }

    /// Score of the change that the newest blocks show most; none where the declared model is kept,
    /// and without a slave's encoder or a torque cell.
    pub const fn score(&self) -> Score {
        self.score
    }

    /// The detector.
    pub const fn detector(&self) -> &Detector {
        &self.detector
    }

    /// The origin of a departure, as far as it is known.
    pub const fn origin(&self) -> Option<&Origin> {
        self.origin.as_ref()
    }

    /// Tick with which the departure began; 0 where there is none.
    pub const fn departed_tick(&self) -> u64 {
        self.departed_tick
    }

    /// Acceleration of the modelled slave over the newest row (rad/s²).
    pub const fn slave_acceleration_rad_s2(&self) -> f64 {
        self.bank.slave_acceleration_rad_s2()
    }

    /// Deviations of the declared parameters with their names, in tolerances.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, f64)> {
        let named = self.bank.changes().iter().filter_map(|change| match change {
            Change::Parameter { name } => Some(name.as_str()),
            Change::Effect { .. } => None,
        });
        named.zip(self.calibration.shares().iter().copied())
    }

    /// How often rows did not go on from those before.
    pub const fn restarts(&self) -> u64 {
        self.restarts
    }
}
