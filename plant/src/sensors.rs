//! From the true state to counts and volts.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// An incremental encoder: counts are the position, quantised downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Counts per rad (or per m), all edges counted; negative for an encoder that counts backwards.
    pub counts_per_unit: f64,
}

impl Encoder {
    /// An encoder of that many counts per turn.
    pub fn per_turn(counts: f64) -> Self {
        Self { counts_per_unit: counts / std::f64::consts::TAU }
    }

    /// Counts at a position, rad (or m). Saturates at the ends of `i64`; a position that is no number reads 0.
    pub fn counts(&self, position: f64) -> i64 {
        (position * self.counts_per_unit).floor() as i64
    }

    /// Middle of the interval of positions that read `counts`.
    pub fn position(&self, counts: i64) -> f64 {
        (counts as f64 + 0.5) / self.counts_per_unit
    }
}

/// What a torque cell does to its torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueCellParameters {
    /// Volts per N·m.
    pub volts_per_nm: f64,
    /// Volts at no torque, V.
    pub offset_v: f64,
    /// Standard deviation of white noise on each reading, V.
    pub noise_v: f64,
    /// Cut-off of the first-order low pass, Hz; infinite for none.
    pub bandwidth_hz: f64,
    /// Volts at which the output clips, V.
    pub limit_v: f64,
}

/// The optical torque cell of the handle, with seeded noise.
#[derive(Clone, Debug)]
pub struct TorqueCell {
    parameters: TorqueCellParameters,
    filtered_nm: f64,
    generator: Pcg64Mcg,
}

impl TorqueCell {
    /// A cell at rest; the same seed gives the same noise.
    pub fn new(parameters: TorqueCellParameters, seed: u64) -> Self {
        Self { parameters, filtered_nm: 0.0, generator: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// The parameters.
    pub fn parameters(&self) -> &TorqueCellParameters {
        &self.parameters
    }

    /// Volts after `dt_s` with the torque held, N·m.
    pub fn read(&mut self, torque_nm: f64, dt_s: f64) -> f64 {
        let decay = (-std::f64::consts::TAU * self.parameters.bandwidth_hz * dt_s).exp();
        self.filtered_nm = torque_nm + (self.filtered_nm - torque_nm) * decay;
        let noise: f64 = StandardNormal.sample(&mut self.generator);
        let parameters = &self.parameters;
        let volts = parameters.volts_per_nm * self.filtered_nm + parameters.offset_v + parameters.noise_v * noise;
        volts.clamp(-parameters.limit_v.abs(), parameters.limit_v.abs())
    }

    /// The torque that volts stand for, N·m.
    pub fn torque_nm(&self, volts: f64) -> f64 {
        (volts - self.parameters.offset_v) / self.parameters.volts_per_nm
    }
}
