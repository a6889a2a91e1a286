//! A case: a machine, eight to ten records of it, and the truth about them.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case_plan::{Builder, CaseError, Plan, signals};
use crate::detectability::{Detectability, detect};
use crate::effects::{self, Effect, Entry, Kinds};
use crate::machine_parameters::MachineParameters;
use crate::random::{Draw, subseed};
use crate::record::{self, Noise, RECORD_TO_RECORD_S, Record};
use crate::reference::Kind;
use crate::rules::{Conditions, Missing, Rules, STUCK_SCALE, weakened};
use crate::smoothing::Smoothing;

/// The set that a case belongs to.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Set {
    /// One listed effect.
    Listed,
    /// No effect.
    Clean,
    /// One unlisted effect.
    Unlisted,
    /// Two listed effects at different sites.
    Pairs,
    /// Three of them.
    Triples,
    /// A machine with one channel and a listed effect ([`crate::one_channel`]).
    OneChannelListed,
    /// One without an effect.
    OneChannelClean,
    /// One with an unlisted effect.
    OneChannelUnlisted,
    /// One with two listed effects.
    OneChannelPairs,
}

impl Set {
    /// All sets.
    pub const ALL: [Self; 9] = [
        Self::Listed,
        Self::Clean,
        Self::Unlisted,
        Self::Pairs,
        Self::Triples,
        Self::OneChannelListed,
        Self::OneChannelClean,
        Self::OneChannelUnlisted,
        Self::OneChannelPairs,
    ];

    /// Whether its machines have one channel.
    pub fn one_channel(self) -> bool {
        matches!(
            self,
            Self::OneChannelListed
                | Self::OneChannelClean
                | Self::OneChannelUnlisted
                | Self::OneChannelPairs
        )
    }

    /// Its name in folders and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Listed => "listed",
            Self::Clean => "clean",
            Self::Unlisted => "unlisted",
            Self::Pairs => "pairs",
            Self::Triples => "triples",
            Self::OneChannelListed => "one-channel-listed",
            Self::OneChannelClean => "one-channel-clean",
            Self::OneChannelUnlisted => "one-channel-unlisted",
            Self::OneChannelPairs => "one-channel-pairs",
        }
    }
}

/// The truth about a case, except for its random numbers: `truth.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Set.
    pub set: Set,
    /// Index within the set.
    pub index: usize,
    /// Seed of the case.
    pub seed: u64,
    /// Effects; none in a clean case.
    pub effects: Vec<Effect>,
    /// Constants of the machine without the effects.
    pub machine: BTreeMap<String, f64>,
    /// How dry friction passes through zero.
    pub smoothing: Smoothing,
    /// Noise.
    pub noise: Noise,
    /// How the records were taken.
    #[serde(default)]
    pub conditions: Conditions,
    /// Steps of the integrator per row.
    pub steps_per_row: usize,
    /// Records.
    pub records: Vec<Plan>,
    /// Detectability of each effect.
    pub detectability: Vec<Detectability>,
}

impl Truth {
    /// Builds the simulators of the case.
    fn builder(&self) -> Builder {
        let mut machine = MachineParameters::declared();
        for (name, value) in &self.machine {
            if let Some(place) = machine.named_mut(name) {
                *place = *value;
            }
        }
        Builder { machine, smoothing: self.smoothing, effects: self.effects.clone() }
    }
}

/// A case with its records.
#[derive(Clone, Debug)]
pub struct Case {
    /// The truth.
    pub truth: Truth,
    /// Records, in the order of the plan.
    pub records: Vec<Record>,
}

/// What a case is drawn from, beside its set, index and seed.
#[derive(Clone, Debug, Default)]
pub struct DrawnFrom {
    /// Which of the unlisted effects.
    pub kinds: Kinds,
    /// By which rules.
    pub rules: Rules,
    /// Names of effects in place of those of the set.
    pub forced: Vec<String>,
}

/// The case of a set, an index within it and a campaign's seed.
///
/// # Errors
/// [`CaseError::Unknown`], [`CaseError::Unbuildable`].
pub fn make(
    set: Set,
    index: usize,
    campaign_seed: u64,
    from: &DrawnFrom,
) -> Result<Case, CaseError> {
    let mut case = unjudged(set, index, campaign_seed, from)?;
    let builder = case.truth.builder();
    case.truth.detectability = (0..builder.effects.len())
        .map(|index| {
            let (plans, taken) = (&case.truth.records, &case.truth.conditions);
            detect(plans, (&case.records, taken), &builder, &builder.without(index))
        })
        .collect::<Result<Vec<_>, CaseError>>()?;
    Ok(case)
}

/// As [`make`], without the detectability of the effects.
///
/// # Errors
/// [`CaseError::Unknown`], [`CaseError::Unbuildable`].
pub fn unjudged(
    set: Set,
    index: usize,
    campaign_seed: u64,
    from: &DrawnFrom,
) -> Result<Case, CaseError> {
    let truth = drawn(set, index, campaign_seed, from)?;
    let builder = truth.builder();
    let records = truth
        .records
        .par_iter()
        .enumerate()
        .map(|(number, plan)| {
            let (wanted, torque) = signals(plan);
            let seed = subseed(truth.seed, &format!("noise {number}"));
            let mut model = builder.model(None)?;
            Ok(record::run(&mut model, &wanted, &torque, plan.start_s, &truth.noise, seed))
        })
        .collect::<Result<Vec<_>, CaseError>>()?;
    Ok(Case { truth, records })
}

/// Draws a case from its seed, without its records and the detectability of the effects.
///
/// # Errors
/// [`CaseError::Unknown`], [`CaseError::Unbuildable`].
pub fn drawn(
    set: Set,
    index: usize,
    campaign_seed: u64,
    from: &DrawnFrom,
) -> Result<Truth, CaseError> {
    let seed = subseed(campaign_seed, &format!("{} {index}", set.name()));
    let mut draw = Draw::new(subseed(seed, "machine"));
    let harder = from.rules == Rules::Harder;
    let machine = if harder {
        MachineParameters::drawn_to_the_edge(&mut draw)
    } else {
        MachineParameters::drawn(&mut draw)
    };
    let smoothing = match set {
        _ if harder => Smoothing::foreign(&mut draw),
        Set::Clean if index % 2 == 1 => Smoothing::foreign(&mut draw),
        Set::Clean => Smoothing::plain(&mut draw),
        _ => Smoothing::common(&mut draw),
    };
    let noise = Noise::drawn(&mut draw);
    let mut draw = Draw::new(subseed(seed, "effects"));
    let effects: Vec<Effect> = choose(set, index, from, &mut draw)?
        .into_iter()
        .map(|entry| weakened(entry.draw(&mut draw), from.rules, &mut draw))
        .collect();
    let conditions = Conditions::drawn(from.rules, &mut Draw::new(subseed(seed, "conditions")));
    let mut truth = Truth {
        set,
        index,
        seed,
        effects,
        machine: machine.named(),
        smoothing,
        noise,
        records: plan(seed, &conditions),
        conditions,
        steps_per_row: 0,
        detectability: Vec::new(),
    };
    truth.steps_per_row = truth.builder().model(None)?.steps();
    Ok(truth)
}

fn choose(
    set: Set,
    index: usize,
    from: &DrawnFrom,
    draw: &mut Draw,
) -> Result<Vec<&'static Entry>, CaseError> {
    if !from.forced.is_empty() {
        return from
            .forced
            .iter()
            .map(|name| effects::find(name).ok_or_else(|| CaseError::Unknown(name.clone())))
            .collect();
    }
    let listed = effects::listed();
    Ok(match set {
        Set::Clean => Vec::new(),
        Set::Listed => vec![listed[index % listed.len()]],
        Set::Unlisted => {
            let unlisted = effects::unlisted(from.kinds);
            vec![unlisted[index % unlisted.len()]]
        }
        Set::Pairs | Set::Triples => {
            let mut chosen = vec![listed[draw.below(listed.len())]];
            for _ in 1..if set == Set::Pairs { 2 } else { 3 } {
                let others = effects::beside(&chosen);
                chosen.push(others[draw.below(others.len())]);
            }
            chosen
        }
        // Made by `one_channel::case`.
        Set::OneChannelListed
        | Set::OneChannelClean
        | Set::OneChannelUnlisted
        | Set::OneChannelPairs => Vec::new(),
    })
}

/// Eight to ten records: a repeated multisine, a repeated one with a hand and another with a hand,
/// and each other kind. Without a torque cell nobody is at the handle.
fn plan(seed: u64, taken: &Conditions) -> Vec<Plan> {
    let free = taken.missing == Some(Missing::SlaveTorque);
    let mut draw = Draw::new(subseed(seed, "plan"));
    let kinds = [
        (Kind::Multisine, "a", None),
        (Kind::Triangles, "b", None),
        (Kind::Multisine, "f", Some("hand a")),
        (Kind::Chirp, "c", None),
        (Kind::Multisine, "a", None),
        (Kind::Steps, "d", None),
        (Kind::Multisine, "f", Some("hand a")),
        (Kind::Sines, "e", None),
        (Kind::Triangles, "g", Some("hand b")),
        (Kind::Multisine, "h", None),
    ];
    let count = 8 + draw.below(3);
    kinds[..count]
        .iter()
        .enumerate()
        .map(|(number, (kind, reference, hand))| Plan {
            file: format!("record-{:02}.csv", number + 1),
            kind: *kind,
            reference_seed: subseed(seed, reference),
            hand_seed: hand.filter(|_| !free).map(|hand| subseed(seed, hand)),
            start_s: number as f64 * RECORD_TO_RECORD_S,
            scale: if taken.stuck == Some(number) { STUCK_SCALE } else { 1.0 },
        })
        .collect()
}

impl Case {
    /// Writes records and truth into a folder.
    ///
    /// # Errors
    /// [`CaseError::Write`].
    pub fn write(&self, folder: &Path) -> Result<(), CaseError> {
        self.write_records(folder)?;
        let path = folder.join("truth.json");
        serde_json::to_string_pretty(&self.truth)
            .map_err(io::Error::from)
            .and_then(|text| fs::write(&path, text))
            .map_err(|source| CaseError::Write { path, source })
    }

    /// Writes the records only, without the truth; returns their files.
    ///
    /// # Errors
    /// [`CaseError::Write`].
    pub fn write_records(&self, folder: &Path) -> Result<Vec<PathBuf>, CaseError> {
        let write = |path: &Path, record: &Record, seed: u64| {
            let mut file = BufWriter::new(File::create(path)?);
            record.write(&mut file, &self.truth.conditions, seed)?;
            file.flush()
        };
        fs::create_dir_all(folder)
            .map_err(|source| CaseError::Write { path: folder.to_owned(), source })?;
        let named = self.truth.records.iter().zip(&self.records);
        named
            .map(|(plan, record)| {
                let path = folder.join(&plan.file);
                match write(&path, record, subseed(self.truth.seed, &plan.file)) {
                    Ok(()) => Ok(path),
                    Err(source) => Err(CaseError::Write { path, source }),
                }
            })
            .collect()
    }
}
