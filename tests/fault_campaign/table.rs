//! The campaign's result as a table, for the terminal and for `docs/fault-campaign.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use ipc_types::Profile;

use crate::common::monitor::TICK_NS;
use crate::kinds;
use crate::strike::Outcome;
use crate::verdict::Verdict;

/// All outcomes of one kind in one profile.
struct Row<'a> {
    kind: &'a str,
    outcomes: Vec<&'a Outcome>,
}

impl Row<'_> {
    fn counted(&self) -> impl Iterator<Item = &Outcome> {
        self.outcomes.iter().copied().filter(|it| !matches!(it.verdict, Verdict::HostStalled(_)))
    }

    fn repeated(&self) -> usize {
        self.outcomes.len() - self.counted().count()
    }

    fn failed(&self) -> usize {
        self.counted().filter(|it| matches!(it.verdict, Verdict::Failed(_))).count()
    }

    fn undecided(&self) -> usize {
        self.counted().filter(|it| matches!(it.verdict, Verdict::Undecided(_))).count()
    }

    /// Why the host decides, where it does.
    fn why_undecided(&self) -> Option<String> {
        let why = self.counted().find_map(|it| match &it.verdict {
            Verdict::Undecided(why) => Some(why),
            _ => None,
        });
        why.map(|why| format!("{}: {why}", self.kind))
    }

    fn kept_power(&self) -> usize {
        self.counted().filter(|it| it.off_ticks.is_none()).count()
    }

    /// Milliseconds to 0 V of those that lost their power, in order.
    fn off_ms(&self) -> Vec<f64> {
        sorted(self.counted().filter_map(|it| it.off_ticks).map(milliseconds).collect())
    }

    fn back_ms(&self) -> Vec<f64> {
        sorted(self.counted().map(|it| it.back_ms).collect())
    }

    /// The longest bound among those that have one: which processes are drawn decides.
    fn bound_ms(&self) -> Option<f64> {
        self.counted().filter_map(|it| it.bound_ticks).max().map(milliseconds)
    }

    /// Why the power went, where no bound says when: causes of the trips, how often, and the
    /// longest time to 0 V.
    fn causes(&self) -> Option<String> {
        if self.bound_ms().is_some() {
            return None;
        }
        let mut by_cause: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
        for outcome in self.counted() {
            let Some(ticks) = outcome.off_ticks else { continue };
            let cause = outcome.cause.as_deref().unwrap_or("no trip");
            let (count, longest) = by_cause.entry(cause).or_default();
            (*count, *longest) = (*count + 1, ticks.max(*longest));
        }
        let told = |(cause, (count, longest)): (&str, (usize, u64))| {
            format!("{count} × {cause}, at most {:.1} ms", milliseconds(longest))
        };
        let all: Vec<String> = by_cause.into_iter().map(told).collect();
        (!all.is_empty()).then(|| format!("{}: {}", self.kind, all.join("; ")))
    }

    fn cells(&self) -> [String; 8] {
        let off = self.off_ms();
        let of =
            |share: f64| quantile(&off, share).map_or("–".to_owned(), |ms| format!("{ms:.1}"));
        let back = self.back_ms();
        let back = |share: f64| quantile(&back, share).unwrap_or_default();
        [
            self.counted().count().to_string(),
            self.kept_power().to_string(),
            format!("{} / {} / {}", of(0.5), of(0.99), of(1.0)),
            self.bound_ms().map_or("–".to_owned(), |ms| format!("{ms:.1}")),
            self.failed().to_string(),
            self.undecided().to_string(),
            self.repeated().to_string(),
            format!("{:.0} / {:.0}", back(0.5), back(1.0)),
        ]
    }
}

const HEAD: [&str; 9] = [
    "fault",
    "injections",
    "power kept",
    "to 0 V: p50 / p99 / max (ms)",
    "bound (ms)",
    "not as stated",
    "undecided",
    "repeated for a stall",
    "all ready again: p50 / max (ms)",
];

fn milliseconds(ticks: u64) -> f64 {
    (ticks * TICK_NS) as f64 * 1e-6
}

pub fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// By nearest rank.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

/// The profiles in the order of their outcomes.
fn profiles(outcomes: &[Outcome]) -> Vec<Profile> {
    let mut profiles = Vec::new();
    for outcome in outcomes {
        if !profiles.contains(&outcome.profile) {
            profiles.push(outcome.profile);
        }
    }
    profiles
}

/// One row for each kind, in the order of the list.
fn rows<'a>(outcomes: &'a [Outcome], profile: Profile) -> Vec<Row<'a>> {
    let mut by_kind: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
    for outcome in outcomes.iter().filter(|it| it.profile == profile) {
        by_kind.entry(&outcome.kind).or_default().push(outcome);
    }
    kinds::list()
        .iter()
        .filter_map(|kind| by_kind.remove_entry(kind.name.as_str()))
        .map(|(kind, outcomes)| Row { kind, outcomes })
        .collect()
}

fn summary(outcomes: &[Outcome], profile: Profile) -> String {
    let rows = rows(outcomes, profile);
    let sum = |of: fn(&Row) -> usize| rows.iter().map(of).sum::<usize>();
    let own = outcomes.iter().filter(|it| it.profile == profile);
    let stalls = sorted(own.map(|it| it.stall_ms).collect());
    let stall = |share: f64| quantile(&stalls, share).unwrap_or_default();
    format!(
        "{} injections of {} kinds: {} not as stated, {} undecided; {} more were repeated because \
         the host stalled. Longest stall of the host during an injection: median {:.1} ms, 99th \
         percentile {:.1} ms, maximum {:.1} ms.",
        sum(|row| row.counted().count()),
        rows.len(),
        sum(|row| row.failed()),
        sum(|row| row.undecided()),
        sum(|row| row.repeated()),
        stall(0.5),
        stall(0.99),
        stall(1.0),
    )
}

/// For the terminal.
pub fn text(outcomes: &[Outcome]) -> String {
    let mut text = String::new();
    for profile in profiles(outcomes) {
        writeln!(text, "\n{profile}: {}", summary(outcomes, profile)).unwrap();
        writeln!(text, "{}", HEAD.join("; ")).unwrap();
        for row in rows(outcomes, profile) {
            let [count, kept, off, bound, failed, undecided, repeated, back] = row.cells();
            let (name, off) = (format!("{:60}", row.kind), format!("{off:22}"));
            let counts = format!("{failed:>2} {undecided:>2} {repeated:>3}  {back}");
            writeln!(text, "{name} {count:>4} {kept:>4}  {off} {bound:>6} {counts}").unwrap();
        }
        for row in rows(outcomes, profile) {
            row.causes().inspect(|causes| writeln!(text, "{causes}").unwrap());
            row.why_undecided().inspect(|why| writeln!(text, "undecided: {why}").unwrap());
        }
    }
    text
}

/// The sources that ran.
fn revision() -> String {
    let git = |arguments: &[&str]| {
        let mut command = Command::new("git");
        let output = command.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output();
        let output = output.ok().filter(|output| output.status.success())?;
        String::from_utf8(output.stdout).ok()
    };
    let head = git(&["rev-parse", "--short=12", "HEAD"]);
    let (Some(head), Some(status)) = (head, git(&["status", "--porcelain"])) else {
        return "Run on a revision that git does not know.".to_owned();
    };
    let folders: BTreeSet<&str> =
        status.lines().filter_map(|line| line.get(3..)?.split('/').next()).collect();
    let folders: Vec<&str> = folders.into_iter().collect();
    let changed = if folders.is_empty() {
        String::new()
    } else {
        format!(", changed in {}", folders.join(", "))
    };
    format!("Run on revision `{}`{changed}.", head.trim())
}

/// A heading and its items; nothing where there are none.
fn write_list(page: &mut String, head: &str, items: &[String]) {
    if items.is_empty() {
        return;
    }
    writeln!(page, "\n{head}:\n").unwrap();
    for item in items {
        let options = textwrap::Options::new(100).initial_indent("- ").subsequent_indent("  ");
        writeln!(page, "{}", textwrap::fill(item, options)).unwrap();
    }
}

/// Writes the page.
pub fn write_page(outcomes: &[Outcome]) {
    let mut page = include_str!("page_introduction.txt").to_owned();
    writeln!(page, "\n{}", textwrap::fill(&revision(), 100)).unwrap();
    for profile in profiles(outcomes) {
        writeln!(page, "\n## Profile {profile}\n").unwrap();
        let summary = textwrap::fill(&summary(outcomes, profile), 100);
        writeln!(page, "{summary}\n").unwrap();
        writeln!(page, "| {} |", HEAD.join(" | ")).unwrap();
        writeln!(page, "|---|{}", "--:|".repeat(HEAD.len() - 1)).unwrap();
        let rows = rows(outcomes, profile);
        for row in &rows {
            writeln!(page, "| {} | {} |", row.kind, row.cells().join(" | ")).unwrap();
        }
        let undecided: Vec<String> = rows.iter().filter_map(Row::why_undecided).collect();
        write_list(&mut page, "Undecided", &undecided);
        let causes: Vec<String> = rows.iter().filter_map(Row::causes).collect();
        write_list(&mut page, "Causes of the trips where no bound is given", &causes);
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/fault-campaign.md");
    std::fs::write(path, page).unwrap();
}
