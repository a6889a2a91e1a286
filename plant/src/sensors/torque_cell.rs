//! The MR-compatible optical torque cell: voltage from torque.
//!
//! The deflection of a polymer cross is measured by the intensity of a beam that is reflected
//! through optical fibres (§ 2.1, § 5.1). Its zero drifts with temperature and with the bending of
//! the fibres. The thesis gives no values.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Parameters of a torque cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueCellParameters {
    /// Volts per N·m.
    pub volts_per_nm: f64,
    /// Voltage at zero torque, V.
    pub offset_v: f64,
    /// Standard deviation of white noise on each reading, V.
    pub noise_v: f64,
    /// Cut-off frequency of the first-order low-pass, Hz; infinite for none.
    pub bandwidth_hz: f64,
    /// Voltage at which the output clips, V.
    pub limit_v: f64,
}

/// Drift of the zero of a torque cell; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    /// Constant rate, as the optics warm up, V/s.
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
    /// Separate, so that the drift does not change the noise.
    walk_generator: Pcg64Mcg,
}

impl TorqueCell {
    /// A cell without load; equal seeds give equal noise.
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

    /// Adds drift of the zero.
    #[must_use]
    pub fn with_drift(self, drift: Drift) -> Self {
        Self { drift, ..self }
    }

    /// Present drift of the zero, V.
    pub fn wandered_v(&self) -> f64 {
        self.wandered_v
    }

    /// Advances by `dt_s` (s) with the torque (N·m) held and returns the voltage, V.
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
}
