//! Every record that others measured, of `../shared/data` beside the project, against one table of
//! what is right and what is plainly wrong for it. The records are no part of the project: where
//! they are absent, this is said and the test does nothing.
//!
//! The evidence for each row stands in `../shared/data/measured/README.md` and, in a phrase, in
//! `docs/identify-measured.md`, whose expectations are those of this table.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use identify::error::IdentifyError;
use identify::outcome::{Outcome, Verdict};
use identify::study::{StudyOptions, read, study};
use rayon::prelude::*;

/// How an answer can be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// A name that is neither expected nor allowed, alone or beside the right one.
    WrongName,
    /// "Nothing is missing", or nothing more, although something is.
    FalseNothing,
    /// Something without a name is said to be missing although nothing is.
    FalseAlarm,
    /// No answer.
    Refused,
}

/// An answer, judged.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Judged {
    /// What is expected is named, or nothing is where nothing is missing.
    Right,
    /// The right answer is not given, and no wrong one: unlisted, inadequate, or ambiguous with
    /// the right one among the rivals.
    Honest(&'static str),
    /// What is wrong, and in which words.
    Wrong(Fault, String),
}

/// One set and what is right for it.
#[derive(Clone, Copy)]
struct Set {
    name: &'static str,
    /// Answers, each of them right: the effects that must be named, in this order.
    right: &'static [&'static [&'static str]],
    /// Effects that may follow these, or stand beside a residual without a name.
    may_follow: &'static [&'static str],
    /// What a residual without a name depends on, where such an answer is the right one.
    unlisted: &'static [&'static str],
    /// What is plainly wrong, with the reason. Any other name that is not expected is wrong, too.
    wrong: &'static [(&'static str, &'static str)],
    /// The first rows of each record that take part.
    rows: usize,
}

impl Set {
    /// A set of which nothing is expected: the rows of the table say what differs.
    const ANY: Self =
        Self { name: "", right: &[], may_follow: &[], unlisted: &[], wrong: &[], rows: usize::MAX };
}

/// A spring that a drive has no name for; with dry friction it differs by direction.
const POSITION: &[&str] = &["position", "position_by_direction"];
/// Nothing is missing.
const NOTHING: &[&str] = &[];
/// No limit of the amplifier was reached: the source gives 1.1 N·m.
const NO_LIMIT: &[(&str, &str)] =
    &[("amplifier_saturation", "nothing clips: the source's limit is 1.1 N·m")];

const TABLE: &[Set] = &[
    Set {
        name: "tue-slave-free",
        right: &[&["coulomb_friction"]],
        // The motor's torque is a command, and 3 ms pass until it shows in the motion.
        may_follow: &["transport_delay"],
        wrong: NO_LIMIT,
        ..Set::ANY
    },
    Set {
        name: "tue-slave-spring",
        may_follow: &["coulomb_friction"],
        unlisted: POSITION,
        wrong: NO_LIMIT,
        ..Set::ANY
    },
    Set {
        name: "tue-slave-oscillator",
        right: &[&["coulomb_friction"]],
        wrong: NO_LIMIT,
        ..Set::ANY
    },
    Set {
        name: "tue-spring-alone",
        // The mass of tip and spring.
        right: &[NOTHING, &["extra_inertia"]],
        ..Set::ANY
    },
    Set { name: "tue-master-spring", right: &[&["coulomb_friction"]], wrong: NO_LIMIT, ..Set::ANY },
    Set {
        name: "tue-slave-foam",
        may_follow: &["coulomb_friction"],
        unlisted: POSITION,
        wrong: NO_LIMIT,
        ..Set::ANY
    },
    Set {
        name: "bam-xl330",
        right: &[&["gravity_imbalance"]],
        may_follow: &["coulomb_friction", "load_dependent_friction", "stribeck_friction"],
        ..Set::ANY
    },
    Set {
        name: "pendulum-free",
        right: &[NOTHING],
        wrong: &[("coulomb_friction", "of the 1 to 3 % that are left it takes 3 %")],
        ..Set::ANY
    },
    Set {
        name: "odrive-cogging",
        right: &[&["torque_ripple"]],
        // Further orders of the same effect.
        may_follow: &["torque_ripple"],
        wrong: &[("amplifier_saturation", "the current follows a wave of the angle throughout")],
        ..Set::ANY
    },
    Set { name: "kuka-joint6", right: &[&["coulomb_friction"]], ..Set::ANY },
    Set {
        name: "damper-36lb",
        right: &[&["presliding_hysteresis"], &["backlash"]],
        // The machine's moving beam.
        may_follow: &["extra_inertia"],
        wrong: &[
            ("coulomb_friction", "the force builds up over some 5 mm after a reversal"),
            ("nonlinear_stiffness", "a curved spring does not help"),
        ],
        ..Set::ANY
    },
    Set {
        name: "double-pendulum-a",
        right: &[&["gravity_imbalance"]],
        may_follow: &["coulomb_friction"],
        ..Set::ANY
    },
    Set { name: "emps", right: &[&["coulomb_friction", "asymmetric_friction"]], ..Set::ANY },
    Set {
        name: "silverbox",
        right: &[&["nonlinear_stiffness"]],
        // Small and seen in the simulated output, of a circuit that nobody took apart.
        may_follow: &["quadratic_drag"],
        // A longer part, with the right sizes, stands in `oscillator.rs`: the whole record would
        // take three quarters of the time of all.
        rows: 8_000,
        ..Set::ANY
    },
];

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn data() -> PathBuf {
    project().join("../shared/data")
}

/// The rig file of a set and its records, in the order of their names; `None` where it is absent.
fn files(name: &str) -> Option<(PathBuf, Vec<PathBuf>)> {
    let (rig, records) = match name {
        "emps" => ("launch/rigs/emps.toml", vec![data().join("emps_train.csv")]),
        "silverbox" => ("launch/rigs/silverbox.toml", vec![data().join("silverbox_multisine.csv")]),
        _ => {
            let folder = data().join("measured").join(name);
            let entries = std::fs::read_dir(&folder).ok()?;
            let paths = entries.map(|entry| entry.unwrap().path());
            let mut records: Vec<PathBuf> =
                paths.filter(|path| path.extension().is_some_and(|e| e == "csv")).collect();
            records.sort();
            return Some((folder.join("rig.toml"), records));
        }
    };
    records.iter().all(|path| path.exists()).then(|| (project().join(rig), records))
}

/// As the command line does it, on one thread.
fn identify(rig: &Path, records: &[PathBuf], rows: usize) -> Result<Outcome, IdentifyError> {
    let rig = rig::RigFile::load(rig).unwrap();
    let mut records: Vec<_> = records.iter().map(|path| read(path, &rig).unwrap()).collect();
    for (_, values) in records.iter_mut().flat_map(|record| &mut record.columns) {
        values.truncate(rows);
    }
    let options = StudyOptions { jobs: 1, ..StudyOptions::default() };
    Ok(study(&rig, &records, options)?.outcome)
}

/// The effects named, then what remains over a variable.
fn said(outcome: &Outcome) -> String {
    let mut text = format!("{:?}", outcome.verdict).to_lowercase();
    for effect in &outcome.effects {
        write!(text, " {}", effect.id).unwrap();
    }
    for rival in &outcome.ambiguous_with {
        write!(text, " (or {})", rival.id).unwrap();
    }
    if let Some(unlisted) = &outcome.unlisted {
        write!(text, ", and something over {}", unlisted.depends_on).unwrap();
    }
    let error = outcome.error.values().next().unwrap();
    write!(text, "; error {:.2} -> {:.2} %", error.before_percent, error.after_percent).unwrap();
    text
}

/// Whether the names begin with one of the right answers, and only allowed ones follow.
fn names_are_right(set: &Set, names: &[&str]) -> bool {
    let follow = |rest: &[&str]| rest.iter().all(|name| set.may_follow.contains(name));
    set.right.iter().any(|right| {
        // Where nothing is missing, no name may stand beside it.
        names
            .strip_prefix(*right)
            .is_some_and(|rest| follow(rest) && (!right.is_empty() || rest.is_empty()))
    })
}

fn judge(set: &Set, outcome: &Outcome) -> Judged {
    let names: Vec<&str> = outcome.effects.iter().map(|effect| effect.id.as_str()).collect();
    let over = outcome.unlisted.as_ref().and_then(|unlisted| unlisted.variable());
    let nothing_is_right = set.right.contains(&NOTHING);
    let allowed = |name: &&str| {
        set.may_follow.contains(name) || set.right.iter().any(|right| right.contains(name))
    };
    // With each rival of the last effect in its place.
    let mut answers = vec![names.clone()];
    for rival in &outcome.ambiguous_with {
        let mut other = names.clone();
        other.pop();
        other.push(&rival.id);
        answers.push(other);
    }
    let ambiguous = outcome.verdict == Verdict::Ambiguous;
    if ambiguous && answers.iter().any(|names| names_are_right(set, names)) {
        return Judged::Honest("ambiguous");
    }
    if let Some(name) = names.iter().find(|name| !allowed(name)) {
        let why = set.wrong.iter().find(|(wrong, _)| wrong == name);
        let why = why.map_or(String::new(), |(_, why)| format!(" ({why})"));
        return Judged::Wrong(Fault::WrongName, format!("{name}{why}"));
    }
    let without_a_name = outcome.remains || is_inadequate(outcome);
    if without_a_name && over.is_some_and(|variable| set.unlisted.contains(&variable)) {
        return Judged::Right;
    }
    match (names.is_empty(), without_a_name) {
        (true, false) if nothing_is_right => Judged::Right,
        (true, false) => Judged::Wrong(Fault::FalseNothing, "nothing is missing".into()),
        (true, true) if nothing_is_right => {
            Judged::Wrong(Fault::FalseAlarm, "something without a name".into())
        }
        (false, _) if names_are_right(set, &names) => Judged::Right,
        (_, true) => Judged::Honest("unlisted or inadequate"),
        (false, false) => {
            Judged::Wrong(Fault::FalseNothing, format!("nothing beside {}", names.join(", ")))
        }
    }
}

/// Whether the verdict is that something is missing which no name describes.
fn is_inadequate(outcome: &Outcome) -> bool {
    let verdict = serde_json::to_value(outcome.verdict).unwrap();
    verdict == "inadequate" || verdict == "unlisted"
}

/// One line of the test's output, and a complaint where the set is not as the table says.
fn walk(set: &Set) -> (Option<Judged>, String, Option<String>) {
    let Some((rig, records)) = files(set.name) else {
        let text = format!(
            "SKIPPED: {} is not in {}; it took no part in this test",
            set.name,
            data().display()
        );
        return (None, text, None);
    };
    let (judged, said) = match identify(&rig, &records, set.rows) {
        Ok(outcome) => (judge(set, &outcome), said(&outcome)),
        Err(error) => (Judged::Wrong(Fault::Refused, error.to_string()), error.to_string()),
    };
    let line = format!("{}: {judged:?}: {said}", set.name);
    let complaint = matches!(judged, Judged::Wrong(..)).then(|| line.clone());
    (Some(judged), line, complaint)
}

#[test]
fn no_measured_set_gets_a_wrong_answer() {
    let mut complaints = Vec::new();
    let mut judged = Vec::new();
    let walked: Vec<_> = TABLE.par_iter().map(walk).collect();
    for (answer, line, complaint) in walked {
        eprintln!("{line}");
        judged.extend(answer);
        complaints.extend(complaint);
    }
    let count = |of: fn(&Judged) -> bool| judged.iter().filter(|judged| of(judged)).count();
    eprintln!(
        "{} sets: {} right, {} honest, {} wrong",
        judged.len(),
        count(|judged| *judged == Judged::Right),
        count(|judged| matches!(judged, Judged::Honest(_))),
        count(|judged| matches!(judged, Judged::Wrong(..)))
    );
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
}

#[test]
fn every_set_that_is_there_is_in_the_table() {
    let Ok(folders) = std::fs::read_dir(data().join("measured")) else {
        eprintln!("SKIPPED: {} is not there", data().join("measured").display());
        return;
    };
    let folders = folders.map(|entry| entry.unwrap().path());
    let there: BTreeSet<String> = folders
        .filter(|folder| folder.join("rig.toml").exists())
        .map(|folder| folder.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let listed: BTreeSet<String> = TABLE.iter().map(|set| set.name.to_owned()).collect();
    let missing: Vec<&String> = there.difference(&listed).collect();
    assert!(missing.is_empty(), "no row for {missing:?}: what is right for them?");
}

#[test]
fn the_table_names_effects_that_exist() {
    for set in TABLE {
        let wrong = set.wrong.iter().map(|(name, _)| name);
        for id in set.right.iter().copied().flatten().chain(set.may_follow).chain(wrong) {
            assert!(identify::effects::find(id).is_some(), "{}: {id}", set.name);
        }
        assert!(!set.right.is_empty() || !set.unlisted.is_empty(), "{}: nothing right", set.name);
    }
}
