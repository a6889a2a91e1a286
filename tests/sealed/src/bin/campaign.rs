//! Generates sealed cases, lets `farreach identify` judge them, and prints how it did.
//!
//! ```text
//! $ campaign --farreach target/release/farreach --seed 1 --results campaign.jsonl --json campaign.json
//! $ campaign --results campaign.jsonl --only-print
//! ```
//!
//! Every case is a line in the results file as soon as it is scored. Started again with the same file, seed and program, the campaign goes
//! on after what is there; interrupted, it prints what it has.

use std::collections::{BTreeSet, HashSet};
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Parser;
use sealed::case::{Set, make};
use sealed::score::{Answer, End, Run, Score, score};
use sealed::table::table;
use serde::{Deserialize, Serialize};

/// Scores `farreach identify` on sealed cases.
#[derive(Parser)]
struct Args {
    /// The program
    #[arg(long, default_value = "target/release/farreach")]
    farreach: PathBuf,
    /// The declared model
    #[arg(long, default_value = "launch/rigs/hydrostatic.toml")]
    rig: PathBuf,
    /// Cases with one listed effect
    #[arg(long, default_value_t = 200)]
    listed: usize,
    /// Cases with nothing missing
    #[arg(long, default_value_t = 100)]
    clean: usize,
    /// Cases with an effect that is on no list
    #[arg(long, default_value_t = 60)]
    unlisted: usize,
    /// Cases with two listed effects
    #[arg(long, default_value_t = 60)]
    pairs: usize,
    /// Seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Handed to identify
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Longest time of one case (s)
    #[arg(long, default_value_t = 300)]
    limit_s: u64,
    /// One line (JSON) a scored case; the campaign goes on after what is there
    #[arg(long, default_value = "campaign.jsonl")]
    results: PathBuf,
    /// The table for programs
    #[arg(long)]
    json: Option<PathBuf>,
    /// Keeps records, truth and answers in this folder
    #[arg(long)]
    keep: Option<PathBuf>,
    /// Runs nothing, prints the table of what is in the results file
    #[arg(long)]
    only_print: bool,
}

/// A line of the results file.
#[derive(Serialize, Deserialize)]
struct Line {
    seed: u64,
    /// What the program says of itself: one table is of one program.
    #[serde(default)]
    program: String,
    #[serde(flatten)]
    score: Score,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let program = if args.only_print { None } else { Some(version(&args.farreach)?) };
    let mut known = known(&args.results, args.seed, program.as_deref())?;
    if let Some(program) = &program {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, stop.clone())?;
        }
        run_all(&args, program, &mut known.scores, &stop)?;
        known.programs.insert(program.clone());
    }
    let Known { scores, programs } = known;
    let table = table(&scores);
    for program in &programs {
        println!("{program}");
    }
    println!(
        "seed {}, {} cases, one row = one kind of count; shares with Wilson's 95 % bounds",
        args.seed,
        scores.len()
    );
    println!("{table}");
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(
            &serde_json::json!({ "seed": args.seed, "programs": programs, "table": table, "cases": scores }),
        )?;
        fs::write(path, text).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// Cases in an order in which an interrupted campaign has some of each set.
fn plan(args: &Args) -> Vec<(Set, usize)> {
    let counts = [
        (Set::Listed, args.listed),
        (Set::Clean, args.clean),
        (Set::Unlisted, args.unlisted),
        (Set::Pairs, args.pairs),
    ];
    let mut cases: Vec<(f64, Set, usize)> = counts
        .into_iter()
        .flat_map(|(set, count)| (0..count).map(move |index| ((index as f64 + 0.5) / count as f64, set, index)))
        .collect();
    cases.sort_by(|a, b| a.0.total_cmp(&b.0));
    cases.into_iter().map(|(_, set, index)| (set, index)).collect()
}

fn run_all(args: &Args, program: &str, scores: &mut Vec<Score>, stop: &AtomicBool) -> anyhow::Result<()> {
    let done: HashSet<(Set, usize)> = scores.iter().map(|score| (score.set, score.index)).collect();
    let cases: Vec<(Set, usize)> = plan(args).into_iter().filter(|case| !done.contains(case)).collect();
    if cases.is_empty() {
        return Ok(());
    }
    for path in [&args.farreach, &args.rig] {
        if !path.exists() {
            bail!(
                "{}: not found; build with `cargo build --release` and start in the repository's root",
                path.display()
            );
        }
    }
    let mut results = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&args.results)
        .with_context(|| args.results.display().to_string())?;
    // After a line that was cut off.
    let before = fs::read(&args.results)?;
    if !before.is_empty() && !before.ends_with(b"\n") {
        writeln!(results)?;
    }
    let count = cases.len();
    for (number, (set, index)) in cases.into_iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let Some(score) = one(args, set, index, stop)? else { break };
        writeln!(
            results,
            "{}",
            serde_json::to_string(&Line { seed: args.seed, program: program.to_owned(), score: score.clone() })?
        )?;
        eprintln!(
            "{}/{count} {}-{:03} [{}] {:?} {} {:?} {:.1} s {}",
            number + 1,
            set.name(),
            index + 1,
            score.truth.join(" + "),
            score.end,
            score.verdict,
            score.named,
            score.seconds,
            score.message
        );
        scores.push(score);
    }
    Ok(())
}

/// Generates, runs and scores one case; nothing if it was interrupted.
fn one(args: &Args, set: Set, index: usize, stop: &AtomicBool) -> anyhow::Result<Option<Score>> {
    let case = make(set, index, args.seed, &[])?;
    // Identify sees a folder whose name says nothing, with the records and nothing else.
    let sealed = tempfile::tempdir()?;
    let records = case.write_records(&sealed.path().join("records"))?;
    let json = sealed.path().join("identify.json");
    let said = sealed.path().join("identify.txt");
    let Some(run) = identify(args, &records, &json, &said, stop)? else { return Ok(None) };
    if let Some(keep) = &args.keep {
        let folder = keep.join(format!("{}-{:03}", set.name(), index + 1));
        case.write(&folder)?;
        for file in [&json, &said] {
            if let (true, Some(name)) = (file.exists(), file.file_name()) {
                fs::copy(file, folder.join(name))?;
            }
        }
    }
    let answer = if run.end == End::Done { read_answer(&json) } else { None };
    let run = if run.end == End::Done && answer.is_none() {
        Run { end: End::Failed, message: "no result that can be read".to_owned(), ..run }
    } else {
        run
    };
    Ok(Some(score(&case.truth, answer.as_ref(), &run)))
}

fn read_answer(json: &Path) -> Option<Answer> {
    serde_json::from_str(&fs::read_to_string(json).ok()?).ok()
}

/// Runs identify on a case.
fn identify(
    args: &Args,
    records: &[PathBuf],
    json: &Path,
    said: &Path,
    stop: &AtomicBool,
) -> anyhow::Result<Option<Run>> {
    let started = Instant::now();
    let mut child = Command::new(&args.farreach)
        .arg("identify")
        .arg("--rig")
        .arg(&args.rig)
        .arg("--json")
        .arg(json)
        .arg("--jobs")
        .arg(args.jobs.to_string())
        .args(records)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(said)?)
        .spawn()
        .with_context(|| args.farreach.display().to_string())?;
    let limit = Duration::from_secs(args.limit_s);
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        let interrupted = stop.load(Ordering::Relaxed);
        if interrupted || started.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            if interrupted {
                return Ok(None);
            }
            break None;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let seconds = started.elapsed().as_secs_f64();
    let message = |failed: bool| {
        let text = fs::read_to_string(said).unwrap_or_default();
        if failed { text.lines().last().unwrap_or_default().to_owned() } else { String::new() }
    };
    Ok(Some(match status {
        None => Run { end: End::TooLate, code: None, message: message(true), seconds },
        Some(status) => {
            let end = if status.success() { End::Done } else { End::Failed };
            Run { end, code: status.code(), message: message(!status.success()), seconds }
        }
    }))
}

/// What a program says of itself.
fn version(program: &Path) -> anyhow::Result<String> {
    let said = Command::new(program).arg("--version").output().with_context(|| {
        format!("{}: build with `cargo build --release` and start in the repository's root", program.display())
    })?;
    Ok(String::from_utf8_lossy(&said.stdout).trim().to_owned())
}

/// What is already there.
#[derive(Default)]
struct Known {
    scores: Vec<Score>,
    programs: BTreeSet<String>,
}

/// Scores of this seed, of one program or of any. A last line that was cut off is left out.
fn known(path: &Path, seed: u64, program: Option<&str>) -> anyhow::Result<Known> {
    let mut known = Known::default();
    if !path.exists() {
        return Ok(known);
    }
    for (number, line) in BufReader::new(File::open(path)?).lines().enumerate() {
        let line = line?;
        if line.trim().is_empty() {
            continue;
        }
        match serde_json::from_str::<Line>(&line) {
            Ok(line) if line.seed == seed && program.is_none_or(|program| program == line.program) => {
                known.scores.push(line.score);
                known.programs.insert(line.program);
            }
            Ok(_) => {}
            Err(error) => eprintln!("{}, line {}: {error}; left out", path.display(), number + 1),
        }
    }
    Ok(known)
}
