//! `transport_delay`: dead time.
//!
//! - drive: the amplifier applies the volts commanded `T` earlier;
//! - sensor: all measured channels (not the motor's volts) lag by `T`;
//! - line: a lossless transmission line of travel time `T` and wave impedance `Z = √(K m_l)` lies
//!   between the fluid and the slave's spring. With force `f` and velocity `v` at its two ends:
//!
//! ```text
//! f₁(t) - Z v₁(t) = f₂(t-T) - Z v₂(t-T)
//! f₂(t) + Z v₂(t) = f₁(t-T) + Z v₁(t-T)
//! ```
//!
//! It conserves energy, whereas a delayed spring force would excite the line's mode. Both ends use
//! the velocities of the step itself, not extrapolated ones: a reflected wave would grow by the
//! error of the extrapolation.
//!
//! Source: method of characteristics; Wylie and Streeter, Fluid Transients.
//!
//! # In a model of one channel
//!
//! Dead time between the force and the motion.
//!
//! `F(t) = f(t + delay)`, where `f` is the force that the model predicts from the motion: for a
//! positive delay the motion lags the recorded force (dead time of amplifier, network or position
//! sensor), for a negative one the force channel lags.
//!
//! Parameter: `delay` (s), any sign, at most one period of the cut-off frequency; 0.1 to 20 ms.
//!
//! In a residual: an error proportional to the rate of the force. Confused with: a lag of the
//! amplifier (equal to first order), damping in parallel with a spring, channels that were not
//! sampled at the same instant. Below one and a half sampling periods it is not reported:
//! zero-order hold of the command alone delays it by half a period, and computing time in the loop
//! by one more.

use super::delay_line::DelayLine;
use super::one_channel::samples::step_of;
use super::one_channel::{Shape, Term, samples};
use super::search::{MultiStart, SearchRange};
use super::{Demand, Effect, LineConstants, Link, Moment, Reading, Side, Site, effect};

/// The experiment that distinguishes a lag from dead time.
pub(super) const LAG_OR_DEAD_TIME: &str = "steps of the command with the current measured: a lag \
                                           begins at once, dead time does not; or sines up to the \
                                           bandwidth: a lag loses amplitude, dead time only phase";

/// Shortest dead time of a line that is searched, in steps: slightly more than one.
const LEAST_STEPS_OF_LINE: f64 = 1.05;

effect! {
    "transport_delay": "dead time";
    at Line = 5e-3 "s", Drive = 5e-3 "s", Sensor = 5e-3 "s";
    /// Dead time.
    pub struct TransportDelay {
        /// Dead time `T`.
        delay_s: "s", 0.0, 1.0, 5e-3,
            "10 m of pure fluid take 7 ms, which the model's masses and springs stand for";
    }
    state {
        signals: Vec<DelayLine> = Vec::new();
        far_position_m: [Option<f64>; 2] = [None; 2];
        far_velocity_m_s: [f64; 2] = [0.0; 2];
        arriving_n: [f64; 2] = [0.0; 2];
        impedance_n_s_per_m: f64 = 1.0;
        spring_rate: f64 = 0.0;
    }
    search {
        space: |of| {
            let from = |least_s| SearchRange::linear("delay_s", least_s, 0.05);
            match of.site {
                Site::Line => of
                    .sizes(from(LEAST_STEPS_OF_LINE * of.features.step_s), &[0.6, 1.2, 2.0])
                    .multi_start(MultiStart::Always),
                _ => of.sizes(from(0.0), &[0.2, 0.6, 2.0]),
            }
        },
        // Late volts and late readings differ by the origin of time alone.
        equivalent_sites: &[Site::Drive, Site::Sensor],
    }
    one_channel {
        rank: 210,
        words: "dead time between force and motion",
        experiment: LAG_OR_DEAD_TIME,
        uses_model: true,
        linear: true,
        shift: |_, shapes| shapes.first().copied(),
        terms: |_| vec![Term::given()],
        shapes: |axis| {
            let longest = 1.0 / axis.cut_off;
            vec![Shape::by_steps("delay", "s", (-longest, longest), 20)]
        },
        columns: Some(|view, shapes| {
            let step = step_of(&view.signals.time).unwrap_or(1.0);
            let late = samples::shifted(view.model, shapes[0] / step);
            vec![late.iter().zip(view.model).map(|(late, now)| late - now).collect()]
        }),
        deliver: Some(|command, step, _, shapes| samples::shifted(command, -shapes[0] / step)),
        // The plant's line carries waves.
        of_plant: |fit| {
            let renamed = fit.renamed(&[("delay", "delay_s")]);
            renamed.filter(|_| fit.site == Site::Drive.name())
        },
    }
}

impl Effect for TransportDelay {
    fn prepare(&mut self, constants: &dyn LineConstants) {
        let signals = match self.site {
            Site::Line => 4,
            Site::Sensor => 3,
            _ => 1,
        };
        self.signals = vec![DelayLine::new(self.delay_s); signals];
        self.far_position_m = [None; 2];
        self.far_velocity_m_s = [0.0; 2];
        self.arriving_n = [0.0; 2];
        let stiffness = constants.line_stiffness_n_per_m();
        self.impedance_n_s_per_m = (stiffness * constants.line_mass_kg()).sqrt();
        self.spring_rate = 2.0 * stiffness / self.impedance_n_s_per_m;
    }

    fn demand(&self) -> Demand {
        Demand {
            rate_rad_s: if self.site == Site::Line { self.spring_rate } else { 0.0 },
            ..Demand::default()
        }
    }

    fn delay_of_all_readings_s(&self) -> Option<f64> {
        (self.site == Site::Sensor).then_some(self.delay_s)
    }

    fn amplifier(&mut self, volts: f64, moment: &Moment) -> f64 {
        self.signals[0].push(moment.time_s, volts);
        self.signals[0].past(moment.time_s)
    }

    fn deflect(&mut self, link: &mut Link, moment: &Moment) {
        if link.end == Side::Master || self.delay_s <= 0.0 {
            return;
        }
        // The far end starts where the fluid is; at the middle of the step it is half a step on.
        let far = *self.far_position_m[link.line].get_or_insert(link.fluid_position_m);
        let far_velocity = self.far_velocity_m_s[link.line];
        link.deflection_m += far + 0.5 * moment.step_s * far_velocity - link.fluid_position_m;
        link.rate_m_s += far_velocity - link.fluid_velocity_m_s;
    }

    fn link(&mut self, link: &mut Link, moment: &Moment) {
        if link.end == Side::Master || self.delay_s <= 0.0 {
            return;
        }
        let (line, time, impedance) = (link.line, moment.time_s, self.impedance_n_s_per_m);
        let (outward, inward) = (2 * line, 2 * line + 1);
        // Spring and port's damper see the new speed of the far end, half a step of it at the
        // middle of the step.
        let damping = link.damping_n_s_per_m + 0.5 * moment.step_s * link.stiffness_n_per_m;
        let before = self.far_velocity_m_s[line];
        let arriving = self.signals[outward].past(time);
        let far_velocity = (arriving - link.force_n + damping * before) / (impedance + damping);
        link.force_n += damping * (far_velocity - before);
        self.arriving_n[line] = self.signals[inward].past(time);
        self.signals[inward].push(time, link.force_n - impedance * far_velocity);
        if let Some(far) = &mut self.far_position_m[line] {
            *far += moment.step_s * far_velocity;
        }
        self.far_velocity_m_s[line] = far_velocity;
        link.fluid_force_n = self.arriving_n[line];
        link.fluid_damping_n_s_per_m = impedance;
    }

    fn flowed(&mut self, line: usize, displacement_m: f64, moment: &Moment) {
        if self.delay_s <= 0.0 {
            return;
        }
        let velocity = displacement_m / moment.step_s;
        self.signals[2 * line]
            .push(moment.time_s, self.arriving_n[line] + 2.0 * self.impedance_n_s_per_m * velocity);
    }

    fn sense(&mut self, reading: &mut Reading, moment: &Moment) {
        let channels =
            [&mut reading.master_rad, &mut reading.slave_rad, &mut reading.slave_torque_nm];
        for (signal, channel) in self.signals.iter_mut().zip(channels) {
            signal.push(moment.time_s, *channel);
            *channel = signal.past(moment.time_s);
        }
    }
}
