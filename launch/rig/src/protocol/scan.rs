//! `[scanner]`: what a protocol expects of the scan.

use scanner::{REPETITION_S, Series};

use crate::checked_toml::{Keys, Section, bounds};

/// What a protocol expects of the scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan {
    /// Repetition time, number of volumes, tolerance.
    pub series: Series,
    /// Whether the segments keep to the scanner's clock, once it has sent a pulse.
    pub in_step: bool,
}

pub(super) const KEYS: Keys = &[
    ("repetition_s", "Repetition time TR: from volume to volume."),
    (
        "volumes",
        "Number of volumes in the whole protocol; without it, the last ones may be missing unseen.",
    ),
    ("tolerance_s", "A pulse further than this from its time belongs to no volume."),
    ("in_step", "Whether the segments keep to the scanner's clock, once it has sent a pulse."),
];

/// Largest number of volumes of a scan.
const VOLUMES: u64 = 1_000_000;
/// Largest tolerance, as a share of the repetition time: beyond it two volumes could be meant.
const LARGEST_TOLERANCE: f64 = 0.25;

impl Scan {
    /// Reads the section; `None` where it is not in the file.
    pub(super) fn read(section: Section<'_>) -> Option<Self> {
        section.document("[scanner]", KEYS);
        if !section.exists() {
            return None;
        }
        let (shortest, longest) = REPETITION_S;
        let repetition_s = section
            .number("repetition_s", bounds(shortest, longest, "TR, in s; usual is 0.5 to 3"));
        let volumes = section.whole_or_none("volumes", 1, VOLUMES, "as set on the scanner");
        let usual = Series::new(repetition_s, volumes);
        let bounds = bounds(1e-4, 10.0, "in s; more than the jitter of the trigger");
        let tolerance_s = section.number_or_none("tolerance_s", bounds);
        let tolerance_s = tolerance_s.unwrap_or(usual.tolerance_s);
        let most = LARGEST_TOLERANCE * repetition_s;
        if tolerance_s > most {
            let expected = format!("at most a quarter of repetition_s ({most} s)");
            section.problem("tolerance_s", expected, tolerance_s, "lower it");
        }
        Some(Self {
            series: Series { tolerance_s, ..usual },
            in_step: section.flag_or("in_step", true),
        })
    }
}
