//! What the player does, as events.

use ipc_types::{Event, EventKind, Process, Severity};
use runtime::{PortError, Service};

use crate::player::{Change, Notice, Program};

/// The events of a notice. Of a range, first what the handle's own encoder saw, then, where the
/// limits are much wider, what the motor's did: positions in protocols are the motor's.
pub(super) fn publish_notice(
    notice: Notice,
    segment: u32,
    service: &mut Service,
) -> Result<(), PortError> {
    let mut send = |kind, severity, text: &str, [a, b, c]: [f64; 3]| {
        let event = Event::new(Process::Experiment, kind, severity, text);
        service.publish(Event { a, b, c, segment, ..event })
    };
    match notice {
        Notice::Beat { position, number } => {
            send(EventKind::Beat, Severity::Info, "", [position, f64::from(number), 0.0])
        }
        Notice::Range { axis, range, narrower } => {
            let text = match range.met {
                (true, true) => "both ends met, as the handle sees them",
                (false, false) => "no end met within the rig's limits",
                _ => "one end met; the other is where the rig's limits or the protocol end",
            };
            let axis = axis as f64;
            send(
                EventKind::RangeFound,
                Severity::Info,
                text,
                [range.lower.handle, range.upper.handle, axis],
            )?;
            if !narrower {
                return Ok(());
            }
            let text = "narrower than the rig's limits, as the motor sees it; narrow the limits";
            send(
                EventKind::RangeFound,
                Severity::Warning,
                text,
                [range.lower.motor, range.upper.motor, axis],
            )
        }
    }
}

/// The events of a change: with each segment that begins, what the subject is told. Texts are
/// copied, not formatted.
pub(super) fn publish_change(
    change: Change,
    program: Option<&Program>,
    service: &mut Service,
) -> Result<(), PortError> {
    let name = program.map_or("", Program::name);
    let duration_s = program.map_or(0.0, Program::duration_s);
    let label = |segment: u32| program.map_or("", |program| program.label(segment as usize));
    let mut send = |kind, segment: u32, text: &str, b: f64| {
        let event = Event::new(Process::Experiment, kind, Severity::Info, text);
        service.publish(Event { a: f64::from(segment), b, segment, ..event })
    };
    let begun = match change {
        Change::Started => {
            send(EventKind::ProtocolStarted, 0, name, duration_s)?;
            send(EventKind::SegmentStarted, 0, label(0), 0.0)?;
            0
        }
        Change::Continued(segment) => {
            send(EventKind::ProtocolStarted, segment, name, duration_s)?;
            send(EventKind::ProtocolResumed, segment, label(segment), 0.0)?;
            segment
        }
        Change::Segment(segment) => {
            send(EventKind::SegmentStarted, segment, label(segment), 0.0)?;
            segment
        }
        Change::Resumed(segment) => {
            send(EventKind::ProtocolResumed, segment, label(segment), 0.0)?;
            segment
        }
        Change::Stopped(segment) => {
            return send(EventKind::ProtocolStopped, segment, name, 0.0);
        }
        Change::Aborted(segment, reason) => {
            return send(EventKind::ProtocolStopped, segment, reason.text(), 0.0);
        }
        Change::Done => {
            let last = program.map_or(0, |program| program.segments().saturating_sub(1) as u32);
            return send(EventKind::ProtocolDone, last, name, 0.0);
        }
    };
    let Some(program) = program else { return Ok(()) };
    if let Some(text) = program.instruction(begun as usize) {
        send(EventKind::Instruction, begun, text, 0.0)?;
    }
    if let Some(sound) = program.sound(begun as usize) {
        let event = Event::new(Process::Experiment, EventKind::Sound, Severity::Info, sound.text());
        service.publish(Event { a: f64::from(sound.code()), segment: begun, ..event })?;
    }
    Ok(())
}
