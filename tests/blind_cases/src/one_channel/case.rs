//! Cases of machines with one channel: a machine, its rig file, its records, and the truth.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Kind;
use super::catalogue::{find, of_kind};
use super::effect::{Entry, Law, Setting};
use super::instruments::{Noise, Record};
use super::machine::{Declared, Demands, Machine};
use super::movement::{Movement, Shape};
use super::simulator::{Surroundings, Track, run, steps};
use super::visibility::{Judged, Visibility, error};
use crate::case::Set;
use crate::case_plan::CaseError;
use crate::effects::{Effect, Values};
use crate::random::{Draw, subseed};

/// Machines that are drawn for a case before an effect that cannot be seen is kept.
const ATTEMPTS: usize = 8;
/// Rounds in which a size is brought to its share of the force.
const ROUNDS: usize = 7;
/// Most rows of a case.
const MOST_ROWS: f64 = 60_000.0;

/// The truth about a case: `truth.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Set.
    pub set: Set,
    /// Index within the set.
    pub index: usize,
    /// Seed of the case.
    pub seed: u64,
    /// The machine.
    pub machine: Machine,
    /// Its constants as declared.
    pub declared: Vec<Declared>,
    /// Effects; none in a clean case.
    pub effects: Vec<Effect>,
    /// How well each can be seen.
    pub visibility: Vec<Visibility>,
    /// Kind and size of the noise of the force channel.
    pub noise: (Noise, f64),
    /// Steps of the simulator a row.
    pub steps_per_row: usize,
    /// Length and kind of the records, s; no kind where several are joined.
    pub records: Vec<(f64, Option<Shape>)>,
}

/// A case.
#[derive(Clone, Debug)]
pub struct Case {
    /// The truth.
    pub truth: Truth,
    /// The rig file.
    pub rig: String,
    /// The records.
    pub records: Vec<Record>,
}

/// A machine with its movements and surroundings.
struct Bench {
    seed: u64,
    machine: Machine,
    declared: Vec<Declared>,
    movements: Vec<(f64, Option<Shape>, Movement)>,
    around: Surroundings,
    noise: (Noise, f64),
    output_noise: f64,
}

/// The case of a set, an index within it and a campaign's seed; `forced` names effects (`ID@KIND`)
/// in place of those of the set.
///
/// # Errors
/// [`CaseError::Unknown`].
pub fn make(
    set: Set,
    index: usize,
    campaign_seed: u64,
    forced: &[String],
) -> Result<Case, CaseError> {
    let seed = subseed(campaign_seed, &format!("{} {index}", set.name()));
    let (kind, entries) = choose(set, index, forced, &mut Draw::new(subseed(seed, "effects")))?;
    let mut kept = None;
    for attempt in 0..ATTEMPTS {
        let case =
            attempted(set, index, subseed(seed, &format!("machine {attempt}")), kind, &entries);
        let Some(case) = case else { continue };
        let whole = case.truth.visibility.iter().all(Visibility::seen);
        kept = Some(case);
        if whole {
            break;
        }
    }
    kept.ok_or_else(|| {
        CaseError::Unbuildable(entries.iter().map(|e| e.id).collect::<Vec<_>>().join(" + "))
    })
}

fn choose(
    set: Set,
    index: usize,
    forced: &[String],
    draw: &mut Draw,
) -> Result<(Kind, Vec<&'static Entry>), CaseError> {
    let kinds = Kind::ALL;
    let kind = kinds[index % kinds.len()];
    if !forced.is_empty() {
        let kind_of = |name: &str| kinds.into_iter().find(|kind| kind.name() == name);
        let kind = forced[0].split_once('@').and_then(|(_, name)| kind_of(name)).unwrap_or(kind);
        let entries = forced
            .iter()
            .map(|name| {
                let id = name.split_once('@').map_or(name.as_str(), |parts| parts.0);
                find(id, kind).ok_or_else(|| CaseError::Unknown(name.clone()))
            })
            .collect::<Result<_, _>>()?;
        return Ok((kind, entries));
    }
    let listed = of_kind(kind, true);
    let number = index / kinds.len();
    let entries = match set {
        Set::OneChannelListed => vec![listed[number % listed.len()]],
        Set::OneChannelUnlisted => {
            let unlisted = of_kind(kind, false);
            vec![unlisted[number % unlisted.len()]]
        }
        Set::OneChannelPairs => {
            let first = listed[draw.below(listed.len())];
            let others: Vec<&Entry> =
                listed.into_iter().filter(|other| apart(first, other)).collect();
            vec![first, others[draw.below(others.len())]]
        }
        _ => Vec::new(),
    };
    Ok((kind, entries))
}

/// Effects of which one contains the other, or which are equal to first order.
const ALIKE: [[&str; 2]; 4] = [
    ["coulomb_friction", "presliding_hysteresis"],
    ["amplifier_lag", "transport_delay"],
    ["line_damping", "viscoelastic_line"],
    ["line_compliance", "backlash"],
];

/// Whether two effects make a pair.
pub fn apart(one: &Entry, other: &Entry) -> bool {
    let alike = |pair: &[&str; 2]| pair.contains(&one.id) && pair.contains(&other.id);
    one.id != other.id && one.demands.agrees(other.demands) && !ALIKE.iter().any(alike)
}

fn attempted(
    set: Set,
    index: usize,
    seed: u64,
    kind: Kind,
    entries: &[&'static Entry],
) -> Option<Case> {
    let demands = entries.iter().fold(Demands::default(), |all, entry| all.and(entry.demands));
    let bench = Bench::drawn(kind, demands, seed);
    let clean = bench.tracks(&[], &Surroundings::default());
    let machine = bench.machine.clone();
    let quiet = setting(&machine, &clean, bench.longest());
    let bench = bench.noisy(&quiet);
    let mut draw = Draw::new(subseed(seed, "sizes"));
    let mut chosen: Vec<(&'static Entry, Values)> = Vec::new();
    for entry in entries {
        let values = (entry.draw)(&mut draw, &quiet)?;
        let target = draw.log_uniform(0.1, 0.35);
        chosen.push((entry, sized(&bench, entry, values, target, &quiet)));
    }
    let tracks = bench.tracks(&chosen, &bench.around);
    let finite = tracks
        .iter()
        .all(|track| track.force.iter().chain(&track.position).all(|value| value.is_finite()));
    let peak = tracks.iter().flat_map(|track| &track.position).fold(0.0_f64, |p, x| p.max(x.abs()));
    // A loop that an effect makes unstable is no laboratory's record.
    if !finite || peak > 4.0 * quiet.travel {
        return None;
    }
    let visibility = visibility(&bench, &chosen, &tracks);
    let records: Vec<Record> =
        tracks.iter().enumerate().map(|(number, track)| bench.record(number, track)).collect();
    let effects = chosen.into_iter().map(|(entry, values)| entry.effect(kind, values)).collect();
    let rig = bench.machine.rig("machine", &bench.declared);
    let truth = Truth {
        set,
        index,
        seed,
        effects,
        visibility,
        noise: bench.noise,
        steps_per_row: steps(bench.machine.row_hz),
        records: bench.movements.iter().map(|(seconds, shape, _)| (*seconds, *shape)).collect(),
        declared: bench.declared,
        machine: bench.machine,
    };
    Some(Case { truth, rig, records })
}

impl Bench {
    fn drawn(kind: Kind, demands: Demands, seed: u64) -> Self {
        let mut draw = Draw::new(seed);
        let machine = Machine::drawn(kind, demands, &mut draw);
        let declared = machine.declare(&mut draw);
        let size = if kind == Kind::Oscillator {
            machine.amplitude * machine.stiffness
        } else {
            machine.amplitude
        };
        let single = demands.single || draw.below(5) == 0;
        let count = if single { 1 } else { 3 + draw.below(4) };
        let wanted = if single { draw.uniform(30.0, 60.0) } else { draw.log_uniform(5.0, 15.0) };
        // An oscillator needs so many swings for each role of its rows.
        let wanted = match kind {
            Kind::Oscillator => wanted.max(100.0 / machine.natural_hz()),
            _ => wanted,
        };
        let most = MOST_ROWS / machine.row_hz / count as f64;
        // Whole tenths of a second, so that records have whole rows.
        let seconds = (10.0 * wanted.min(most)).floor() / 10.0;
        let first = draw.below(Shape::ALL.len());
        let movements = (0..count)
            .map(|number| {
                let shape = Shape::ALL[(first + number) % Shape::ALL.len()];
                let movement = if single {
                    Movement::joined(seconds, size, machine.top_hz, &mut draw)
                } else {
                    Movement::drawn(shape, seconds, size, machine.top_hz, &mut draw)
                };
                (seconds, (!single).then_some(shape), movement)
            })
            .collect();
        Self {
            seed,
            machine,
            declared,
            movements,
            around: Surroundings::default(),
            noise: (Noise::default(), 0.0),
            output_noise: 0.0,
        }
    }

    fn longest(&self) -> f64 {
        self.movements.iter().map(|movement| movement.0).fold(0.0, f64::max)
    }

    /// With noise and converters in proportion to the movement.
    fn noisy(mut self, quiet: &Setting<'_>) -> Self {
        let mut draw = Draw::new(subseed(self.seed, "noise"));
        let part = match self.machine.kind {
            Kind::Drive => draw.log_uniform(0.003, 0.02),
            Kind::Oscillator => draw.log_uniform(5e-4, 3e-3),
            Kind::Element => draw.log_uniform(5e-4, 5e-3),
        };
        self.around = Surroundings {
            disturbance: part * quiet.force_rms,
            corner_hz: draw.log_uniform(1.0, 20.0),
            count: quiet.travel / draw.log_uniform(4e3, 1e5),
            limit: 3.0 * quiet.force_peak,
        };
        let (low, high) =
            if self.machine.kind == Kind::Oscillator { (5e-4, 3e-3) } else { (2e-3, 0.03) };
        let kind = draw.choose(&Noise::ALL);
        self.noise = (kind, draw.log_uniform(low, high) * quiet.force_rms);
        if self.machine.kind == Kind::Oscillator {
            self.output_noise = draw.log_uniform(1e-5, 2e-4) * quiet.travel;
        }
        self
    }

    fn rows(&self, number: usize) -> usize {
        (self.movements[number].0 * self.machine.row_hz).round() as usize
    }

    /// All records with these effects.
    fn tracks(&self, chosen: &[(&'static Entry, Values)], around: &Surroundings) -> Vec<Track> {
        (0..self.movements.len())
            .into_par_iter()
            .map(|number| {
                let mut laws: Vec<Law> =
                    chosen.iter().map(|(entry, values)| (entry.build)(values)).collect();
                let seed = subseed(self.seed, &format!("record {number}"));
                let movement = &self.movements[number].2;
                run(&self.machine, &mut laws, movement, self.rows(number), around, seed)
            })
            .collect()
    }

    fn record(&self, number: usize, track: &Track) -> Record {
        let mut draw = Draw::new(subseed(self.seed, &format!("channels {number}")));
        Record::of(&self.machine, track, self.noise, self.output_noise, &mut draw)
    }

    /// Records as judged, less what these effects take of the force.
    fn judged(&self, tracks: &[Track], less: &[usize]) -> Vec<Judged> {
        let one = |(number, track): (usize, &Track)| {
            let record = self.record(number, track);
            let mut force = record.force;
            for index in less {
                for (force, taken) in force.iter_mut().zip(&track.effects[*index]) {
                    *force -= taken;
                }
            }
            Judged { position: record.position, direction: track.direction.clone(), force }
        };
        tracks.iter().enumerate().map(one).collect()
    }
}

fn rms<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

fn setting<'a>(machine: &'a Machine, tracks: &[Track], seconds: f64) -> Setting<'a> {
    let peak = |of: fn(&Track) -> &Vec<f64>| {
        tracks.iter().flat_map(of).fold(0.0_f64, |peak, value| peak.max(value.abs()))
    };
    let places = || tracks.iter().flat_map(|track| &track.position);
    let (low, high) = places().fold((0.0_f64, 0.0_f64), |(l, h), x| (l.min(*x), h.max(*x)));
    Setting {
        machine,
        force_rms: rms(tracks.iter().flat_map(|track| &track.force)),
        force_peak: peak(|track| &track.force),
        travel: high - low,
        speed_rms: rms(tracks.iter().flat_map(|track| &track.velocity)),
        speed_peak: peak(|track| &track.velocity),
        seconds,
    }
}

/// Brings the size of an effect to a share of the force.
fn sized(
    bench: &Bench,
    entry: &'static Entry,
    mut values: Values,
    target: f64,
    quiet: &Setting<'_>,
) -> Values {
    let (low, high) = (entry.limits)(quiet);
    for _ in 0..ROUNDS {
        let chosen = [(entry, values.clone())];
        let tracks = bench.tracks(&chosen, &bench.around);
        let seen = visibility(bench, &chosen, &tracks)[0];
        let share = seen.share();
        let fits = share > 0.75 * target && share < 1.35 * target && seen.seen();
        if fits || !share.is_finite() {
            break;
        }
        // At the floor of what can be told, the gain decides.
        let wanted = if seen.gain() < 0.3 { (1.3 * share).max(target) } else { target };
        let factor = (wanted / share.max(0.2 * wanted)).clamp(0.25, 4.0);
        let Some(first) = values.0.first_mut() else { break };
        let before = first.value;
        let moved = if entry.inverse { before / factor.sqrt() } else { before * factor };
        first.value = moved.clamp(low, high.max(low));
        if first.value == before {
            break;
        }
    }
    values
}

/// How well each effect can be seen. What an unlisted one takes need not be a force: it is compared
/// with the machine that does not have it.
fn visibility(
    bench: &Bench,
    chosen: &[(&'static Entry, Values)],
    tracks: &[Track],
) -> Vec<Visibility> {
    let all: Vec<usize> = (0..chosen.len()).collect();
    all.iter()
        .map(|index| {
            let others: Vec<usize> = all.iter().copied().filter(|other| other != index).collect();
            let judge = |records: &[Judged]| error(&bench.machine, &bench.declared, records);
            let (force, without) = judge(&bench.judged(tracks, &others));
            let floor = if chosen[*index].0.listed {
                judge(&bench.judged(tracks, &all)).1
            } else {
                judge(&bench.judged(&bench.tracks(&[], &bench.around), &[])).1
            };
            Visibility { force, floor, without }
        })
        .collect()
}

impl Case {
    /// Writes rig file, records and truth into a folder.
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

    /// Writes rig file and records; returns the files, the rig file first.
    ///
    /// # Errors
    /// [`CaseError::Write`].
    pub fn write_records(&self, folder: &Path) -> Result<Vec<PathBuf>, CaseError> {
        let failed = |path: &Path, source| CaseError::Write { path: path.to_owned(), source };
        fs::create_dir_all(folder).map_err(|source| failed(folder, source))?;
        let rig = folder.join("rig.toml");
        fs::write(&rig, &self.rig).map_err(|source| failed(&rig, source))?;
        let mut files = vec![rig];
        for (number, record) in self.records.iter().enumerate() {
            let path = folder.join(format!("record-{:02}.csv", number + 1));
            let write = || {
                let mut file = BufWriter::new(File::create(&path)?);
                record.write(&mut file)?;
                file.flush()
            };
            write().map_err(|source| failed(&path, source))?;
            files.push(path);
        }
        Ok(files)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_follows_from_its_seed() {
        for (set, index) in [(Set::OneChannelListed, 0), (Set::OneChannelPairs, 2)] {
            let (one, other) =
                (make(set, index, 5, &[]).unwrap(), make(set, index, 5, &[]).unwrap());
            assert_eq!(one.truth, other.truth);
            assert_eq!((one.rig, one.records), (other.rig, other.records));
            assert_ne!(one.truth.machine, make(set, index, 6, &[]).unwrap().truth.machine);
        }
    }

    #[test]
    fn an_effect_explains_its_share_of_the_force() {
        let named = |name: &str| vec![name.to_owned()];
        for name in ["coulomb_friction@drive", "quadratic_drag@element", "backlash@oscillator"] {
            let case = make(Set::OneChannelListed, 1, 7, &named(name)).unwrap();
            let seen = case.truth.visibility[0];
            assert!(seen.seen() && seen.share() < 0.6, "{name}: {seen:?}");
        }
        assert!(make(Set::OneChannelListed, 1, 7, &named("backlash@drive")).is_err());
    }

    #[test]
    fn files_are_those_that_identify_reads() {
        let folder = tempfile::tempdir().unwrap();
        let case = make(Set::OneChannelClean, 0, 3, &[]).unwrap();
        case.write(folder.path()).unwrap();
        let text = fs::read_to_string(folder.path().join("truth.json")).unwrap();
        assert_eq!(serde_json::from_str::<Truth>(&text).unwrap(), case.truth);
        let first = fs::read_to_string(folder.path().join("record-01.csv")).unwrap();
        assert_eq!(first.lines().next(), Some(case.records[0].header));
        assert_eq!(first.lines().count(), case.records[0].force.len() + 1);
    }
}
