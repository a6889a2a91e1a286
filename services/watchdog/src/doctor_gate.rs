//! A real card is armed only by a doctor's report: the command thread looks for the newest one
//! before it hands the verb `arm` to the loop. Whoever sends the verb, command line, console or
//! another program, comes through here.
//!
//! A thread of its own reads the report, since a disk may take seconds: the command thread, which
//! also serves `estop`, waits for it for half a second.

use std::path::Path;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

use ipc_types::{CardKind, Verb};
use runtime::machine_report::{MachineReport, objection, unix_ms};
use runtime::{RigName, machine_report};

/// Longest time that a verb waits for the report to be read.
const READ_LIMIT: Duration = Duration::from_millis(500);

/// Asks the thread that reads the reports of one rig. Each question brings the channel for its own
/// answer, what speaks against arming: one that comes late finds it closed.
#[derive(Debug)]
pub(crate) struct DoctorGate {
    questions: SyncSender<SyncSender<Option<String>>>,
}

/// What the gate decides about a verb.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Passage {
    /// The verb goes to the loop.
    Free,
    /// It goes to the loop; once it is done, the event tells this.
    Overridden(String),
    /// It is refused for this reason.
    Refused(String),
}

impl DoctorGate {
    /// A gate that reads the reports in `folder`; without one, no report is ever found. Starts the
    /// thread, which ends with the gate.
    ///
    /// # Errors
    /// The thread could not be started.
    pub(crate) fn new(folder: Option<&Path>, rig_name: RigName) -> std::io::Result<Self> {
        let folder = folder.map(Path::to_owned);
        Self::with_reader(move || objection_in(folder.as_deref(), &rig_name))
    }

    fn with_reader(reader: impl Fn() -> Option<String> + Send + 'static) -> std::io::Result<Self> {
        let (questions, asked) = sync_channel::<SyncSender<_>>(1);
        runtime::realtime::beside_loop("doctor-report").spawn(move || {
            while let Ok(answer) = asked.recv() {
                // Fails where nobody waits any more.
                let _ = answer.send(reader());
            }
        })?;
        Ok(Self { questions })
    }

    /// Decides about a verb, for the card that the newest sample names. Waits for a file where it
    /// is one that arms a real card, so it is not for the loop.
    pub(crate) fn passage(&self, verb: Verb, card: Option<CardKind>) -> Passage {
        let real = card.is_some_and(|card| card.capabilities().real);
        match verb {
            Verb::Arm | Verb::ArmUnchecked => {
                decide(verb, real, if real { self.objection() } else { None })
            }
            Verb::Reset | Verb::Enable | Verb::Disarm | Verb::Estop => Passage::Free,
        }
    }

    fn objection(&self) -> Option<String> {
        let (answer, objection) = sync_channel(1);
        let asked = self.questions.try_send(answer).is_ok();
        let found = asked.then(|| objection.recv_timeout(READ_LIMIT).ok()).flatten();
        found.unwrap_or_else(|| {
            Some(format!(
                "the doctor's report could not be read within {READ_LIMIT:?}: is the disk busy?"
            ))
        })
    }
}

fn objection_in(folder: Option<&Path>, rig_name: &RigName) -> Option<String> {
    let Some(folder) = folder else {
        return objection(None, "", 0);
    };
    match MachineReport::newest(folder, rig_name) {
        Ok(report) => objection(report.as_ref(), &machine_report::boot_id(), unix_ms()),
        Err(error) => Some(format!("the doctor's report cannot be read: {error}")),
    }
}

/// Whether a rig whose card is `real` or not is armed although `objection` speaks against it.
/// Without a sample the card is not known; the loop then refuses, since acquisition is lost.
fn decide(verb: Verb, real: bool, objection: Option<String>) -> Passage {
    match (verb, objection) {
        (Verb::ArmUnchecked, Some(objection)) if real => Passage::Overridden(objection),
        (Verb::ArmUnchecked, _) => Passage::Overridden("nothing spoke against it".to_owned()),
        (_, Some(objection)) if real => Passage::Refused(format!(
            "{objection}; run `farreach doctor` on this computer as the user of the rig, mend what \
             it finds, or take the risk with `farreach arm --unchecked`, which is recorded"
        )),
        _ => Passage::Free,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use runtime::machine_report::LAYOUT;
    use runtime::{CheckResult, Verdict};

    use super::*;

    const NONE: &str = "there is no doctor's report";

    #[test]
    fn sr_14_a_real_card_without_a_sound_report_arms_by_a_recorded_override_only() {
        let ill = || Some(NONE.to_owned());
        let Passage::Refused(why) = decide(Verb::Arm, true, ill()) else {
            panic!("armed without a report");
        };
        assert!(why.contains(NONE) && why.contains("farreach doctor"), "{why}");
        assert!(why.contains("arm --unchecked"), "{why}");
        let overridden = decide(Verb::ArmUnchecked, true, ill());
        assert_eq!(overridden, Passage::Overridden(NONE.to_owned()));
        assert_eq!(decide(Verb::Arm, true, None), Passage::Free);
    }

    #[test]
    fn sr_14_a_simulated_card_needs_no_report_and_no_other_verb_does() {
        let gate = DoctorGate::new(None, "bench".parse().unwrap()).unwrap();
        for card in [Some(CardKind::Simulated), Some(CardKind::Replay), None] {
            assert_eq!(gate.passage(Verb::Arm, card), Passage::Free);
        }
        assert_eq!(decide(Verb::Arm, false, Some(NONE.to_owned())), Passage::Free);
        for verb in [Verb::Reset, Verb::Enable, Verb::Disarm, Verb::Estop] {
            assert_eq!(gate.passage(verb, Some(CardKind::Hardware)), Passage::Free, "{verb}");
        }
        // The override is recorded on a simulated card, too.
        let told = gate.passage(Verb::ArmUnchecked, Some(CardKind::Simulated));
        assert_eq!(told, Passage::Overridden("nothing spoke against it".to_owned()));
    }

    #[test]
    fn sr_14_the_newest_report_of_this_rig_decides() {
        let folder = tempfile::tempdir().unwrap();
        let name: RigName = "bench".parse().unwrap();
        let gate = DoctorGate::new(Some(folder.path()), name.clone()).unwrap();
        let arm = || gate.passage(Verb::Arm, Some(CardKind::Hardware));
        assert!(matches!(arm(), Passage::Refused(why) if why.contains(NONE)));
        let mut report = MachineReport {
            layout: LAYOUT,
            taken_unix_ms: unix_ms(),
            host: String::new(),
            boot_id: machine_report::boot_id(),
            user: 0,
            version: String::new(),
            revision: String::new(),
            rig_name: "bench".to_owned(),
            rig: None,
            checks: Vec::new(),
        };
        report.keep(folder.path(), &name).unwrap();
        assert_eq!(arm(), Passage::Free);
        let other = DoctorGate::new(Some(folder.path()), "other".parse().unwrap()).unwrap();
        assert!(matches!(other.passage(Verb::Arm, Some(CardKind::Hardware)), Passage::Refused(_)));
        report.checks.push(CheckResult {
            id: "stalls".to_owned(),
            title: String::new(),
            verdict: Verdict::Fail,
            value: String::new(),
            remedy: String::new(),
            measured: Default::default(),
        });
        let path = report.keep(folder.path(), &name).unwrap();
        assert!(matches!(arm(), Passage::Refused(why) if why.contains("failures: stalls")));
        std::fs::write(path, "{").unwrap();
        assert!(matches!(arm(), Passage::Refused(why) if why.contains("cannot be read")));
    }

    #[test]
    fn sr_14_a_disk_that_hangs_refuses_arm_and_holds_up_nothing_else() {
        let (go_on, waits) = sync_channel::<()>(1);
        let gate = DoctorGate::with_reader(move || {
            let _ended = waits.recv();
            None
        })
        .unwrap();
        let arm = || gate.passage(Verb::Arm, Some(CardKind::Hardware));
        let slow =
            |said| matches!(said, Passage::Refused(why) if why.contains("could not be read"));
        assert!(slow(arm()));
        assert_eq!(gate.passage(Verb::Estop, Some(CardKind::Hardware)), Passage::Free);
        // One question is being read, one waits; a third is refused at once.
        assert!(slow(arm()) && slow(arm()));
        drop(go_on);
        // Its answers to the earlier questions are not taken for those to a later one.
        let until = Instant::now() + Duration::from_secs(60);
        while arm() != Passage::Free {
            assert!(Instant::now() < until, "the reader did not go on");
        }
    }
}
