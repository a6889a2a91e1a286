//! How the handle followed a protocol, from a recording.

use std::path::Path;

use ipc_types::{SAMPLE, SETPOINT, Sample, Setpoint};
use recording::mcap_read::{ReadError, Recording};

use crate::tracking::Followed;

/// Two setpoints further apart than this are of two passes (s): a trip lies between.
const PASS_GAP_S: f64 = 0.1;
/// Longest time between two samples over which a position is interpolated (s).
const SAMPLE_GAP_S: f64 = 0.02;

/// Reads every pass of a protocol in a recording, in the order of time: the desired position of the
/// first axis, and the measured one at the instants for which it was meant. `protocol` is its
/// [`identity`]; of its segments one, or all.
///
/// [`identity`]: rig::protocol::Protocol::identity
///
/// # Errors
/// Where the recording cannot be read.
pub fn passes(
    path: &Path,
    protocol: u64,
    segment: Option<u32>,
) -> Result<Vec<Followed>, ReadError> {
    let recording = Recording::open(path)?;
    let mut samples = Vec::new();
    for sample in recording.messages::<Sample>(SAMPLE.topic.name)? {
        let Sample { scan_time_ns, slave_present, slave_position, master_position, .. } =
            sample?.message;
        let measured = if slave_present & 1 == 1 { slave_position } else { master_position };
        samples.push((scan_time_ns, measured[0]));
    }
    samples.sort_by_key(|(time_ns, _)| *time_ns);
    samples.dedup_by_key(|(time_ns, _)| *time_ns);
    let mut aims = Vec::new();
    for setpoint in recording.messages::<Setpoint>(SETPOINT.topic.name)? {
        let setpoint = setpoint?.message;
        let wanted = segment.is_none_or(|segment| segment == setpoint.segment);
        if setpoint.protocol == protocol && wanted {
            aims.push((setpoint.at_ns, setpoint.position[0]));
        }
    }
    aims.sort_by_key(|(time_ns, _)| *time_ns);
    aims.dedup_by_key(|(time_ns, _)| *time_ns);
    Ok(split(&aims, &samples))
}

/// Seconds from one instant to a later one (ns).
fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

/// Divides the desired positions at gaps, and puts the measured ones beside them. Both are sorted
/// by time.
fn split(aims: &[(u64, f64)], samples: &[(u64, f64)]) -> Vec<Followed> {
    let mut passes: Vec<Followed> = Vec::new();
    let (mut begun_ns, mut before_ns) = (0, None);
    for &(at_ns, desired) in aims {
        if before_ns.is_none_or(|before_ns| seconds(before_ns, at_ns) > PASS_GAP_S) {
            passes.push(Followed::default());
            begun_ns = at_ns;
        }
        before_ns = Some(at_ns);
        if let (Some(pass), Some(measured)) = (passes.last_mut(), at(samples, at_ns)) {
            pass.push(seconds(begun_ns, at_ns), desired, measured);
        }
    }
    passes
}

/// The measured position at an instant, interpolated; `None` beyond the samples or in a gap.
fn at(samples: &[(u64, f64)], at_ns: u64) -> Option<f64> {
    let next = samples.partition_point(|(time_ns, _)| *time_ns < at_ns);
    let &(next_ns, after) = samples.get(next)?;
    if next_ns == at_ns {
        return Some(after);
    }
    let &(last_ns, before) = samples.get(next.checked_sub(1)?)?;
    let between_s = seconds(last_ns, next_ns);
    (between_s <= SAMPLE_GAP_S)
        .then(|| before + (after - before) * seconds(last_ns, at_ns) / between_s)
}

#[cfg(test)]
mod tests {
    use ipc_types::Message as _;
    use recording::mcap_write::{Start, Writer};

    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn positions_are_interpolated_and_gaps_are_left_out() {
        let samples = [(0, 0.0), (2 * MS, 0.2), (3 * MS, 0.4), (50 * MS, 1.0)];
        assert_eq!(at(&samples, 2 * MS), Some(0.2));
        assert!((at(&samples, MS).unwrap() - 0.1).abs() < 1e-12);
        assert_eq!((at(&samples, 30 * MS), at(&samples, 51 * MS)), (None, None));
    }

    #[test]
    fn a_gap_in_the_setpoints_begins_another_pass() {
        let samples: Vec<(u64, f64)> = (0..2000).map(|at| (at * MS, at as f64)).collect();
        let aims: Vec<(u64, f64)> =
            (10..40).chain(500..510).map(|at| (2 * at * MS, 2.0 * at as f64)).collect();
        let passes = split(&aims, &samples);
        assert_eq!(passes.iter().map(|pass| pass.time_s.len()).collect::<Vec<_>>(), [30, 10]);
        assert_eq!(passes[1].time_s[..2], [0.0, 0.002]);
        assert_eq!(passes[1].measured, passes[1].desired);
    }

    #[test]
    fn the_setpoints_of_one_protocol_and_segment_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut writer = Writer::create(&path, &Start::default(), 0).unwrap();
        for tick in 0..100u64 {
            let mut sample = Sample { scan_time_ns: tick * MS, slave_present: 1, ..<_>::default() };
            sample.slave_position[0] = tick as f64;
            sample.stamp(1, tick, 0, tick * MS);
            writer.write_message(&SAMPLE, &sample).unwrap();
            let (protocol, segment) = (7 + tick / 60, (tick / 20) as u32);
            let mut aim = Setpoint { at_ns: tick * MS, protocol, segment, ..<_>::default() };
            aim.position[0] = 1.0 + tick as f64;
            aim.stamp(2, tick, 0, tick * MS);
            writer.write_message(&SETPOINT, &aim).unwrap();
        }
        writer.finish(&[]).unwrap();
        let rows = |protocol, segment| -> Vec<usize> {
            let passes = passes(&path, protocol, segment).unwrap();
            assert!(passes.iter().all(|pass| pass.desired[0] - pass.measured[0] == 1.0));
            passes.iter().map(|pass| pass.time_s.len()).collect()
        };
        assert_eq!(
            (rows(7, None), rows(7, Some(1)), rows(8, None)),
            (vec![60], vec![20], vec![40])
        );
        assert!(passes(&path, 9, None).unwrap().is_empty());
    }
}
