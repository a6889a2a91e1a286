//! Figures of a recording: frequency response, friction and work, beside the declared model's.
//!
//! The model is the rig file's machine under its controller: it plays the same segments, and what
//! is read off the recorded machine is read off it by the same functions. Nobody holds its handle,
//! but for the simulated hand where the recorded machine was simulated, too.

mod friction;
mod page;
mod response;
mod trace;
mod work;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use recorder::{PlayedSegment, Samples, played_segments, replaced_lines};
use recording::mcap_read::Recording;
use rig::protocol::{Envelope, Movement};
use rig::{AxisUnit, HandKind, RigFile};
use serde::Serialize;

use crate::folder;
use friction::{FrictionMap, SpeedPoint};
use response::{Frequencies, Point, response};
use trace::Trace;
use work::Work;

/// What is shown of the machine, and of the model.
#[derive(Debug, Serialize)]
struct Beside<T> {
    measured: T,
    /// `None` where the model does not play the segment, or shows nothing in it.
    model: Option<T>,
}

/// What a segment of the recording shows.
#[derive(Debug, Default, Serialize)]
struct Shown {
    label: String,
    kind: &'static str,
    duration_s: f64,
    /// Samples that are missing: the ones before them take their place.
    missing: u64,
    /// Slave over master.
    response: Option<Beside<Vec<Point>>>,
    /// Torque of the motor against the position of the handle.
    friction: Option<Beside<FrictionMap>>,
    /// Torque of the motor at the highest speed.
    at_speed: Option<Beside<SpeedPoint>>,
    work: Option<Beside<Work>>,
}

impl Shown {
    const fn is_empty(&self) -> bool {
        self.response.is_none()
            && self.friction.is_none()
            && self.at_speed.is_none()
            && self.work.is_none()
    }
}

/// Draws the figures of a recording's axis; 0 when done.
///
/// # Errors
/// Where the recording cannot be read, or no segment of it shows anything.
pub(crate) fn run(file: &Path, axis: usize, out: Option<PathBuf>, json: bool) -> Result<i32> {
    let out = out.map(|out| folder::check(&out)).transpose()?;
    let recording = Recording::open(file)?;
    let samples = Samples::read(&recording, 0..u64::MAX)?;
    let segments = played_segments(&recording, &samples.rig)?;
    let shown = all(file, &samples, &segments, axis)?;
    let text = serde_json::to_string_pretty(&shown)?;
    let replaced = replaced_lines(&recording)?;
    if let Some(out) = &out {
        folder::write(out, &page::files(file, &samples.rig, axis, &replaced, &shown, &text)?)?;
    }
    if json {
        println!("{text}");
        return Ok(0);
    }
    for line in replaced.into_iter().chain(page::lines(&shown)) {
        println!("{line}");
    }
    if let Some(out) = out {
        println!("page: {}", out.join("index.html").display());
    }
    Ok(0)
}

/// What each segment shows, of those that show anything.
fn all(
    file: &Path,
    samples: &Samples,
    segments: &[PlayedSegment],
    axis: usize,
) -> Result<Vec<Shown>> {
    let rig = &samples.rig;
    let Some(declared) = rig.axes.get(axis) else {
        bail!("--axis: the rig \"{}\" has the axes 0 to {}", rig.name, rig.axes.len() - 1);
    };
    if declared.unit != AxisUnit::Radian {
        bail!("axis {axis} is linear: these figures are made for rotary axes");
    }
    let mut machine = rig.clone();
    machine.axes = vec![declared.clone()];
    machine.model.handle_coupling.clear();
    if !samples.simulated {
        machine.simulation.hand.kind = HandKind::Absent;
    }
    let torque_per_volt = rig.axis_parameters(declared)?.motor_torque_per_volt_nm();
    let mut shown = Vec::new();
    for segment in segments.iter().filter(|segment| segment.axis == axis) {
        let found = of_segment(&machine, torque_per_volt, samples, segment)
            .with_context(|| format!("{}: segment \"{}\"", file.display(), segment.label))?;
        shown.extend(found.filter(|found| !found.is_empty()));
    }
    if shown.is_empty() {
        bail!(
            "{}: no segment on axis {axis} shows a response, friction or work: play `farreach run \
             friction-map`, or a protocol with multisine, chirp, guided_sine or rhythm",
            file.display()
        );
    }
    Ok(shown)
}

/// What a segment shows; `None` for a kind that shows nothing. `machine` is the declared one, with
/// the segment's axis alone.
fn of_segment(
    machine: &RigFile,
    torque_per_volt: f64,
    samples: &Samples,
    segment: &PlayedSegment,
) -> Result<Option<Shown>> {
    let (sine, excitation) = match &segment.movement {
        Movement::GuidedSine(sine) => (Some(sine), None),
        Movement::Rhythm(_) => (None, None),
        Movement::Multisine(sines) => {
            let lines = sines.lines.iter().map(|line| line.frequency_hz).collect();
            (None, Some((&sines.envelope, Frequencies::Lines(lines))))
        }
        Movement::Chirp(chirp) => {
            let [one, other] = chirp.frequencies_hz;
            let bands = Frequencies::Bands(one.min(other), one.max(other));
            (None, Some((&chirp.envelope, bands)))
        }
        _ => return Ok(None),
    };
    let measured = Trace::measured(samples, segment.axis, &segment.times_ns, torque_per_volt)?;
    // A rhythm is the hand's.
    let model = match segment.movement {
        Movement::Rhythm(_) => None,
        _ => Some(measured.simulated(machine, &segment.movement, torque_per_volt)?),
    };
    let both = (&measured, model.as_ref());
    let mut shown = Shown {
        label: segment.label.clone(),
        kind: segment.movement.kind(),
        duration_s: measured.duration_s(),
        missing: measured.missing,
        ..Shown::default()
    };
    if let Some(sine) = sine {
        if friction::is_slow(sine) {
            shown.friction = beside(both, |trace| friction::map(trace, sine));
        }
        shown.at_speed = beside(both, |trace| friction::at_speed(trace, sine));
    }
    match excitation {
        Some((envelope, frequencies)) => {
            shown.response = beside(both, |trace| responded(trace, envelope, &frequencies));
        }
        None => shown.work = beside(both, work::work),
    }
    Ok(Some(shown))
}

/// The response of what lies between the fades.
fn responded(trace: &Trace, envelope: &Envelope, frequencies: &Frequencies) -> Option<Vec<Point>> {
    let settled = trace.settled(envelope);
    let slave = trace.slave.as_ref()?.get(settled.clone())?;
    response(trace.master.get(settled)?, slave, trace.rate_hz, frequencies)
}

fn beside<T>(
    (measured, model): (&Trace, Option<&Trace>),
    of: impl Fn(&Trace) -> Option<T>,
) -> Option<Beside<T>> {
    Some(Beside { measured: of(measured)?, model: model.and_then(of) })
}
