//! Runs the checks, one after the other, and makes the report.

use std::sync::atomic::Ordering;

use runtime::machine_report::{self, LAYOUT, MachineReport};
use runtime::{CheckResult, RigName, Verdict};

use crate::bench::Bench;
use crate::checks::{CHECKS, Check, Needs};
use crate::live::RunningRig;
use crate::outcome::Outcome;

/// Why a check cannot be made now; `None` where it can.
fn obstacle(bench: &Bench<'_>, needs: Needs) -> Option<Outcome> {
    let Some(rig) = &bench.rig else {
        let needed = matches!(needs, Needs::Rig | Needs::Movement);
        return needed.then(|| {
            let remedy = "bring it up (farreach up), then `farreach doctor` again";
            Outcome::skipped(bench.no_rig.clone(), remedy)
        });
    };
    let in_use = || {
        let why = rig.in_use()?;
        Some(Outcome::skipped(why, "farreach stop, farreach disarm, then look again"))
    };
    match needs {
        Needs::Nothing | Needs::Rig => None,
        Needs::Rest => in_use(),
        Needs::Movement if !bench.options.may_move => Some(Outcome::skipped(
            "powers the motor, which nobody has agreed to",
            "farreach doctor --move",
        )),
        Needs::Movement => in_use(),
    }
}

fn outcome_of(bench: &mut Bench<'_>, check: &Check) -> Outcome {
    if let Some(skipped) = obstacle(bench, check.needs) {
        return skipped;
    }
    if bench.stop.load(Ordering::Relaxed) {
        return Outcome::skipped("stopped", "look again");
    }
    (check.examine)(bench).unwrap_or_else(|error| {
        Outcome::new(Verdict::Fail, format!("could not be examined: {error:#}"))
    })
}

/// Makes all checks. `progress` is told each before it is made, and its result.
pub(crate) fn examine(
    bench: &mut Bench<'_>,
    rig_name: &RigName,
    revision: &str,
    progress: &mut dyn FnMut(Told<'_>),
) -> MachineReport {
    let mut report = MachineReport {
        layout: LAYOUT,
        taken_unix_ms: machine_report::unix_ms(),
        host: rustix::system::uname().nodename().to_string_lossy().into_owned(),
        boot_id: machine_report::boot_id(),
        user: rustix::process::geteuid().as_raw(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        revision: revision.to_owned(),
        rig_name: rig_name.to_string(),
        rig: bench.rig.as_ref().map(RunningRig::examined),
        checks: Vec::new(),
    };
    progress(Told::Headline(&report));
    for check in CHECKS {
        if check.needs == Needs::Movement && bench.options.may_move {
            // A real card is armed for them by what was found so far.
            progress(Told::SoFar(&report));
        }
        progress(Told::Begins(check));
        let result = result(check, outcome_of(bench, check));
        progress(Told::Done(&result));
        report.checks.push(result);
    }
    report
}

/// What the caller is told while the checks are made.
pub(crate) enum Told<'a> {
    /// Which machine and rig; no check was made yet.
    Headline(&'a MachineReport),
    /// This one is made now.
    Begins(&'a Check),
    /// This was found.
    Done(&'a CheckResult),
    /// All that was found before the motor gets power.
    SoFar(&'a MachineReport),
}

fn result(check: &Check, outcome: Outcome) -> CheckResult {
    let Outcome { verdict, value, remedy, measured } = outcome;
    let remedy = match verdict {
        Verdict::Pass => String::new(),
        _ => remedy.unwrap_or_else(|| check.remedy.to_owned()),
    };
    CheckResult {
        id: check.id.to_owned(),
        title: check.title.to_owned(),
        verdict,
        value,
        remedy,
        measured,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use anyhow::anyhow;

    use super::*;
    use crate::bench::Options;

    fn options() -> Options {
        Options { folder: ".".into(), trigger_s: None, may_move: true }
    }

    #[test]
    fn without_a_rig_its_checks_are_skipped_and_say_what_to_do() {
        let (options, stop) = (options(), AtomicBool::new(false));
        let mut bench = Bench::new(&options, &stop, Err("rig bench is not up".to_owned()));
        for check in CHECKS.iter().filter(|it| matches!(it.needs, Needs::Rig | Needs::Movement)) {
            let found = result(check, outcome_of(&mut bench, check));
            assert_eq!(found.verdict, Verdict::Skipped, "{}", check.id);
            assert_eq!(found.value, "rig bench is not up", "{}", check.id);
            assert!(found.remedy.contains("farreach up"), "{}", check.id);
        }
    }

    #[test]
    fn what_cannot_be_examined_has_failed_and_what_passed_has_no_remedy() {
        let (options, stop) = (options(), AtomicBool::new(false));
        let mut bench = Bench::new(&options, &stop, Err(String::new()));
        let check = Check { examine: |_| Err(anyhow!("no such thing")), ..CHECKS[0] };
        let found = result(&check, outcome_of(&mut bench, &check));
        assert_eq!(found.verdict, Verdict::Fail);
        assert_eq!(found.value, "could not be examined: no such thing");
        assert_eq!(found.remedy, check.remedy);
        let passed = result(&check, Outcome::new(Verdict::Pass, "1").remedy("mend it"));
        assert_eq!(passed.remedy, "");
        stop.store(true, Ordering::Relaxed);
        assert_eq!(outcome_of(&mut bench, &check).verdict, Verdict::Skipped);
    }
}
