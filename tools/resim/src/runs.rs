//! The protocols that were played, as the metadata of a recording tell them.

use std::sync::Arc;

use experiment::interrupted::Continuation;
use experiment::player::Program;
use experiment::scan_tracker::ScanState;
use experiment::session_state::SessionState;
use ipc_types::{PulseSource, Setpoint};
use recording::mcap_read::Recording;
use recording::mcap_write::key;
use rig::protocol::Protocol;
use rig::{RigFile, identity};

use crate::report::NotCompared;

/// A protocol that was to be played.
#[derive(Clone, Debug)]
struct Run {
    /// When it was noted, before it began [ns, CLOCK_MONOTONIC].
    noted_ns: u64,
    protocol: u64,
    text: String,
    pulses: PulseSource,
}

/// The protocols that were to be played.
#[derive(Clone, Debug, Default)]
pub struct Runs(Vec<Run>);

impl Runs {
    /// Those that a recording has noted. One whose source of pulses this build does not know is
    /// left out.
    pub fn of(recording: &Recording) -> Self {
        let mut runs = Self::default();
        for run in recording.runs() {
            let Some(text) = run.get(key::PROTOCOL_FILE) else { continue };
            let noted_ns = run.get(key::TIME_NS).and_then(|time| time.parse().ok()).unwrap_or(0);
            let pulses = run.get(key::SCANNER_PULSES);
            let pulses = pulses.map_or(Ok(PulseSource::Line), |source| source.parse());
            if let Ok(pulses) = pulses {
                runs.push(noted_ns, text.clone(), pulses);
            }
        }
        runs
    }

    /// Adds a protocol's text that was noted before it was played [ns, CLOCK_MONOTONIC], with the
    /// source of its scanner's pulses.
    pub fn push(&mut self, noted_ns: u64, text: String, pulses: PulseSource) {
        self.0.push(Run { noted_ns, protocol: identity(&text), text, pulses });
    }

    /// The program that the player was given for a run that begins with this setpoint.
    ///
    /// # Errors
    /// The protocol is not there, or is none for the rig; or it depends on how far the scanner was
    /// followed before, which is in no recording.
    pub(crate) fn program(
        &self,
        setpoint: &Setpoint,
        rig: &RigFile,
    ) -> Result<Arc<Program>, NotCompared> {
        let of_it =
            |run: &&Run| run.protocol == setpoint.protocol && run.noted_ns <= setpoint.run_ns;
        // The same protocol may be played again with pulses from elsewhere.
        let run = self.0.iter().filter(of_it).max_by_key(|run| run.noted_ns);
        let program = run.and_then(|run| {
            let protocol = Protocol::parse(&run.text, "protocol of the recording").ok()?;
            Program::new(&protocol, rig).ok()?.with_pulses(&run.pulses).ok()
        });
        let program = program.ok_or(NotCompared::ProtocolMissing)?;
        let goes_on = setpoint.run == 0 || setpoint.continued != 0;
        if goes_on && program.keeps_to_scanner() {
            return Err(NotCompared::ScannerFollowedBefore);
        }
        if setpoint.continued == 0 {
            return Ok(Arc::new(program));
        }
        let from = Continuation {
            segment: setpoint.segment,
            scan: ScanState::default(),
            sessions: SessionState::default(),
        };
        program.continuing(from).map(Arc::new).map_err(|_| NotCompared::ProtocolMissing)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
    const HOLD: &str = "[protocol]\nname = \"hold\"\n\
        [[segments]]\nkind = \"hold\"\nduration_s = 1.0\n";
    const WAIT: &str = "[protocol]\nname = \"wait\"\n\
        [[segments]]\nkind = \"wait_for_scanner\"\ntimeout_s = 5.0\n\
        [[segments]]\nkind = \"hold\"\nduration_s = 1.0\n";

    fn begins(text: &str, run_ns: u64) -> Setpoint {
        Setpoint { protocol: identity(text), run_ns, run: 1, ..Setpoint::default() }
    }

    #[test]
    fn the_newest_that_was_noted_before_is_the_one() {
        let rig = RigFile::parse(RIG, "rig.toml").unwrap();
        let mut runs = Runs::default();
        let missing = runs.program(&begins(WAIT, 100), &rig).unwrap_err();
        assert_eq!(missing, NotCompared::ProtocolMissing);
        runs.push(10, WAIT.to_owned(), PulseSource::Line);
        runs.push(50, WAIT.to_owned(), PulseSource::Key);
        runs.push(60, HOLD.to_owned(), PulseSource::Line);
        assert!(runs.program(&begins(WAIT, 49), &rig).unwrap().needs_trigger());
        assert!(runs.program(&begins(WAIT, 50), &rig).unwrap().takes_keys());
        assert_eq!(runs.program(&begins(HOLD, 100), &rig).unwrap().name(), "hold");
        assert!(runs.program(&begins(HOLD, 59), &rig).is_err());
    }

    #[test]
    fn what_depends_on_the_scanner_before_is_not_run_again() {
        let rig = RigFile::parse(RIG, "rig.toml").unwrap();
        let mut runs = Runs::default();
        runs.push(10, WAIT.to_owned(), PulseSource::Line);
        runs.push(10, HOLD.to_owned(), PulseSource::Line);
        for text in [WAIT, HOLD] {
            let resumed = Setpoint { run: 0, ..begins(text, 20) };
            let continued = Setpoint { continued: 1, ..begins(text, 20) };
            for setpoint in [resumed, continued] {
                let found = runs.program(&setpoint, &rig).err();
                let expected = (text == WAIT).then_some(NotCompared::ScannerFollowedBefore);
                assert_eq!(found, expected);
            }
        }
    }
}
