//! Multi-step prediction and open-loop simulation of records by a model that `identify` fitted.
//!
//! `identify` itself reports innovations of an observer, which black-box models do not have. For a
//! comparison with them (`tests/peers`) this simulates the model that its JSON describes:
//!
//! - *ahead*: `--rows` rows from every 25th row on, without correction, with voltage and hand
//!   torque as recorded; until then the state is estimated by an observer of bandwidth `--observer`
//!   (rad/s). The predicted row is compared with the measured one.
//! - *free*: open-loop simulation from rest at the first row to the end of the record.
//!
//! Both are written to stdout as JSON: for each record and channel the sum of squared errors (rad²)
//! and how many there are, `null` where the model was lost. Effects that change only what the
//! torque cell shows, and a function without a name (`unlisted`), are left out and named under
//! `left_out`. The torque of the hand is the measured one throughout.
//!
//!     cargo run --release -p identify --example prediction_horizon -- \
//!         --rig launch/rigs/hydrostatic.toml --identified identify.json run-1.csv

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::Parser;
use identify::prediction_error::transmission_model::acts_on_torque_alone;
use plant::effects::{self, Effect, Site};
use plant::transmission::{Correction, Input, Transmission as _};
use plant::transmission_kinds;
use serde_json::{Value, json};

/// Damping of the observer, as a factor on its bandwidth: that of `identify`.
const OBSERVER_DAMPING: f64 = 1.4;
/// Rows from one start to the next.
const APART: usize = 25;
/// A model beyond this has lost the record (rad).
const DIVERGED_RAD: f64 = 1e3;

/// Runs a fitted model ahead.
#[derive(Parser)]
struct Args {
    /// Rig file with the declared model
    #[arg(long)]
    rig: PathBuf,
    /// What `farreach identify --json` wrote
    #[arg(long)]
    identified: PathBuf,
    /// Rows ahead
    #[arg(long, default_value_t = 25)]
    rows: usize,
    /// Rows left out at the start: the observer finds the lines' state
    #[arg(long, default_value_t = 400)]
    settling: usize,
    /// Bandwidths of the observer (rad/s)
    #[arg(long, value_delimiter = ',', default_value = "150")]
    observer: Vec<f64>,
    /// Records (CSV with t_s, motor_v, master_rad, slave_rad, slave_torque_nm)
    records: Vec<PathBuf>,
}

/// A record's columns.
struct Record {
    step_s: f64,
    start_s: f64,
    volts: Vec<f64>,
    master: Vec<f64>,
    slave: Vec<f64>,
    torque: Vec<f64>,
}

/// What was fitted.
struct Model {
    constants: transmission_kinds::Parameters,
    effects: Vec<Box<dyn Effect>>,
    slave_zero_rad: f64,
    left_out: Vec<String>,
}

/// Squared errors of master and slave.
#[derive(Default)]
struct Errors {
    squares: [f64; 2],
    count: usize,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let model = model(&args)?;
    let mut records = Vec::new();
    for path in &args.records {
        let record = record(path)?;
        let mut ahead = serde_json::Map::new();
        for observer in &args.observer {
            ahead.insert(observer.to_string(), as_json(model.ahead(&record, *observer, &args)?));
        }
        let free = as_json(model.free(&record)?);
        records.push(json!({ "file": path, "ahead": ahead, "free": free }));
    }
    println!("{:#}", json!({ "records": records, "left_out": model.left_out }));
    Ok(())
}

fn as_json(errors: Option<Errors>) -> Value {
    errors.map_or(Value::Null, |Errors { squares: [master, slave], count, .. }| {
        json!({ "master": master, "slave": slave, "count": count })
    })
}

fn model(args: &Args) -> anyhow::Result<Model> {
    let rig = rig::RigFile::load(&args.rig)?;
    let mut constants = rig.model.transmission(&args.rig.display().to_string())?;
    let text = std::fs::read_to_string(&args.identified)
        .with_context(|| format!("{}: cannot be read", args.identified.display()))?;
    let found: Value = serde_json::from_str(&text)
        .with_context(|| format!("{}: no JSON", args.identified.display()))?;
    let list = |value: &Value, key: &str| value[key].as_array().cloned().unwrap_or_default();
    let mut slave_zero_rad = 0.0;
    for parameter in list(&found, "parameters") {
        let (name, value) =
            (parameter["name"].as_str().unwrap_or_default(), number(&parameter, "fitted")?);
        if name == "slave_encoder_zero_rad" {
            slave_zero_rad = value;
            continue;
        }
        constants.set(name, value)?;
    }
    let (mut placed, mut left_out) = (Vec::new(), Vec::new());
    for effect in list(&found, "effects") {
        let (id, site) = (
            effect["id"].as_str().unwrap_or_default(),
            effect["site"].as_str().unwrap_or_default(),
        );
        let place = Site::from_name(site)
            .with_context(|| format!("{id}: expected a site, found {site:?}"))?;
        let parameters = list(&effect, "parameters");
        let size = parameters.first().with_context(|| format!("{id}@{site}: no parameters"))?;
        let mut made = effects::make(id, place, number(size, "value")?)?;
        for parameter in &parameters {
            made.set(parameter["name"].as_str().unwrap_or_default(), number(parameter, "value")?)?;
        }
        if acts_on_torque_alone(made.as_ref()) {
            left_out.push(format!("{id}@{site}"));
        } else {
            placed.push(made);
        }
    }
    if found["unlisted"].is_object() {
        left_out.push("a function without a name".to_owned());
    }
    Ok(Model { constants, effects: placed, slave_zero_rad, left_out })
}

fn number(value: &Value, key: &str) -> anyhow::Result<f64> {
    value[key].as_f64().with_context(|| format!("{}: expected a number, found {}", key, value[key]))
}

fn record(path: &std::path::Path) -> anyhow::Result<Record> {
    let file = recording::record::from_csv(path, &recording::record::Options::default())?;
    let column = |name: &str| {
        let found = file.columns.iter().find(|(own, _)| *own == name);
        found
            .map(|(_, values)| values.clone())
            .with_context(|| format!("{}: no column {name}", path.display()))
    };
    let time = &file.time_s;
    if time.len() < 2 {
        bail!("{}: expected rows, found {}", path.display(), time.len());
    }
    Ok(Record {
        step_s: (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64,
        start_s: time[0],
        volts: column("motor_v")?,
        master: column("master_rad")?,
        slave: column("slave_rad")?,
        torque: column("slave_torque_nm")?,
    })
}

impl Model {
    fn plant(&self, record: &Record) -> anyhow::Result<transmission_kinds::Plant> {
        let made = self.constants.clone().plant(self.effects.clone())?;
        let mut plant = made.with_longest_step(record.step_s);
        plant.rest_at(record.master[0], Some(record.slave[0] - self.slave_zero_rad));
        plant.set_time(record.start_s);
        Ok(plant)
    }

    /// Measured less shown: master, slave (rad); `None` where the model is lost.
    fn off(
        &self,
        plant: &transmission_kinds::Plant,
        record: &Record,
        row: usize,
    ) -> Option<[f64; 2]> {
        let reading = plant.reading();
        let off = [
            record.master[row] - reading.master_rad,
            record.slave[row] - self.slave_zero_rad - reading.slave_rad,
        ];
        // Also what is no number has lost it.
        off.iter().all(|off| off.abs() < DIVERGED_RAD).then_some(off)
    }

    fn ahead(
        &self,
        record: &Record,
        observer_rad_s: f64,
        args: &Args,
    ) -> anyhow::Result<Option<Errors>> {
        let mut plant = self.plant(record)?;
        let dt = record.step_s;
        let (on_position, on_speed) =
            (OBSERVER_DAMPING * observer_rad_s * dt, observer_rad_s * observer_rad_s * dt);
        let mut errors = Errors::default();
        for row in 0..record.volts.len().saturating_sub(args.rows) {
            let Some([master, slave]) = self.off(&plant, record, row) else { return Ok(None) };
            plant.correct(Correction {
                master_position_rad: on_position * master,
                master_velocity_rad_s: on_speed * master,
                slave_position_rad: on_position * slave,
                slave_velocity_rad_s: on_speed * slave,
            });
            if row >= args.settling && (row - args.settling).is_multiple_of(APART) {
                let mut alone = plant.clone();
                for next in row..row + args.rows {
                    alone.step(input(record, next), dt);
                }
                let Some(off) = self.off(&alone, record, row + args.rows) else { return Ok(None) };
                errors.add(off);
            }
            plant.step(input(record, row), dt);
        }
        Ok(Some(errors))
    }

    fn free(&self, record: &Record) -> anyhow::Result<Option<Errors>> {
        let mut plant = self.plant(record)?;
        let mut errors = Errors::default();
        for row in 0..record.volts.len() {
            let Some(off) = self.off(&plant, record, row) else { return Ok(None) };
            errors.add(off);
            plant.step(input(record, row), record.step_s);
        }
        Ok(Some(errors))
    }
}

fn input(record: &Record, row: usize) -> Input {
    Input { motor_v: record.volts[row], hand_torque_nm: record.torque[row] }
}

impl Errors {
    fn add(&mut self, off: [f64; 2]) {
        self.squares[0] += off[0] * off[0];
        self.squares[1] += off[1] * off[1];
        self.count += 1;
    }
}
