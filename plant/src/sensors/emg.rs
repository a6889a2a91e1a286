//! Surface EMG of the muscles that generate the torque of the hand.
//!
//! Per channel, in this order:
//!
//! 1. **Excitation** from torque: `u = |τ| / τ_max` for the agonists, `κ u` for the antagonists
//!    (co-contraction), plus a stiffening part for both; limited to 0 to 1. Flexors generate
//!    positive hand torque.
//! 2. **Activation** follows excitation with a first-order lag, faster when rising than when
//!    falling: `ȧ = (u - a) / t` (Zajac 1989; Winters 1990 for the times).
//! 3. **Signal**: white noise through a causal band-pass of 10 to 400 Hz (§ 2.2: "EMG signals cover
//!    frequencies from 10 to 400 Hz"), scaled to unit rms, times `a` and volts at full
//!    activation. Amplitude is proportional to activation ("amplitude is correlated with
//!    muscle tension", § 2.1).
//! 4. **Floor**: white noise of electrodes and amplifier; the sum is clipped.
//!
//! The EMG of a real muscle precedes its torque by about 50 ms; here it is derived from the torque
//! and follows it.

use super::BandPass;
use crate::parameter::parameter_set;
use crate::{ParameterError, ParameterSet};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Channels of the rig: "upto six EMG inputs" (§ 2.1).
pub const EMG_CHANNELS: usize = 6;

parameter_set! {
    /// Constants of the muscles and of the amplifier, equal for all channels.
    #[derive(PartialEq)]
    pub struct EmgParameters {
        /// Hand torque at full activation `τ_max`.
        full_torque_nm: "N m", 1e-3, 1e3, 5.0, "assumed: somewhat less than a strong wrist";
        /// Excitation of the antagonist over that of the agonist `κ`.
        cocontraction: "1", 0.0, 1.0, 0.15, "assumed";
        /// Excitation of both without torque, as in a stiffened joint.
        stiffening: "1", 0.0, 1.0, 0.0, "assumed: relaxed";
        /// Time constant of rising activation.
        activation_s: "s", 1e-4, 1.0, 0.015, "Zajac 1989, order of magnitude";
        /// Time constant of falling activation.
        deactivation_s: "s", 1e-4, 1.0, 0.05, "Zajac 1989, order of magnitude";
        /// Lower corner frequency.
        low_hz: "Hz", 1.0, 100.0, 10.0, "§ 2.2";
        /// Upper corner frequency.
        high_hz: "Hz", 101.0, 1e4, 400.0, "§ 2.2";
        /// Rms voltage at full activation, after the amplifier.
        full_rms_v: "V", 0.0, 10.0, 0.2, "assumed: 0.2 mV, amplified 1000 times";
        /// Rms voltage of the noise floor.
        floor_rms_v: "V", 0.0, 10.0, 0.003, "assumed: 3 uV, amplified 1000 times";
        /// Voltage at which the output clips.
        limit_v: "V", 1e-3, 100.0, 10.0, "assumed: the card's range";
    }
}

/// One channel.
#[derive(Clone, Debug)]
struct Channel {
    filter: BandPass,
    generator: Pcg64Mcg,
}

/// Six channels of surface EMG, sampled at a fixed rate.
#[derive(Clone, Debug)]
pub struct Emg {
    parameters: EmgParameters,
    channels: [Channel; EMG_CHANNELS],
    /// Scale from filtered noise to volts at full activation.
    scale_v: f64,
    rise: f64,
    fall: f64,
    /// Of flexors and extensors.
    activation: [f64; 2],
}

impl Emg {
    /// Relaxed muscles, sampled every `step_s` (s): flexors on channels 0, 2, 4 and extensors on 1,
    /// 3, 5. Equal seeds give equal signals.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`]; also if the upper corner frequency is 0.49 of the sampling
    /// rate or more.
    pub fn new(parameters: EmgParameters, step_s: f64, seed: u64) -> Result<Self, ParameterError> {
        parameters.check()?;
        let EmgParameters { low_hz, high_hz, .. } = parameters;
        // Written such that NaN fails, too.
        if !(step_s > 0.0 && high_hz * step_s < 0.49) {
            let (minimum, maximum) = (101.0, 0.49 / step_s);
            return Err(ParameterError::OutOfRange {
                name: "high_hz",
                value: high_hz,
                minimum,
                maximum,
                unit: "Hz",
            });
        }
        let filter = BandPass::new(low_hz * step_s, high_hz * step_s);
        // The high-pass rings longest: it has decayed by e⁻⁴⁰ after this many samples.
        let samples = (20.0 / (low_hz * step_s)).min(1e6) as usize;
        let channels = std::array::from_fn(|index| Channel {
            filter,
            generator: Pcg64Mcg::seed_from_u64(
                seed ^ (0x656d_6700 + index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15),
            ),
        });
        Ok(Self {
            scale_v: parameters.full_rms_v / filter.noise_gain(samples),
            rise: -(-step_s / parameters.activation_s).exp_m1(),
            fall: -(-step_s / parameters.deactivation_s).exp_m1(),
            parameters,
            channels,
            activation: [0.0; 2],
        })
    }

    /// Activation of flexors and extensors, 0 to 1.
    pub fn activation(&self) -> (f64, f64) {
        (self.activation[0], self.activation[1])
    }

    /// Excitation of flexors and extensors under a hand torque, N·m; 0 to 1.
    pub fn excitation(&self, hand_torque_nm: f64) -> (f64, f64) {
        let parameters = &self.parameters;
        let agonist = hand_torque_nm.abs() / parameters.full_torque_nm;
        let antagonist = parameters.cocontraction * agonist;
        let (flexor, extensor) =
            if hand_torque_nm >= 0.0 { (agonist, antagonist) } else { (antagonist, agonist) };
        (
            (flexor + parameters.stiffening).clamp(0.0, 1.0),
            (extensor + parameters.stiffening).clamp(0.0, 1.0),
        )
    }

    /// Advances by one step with the hand torque (N·m) held and returns the voltages of the six
    /// channels. NaN counts as zero torque.
    pub fn read(&mut self, hand_torque_nm: f64) -> [f64; EMG_CHANNELS] {
        let torque = if hand_torque_nm.is_nan() { 0.0 } else { hand_torque_nm };
        let (flexor, extensor) = self.excitation(torque);
        for (activation, excitation) in self.activation.iter_mut().zip([flexor, extensor]) {
            let part = if excitation > *activation { self.rise } else { self.fall };
            *activation += part * (excitation - *activation);
        }
        let Self { parameters, channels, scale_v, activation, .. } = self;
        let mut volts = [0.0; EMG_CHANNELS];
        for (index, (channel, volts)) in channels.iter_mut().zip(&mut volts).enumerate() {
            let white: f64 = StandardNormal.sample(&mut channel.generator);
            let floor: f64 = StandardNormal.sample(&mut channel.generator);
            let signal = activation[index % 2] * *scale_v * channel.filter.update(white);
            *volts = (signal + parameters.floor_rms_v * floor)
                .clamp(-parameters.limit_v, parameters.limit_v);
        }
        volts
    }
}
