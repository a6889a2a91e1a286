//! Suppression of the scanner's gradient artefact: what repeats with every volume is averaged and
//! subtracted (average artefact subtraction, Allen et al. 2000), causally.

/// Longest repetition time for which there is memory (s).
pub const LONGEST_REPETITION_S: f64 = 10.0;
/// Volumes that must have been averaged before anything is subtracted: fewer would take as much of
/// the muscle's signal as of the artefact.
const LEAST_VOLUMES: u32 = 3;
/// Samples about the next one that its interpolation needs.
const AROUND: usize = 4;
/// Longest distance between two samples without a gap, in samples: the volume's beginning may be
/// corrected.
const LONGEST_STEP: f64 = 1.5;
/// Rounding of times, in samples.
const ROUNDING: f64 = 1e-6;

/// The artefact of one electrode, as an average over the last volumes.
///
/// Volumes need not begin with a sample: the signal of each is interpolated onto a grid that begins
/// with the volume (cubic), and the average is interpolated at the time of each sample.
#[derive(Clone, Debug)]
pub struct ArtefactTemplate {
    rate_hz: f64,
    volumes: u32,
    /// The average, on the grid of the volume; the first `length` are of this scan.
    average: Vec<f64>,
    length: usize,
    averaged: u32,
    /// The last samples, the newest first, with the time of the newest since its volume began (in
    /// samples).
    recent: [f64; AROUND],
    phase: Option<f64>,
    /// The next point of the grid to be averaged.
    next: usize,
}

impl ArtefactTemplate {
    /// Averages over the last `volumes`, of a signal sampled at `rate_hz`.
    pub fn new(volumes: u32, rate_hz: f64) -> Self {
        Self {
            rate_hz,
            volumes: volumes.max(1),
            average: vec![0.0; (LONGEST_REPETITION_S * rate_hz) as usize + AROUND],
            length: 0,
            averaged: 0,
            recent: [0.0; AROUND],
            phase: None,
            next: 0,
        }
    }

    /// Forgets the artefact: the scan ended, or another begins.
    pub fn clear(&mut self) {
        (self.averaged, self.length, self.phase, self.next) = (0, 0, None, 0);
    }

    /// Notes that a sample is left out: the volume has a gap.
    pub const fn skip(&mut self) {
        self.phase = None;
        self.next = usize::MAX;
    }

    /// Whether the average is used.
    pub const fn is_ready(&self) -> bool {
        self.averaged >= LEAST_VOLUMES
    }

    /// Takes a sample, `since_volume_s` after the beginning of its volume, in a scan of that
    /// repetition time (s); returns it without the artefact. A repetition time beyond
    /// [`LONGEST_REPETITION_S`] leaves the signal as it is.
    pub fn update(&mut self, value: f64, since_volume_s: f64, repetition_s: f64) -> f64 {
        let length = (repetition_s * self.rate_hz).round();
        if !(1.0..=LONGEST_REPETITION_S * self.rate_hz).contains(&length) {
            return value;
        }
        if self.length != length as usize {
            self.clear();
            self.average[..length as usize].fill(0.0);
            self.length = length as usize;
        }
        let phase = since_volume_s * self.rate_hz;
        // A correction of the volume's beginning may set the time back a little.
        let begins = self.phase.is_some_and(|before| phase < before - 0.5 * length);
        let step = self
            .phase
            .map(|before| phase - before + if begins { repetition_s * self.rate_hz } else { 0.0 });
        self.recent.rotate_right(1);
        self.recent[0] = value;
        let gap = step.is_none_or(|step| step > LONGEST_STEP);
        if begins && !gap {
            self.average_up_to(phase + repetition_s * self.rate_hz);
            self.averaged += u32::from(self.next == self.length);
        }
        // Only a volume that was seen from its beginning to its end counts.
        if begins || gap {
            self.next = if phase < 1.0 { 0 } else { usize::MAX };
        }
        self.phase = Some(phase);
        self.average_up_to(phase);
        if self.is_ready() { value - self.at(phase) } else { value }
    }

    /// Averages the points of the grid that lie between the two samples before the newest.
    fn average_up_to(&mut self, phase: f64) {
        while self.next < self.length {
            // Time of this point before the newest sample, in samples.
            let back = phase - self.next as f64;
            if back < 1.0 - ROUNDING {
                return;
            }
            if back > 2.0 + ROUNDING {
                // The volume's beginning was corrected: what was averaged here before stays.
                self.next += 1;
                continue;
            }
            let [newest, a, b, oldest] = self.recent;
            let value = cubic([newest, a, b, oldest], back - 1.0);
            let weight = 1.0 / f64::from((self.averaged + 1).min(self.volumes));
            let average = &mut self.average[self.next];
            *average += weight * (value - *average);
            self.next += 1;
        }
    }

    /// The average at a time since the volume began (in samples).
    fn at(&self, phase: f64) -> f64 {
        let at = |offset: i64| {
            let length = self.length as i64;
            self.average[(phase as i64 + offset).rem_euclid(length) as usize]
        };
        cubic([at(-1), at(0), at(1), at(2)], phase.fract())
    }
}

/// Catmull-Rom interpolation between the two inner ones of four values, a share after the first of
/// them.
fn cubic([a, b, c, d]: [f64; 4], share: f64) -> f64 {
    let (linear, square, cube) = (c - a, 2.0 * a - 5.0 * b + 4.0 * c - d, 3.0 * (b - c) + d - a);
    b + 0.5 * share * (linear + share * (square + share * cube))
}
