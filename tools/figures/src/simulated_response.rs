//! Measurements on a simulated transmission: sweeps, the peak, the cut-off, one settled cycle.

use anyhow::Result;
use lock_step::guided::longest_rest;
use plant::response::{Response, frequency_response};
use plant::transmission::{EnergyBalance, ImposedMotion, Input, Motion, Reading, Transmission};
use rayon::prelude::*;
use roots::{SimpleConvergency, find_root_brent};

/// Gain at which a response counts as cut off (absolute, above the peak).
pub const CUT_OFF_GAIN: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Gain below which the slave's movement counts as "almost disappeared" (§ 3.3.1 gives no number).
pub const VANISHED_GAIN: f64 = 0.1;

/// Something whose master can be moved.
pub trait Rig: Sync {
    /// The plant behind it.
    type Plant: Transmission;

    /// A fresh plant at rest.
    ///
    /// # Errors
    /// Where a constant or an effect is out of range.
    fn plant(&self) -> Result<Self::Plant>;

    /// Amplitude of the master's sine, rad.
    fn amplitude_rad(&self) -> f64;

    /// Master angle per slave angle that is taken out of the gain, as § 5.2.3 does for the cable.
    fn mechanical_ratio(&self) -> f64 {
        1.0
    }
}

/// The response at one frequency, Hz.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn at(rig: &impl Rig, frequency_hz: f64) -> Result<Response> {
    let response = frequency_response(&mut rig.plant()?, frequency_hz, rig.amplitude_rad());
    Ok(Response { gain: rig.mechanical_ratio() * response.gain, ..response })
}

/// The responses at many frequencies, computed side by side.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn sweep(rig: &impl Rig, frequencies_hz: &[f64]) -> Result<Vec<Response>> {
    frequencies_hz.par_iter().map(|frequency| at(rig, *frequency)).collect()
}

/// `count` frequencies from `low` to `high`, evenly spaced on a logarithmic axis.
pub fn logarithmic(low: f64, high: f64, count: usize) -> Vec<f64> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|index| low * (high / low).powf(index as f64 / last)).collect()
}

/// Where the gain is largest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Peak {
    /// Inside the range: frequency in Hz, and the gain there.
    Inside {
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Gain, rad/rad.
        gain: f64,
    },
    /// The gain only falls: if there is a peak, it lies below the range.
    Below,
    /// The gain only rises: if there is a peak, it lies above the range.
    Above,
    /// The slave hardly moves anywhere in the range: friction holds it.
    Still,
    /// The simulation diverges somewhere in the range.
    Diverged,
}

impl Peak {
    /// Its frequency, Hz, where there is one.
    pub fn frequency_hz(self) -> Option<f64> {
        match self {
            Self::Inside { frequency_hz, .. } => Some(frequency_hz),
            _ => None,
        }
    }

    /// Its gain, where there is one.
    pub fn gain(self) -> Option<f64> {
        match self {
            Self::Inside { gain, .. } => Some(gain),
            _ => None,
        }
    }
}

/// Steps of the coarse search, as a ratio of frequencies.
const COARSE: f64 = 1.1;
/// Points of the fine search between the neighbours of the coarse top.
const FINE: usize = 7;

/// The largest gain between two frequencies, Hz: a coarse search, a fine one round its top, and a
/// parabola through the three highest neighbours.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn peak(rig: &impl Rig, low: f64, high: f64) -> Result<Peak> {
    let count = ((high / low).ln() / COARSE.ln()).ceil() as usize + 1;
    let coarse = sweep(rig, &logarithmic(low, high, count))?;
    let top = highest(&coarse);
    if !coarse.iter().all(sound) {
        return Ok(Peak::Diverged);
    }
    if coarse[top].gain < VANISHED_GAIN {
        return Ok(Peak::Still);
    }
    if top == 0 {
        return Ok(Peak::Below);
    }
    if top + 1 == coarse.len() {
        return Ok(Peak::Above);
    }
    let fine =
        sweep(rig, &logarithmic(coarse[top - 1].frequency_hz, coarse[top + 1].frequency_hz, FINE))?;
    let best = highest(&fine).clamp(1, FINE - 2);
    let (frequency_hz, gain) = vertex(&fine[best - 1..=best + 1]);
    Ok(Peak::Inside { frequency_hz, gain })
}

/// Whether a response can be that of a machine: a simulation that diverges is told, not drawn.
pub fn sound(response: &Response) -> bool {
    response.gain < 1e3 && response.efficiency < 1e3
}

fn highest(curve: &[Response]) -> usize {
    (0..curve.len()).max_by(|a, b| curve[*a].gain.total_cmp(&curve[*b].gain)).unwrap_or(0)
}

/// Top of the parabola through three points, over the logarithm of the frequency.
fn vertex(points: &[Response]) -> (f64, f64) {
    let x = [0, 1, 2].map(|i| (points[i].frequency_hz / points[1].frequency_hz).ln());
    let y = [0, 1, 2].map(|i| points[i].gain);
    let (left, right) = ((y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1]));
    let curvature = (right - left) / (x[2] - x[0]);
    if curvature >= 0.0 {
        return (points[1].frequency_hz, y[1]);
    }
    // Through the middle point, where x is 0: y = y1 + slope x + curvature x².
    let slope = left - curvature * x[0];
    let at = (-slope / (2.0 * curvature)).clamp(x[0], x[2]);
    (points[1].frequency_hz * at.exp(), y[1] + slope * at + curvature * at * at)
}

/// Range above a start in which [`falls_below`] looks, as a ratio.
const REACH: f64 = 5.0;
/// Its steps, in the logarithm of the frequency.
const STEP: f64 = 0.05;

/// The first frequency above `from_hz` at which `value` falls below `level`; `None` where there is
/// none within five times `from_hz`, or no frequency to start from.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn falls_below(
    rig: &impl Rig,
    from_hz: Option<f64>,
    level: f64,
    value: fn(&Response) -> f64,
) -> Result<Option<f64>> {
    let Some(from_hz) = from_hz else { return Ok(None) };
    // A few at a time: what lies far above the crossing need not be computed.
    let steps = (REACH.ln() / STEP).ceil() as usize;
    let frequencies = logarithmic(from_hz, REACH * from_hz, steps + 1);
    let mut curve = Vec::with_capacity(frequencies.len());
    let mut found = None;
    for some in frequencies.chunks(4) {
        curve.extend(sweep(rig, some)?);
        found = curve.iter().position(|point| value(point) < level);
        if found.is_some() {
            break;
        }
    }
    let Some(first) = found else {
        return Ok(None);
    };
    if first == 0 {
        return Ok(Some(from_hz));
    }
    let (low, high) = (curve[first - 1].frequency_hz, curve[first].frequency_hz);
    root(low, high, 1e-4, |frequency| Ok(value(&at(rig, frequency)?) - level))
}

/// The frequency above the peak at which the gain falls below 0.707, Hz; `None` without a peak.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn cut_off(rig: &impl Rig, peak_hz: Option<f64>) -> Result<Option<f64>> {
    falls_below(rig, peak_hz, CUT_OFF_GAIN, |response| response.gain)
}

/// A root between two places, by Brent's method; `None` where the ends do not bracket one.
///
/// # Errors
/// The first that the function returns.
pub fn root(
    low: f64,
    high: f64,
    tolerance: f64,
    mut function: impl FnMut(f64) -> Result<f64>,
) -> Result<Option<f64>> {
    let mut failed = None;
    // The method asks for both ends of its bracket again and again, and each answer is a
    // simulation.
    let mut known: Vec<(f64, f64)> = Vec::new();
    let found = find_root_brent(
        low,
        high,
        |x| {
            if let Some((_, value)) = known.iter().find(|(place, _)| *place == x) {
                return *value;
            }
            let value = function(x).unwrap_or_else(|error| {
                failed.get_or_insert(error);
                f64::NAN
            });
            known.push((x, value));
            value
        },
        &mut SimpleConvergency { eps: tolerance, max_iter: 40 },
    );
    match failed {
        Some(error) => Err(error),
        None => Ok(found.ok()),
    }
}

/// One settled cycle of a sine.
#[derive(Clone, Debug)]
pub struct Cycle {
    /// The fundamental.
    pub response: Response,
    /// The movement over one cycle, from the plant's own start of a period on.
    pub motion: Vec<Motion>,
}

/// Moves the master along a sine and keeps the last cycle.
///
/// # Errors
/// Those of [`Rig::plant`].
pub fn cycle(rig: &impl Rig, frequency_hz: f64) -> Result<Cycle> {
    let mut tap = Tap { plant: rig.plant()?, motion: Vec::new() };
    let response = frequency_response(&mut tap, frequency_hz, rig.amplitude_rad());
    let motion = tap.motion;
    let steps = match motion.first() {
        Some(first) if first.time_s > 0.0 => (1.0 / (frequency_hz * first.time_s)).round() as usize,
        _ => 0,
    };
    let start = motion.len().saturating_sub(steps);
    Ok(Cycle { response, motion: motion[start..].to_vec() })
}

impl Cycle {
    /// Efficiency exactly as eq. 3.2.1 prints it: `max(τ_m q̇_s) / max(τ_s q̇_m)`, which pairs
    /// torque and speed of different sides.
    pub fn efficiency_as_printed(&self) -> f64 {
        let largest = |power: fn(&Motion) -> f64| self.motion.iter().map(power).fold(0.0, f64::max);
        let slave = largest(|m| m.motor_torque_nm * m.slave_velocity_rad_s);
        let master = largest(|m| m.transmitted_torque_nm * m.master_velocity_rad_s);
        if master > 0.0 { slave / master } else { 0.0 }
    }

    /// Work that reaches the slave over work of the motor, over the cycle: an efficiency in the
    /// strict sense, which inertia cannot lift above 1.
    pub fn work_efficiency(&self) -> f64 {
        let sum = |power: fn(&Motion) -> f64| self.motion.iter().map(power).sum::<f64>();
        let given = sum(|m| m.motor_torque_nm * m.master_velocity_rad_s);
        let arrived = sum(|m| m.transmitted_torque_nm * m.slave_velocity_rad_s);
        if given > 0.0 { arrived / given } else { 0.0 }
    }

    /// The longest time for which the slave stands still, s: the flat top of fig. 3.3 and 5.8.
    pub fn flat_top_s(&self) -> f64 {
        let step = match self.motion.as_slice() {
            [first, second, ..] => second.time_s - first.time_s,
            _ => 0.0,
        };
        let velocity: Vec<f64> = self.motion.iter().map(|m| m.slave_velocity_rad_s).collect();
        longest_rest(&velocity) as f64 * step
    }
}

/// Passes everything on to a plant and writes down how it moved.
#[derive(Clone)]
struct Tap<P> {
    plant: P,
    motion: Vec<Motion>,
}

impl<P: Transmission> Transmission for Tap<P> {
    fn step(&mut self, input: Input, dt_s: f64) {
        self.plant.step(input, dt_s);
        self.motion.push(self.plant.motion());
    }

    fn step_imposed(&mut self, master: ImposedMotion, hand_torque_nm: f64, dt_s: f64) {
        self.plant.step_imposed(master, hand_torque_nm, dt_s);
        self.motion.push(self.plant.motion());
    }

    fn motion(&self) -> Motion {
        self.plant.motion()
    }

    fn reading(&self) -> Reading {
        self.plant.reading()
    }

    fn energy(&self) -> EnergyBalance {
        self.plant.energy()
    }
}
