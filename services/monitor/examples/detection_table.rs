//! The table of `docs/live-loop.md`: eight effects in five sizes from ten starts, put into the
//! simulated machine while it moves, in lock-step with the law and the monitor; and two hours of a
//! machine that only warms up. `cargo run --release -p monitor --example detection_table`

use std::f64::consts::PI;

use anyhow::{Context, Result};
use lock_step::guided::{Quality, Sine, guided};
use lock_step::{Aim, LockStepRig};
use monitor::axis_monitor::{AxisMonitor, BLOCK_ROWS, Seen};
use monitor::departure::Verdict;
use monitor::origin::{Origin, side};
use plant::effects::{Site, entry};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use rig::{RIGS, RigFile};

/// Effects of the table, each with its site.
const EFFECTS: [(&str, Site); 8] = [
    ("backlash", Site::Slave),
    ("coulomb_friction", Site::Master),
    ("viscous_friction", Site::Slave),
    ("gravity_imbalance", Site::Slave),
    ("line_compliance", Site::Line),
    ("leakage", Site::Line),
    ("torque_ripple", Site::Drive),
    ("extra_inertia", Site::Slave),
];
/// Sizes, as factors on the one that costs 5 % of tracking error.
const FACTORS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
const STARTS: u64 = 10;
/// Movement before the effect (s): the baseline takes 20 s.
const BEFORE_S: f64 = 25.0;
const AFTER_S: f64 = 20.0;
/// Seconds of movement in a block.
const BLOCK_S: f64 = BLOCK_ROWS as f64 / 250.0;

/// A movement of the master: two sines, so that no two cycles are alike.
#[derive(Clone, Copy, Debug)]
struct Movement {
    amplitudes: [f64; 2],
    hertz: [f64; 2],
}

impl Movement {
    fn random(generator: &mut Pcg64Mcg) -> Self {
        let mut of = |low: f64, high: f64| generator.random_range(low..high);
        let hertz = [of(0.3, 1.2), of(0.2, 0.5)];
        Self { amplitudes: [of(0.15, 0.5), of(0.05, 0.3)], hertz }
    }

    fn at(&self, time_s: f64) -> Aim {
        let mut aim = Aim::at_rest(0.0);
        for (amplitude, hertz) in self.amplitudes.iter().zip(self.hertz) {
            let own = Aim::sine(*amplitude, hertz, time_s);
            aim.position += own.position;
            aim.velocity += own.velocity;
            aim.acceleration += own.acceleration;
            aim.peak_speed += amplitude * 2.0 * PI * hertz;
        }
        aim
    }
}

/// What a run showed.
#[derive(Clone, Debug, Default)]
struct Outcome {
    /// From the effect to the alarm, in movement (s); `None` without an alarm.
    delay_s: Option<f64>,
    /// Whether an alarm came before the effect.
    false_alarm: bool,
    /// The origin five seconds of movement after the alarm.
    origin: Option<Origin>,
}

fn run(rig: &RigFile, movement: Movement, effect: &str, at_s: f64) -> Result<Outcome> {
    let mut system = LockStepRig::new(rig, &[])?;
    let mut monitor = AxisMonitor::new(rig, 0, &rig.axes[0])?;
    let (mut outcome, mut put, mut since) = (Outcome::default(), false, 0u32);
    while system.time_s() < at_s + AFTER_S {
        if !put && system.time_s() >= at_s {
            put = true;
            system.change_effects(rig, &[effect.to_owned()])?;
        }
        let setpoint = system.setpoint(&movement.at(system.time_s()));
        system.cycle_seeing(Some(&setpoint), true, &mut |sample| {
            let Seen::Block(_, verdict) = monitor.see(sample, 0.0) else { return };
            since += u32::from(put);
            if verdict == Verdict::Departs {
                outcome.false_alarm |= !put;
                outcome.delay_s = Some(f64::from(since) * BLOCK_S);
            }
        })?;
        outcome.origin = monitor.origin().cloned();
        let enough = |delay_s| f64::from(since) * BLOCK_S >= delay_s + 5.0;
        if outcome.delay_s.is_some_and(enough) {
            break;
        }
    }
    Ok(outcome)
}

/// The size of an effect that changes the slave's tracking error by 5 %.
fn costly_size(rig: &RigFile, id: &str, site: Site) -> Result<f64> {
    let sine = Sine { amplitude: 0.35, hertz: 0.8, settle_s: 3.0, keep_s: 5.0 };
    let error = |size: f64| -> Result<f64> {
        let effects =
            if size > 0.0 { vec![format!("{id}@{}={size:e}", site.name())] } else { Vec::new() };
        let trace = guided(rig, &effects, &sine)?;
        Ok(Quality::of(&trace).context("a trace")?.slave_error)
    };
    let clean = error(0.0)?;
    let place = entry(id).and_then(|entry| entry.sites.iter().find(|place| place.site == site));
    let default = place.context("no such effect")?.size;
    let costs = |size: f64| -> Result<bool> { Ok((error(size)? / clean - 1.0).abs() >= 0.05) };
    // The smallest of sizes a tenth of a decade apart, then halved.
    let sizes = (-30..=20).map(|step| default * 10f64.powf(f64::from(step) / 10.0));
    for size in sizes {
        if costs(size).unwrap_or(true) {
            return Ok(size);
        }
    }
    anyhow::bail!("{id}@{}: no size costs 5 %", site.name())
}

/// Friction and viscosity a fifth higher when cold, within their tolerances of a quarter.
const WARMING: &str = "
[[model.effects]]
id = \"thermal_drift\"
site = \"SITE\"
parameters = { excess = 0.2, time_constant_s = 2400.0 }

";
const CLEAN_S: f64 = 7200.0;

/// Two hours of a machine that warms up, with movements of two minutes and rests between them.
fn warming(rig: &RigFile, text: &str, name: &str, seed: u64) -> Result<String> {
    let drifts: String =
        ["master", "slave", "line"].map(|site| WARMING.replace("SITE", site)).concat();
    let warms = text.replacen("[replay]", &format!("{drifts}[replay]"), 1);
    let mut warms = RigFile::parse(&warms, name)?;
    warms.simulation.seed = seed;
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let mut system = LockStepRig::new(&warms, &[])?;
    let mut monitor = AxisMonitor::new(rig, 0, &rig.axes[0])?;
    let (mut alarms, mut blocks, mut most, mut score) = (0u32, 0u32, 0.0_f64, 0.0_f64);
    let mut movement = Movement::random(&mut generator);
    while system.time_s() < CLEAN_S {
        let time_s = system.time_s();
        let within = time_s % 140.0;
        if within < 0.001 {
            movement = Movement::random(&mut generator);
        }
        let aim = if within < 120.0 { movement.at(within) } else { Aim::at_rest(0.0) };
        let setpoint = system.setpoint(&aim);
        system.cycle_seeing(Some(&setpoint), true, &mut |sample| {
            if let Seen::Block(_, verdict) = monitor.see(sample, 0.0) {
                blocks += 1;
                alarms += u32::from(verdict == Verdict::Departs);
                most = most.max(monitor.detector().sums().into_iter().fold(0.0, f64::max));
                score = score.max(monitor.score().ratio);
            }
        })?;
    }
    let mut shares: Vec<(&str, f64)> = monitor.parameters().collect();
    shares.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    Ok(format!(
        "{CLEAN_S} s of warming up, {:.0} s of it in movement: {alarms} alarms; largest sum \
         {most:.2}, largest score {score:.2}; parameters {:.2?}",
        f64::from(blocks) * BLOCK_S,
        &shares[..shares.len().min(4)]
    ))
}

fn main() -> Result<()> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "hydrostatic".to_owned());
    let seed = std::env::args().nth(2).map_or(Ok(1), |text| text.parse::<u64>())?;
    let shipped = RIGS.iter().find(|shipped| shipped.name == name).context("no such rig")?;
    let rig = RigFile::parse(shipped.text, &name)?;
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    println!("{}\n", warming(&rig, shipped.text, &name, seed)?);
    println!(
        "| effect | size | of 5 % | alarms | within 5 s | median delay s | longest s | effect | \
         place |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let (mut right, mut alarms, mut early) = (0, 0, 0);
    for (id, site) in EFFECTS {
        let size = costly_size(&rig, id, site)?;
        for factor in FACTORS {
            let effect = format!("{id}@{}={:e}", site.name(), factor * size);
            let (mut delays, mut named, mut placed) = (Vec::new(), 0, 0);
            for _ in 0..STARTS {
                let mut rig = rig.clone();
                rig.simulation.seed = generator.random();
                let movement = Movement::random(&mut generator);
                let at_s = BEFORE_S + generator.random_range(0.0..3.0);
                let outcome = run(&rig, movement, &effect, at_s)?;
                early += u32::from(outcome.false_alarm);
                let Some(delay_s) = outcome.delay_s else { continue };
                delays.push(delay_s);
                if let Some(origin) = outcome.origin {
                    named += u32::from((origin.id, origin.site) == (id, site));
                    placed += u32::from(side(origin.site) == side(site));
                    if side(origin.site) != side(site) {
                        eprintln!("{effect} after {delay_s}: {origin:.2?} {movement:.2?}");
                    }
                }
            }
            delays.sort_by(f64::total_cmp);
            (right, alarms) = (right + placed, alarms + delays.len());
            let soon = delays.iter().filter(|delay_s| **delay_s <= 5.0).count();
            let at = |share: f64| delays.get(((delays.len() as f64 - 1.0) * share) as usize);
            let shown = |delay: Option<&f64>| delay.map_or("-".to_owned(), |d| format!("{d:.1}"));
            println!(
                "| `{id}@{}` | {:.2e} | {factor} | {} of {STARTS} | {soon} | {} | {} | {named} | \
                 {placed} |",
                site.name(),
                factor * size,
                delays.len(),
                shown(at(0.5)),
                shown(at(1.0)),
            );
        }
    }
    println!("\nplace right in {right} of {alarms} alarms; {early} alarms before the effect");
    Ok(())
}
