//! The command line.

use std::path::PathBuf;

use recording::record::Mapping;

use crate::study::StudyOptions;

/// Identifies the declared model from measured records and reports the effect that it lacks.
///
/// A record is a recording of farreach's (MCAP) or a CSV file with a header, SI units. Columns of a
/// transmission: t_s, motor_v, master_rad, and slave_rad, slave_torque_nm where they were measured;
/// of a drive: t_s, force_n, position_m (or torque_nm, position_rad); of an element: t_s,
/// position_m, force_n; of an oscillator: t_s, input, output.
///
/// Of a rig with several axes, one is identified at a time (--axis). A CSV file then has the axis's
/// own columns, by these names or with the name of the axis before them (flexion.motor_v), and of
/// each other axis the position of its slave (rotation.slave_rad), whose acceleration acts through
/// the handle that they share. Recordings have all of them.
///
/// A CSV file that names its columns otherwise, and a recording (MCAP) of another program, are read
/// with --map: SOURCE is a name in the header, or TOPIC:FIELD with dots into messages and brackets
/// into arrays; FACTOR brings it to SI units. Without a mapping of t_s the time of a recording is
/// that at which messages were written.
///
/// A transmission needs three records or more, or one that moves for 9 s or more and is cut into
/// segments; whole records fit, select and report, unless --fit, --select and --report-on say
/// otherwise. For the other kinds one record suffices: blocks of it fit, select and report.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example:\n  farreach identify --rig launch/rigs/emps.toml emps.csv --report out \
        --json out/identify.json\n  \
    farreach identify --rig launch/rigs/hydrostatic.toml run-*.csv --write-rig fitted.toml\n  \
    farreach identify --rig hydrostatic --trend recordings/ --report out\n\n\
    Exit codes: 0 done (whatever the verdict), 1 the data or the rig file cannot be used, 2 usage"
)]
pub struct Args {
    /// Rig file with the declared model, or the name of one that comes with farreach
    #[arg(long, value_name = "FILE|NAME")]
    pub rig: PathBuf,
    /// Measured records
    #[arg(
        value_name = "RECORD",
        required_unless_present_any = ["fit", "select", "report_on", "trend"]
    )]
    pub records: Vec<PathBuf>,
    /// Instead of records: identifies every recording in DIR (*.mcap, *.csv) by itself, and tells
    /// which declared parameters changed over them, when, and whether the machine is still that of
    /// the rig file
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = [
            "records", "fit", "select", "report_on", "write_rig", "propose_experiment", "calibrate"
        ]
    )]
    pub trend: Option<PathBuf>,
    /// With --trend, also searches each recording for the effects that the model lacks, which takes
    /// far longer
    #[arg(long, requires = "trend")]
    pub effects: bool,
    /// The axis to identify, by name or by number from 0; required for a rig with several
    #[arg(long, value_name = "NAME|N")]
    pub axis: Option<String>,
    /// Where a column comes from, for all records (repeatable):
    /// slave_torque_nm=/handle:wrench.torque.z
    #[arg(long, value_name = "COLUMN=SOURCE[*FACTOR]")]
    pub map: Vec<Mapping>,
    /// Interpolates the rows to this rate, for records that are not uniform in time
    #[arg(long, value_name = "HZ")]
    pub resample: Option<f64>,
    /// Writes a page with figures and tables into this folder (index.html)
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Writes the result for programs; `-` is stdout, and the text for readers then goes to stderr
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Writes the rig file with the fitted parameters and the effects found; FILE must not exist
    #[arg(long, value_name = "FILE")]
    pub write_rig: Option<PathBuf>,
    /// Writes a protocol for the rig that distinguishes ambiguous effects, or identifies further
    /// parameters; FILE must not exist
    #[arg(long, value_name = "FILE")]
    pub propose_experiment: Option<PathBuf>,
    /// Parametric bootstrap: searches N simulated machines without the last effect found, and
    /// withdraws that effect if p > 0.05 (use 19 or more). Each takes as long as the search itself
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub calibrate: usize,
    /// Time after which the best answer so far is given, and said to be early (s) [default: 120,
    /// and 120 more for each machine of --calibrate]; with --trend, for each recording
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub limit_s: Option<f64>,
    /// Threads [default: one per processor]
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// Seed of the split into blocks and of simulated machines
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// A record for fitting parameters (repeatable)
    #[arg(long, value_name = "RECORD")]
    pub fit: Vec<PathBuf>,
    /// A record for selecting effects (repeatable)
    #[arg(long, value_name = "RECORD")]
    pub select: Vec<PathBuf>,
    /// A record for reporting errors (repeatable)
    #[arg(long, value_name = "RECORD")]
    pub report_on: Vec<PathBuf>,
}

/// Longest time of a search (s), where the command line says nothing.
const LIMIT_S: f64 = 120.0;

impl Args {
    /// Time after which the best answer so far is given (s).
    pub(crate) fn limit_s(&self) -> f64 {
        self.limit_s.unwrap_or(LIMIT_S * (1 + self.calibrate) as f64)
    }

    /// How records are read.
    pub(crate) fn reading(&self) -> recording::record::Options {
        recording::record::Options {
            mapping: self.map.clone(),
            resample_hz: self.resample,
            even_out: true,
            ..Default::default()
        }
    }

    /// How an axis is identified, without proposal and bootstrap.
    pub(crate) fn study(&self, axis: usize) -> StudyOptions {
        let own = StudyOptions::default();
        StudyOptions {
            jobs: self.jobs.unwrap_or(own.jobs),
            seed: self.seed,
            limit_s: Some(self.limit_s()),
            axis,
            ..own
        }
    }
}

/// A positive number of seconds.
fn seconds(text: &str) -> Result<f64, String> {
    let read = text.parse::<f64>().ok().filter(|seconds| *seconds > 0.0);
    read.ok_or_else(|| "expected a positive number of seconds".to_owned())
}
