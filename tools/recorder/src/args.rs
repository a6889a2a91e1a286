//! The command line of `farreach rec`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use crate::bids::FirstRun;
use crate::volumes::PulseInput;

/// Recordings on and off, and what to do with the files.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// What is in a recording: when, which rig, subject and protocol, which topics, which
    /// processes ran programs of others, and what the monitor said of the model beside the machine.
    /// Of a whole file the end alone is read: verify tells whether anything is missing.
    ///
    /// Example: farreach rec info run.mcap --text rig_file > rig.toml
    Info {
        /// The recording.
        file: PathBuf,
        /// Prints this entry of the metadata alone, such as rig_file or protocol_file.
        #[arg(long, value_name = "KEY", conflicts_with = "json")]
        text: Option<String>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Reads everything: checksums, schemas, sequence numbers, ticks. Exit code 3 when anything
    /// is missing.
    ///
    /// Example: farreach rec verify run.mcap
    Verify {
        /// The recording.
        file: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Copies what can be read of a torn or damaged recording into a new file.
    ///
    /// Example: farreach rec recover killed.mcap -o recovered.mcap
    Recover {
        /// The recording.
        file: PathBuf,
        /// The new file; never overwritten.
        #[arg(short, long)]
        out: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Prints messages, one a line.
    ///
    /// Example: farreach rec cat run.mcap --topic command --json
    Cat {
        /// The recording.
        file: PathBuf,
        /// Only this topic (repeatable).
        #[arg(long)]
        topic: Vec<String>,
        /// One JSON object a line, every field; numbers that are not finite as text.
        #[arg(long)]
        json: bool,
    },
    /// Copies an interval of time.
    ///
    /// Example: farreach rec cut run.mcap --from 0.25 --to 0.75 -o middle.mcap
    Cut {
        /// The recording.
        file: PathBuf,
        /// Start (s since the first message of the recording).
        #[arg(long)]
        from: Option<f64>,
        /// End, exclusive (s since the first message of the recording).
        #[arg(long)]
        to: Option<f64>,
        /// The new file; never overwritten.
        #[arg(short, long)]
        out: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Joins the parts that `rec start --split`, or a restart of the logger, left, in the order of
    /// time. Messages that several files hold are copied once.
    ///
    /// Example: farreach rec merge run.mcap run.part2.mcap -o whole.mcap
    Merge {
        /// The recordings.
        #[arg(required = true, num_args = 1..)]
        files: Vec<PathBuf>,
        /// Merges recordings of different rigs, rig files or sessions, or of the same time, too.
        #[arg(long)]
        force: bool,
        /// The new file; never overwritten.
        #[arg(short, long)]
        out: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// The scanner's volumes: when each began, which had no pulse, which pulses belong to none.
    /// Exit code 3 when a volume had no pulse, or the last ones were not seen.
    ///
    /// Example: farreach rec volumes S07.mcap -o volumes.csv --figure volumes.svg
    Volumes {
        /// The recording.
        file: PathBuf,
        /// Numbers the recorded pulses anew, with this repetition time TR (s); needed where no
        /// protocol counted volumes.
        #[arg(long, value_name = "TR")]
        repetition: Option<f64>,
        /// Which pulses, with --repetition, where both the trigger line and the key 5 gave some.
        #[arg(long, value_enum, requires = "repetition")]
        pulses: Option<PulseInput>,
        /// Number of volumes expected, with --repetition.
        #[arg(long, value_name = "N", requires = "repetition",
            value_parser = clap::value_parser!(u64).range(1..))]
        volumes: Option<u64>,
        /// Writes the volumes of all scans as CSV; the file must not exist.
        #[arg(short, long, value_name = "CSV")]
        out: Option<PathBuf>,
        /// Draws how far each volume was off (SVG); the file must not exist.
        #[arg(long, value_name = "SVG")]
        figure: Option<PathBuf>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// The model beside the machine, once more along the samples: when the machine departed from
    /// it, and whether the rows are those that were published live, to the last bit. Exit code 3
    /// where they are not.
    ///
    /// Example: farreach rec innovations S07.mcap --page S07-model.html
    Innovations {
        /// The recording.
        file: PathBuf,
        /// Writes the innovations as CSV; the file must not exist.
        #[arg(short, long, value_name = "CSV")]
        out: Option<PathBuf>,
        /// Writes a page with figures: innovations over time, position and velocity, sum and score,
        /// what happened, what to do next; the file must not exist.
        #[arg(long, value_name = "HTML")]
        page: Option<PathBuf>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Runs the cores of control, gate, watchdog and experiment again on the recorded inputs and
    /// compares every command, token, setpoint and decision of the gate with the recorded one, bit
    /// for bit; says why the watchdog tripped, and from what. Exit code 3 where something differs.
    ///
    /// Example: farreach rec resim run.mcap
    Resim {
        /// The recording.
        file: PathBuf,
        /// Also tries the gains of this rig file (a path, or the name of a shipped one) on the
        /// recorded inputs and tells by how much its volts differ. Open loop: with these gains the
        /// machine would have moved differently.
        #[arg(long, value_name = "FILE")]
        control: Option<PathBuf>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// The sessions of an experiment: when each began and how it ended, mean torque, activity of
    /// the muscles, what it had to match, and how well a guided one followed its reference. Exit
    /// code 3 when a session is not whole, or samples of one are missing.
    ///
    /// Example: farreach rec sessions S07.mcap -o sessions.csv
    Sessions {
        /// The recording.
        file: PathBuf,
        /// Writes the table as CSV; the file must not exist.
        #[arg(short, long, value_name = "CSV")]
        out: Option<PathBuf>,
        /// Draws what the subject had to match and what it did (SVG); the file must not exist.
        #[arg(long, value_name = "SVG")]
        figure: Option<PathBuf>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Writes for other programs: the measured record that `farreach identify` reads, all fields
    /// of one topic, MATLAB files, or part of a BIDS dataset.
    ///
    /// Example: farreach rec export run.mcap --to csv > run.csv;
    /// farreach rec export run.mcap --to parquet --topic sample -o sample.parquet;
    /// farreach rec export S07.mcap --to mat -o S07_;
    /// farreach rec export S07.mcap --to bids -o study
    Export {
        /// The recording.
        file: PathBuf,
        /// What to write.
        #[command(flatten)]
        options: ExportOptions,
    },
}

/// What `farreach rec export` writes.
#[derive(Clone, Debug, Args)]
pub struct ExportOptions {
    /// Format.
    #[arg(long, value_enum)]
    pub to: ExportFormat,
    /// All fields of this topic instead of the measured record (csv, parquet).
    #[arg(long)]
    pub topic: Option<String>,
    /// Unit of the axis, for the names of the columns of the measured record (csv, parquet).
    #[arg(long, value_enum, default_value_t = LengthUnit::Rad)]
    pub unit: LengthUnit,
    /// Axis of the measured record, from 0 (csv, parquet).
    #[arg(long, default_value_t = 0)]
    pub axis: usize,
    /// The new file, never overwritten (csv: stdout where not given; parquet); the name of the new
    /// files (mat); the folder of the dataset, new or not (bids).
    #[arg(
        short,
        long,
        required_if_eq_any([("to", "parquet"), ("to", "mat"), ("to", "bids")])
    )]
    pub out: Option<PathBuf>,
    /// How the runs are named in a dataset.
    #[command(flatten)]
    pub bids: BidsOptions,
}

/// How the runs of a recording are named in a BIDS dataset.
#[derive(Clone, Debug, Default, Args)]
pub struct BidsOptions {
    /// Subject; that of the recording, if left out (bids).
    #[arg(long, value_name = "LABEL")]
    pub subject: Option<String>,
    /// Session, of a subject that comes more than once (bids).
    #[arg(long, value_name = "LABEL")]
    pub session: Option<String>,
    /// Task; the name of the protocol, if left out (bids).
    #[arg(long, value_name = "LABEL")]
    pub task: Option<String>,
    /// Number of the first run of a task, as in the names of its images: 2, 02, or `none` where
    /// they have no run; 1, if left out (bids).
    #[arg(long, value_name = "N")]
    pub run: Option<FirstRun>,
    /// Number of the first volume that the scanner stored, from 0: its beginning is onset 0; 0, if
    /// left out (bids).
    #[arg(long, value_name = "N")]
    pub first_volume: Option<u64>,
}

impl BidsOptions {
    /// An option that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--subject", self.subject.is_some()),
            ("--session", self.session.is_some()),
            ("--task", self.task.is_some()),
            ("--run", self.run.is_some()),
            ("--first-volume", self.first_volume.is_some()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(option, _)| option)
    }
}

/// Formats of `farreach rec export`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Comma-separated values with a header.
    Csv,
    /// Apache Parquet: what csv has, with typed columns, and rig, session and units of the columns
    /// in the metadata of the file.
    Parquet,
    /// MATLAB, version 5: a file for each session, `OUT1.mat`, `OUT2.mat`, … (`OUT1_1.mat`, … of
    /// a recording with several runs; `OUT2_stopped.mat` for one that was stopped); `OUT.mat` for
    /// a recording without sessions. All signals with names and units, events, the subject's bar.
    Mat,
    /// Part of a dataset by the Brain Imaging Data Structure: of each run of a protocol the events,
    /// torque and other inputs, bar, positions, and EMG as BDF+.
    Bids,
}

/// Unit of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LengthUnit {
    /// A rotary axis: `master_rad`, `slave_rad`, `slave_torque_nm`.
    Rad,
    /// A linear axis: `master_m`, `slave_m`, `slave_force_n`.
    M,
}
