//! Generates blind cases, runs `farreach identify` on them, and prints the scores.
//!
//! ```text
//! $ campaign --farreach target/release/farreach --seed 1 --results campaign.jsonl \
//!       --json campaign.json
//! $ campaign --results campaign.jsonl --only-print
//! ```
//!
//! Every case becomes a line in the results file as soon as it is scored. If it is started again
//! with the same file, seed, program, rig and options, the campaign resumes; with another program
//! or other options it starts anew, with a message. If it is interrupted, it prints the cases done.
//! A table holds the cases of one program with one set of options.

use std::collections::HashSet;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use blind_cases::case::{DrawnFrom, Set, make};
use blind_cases::case_plan::CaseError;
use blind_cases::effects::Kinds;
use blind_cases::one_channel;
use blind_cases::results::{Configuration, Line, Results, name, read};
use blind_cases::rules::Rules;
use blind_cases::score::{Answer, End, Run, Score, score, score_one_channel};
use blind_cases::table::table;
use clap::Parser;
use signal_hook::consts::{SIGHUP, SIGINT, SIGKILL, SIGTERM};

/// Signals by which a program is ended from outside.
const ENDED: [i32; 4] = [SIGHUP, SIGINT, SIGKILL, SIGTERM];

/// Scores `farreach identify` on blind cases.
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
    /// Cases with three listed effects
    #[arg(long, default_value_t = 0)]
    triples: usize,
    /// Machines with one channel (drives, oscillators, elements) with one listed effect
    #[arg(long, default_value_t = 0)]
    one_channel_listed: usize,
    /// Those with nothing missing
    #[arg(long, default_value_t = 0)]
    one_channel_clean: usize,
    /// Those with an effect that is on no list
    #[arg(long, default_value_t = 0)]
    one_channel_unlisted: usize,
    /// Those with two listed effects
    #[arg(long, default_value_t = 0)]
    one_channel_pairs: usize,
    /// Which of the effects on no list: those of earlier campaigns, the hold-out, or first the ones
    /// and then the others
    #[arg(long, value_enum, default_value = "all")]
    unlisted_kinds: Kinds,
    /// Rules by which transmissions are drawn and recorded
    #[arg(long, value_enum, default_value = "usual")]
    rules: Rules,
    /// Seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Handed to identify
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Handed to identify, which then gives an early answer; it is ended after twice as long (s)
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
    /// Runs nothing, prints a table for each program of what is in the results file, and each way
    /// in which it was asked
    #[arg(long)]
    only_print: bool,
    /// Prints those tables only whose heading has this text: a revision, the first digits of a hash
    #[arg(long, value_name = "TEXT", requires = "only_print")]
    program: Option<String>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let results = read(&args.results, args.seed)?;
    for line in &results.left_out {
        eprintln!("{line}");
    }
    let campaigns =
        if args.only_print { chosen(&args, results)? } else { vec![run(&args, results)?] };
    if let (Some(path), [(configuration, scores)]) = (&args.json, &campaigns[..]) {
        let text = serde_json::to_string_pretty(&serde_json::json!({
            "seed": args.seed,
            "programs": [configuration.program],
            "configuration": configuration,
            "table": table(scores),
            "cases": scores,
        }))?;
        fs::write(path, text).with_context(|| path.display().to_string())?;
    }
    for (number, (configuration, scores)) in campaigns.iter().enumerate() {
        if number > 0 {
            println!();
        }
        println!("{configuration}");
        println!(
            "seed {}, {} cases, one row = one kind of count; shares with Wilson's 95 % bounds",
            args.seed,
            scores.len()
        );
        println!("{}", table(scores));
    }
    Ok(())
}

/// The requested campaigns of the results file, one per program and set of options.
fn chosen(args: &Args, results: Results) -> anyhow::Result<Vec<(Configuration, Vec<Score>)>> {
    let headings: Vec<String> = results.campaigns.keys().map(ToString::to_string).collect();
    let wanted = |heading: &str| args.program.as_deref().is_none_or(|text| heading.contains(text));
    let chosen: Vec<_> =
        results.campaigns.into_iter().filter(|campaign| wanted(&campaign.0.to_string())).collect();
    if chosen.is_empty() {
        let there = if headings.is_empty() { "nothing".to_owned() } else { headings.join("\n  ") };
        bail!(
            "{}: no such lines of seed {}; there is\n  {there}",
            args.results.display(),
            args.seed
        );
    }
    if args.json.is_some() && chosen.len() > 1 {
        bail!(
            "--json takes one table, and {} has {}; choose with --program TEXT:\n  {}",
            args.results.display(),
            chosen.len(),
            headings.join("\n  ")
        );
    }
    Ok(chosen)
}

/// Resumes after the lines of the same program with the same options.
fn run(args: &Args, mut results: Results) -> anyhow::Result<(Configuration, Vec<Score>)> {
    for path in [&args.farreach, &args.rig] {
        if !path.exists() {
            bail!(
                "{}: not found; build with `cargo build --release` and start in the repository's \
                 root",
                path.display()
            );
        }
    }
    let configuration = configuration(args)?;
    let mut scores = results.campaigns.remove(&configuration).unwrap_or_default();
    for (other, lines) in &results.campaigns {
        eprintln!(
            "{}: {} lines of seed {} are not gone on after, the {} was another: {other}",
            args.results.display(),
            lines.len(),
            args.seed,
            configuration.differs(other).join(", ")
        );
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?;
    }
    run_all(args, &configuration, &mut scores, &stop)?;
    Ok((configuration, scores))
}

/// The configuration as it is now.
fn configuration(args: &Args) -> anyhow::Result<Configuration> {
    let program = (args.farreach.as_path(), &*version(&args.farreach)?);
    let drawn = (args.unlisted_kinds, args.rules);
    Ok(Configuration::of(program, &args.rig, args.limit_s, args.jobs, drawn)?)
}

/// The cases in an order such that an interrupted campaign has some of each set.
fn plan(args: &Args) -> Vec<(Set, usize)> {
    let counts = [
        (Set::Listed, args.listed),
        (Set::Clean, args.clean),
        (Set::Unlisted, args.unlisted),
        (Set::Pairs, args.pairs),
        (Set::Triples, args.triples),
        (Set::OneChannelListed, args.one_channel_listed),
        (Set::OneChannelClean, args.one_channel_clean),
        (Set::OneChannelUnlisted, args.one_channel_unlisted),
        (Set::OneChannelPairs, args.one_channel_pairs),
    ];
    let mut cases: Vec<(f64, Set, usize)> = counts
        .into_iter()
        .flat_map(|(set, count)| {
            (0..count).map(move |index| ((index as f64 + 0.5) / count as f64, set, index))
        })
        .collect();
    cases.sort_by(|a, b| a.0.total_cmp(&b.0));
    cases.into_iter().map(|(_, set, index)| (set, index)).collect()
}

fn run_all(
    args: &Args,
    configuration: &Configuration,
    scores: &mut Vec<Score>,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let done: HashSet<(Set, usize)> = scores.iter().map(|score| (score.set, score.index)).collect();
    let cases: Vec<(Set, usize)> =
        plan(args).into_iter().filter(|case| !done.contains(case)).collect();
    if cases.is_empty() {
        return Ok(());
    }
    let mut results = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&args.results)
        .with_context(|| args.results.display().to_string())?;
    // After an incomplete line.
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
        // A build during the campaign may have replaced the program; the answer cannot be
        // attributed then.
        let now = self::configuration(args)?;
        if now != *configuration {
            let changed = configuration.differs(&now).join(", ");
            bail!(
                "{} is not counted: the {changed} changed while the campaign ran",
                name(set, index)
            );
        }
        let line = Line { seed: args.seed, configuration: now, score: score.clone() };
        writeln!(results, "{}", serde_json::to_string(&line)?)?;
        eprintln!(
            "{}/{count} {} [{}] {:?} {} {:?} {:.1} s {}",
            number + 1,
            name(set, index),
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

/// Generates, runs and scores one case; `None` if it was interrupted.
fn one(args: &Args, set: Set, index: usize, stop: &AtomicBool) -> anyhow::Result<Option<Score>> {
    // Identify gets a folder with a neutral name that holds the records only.
    let folder = tempfile::tempdir()?;
    let records = folder.path().join("records");
    if set.one_channel() {
        let case = one_channel::case::make(set, index, args.seed, &[])?;
        let files = case.write_records(&records)?;
        let keep = |to: &Path| case.write(to);
        let asked = (folder.path(), &*files[0], &files[1..]);
        let Some((run, answer)) = asked_of(args, (set, index), asked, stop, keep)? else {
            return Ok(None);
        };
        return Ok(Some(score_one_channel(&case.truth, answer.as_ref(), &run)));
    }
    let from = DrawnFrom { kinds: args.unlisted_kinds, rules: args.rules, ..DrawnFrom::default() };
    let case = make(set, index, args.seed, &from)?;
    let files = case.write_records(&records)?;
    let keep = |to: &Path| case.write(to);
    let asked = (folder.path(), &*args.rig, &files[..]);
    let Some((run, answer)) = asked_of(args, (set, index), asked, stop, keep)? else {
        return Ok(None);
    };
    Ok(Some(score(&case.truth, answer.as_ref(), &run)))
}

/// What identify says of the records in a folder, with a rig file, and how it ended.
fn asked_of(
    args: &Args,
    (set, index): (Set, usize),
    (folder, rig, records): (&Path, &Path, &[PathBuf]),
    stop: &AtomicBool,
    write: impl Fn(&Path) -> Result<(), CaseError>,
) -> anyhow::Result<Option<(Run, Option<Answer>)>> {
    let json = folder.join("identify.json");
    let said = folder.join("identify.txt");
    let Some(run) = identify(args, (rig, records), &json, &said, stop)? else { return Ok(None) };
    if let Some(keep) = &args.keep {
        let folder = keep.join(name(set, index));
        write(&folder)?;
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
    Ok(Some((run, answer)))
}

fn read_answer(json: &Path) -> Option<Answer> {
    serde_json::from_str(&fs::read_to_string(json).ok()?).ok()
}

/// Runs identify on a case.
fn identify(
    args: &Args,
    (rig, records): (&Path, &[PathBuf]),
    json: &Path,
    said: &Path,
    stop: &AtomicBool,
) -> anyhow::Result<Option<Run>> {
    let started = Instant::now();
    let mut child = Command::new(&args.farreach)
        .arg("identify")
        .arg("--rig")
        .arg(rig)
        .arg("--json")
        .arg(json)
        .arg("--jobs")
        .arg(args.jobs.to_string())
        .arg("--limit-s")
        .arg(args.limit_s.to_string())
        .args(records)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(said)?)
        .spawn()
        .with_context(|| args.farreach.display().to_string())?;
    let limit = Duration::from_secs(2 * args.limit_s);
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
    // Somebody ended it: that says nothing of the program, whereas a crash does.
    if let Some(signal) =
        status.and_then(|status| status.signal()).filter(|own| ENDED.contains(own))
    {
        bail!(
            "identify was ended by signal {signal}; the case is not counted, start again to resume"
        );
    }
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

/// The version that a program reports.
fn version(program: &Path) -> anyhow::Result<String> {
    let said = Command::new(program)
        .arg("--version")
        .output()
        .with_context(|| program.display().to_string())?;
    Ok(String::from_utf8_lossy(&said.stdout).trim().to_owned())
}
