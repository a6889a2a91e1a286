//! Measured columns, and the checks that are common to all models.

pub use plant::effects::one_channel::samples::step_of;

use crate::equation_error::block_roles::Role;
use crate::error::{IdentifyError, Result};

/// One record, as columns.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// File or segment, for messages.
    pub file: String,
    /// Name and values, in the order of the file.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Role fixed on the command line.
    pub role: Option<Role>,
    /// Remarks of the reader.
    pub notes: Vec<String>,
}

/// Largest relative deviation of a time step from the median.
const JITTER: f64 = 0.05;

impl Series {
    /// The column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.0 == name).map(|c| c.1.as_slice())
    }

    /// The first of these columns that exists.
    ///
    /// # Errors
    /// If there is none.
    pub fn any(&self, names: &[&'static str]) -> Result<(&'static str, &[f64])> {
        names.iter().find_map(|n| self.column(n).map(|c| (*n, c))).ok_or_else(|| {
            let found: Vec<&str> = self.columns.iter().map(|c| c.0.as_str()).collect();
            IdentifyError::Unusable(format!(
                "{}: expected a column {}, found {}; SI units, names as in `farreach identify \
                 --help`",
                self.file,
                names.join(" or "),
                found.join(", ")
            ))
        })
    }

    /// The time column, checked: finite, ascending, uniform.
    ///
    /// # Errors
    /// At the first row that breaks the rule; for fewer than three rows.
    pub fn time(&self) -> Result<&[f64]> {
        let (name, time) = self.any(&["t_s"])?;
        self.finite(name)?;
        if time.len() < 3 {
            return Err(self.short(time.len()));
        }
        let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
        let unsorted = steps.clone();
        steps.sort_by(f64::total_cmp);
        let median = steps[steps.len() / 2];
        for (i, step) in unsorted.iter().enumerate() {
            let (expected, advice) = if *step <= 0.0 {
                (
                    "a later time than the row before".to_owned(),
                    "sort the rows and take doubles out",
                )
            } else if (step - median).abs() > JITTER * median {
                (
                    format!("a step of {median:.6} s"),
                    "cut the record at the gap, or resample it uniformly",
                )
            } else {
                continue;
            };
            let found = format!("a step of {step:.6} s");
            return Err(self.cell((i + 2, name), found, expected, advice));
        }
        Ok(time)
    }

    /// Checks that every value of a column is a number.
    ///
    /// # Errors
    /// At the first that is not.
    pub fn finite(&self, name: &str) -> Result<()> {
        let values = self.column(name).unwrap_or(&[]);
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(i) => {
                let advice = "cut the record there; holes are never filled in silently";
                Err(self.cell((i + 1, name), values[i], "a finite number", advice))
            }
        }
    }

    /// The error for one value; the first row below the header is 1.
    fn cell(
        &self,
        (row, column): (usize, &str),
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
        advice: &str,
    ) -> IdentifyError {
        IdentifyError::Unusable(format!(
            "{}, row {row}, column `{column}`: found {found}, expected {expected}; {advice}",
            self.file
        ))
    }

    /// Checks that a channel varies and takes ten different values or more.
    ///
    /// # Errors
    /// If it does not.
    pub fn alive(&self, name: &str, what: &str) -> Result<()> {
        let values = self.column(name).unwrap_or(&[]);
        let first = values.first().copied().unwrap_or(0.0);
        let channel = |found: String, advice: &str| {
            Err(IdentifyError::channel(&self.file, name, found, advice))
        };
        if values.iter().all(|v| *v == first) {
            return channel(
                format!("{what} never changes (it is {first} in all {} rows)", values.len()),
                "check the sensor and its channel, and excite the machine",
            );
        }
        let mut distinct: Vec<u64> = values.iter().map(|v| v.to_bits()).collect();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() < 10 {
            return channel(
                format!("{what} takes {} different values only", distinct.len()),
                "record with a finer resolution, or a larger movement",
            );
        }
        Ok(())
    }

    /// Share of rows in runs of at least five rows at the largest or smallest value of the column:
    /// a clipped channel.
    pub fn railed(&self, name: &str) -> f64 {
        let values = self.column(name).unwrap_or(&[]);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let (mut rows, mut run) = (0, 0);
        for (i, v) in values.iter().enumerate() {
            run = if *v == high || *v == low { run + 1 } else { 0 };
            let ends = values.get(i + 1).is_none_or(|next| next != v);
            if ends && run >= 5 {
                rows += run;
            }
            if ends {
                run = 0;
            }
        }
        rows as f64 / values.len().max(1) as f64
    }

    /// The error for too few rows.
    pub fn short(&self, rows: usize) -> IdentifyError {
        let expected = "at least 2 s of movement at 50 Hz or more";
        IdentifyError::short(&self.file, format!("{rows} rows"), expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(time: Vec<f64>) -> Series {
        Series {
            file: "a.csv".into(),
            columns: vec![("t_s".into(), time)],
            role: None,
            notes: Vec::new(),
        }
    }

    #[test]
    fn time_that_stops_or_jumps_is_refused_with_its_row() {
        assert!(series((0..10).map(|i| f64::from(i) * 0.1).collect()).time().is_ok());
        let mut gap: Vec<f64> = (0..10).map(|i| f64::from(i) * 0.1).collect();
        gap[7..].iter_mut().for_each(|t| *t += 0.3);
        let text = series(gap).time().unwrap_err().to_string();
        assert!(text.contains("row 8") && text.contains("0.400000 s"), "{text}");
        let text = series(vec![0.0, 0.1, 0.1, 0.2]).time().unwrap_err().to_string();
        assert!(text.contains("row 3"), "{text}");
        let text = series(vec![0.0, 0.1, f64::NAN, 0.3]).time().unwrap_err().to_string();
        assert!(text.contains("row 3") && text.contains("NaN"), "{text}");
    }

    #[test]
    fn constant_and_clipped_channels_are_detected() {
        let mut s = series(vec![0.0; 20]);
        s.columns.push(("dead".into(), vec![4.0; 20]));
        s.columns.push(("coarse".into(), (0..20).map(|i| f64::from(i % 3)).collect()));
        s.columns.push(("railed".into(), (0..20).map(|i| f64::from(i).min(9.0)).collect()));
        assert!(s.alive("dead", "x").unwrap_err().to_string().contains("never changes"));
        assert!(s.alive("coarse", "x").unwrap_err().to_string().contains("3 different"));
        assert!((s.railed("railed") - 11.0 / 20.0).abs() < 1e-12);
        assert!(s.any(&["force_n"]).unwrap_err().to_string().contains("t_s, dead, coarse, railed"));
    }
}
