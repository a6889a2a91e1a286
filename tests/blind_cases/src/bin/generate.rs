//! Writes blind cases: records (CSV) and the truth about them, one folder a case.
//!
//! ```text
//! $ generate --set listed --cases 31 --seed 1 --out cases
//! $ generate --set listed --effect backlash@slave --cases 3 --seed 7 --out cases
//! ```

use std::path::PathBuf;
use std::time::Instant;

use blind_cases::case::{DrawnFrom, Set, make};
use blind_cases::effects::{self, Kinds};
use blind_cases::one_channel;
use blind_cases::results::name;
use blind_cases::rules::Rules;
use clap::Parser;

/// Writes blind cases, one folder a case: record-NN.csv and truth.json.
#[derive(Parser)]
struct Args {
    /// Set of the cases
    #[arg(long, value_enum, default_value = "listed")]
    set: Set,
    /// How many
    #[arg(long, default_value_t = 1)]
    cases: usize,
    /// Index of the first
    #[arg(long, default_value_t = 0)]
    from: usize,
    /// Seed of the campaign: a case follows from it, its set and its index
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder
    #[arg(long, required_unless_present = "list")]
    out: Option<PathBuf>,
    /// This effect instead of the set's choice (repeatable): ID or ID@SITE
    #[arg(long, value_name = "ID@SITE")]
    effect: Vec<String>,
    /// Which of the effects on no list: those of earlier campaigns, the hold-out, or first the ones
    /// and then the others
    #[arg(long, value_enum, default_value = "all")]
    unlisted_kinds: Kinds,
    /// Rules by which transmissions are drawn and recorded
    #[arg(long, value_enum, default_value = "usual")]
    rules: Rules,
    /// Names all effects, listed and unlisted, and writes nothing
    #[arg(long)]
    list: bool,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    if args.list {
        for (kind, entries) in [
            ("listed", effects::listed()),
            ("unlisted, old", effects::unlisted(Kinds::Old)),
            ("unlisted, new", effects::unlisted(Kinds::New)),
        ] {
            for entry in entries {
                println!("{kind:13} {}@{}", entry.id, entry.site.name());
            }
        }
        return Ok(());
    }
    let Some(out) = args.out else { return Ok(()) };
    let from =
        DrawnFrom { kinds: args.unlisted_kinds, rules: args.rules, forced: args.effect.clone() };
    for index in args.from..args.from + args.cases {
        let started = Instant::now();
        if args.set.one_channel() {
            let case = one_channel::case::make(args.set, index, args.seed, &args.effect)?;
            let folder = out.join(name(args.set, index));
            case.write(&folder)?;
            println!(
                "{} in {:.1} s: {}",
                folder.display(),
                started.elapsed().as_secs_f64(),
                described(&case.truth)
            );
            continue;
        }
        let case = make(args.set, index, args.seed, &from)?;
        let folder = out.join(name(args.set, index));
        case.write(&folder)?;
        let shown: Vec<String> = case
            .truth
            .effects
            .iter()
            .zip(&case.truth.detectability)
            .map(|(effect, seen)| {
                let numbers: Vec<String> = effect
                    .parameters
                    .0
                    .iter()
                    .map(|value| format!("{} {:.4}", value.name, value.value))
                    .collect();
                let channel = ["master", "slave", "torque"][seen.channel];
                format!(
                    "{} ({}): {channel} {:.2e}, refitted {:.2e}, floor {:.2e}, gain {:.0} %",
                    effect.name(),
                    numbers.join(", "),
                    seen.without[seen.channel],
                    seen.refitted[seen.channel],
                    seen.floor[seen.channel],
                    100.0 * seen.gain
                )
            })
            .collect();
        println!(
            "{} in {:.1} s: {}",
            folder.display(),
            started.elapsed().as_secs_f64(),
            shown.join("; ")
        );
    }
    Ok(())
}

/// Kind, rate, records and effects of a case of one channel.
fn described(truth: &one_channel::case::Truth) -> String {
    let machine = &truth.machine;
    let mut text = format!(
        "{} at {} Hz, {} records of {:.1} s",
        machine.kind.name(),
        machine.row_hz,
        truth.records.len(),
        truth.records[0].0
    );
    for (effect, seen) in truth.effects.iter().zip(&truth.visibility) {
        let size = effect.parameters.0.first().map_or(0.0, |value| value.value);
        text += &format!(
            "; {} {size:.3e}: {:.1} % of the force, {:.1} % floor, gain {:.0} %",
            effect.name(),
            100.0 * seen.share(),
            100.0 * seen.floor / seen.force,
            100.0 * seen.gain()
        );
    }
    text
}
