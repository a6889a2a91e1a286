//! The table of `docs/live-loop.md`: tuning of rigs with hidden effects, in lock-step.
//! `cargo run --release -p tune --example tuning_table -- hydrostatic SEED [DIR]`
//!
//! With a folder it writes, for each effect, the rig file of the true machine and that of a control
//! that knows it, to be run live: `farreach up --simulate --rig KNOWING --machine TRUTH`.

use std::time::Instant;

use anyhow::{Context as _, Result};
use identify::study::{StudyOptions, study};
use identify::write_rig::Provenance;
use rig::protocol::Protocol;
use rig::{RigFile, load_protocol, load_rig};
use tune::proposal::{Predicted, best_control, propose};
use tune::simulated::{Machine, play};

/// Hidden effects; each costs some per cent of tracking error or more.
const EFFECTS: [&str; 8] = [
    "backlash@slave=0.05",
    "coulomb_friction@master=0.4",
    "viscous_friction@slave=0.12",
    "gravity_imbalance@slave=1.3",
    "line_compliance@line=0.9",
    "leakage@line=4e-12",
    "torque_ripple@drive=0.25",
    "extra_inertia@slave=4e-3",
];

/// The text of a rig file with an effect declared.
fn declared(text: &str, effect: &str) -> Result<String> {
    let (name, size) = effect.split_once('=').context("a size")?;
    let (id, site) = name.split_once('@').context("a site")?;
    let made = plant::effects::parse(effect)?;
    let first = made.infos().first().context("a parameter")?.name;
    let entry = format!(
        "[[model.effects]]\nid = \"{id}\"\nsite = \"{site}\"\nparameters = {{ {first} = {size} }}\n"
    );
    Ok(text.replacen("[replay]", &format!("{entry}\n[replay]"), 1))
}

fn rms(control: &RigFile, truth: &RigFile, movement: &Protocol) -> Result<f64> {
    let played = play(control, Machine { rig: truth, effects: &[] }, movement)?;
    Ok(played.followed.error().context("a movement that is long enough")?.rms)
}

fn main() -> Result<()> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "hydrostatic".to_owned());
    let seed = std::env::args().nth(2).map_or(Ok(1), |text| text.parse::<u64>())?;
    let folder = std::env::args().nth(3);
    let mut rig = load_rig(name.as_ref())?;
    let text = rig.text().to_owned();
    rig.simulation.seed = seed;
    let excitation = load_protocol("tuning-excitation".as_ref(), &[])?;
    let movement = load_protocol("guided-1hz".as_ref(), &["segments.0.duration_s=12".to_owned()])?;
    println!("| hidden effect | found | before | predicted | after | knows the truth | ratio |");
    println!("|---|---|---|---|---|---|---|");
    for effect in EFFECTS {
        let mut truth = RigFile::parse(&declared(&text, effect)?, "truth")?;
        truth.simulation.seed = seed;
        let begun = Instant::now();
        let before = rms(&rig, &truth, &movement)?;
        let played = play(&rig, Machine { rig: &truth, effects: &[] }, &excitation)?;
        let options = StudyOptions { seed, ..StudyOptions::default() };
        let found = study(&rig, &[played.record], options)?.outcome;
        let names: Vec<String> =
            found.effects.iter().map(|effect| format!("{}@{}", effect.id, effect.site)).collect();
        let proposal = propose(&rig, &found, &movement, &Provenance::today("example"))?;
        let after = rms(&proposal.control.rig, &truth, &movement)?;
        let knowing = best_control(&truth, &movement)?;
        let best = rms(&knowing.rig, &truth, &movement)?;
        if let Some(folder) = &folder {
            let id = effect.split('@').next().unwrap_or(effect);
            for (what, file) in [("truth", &truth), ("knowing", &knowing.rig)] {
                std::fs::write(format!("{folder}/{id}-{what}.toml"), file.text())?;
            }
        }
        println!(
            "| `{effect}` | {} | {:.1} | {:.1} → {:.1} | {:.1} | {:.1} | {:.2} |",
            names.join(", "),
            1e3 * before,
            1e3 * proposal.before.rms,
            1e3 * proposal.control.error.rms,
            1e3 * after,
            1e3 * best,
            after / best
        );
        eprintln!("{effect}: {:?}, {:.0} s", found.verdict, begun.elapsed().as_secs_f64());
        for choice in proposal.control.choices.iter().chain([&proposal.control.chosen]) {
            let told = match &choice.predicted {
                Predicted::Predicted(error) => format!("{:.2}", 1e3 * error.rms),
                Predicted::Refused(why) => why.clone(),
            };
            eprintln!("    {} {:?}: {told}", choice.name, choice.lead_s);
        }
        eprintln!(
            "    {:?} {} {:?}",
            proposal.control.uncompensated, proposal.model, proposal.left_out
        );
    }
    Ok(())
}
