//! Records of machines with one channel: noise of the force channel, steps of the converters, and
//! the file.

use std::f64::consts::TAU;
use std::io::{self, Write};

use serde::{Deserialize, Serialize};

use super::Kind;
use super::machine::Machine;
use super::simulator::Track;
use crate::random::Draw;

/// Noise of a force channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Noise {
    /// White and normal.
    #[default]
    White,
    /// White, one row in twenty five times as large.
    HeavyTailed,
    /// White, with a slow random walk of about its size at the end.
    Wandering,
    /// A square wave near half the rate of the rows, as a pulse-width modulation leaves.
    Switched,
}

impl Noise {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::White, Self::HeavyTailed, Self::Wandering, Self::Switched];

    /// So many values of it.
    pub fn values(self, size: f64, rows: usize, draw: &mut Draw) -> Vec<f64> {
        let (rate, phase) = (TAU * draw.uniform(0.31, 0.49), draw.phase());
        let mut walk = 0.0;
        let step = 1.0 / (rows.max(1) as f64).sqrt();
        (0..rows)
            .map(|row| {
                let white = size * draw.normal();
                match self {
                    Self::White => white,
                    Self::HeavyTailed if draw.below(20) == 0 => 5.0 * white,
                    Self::HeavyTailed => 0.7 * white,
                    Self::Wandering => {
                        walk += step * size * draw.normal();
                        white + walk
                    }
                    Self::Switched => {
                        0.3 * white + 1.2 * size * (rate * row as f64 + phase).sin().signum()
                    }
                }
            })
            .collect()
    }
}

/// A record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Rows per second.
    pub row_hz: f64,
    /// The header of the file.
    pub header: &'static str,
    /// Force, or input.
    pub force: Vec<f64>,
    /// Position, or output.
    pub position: Vec<f64>,
}

impl Record {
    /// What the instruments write of a track.
    pub fn of(
        machine: &Machine,
        track: &Track,
        (noise, size): (Noise, f64),
        output_noise: f64,
        draw: &mut Draw,
    ) -> Self {
        let rows = track.force.len();
        let noisy = noise.values(size, rows, draw);
        let step = 0.05 * size.max(1e-9 * machine.force_scale());
        let force =
            track.force.iter().zip(noisy).map(|(f, n)| ((f + n) / step).round() * step).collect();
        let position = track.position.iter().map(|x| x + output_noise * draw.normal()).collect();
        let header = match (machine.kind, machine.rotary) {
            (Kind::Oscillator, _) => "t_s,input,output",
            (_, false) => "t_s,force_n,position_m",
            (_, true) => "t_s,torque_nm,position_rad",
        };
        Self { row_hz: machine.row_hz, header, force, position }
    }

    /// Writes it as a CSV file.
    ///
    /// # Errors
    /// What the writer says.
    pub fn write(&self, to: &mut impl Write) -> io::Result<()> {
        writeln!(to, "{}", self.header)?;
        for (row, (force, position)) in self.force.iter().zip(&self.position).enumerate() {
            writeln!(to, "{:.4},{force:.7e},{position:.8e}", row as f64 / self.row_hz)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_about_its_size() {
        for noise in Noise::ALL {
            let values = noise.values(0.5, 20_000, &mut Draw::new(2));
            let rms = (values.iter().map(|v| v * v).sum::<f64>() / 20_000.0).sqrt();
            assert!((0.4..1.6).contains(&rms), "{noise:?}: {rms}");
        }
    }
}
