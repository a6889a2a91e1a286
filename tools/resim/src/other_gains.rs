//! Another rig file's gains on the recorded inputs.
//!
//! Open loop: the handle moves as it was recorded. With these gains it would have moved
//! differently, and the volts would have been others again.

use control::cycle::Seen;
use control::law::{Law, LawConfig};
use ipc_types::{AXES, MotorCommand};

use crate::report::{OtherGains, VoltsDifference};
use crate::rigs::Rigs;

/// The law with the other gains, of one control process. Its state comes to follow from the inputs
/// no later than that of the law that ran: it is stepped from the process's first command on.
#[derive(Debug)]
pub(crate) struct OtherLaw {
    law: Box<Law>,
}

/// What the comparison has found so far.
#[derive(Debug, Default)]
pub(crate) struct Comparison {
    commands: u64,
    powered: u64,
    squares: [f64; AXES],
    largest: [(f64, f64); AXES],
}

impl OtherLaw {
    pub(crate) fn new(config: LawConfig) -> Self {
        Self { law: Box::new(Law::new(config)) }
    }

    /// Takes a recorded command with what it was computed from. It counts where it was `compared`
    /// with the law that ran.
    pub(crate) fn see(
        &mut self,
        command: &MotorCommand,
        seen: &Seen<'_>,
        compared: bool,
        rigs: &Rigs,
        comparison: &mut Comparison,
    ) {
        let other = seen.step(&mut self.law, command.computed_ns);
        if !compared {
            return;
        }
        comparison.commands += 1;
        if !seen.powered() {
            return;
        }
        comparison.powered += 1;
        for axis in 0..AXES {
            let difference = other.volts[axis] - command.volts[axis];
            comparison.squares[axis] += difference * difference;
            if difference.abs() > comparison.largest[axis].0.abs() {
                comparison.largest[axis] = (difference, rigs.seconds(command.computed_ns));
            }
        }
    }
}

impl Comparison {
    /// The result, of a rig of so many axes.
    pub(crate) fn result(&self, axes: usize) -> OtherGains {
        let volts = (0..axes.min(AXES)).map(|axis| {
            let (largest_v, largest_at_s) = self.largest[axis];
            let mean = self.squares[axis] / self.powered.max(1) as f64;
            VoltsDifference { axis, rms_v: mean.sqrt(), largest_v, largest_at_s }
        });
        OtherGains { commands: self.commands, powered: self.powered, volts: volts.collect() }
    }
}
