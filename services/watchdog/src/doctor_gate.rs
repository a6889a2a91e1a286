//! A real card is armed only by a doctor's report: the command thread looks for the newest one
//! before it hands the verb `arm` to the loop. Whoever sends the verb, command line, console or
//! another program, comes through here.

use std::path::{Path, PathBuf};

use ipc_types::{CardKind, Verb};
use runtime::machine_report::{MachineReport, objection, unix_ms};
use runtime::{RigName, machine_report};

/// Where the reports are, and of which rig.
#[derive(Clone, Debug)]
pub(crate) struct DoctorGate {
    folder: Option<PathBuf>,
    rig_name: RigName,
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
    /// A gate that reads the reports in `folder`; without one, no report is ever found.
    pub(crate) fn new(folder: Option<&Path>, rig_name: RigName) -> Self {
        Self { folder: folder.map(Path::to_owned), rig_name }
    }

    /// Decides about a verb, for the card that the newest sample names. Reads a file where it is
    /// one that arms, so it is not for the loop.
    pub(crate) fn passage(&self, verb: Verb, card: Option<CardKind>) -> Passage {
        match verb {
            Verb::Arm | Verb::ArmUnchecked => decide(verb, card, self.objection()),
            Verb::Reset | Verb::Enable | Verb::Disarm | Verb::Estop => Passage::Free,
        }
    }

    fn objection(&self) -> Option<String> {
        let Some(folder) = &self.folder else {
            return objection(None, "", 0);
        };
        match MachineReport::newest(folder, &self.rig_name) {
            Ok(report) => objection(report.as_ref(), &machine_report::boot_id(), unix_ms()),
            Err(error) => Some(format!("the doctor's report cannot be read: {error}")),
        }
    }
}

/// Whether a rig with this card is armed although `objection` speaks against it. Without a sample
/// the card is not known; the loop then refuses, since acquisition is lost.
fn decide(verb: Verb, card: Option<CardKind>, objection: Option<String>) -> Passage {
    let real = card.is_some_and(|card| card.capabilities().real);
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
    use runtime::machine_report::LAYOUT;
    use runtime::{CheckResult, Verdict};

    use super::*;

    const NONE: &str = "there is no doctor's report";

    #[test]
    fn sr_14_a_real_card_without_a_sound_report_arms_by_a_recorded_override_only() {
        let ill = || Some(NONE.to_owned());
        let Passage::Refused(why) = decide(Verb::Arm, Some(CardKind::Hardware), ill()) else {
            panic!("armed without a report");
        };
        assert!(why.contains(NONE) && why.contains("farreach doctor"), "{why}");
        assert!(why.contains("arm --unchecked"), "{why}");
        let overridden = decide(Verb::ArmUnchecked, Some(CardKind::Hardware), ill());
        assert_eq!(overridden, Passage::Overridden(NONE.to_owned()));
        assert_eq!(decide(Verb::Arm, Some(CardKind::Hardware), None), Passage::Free);
    }

    #[test]
    fn sr_14_a_simulated_card_needs_no_report_and_no_other_verb_does() {
        for card in [Some(CardKind::Simulated), Some(CardKind::Replay), None] {
            assert_eq!(decide(Verb::Arm, card, Some(NONE.to_owned())), Passage::Free);
        }
        let gate = DoctorGate::new(None, "bench".parse().unwrap());
        for verb in [Verb::Reset, Verb::Enable, Verb::Disarm, Verb::Estop] {
            assert_eq!(gate.passage(verb, Some(CardKind::Hardware)), Passage::Free, "{verb}");
        }
        // The override is recorded on a simulated card, too.
        let told = decide(Verb::ArmUnchecked, Some(CardKind::Simulated), Some(NONE.to_owned()));
        assert_eq!(told, Passage::Overridden("nothing spoke against it".to_owned()));
    }

    #[test]
    fn sr_14_the_newest_report_of_this_rig_decides() {
        let folder = tempfile::tempdir().unwrap();
        let name: RigName = "bench".parse().unwrap();
        let gate = DoctorGate::new(Some(folder.path()), name.clone());
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
        let other = DoctorGate::new(Some(folder.path()), "other".parse().unwrap());
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
}
