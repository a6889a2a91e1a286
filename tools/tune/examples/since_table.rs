//! How `farreach tune --since` tells machines apart: an excitation of the machine that was tuned,
//! and one of today, in lock-step with noise of its own.
//! `cargo run --release -p tune --example since_table -- SEED`

use anyhow::Result;
use rig::{RigFile, load_protocol, load_rig};
use tune::proposal::best_control;
use tune::simulated::{Machine, samples};
use tune::since::compare;

/// Changes of the machine since it was tuned; the first are none.
const CHANGES: [&str; 14] = [
    "",
    "",
    "",
    "",
    "",
    "backlash@slave=0.02",
    "backlash@slave=0.05",
    "coulomb_friction@master=0.1",
    "coulomb_friction@master=0.3",
    "viscous_friction@slave=0.04",
    "gravity_imbalance@slave=0.5",
    "line_compliance@line=0.2",
    "leakage@line=1e-12",
    "extra_inertia@slave=2e-3",
];

fn main() -> Result<()> {
    let seed = std::env::args().nth(1).map_or(Ok(1), |text| text.parse::<u64>())?;
    let rig = load_rig("hydrostatic".as_ref())?;
    let movement = load_protocol("guided-1hz".as_ref(), &["segments.0.duration_s=12".to_owned()])?;
    let excitation = load_protocol("tuning-excitation".as_ref(), &[])?;
    let tuned = best_control(&rig, &movement)?.rig;
    let noisy = |seed: u64| -> RigFile {
        let mut rig = rig.clone();
        rig.simulation.seed = seed;
        rig
    };
    let with = |control: &RigFile, seed: u64| -> RigFile {
        let mut control = control.clone();
        control.simulation.seed = seed;
        control
    };
    for (at, change) in CHANGES.iter().enumerate() {
        let effects: Vec<String> =
            (!change.is_empty()).then(|| (*change).to_owned()).into_iter().collect();
        let seeds = [100 * seed + at as u64, 200 * seed + at as u64];
        let then_rig = noisy(seeds[0]);
        let then =
            samples(&with(&rig, seeds[0]), Machine { rig: &then_rig, effects: &[] }, &excitation)?;
        let now_rig = noisy(seeds[1]);
        for (name, control) in [("same control", &rig), ("tuned control", &tuned)] {
            let now = samples(
                &with(control, seeds[1]),
                Machine { rig: &now_rig, effects: &effects },
                &excitation,
            )?;
            let since = compare(&tuned, then.iter().copied().map(Ok), now.into_iter().map(Ok))?;
            println!("{change:30} {name:14} {}", since.sentence());
        }
    }
    Ok(())
}
