//! The MR-compatible optical torque cell: volts of a torque.
//!
//! A polymer cross whose deflection is read by the intensity of a reflected beam through optical
//! fibres (§ 2.1, § 5.1); its zero wanders with temperature and with the bend of the fibres. No
//! numbers are printed.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

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

/// How the zero of a torque cell wanders; by default not at all.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    /// Steady drift (the optics warm up), V/s.
    pub ramp_v_per_s: f64,
    /// Random walk, V/√s: the standard deviation after `t` seconds is this times `√t`. One V/√h is
    /// 1/60 V/√s.
    pub walk_v_per_sqrt_s: f64,
}

/// The optical torque cell of the handle, with seeded noise.
#[derive(Clone, Debug)]
pub struct TorqueCell {
    parameters: TorqueCellParameters,
    drift: Drift,
    filtered_nm: f64,
    wandered_v: f64,
    generator: Pcg64Mcg,
    /// Its own, so that drift leaves the noise as it was.
    walk_generator: Pcg64Mcg,
}

impl TorqueCell {
    /// A cell at rest; the same seed gives the same noise.
    pub fn new(parameters: TorqueCellParameters, seed: u64) -> Self {
        Self {
            parameters,
            drift: Drift::default(),
            filtered_nm: 0.0,
            wandered_v: 0.0,
            generator: Pcg64Mcg::seed_from_u64(seed),
            walk_generator: Pcg64Mcg::seed_from_u64(seed ^ 0x6472_6966_7400_0001),
        }
    }

    /// The same cell with a zero that wanders.
    #[must_use]
    pub fn with_drift(self, drift: Drift) -> Self {
        Self { drift, ..self }
    }

    /// How far the zero has wandered, V.
    pub fn wandered_v(&self) -> f64 {
        self.wandered_v
    }

    /// The parameters.
    pub fn parameters(&self) -> &TorqueCellParameters {
        &self.parameters
    }

    /// Volts after `dt_s` with the torque held, N·m.
    pub fn read(&mut self, torque_nm: f64, dt_s: f64) -> f64 {
        let decay = (-std::f64::consts::TAU * self.parameters.bandwidth_hz * dt_s).exp();
        self.filtered_nm = torque_nm + (self.filtered_nm - torque_nm) * decay;
        self.wandered_v += self.drift.ramp_v_per_s * dt_s;
        if self.drift.walk_v_per_sqrt_s != 0.0 {
            let walk: f64 = StandardNormal.sample(&mut self.walk_generator);
            self.wandered_v += self.drift.walk_v_per_sqrt_s * dt_s.max(0.0).sqrt() * walk;
        }
        let noise: f64 = StandardNormal.sample(&mut self.generator);
        let parameters = &self.parameters;
        let zero = parameters.offset_v + self.wandered_v;
        let volts = parameters.volts_per_nm * self.filtered_nm + zero + parameters.noise_v * noise;
        volts.clamp(-parameters.limit_v.abs(), parameters.limit_v.abs())
    }

    /// The torque that volts stand for, N·m, by gain and offset: drift is not known to whoever
    /// reads.
    pub fn torque_nm(&self, volts: f64) -> f64 {
        (volts - self.parameters.offset_v) / self.parameters.volts_per_nm
    }
}
