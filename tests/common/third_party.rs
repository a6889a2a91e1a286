//! A control written by others, in Rust: from `ipc-types` and `runtime` alone.

use ipc_types::program_flow::{Checkpoint, Flow};
use ipc_types::{AXES, COMMAND, GateState, MotorCommand, Process, SAMPLE, TOKEN};
use runtime::{Grid, Service};

/// Name of the rig, for the child.
pub const CHILD: &str = "FARREACH_THIRD_PARTY";
/// Target position (rad), gain (V/rad) and voltage limit (V) of the third-party control.
pub const TARGET_RAD: f64 = 0.6;
const GAIN_V_PER_RAD: f64 = 12.0;
const VOLTS_MAX: f64 = 4.0;

/// The third-party control: a proportional law around one position.
pub fn third_party(rig_name: &str) -> Result<(), Box<dyn std::error::Error>> {
    let mut service = Service::start(Process::Control, rig_name)?;
    let mut samples = service.subscriber(SAMPLE)?;
    let mut tokens = service.subscriber(TOKEN)?;
    let mut commands = service.publisher(COMMAND)?;
    let own = service.identity().incarnation;
    let profile = service.enter_loop()?;
    println!("incarnation {own}");
    let mut grid = Grid::of_rate(500, 200_000);
    let (mut sample, mut token) = (None, None);
    while !service.stopping() {
        let Some(wake) = grid.wait() else { continue };
        // The watchdog checks that each cycle has passed these, in this order.
        let mut flow = Flow::default();
        sample = samples.latest()?.or(sample);
        flow.pass(Checkpoint::SampleTaken);
        // This control follows no setpoints.
        flow.pass(Checkpoint::SetpointsTaken);
        token = tokens.latest()?.or(token);
        flow.pass(Checkpoint::TokenTaken);
        if let (Some(sample), Some(token)) = (&sample, &token) {
            let powered = token.enabled == 1
                && token.control_incarnation == own
                && sample.epoch == token.epoch
                && sample.gate_state == GateState::Open.code();
            let wanted_v = GAIN_V_PER_RAD * (TARGET_RAD - sample.master_position[0]);
            let mut volts = [0.0; AXES];
            volts[0] = if powered { wanted_v.clamp(-VOLTS_MAX, VOLTS_MAX) } else { 0.0 };
            flow.pass(Checkpoint::LawStepped);
            commands.send(MotorCommand {
                flow: flow.signature(token.sequence),
                sample_tick: sample.tick,
                sample_time_ns: sample.scan_time_ns,
                computed_ns: wake.woke_ns,
                token_sequence: token.sequence,
                epoch: token.epoch,
                volts,
                axes: 1,
                profile: profile.code(),
                cycles_missed: grid.missed(),
                ..MotorCommand::default()
            })?;
        }
        service.beat();
    }
    Ok(())
}
