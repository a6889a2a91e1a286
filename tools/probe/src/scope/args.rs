//! The command line of `farreach probe scope`.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};

use crate::attach;
use crate::scope::capture::{Mode, Settings};
use crate::scope::channel::Channel;
use crate::scope::trigger::Condition;

/// Divisions of the screen along time.
pub(crate) const DIVISIONS: u32 = 10;

/// Arguments of `scope`.
#[derive(Clone, Debug, Args)]
pub struct ScopeArgs {
    /// Signals by the names of the rig file (handle_torque, emg_1), an axis for all of its signals
    /// (handle), or TOPIC.FIELD[INDEX] (command.volts[0]) [default: the signals of the first axis]
    pub(crate) channels: Vec<String>,
    /// Reads a recording instead of a running rig, from trigger to trigger
    #[arg(long, value_name = "FILE.mcap")]
    pub(crate) file: Option<PathBuf>,
    /// Channel that triggers [default: the first]
    #[arg(long, value_name = "CHANNEL")]
    pub(crate) trigger: Option<String>,
    /// What that channel does when it triggers
    #[arg(long, value_enum, default_value_t = When::Rising)]
    pub(crate) when: When,
    /// Level of the trigger, in the channel's unit (rising, falling, above, below)
    #[arg(long, allow_negative_numbers = true, default_value_t = 0.0, value_parser = number)]
    pub(crate) level: f64,
    /// Band of the trigger, in the channel's unit (enters, leaves)
    #[arg(
        long,
        value_name = "LOW:HIGH",
        allow_hyphen_values = true,
        value_parser = band,
        conflicts_with = "level",
        required_if_eq_any([("when", "enters"), ("when", "leaves")])
    )]
    pub(crate) band: Option<Band>,
    /// How far beyond the level the channel must have been since the last trigger, in its unit:
    /// above its noise, so that a slow edge triggers once
    #[arg(long, default_value_t = 0.0, value_parser = distance)]
    pub(crate) hysteresis: f64,
    /// When windows are captured [default: auto; of a recording normal; with --out single]
    #[arg(long, value_enum)]
    pub(crate) mode: Option<Mode>,
    /// Length of a window, ten divisions of the screen (s)
    #[arg(long, default_value_t = 1.0, value_parser = window)]
    pub(crate) seconds: f64,
    /// Share of the window before the trigger, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.2, value_parser = share)]
    pub(crate) pre_trigger: f64,
    /// Waits for the trigger without a screen, writes the window to a file and ends: a figure
    /// (.svg), a table (.csv), or the messages themselves (.mcap). Never overwrites one. Exit code
    /// 3 if messages are missing within the window
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Gives up where nothing triggers within this time (s) [default: waits]
    #[arg(long, value_name = "SECONDS", requires = "out", value_parser = timeout)]
    pub(crate) timeout: Option<f64>,
}

/// Two levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Band(f64, f64);

/// What a channel does when it triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum When {
    /// Rises to the level
    Rising,
    /// Falls to the level
    Falling,
    /// Is at the level or above it
    Above,
    /// Is at the level or below it
    Below,
    /// Comes into the band
    Enters,
    /// Leaves the band
    Leaves,
}

impl ScopeArgs {
    fn condition(&self) -> Condition {
        // The command line requires a band for those that need one.
        let Band(low, high) = self.band.unwrap_or(Band(self.level, self.level));
        match self.when {
            When::Rising => Condition::Rising(self.level),
            When::Falling => Condition::Falling(self.level),
            When::Above => Condition::Above(self.level),
            When::Below => Condition::Below(self.level),
            When::Enters => Condition::Enters(low, high),
            When::Leaves => Condition::Leaves(low, high),
        }
    }

    /// The names of all channels, that of the trigger among them.
    pub(crate) fn channels(&self) -> Vec<String> {
        let mut channels = self.channels.clone();
        if !channels.is_empty() {
            channels.extend(self.trigger.clone());
        }
        channels
    }

    /// What is captured, of these channels.
    ///
    /// # Errors
    /// If the mode does not suit where the messages come from and go to.
    pub(crate) fn settings(&self, channels: &[Channel]) -> anyhow::Result<Settings> {
        let usual = match (&self.out, &self.file) {
            (Some(_), _) => Mode::Single,
            (None, Some(_)) => Mode::Normal,
            (None, None) => Mode::Auto,
        };
        let mode = self.mode.unwrap_or(usual);
        if mode == Mode::Roll && (self.out.is_some() || self.file.is_some()) {
            bail!(
                "--mode roll shows a running rig on a screen: with --out or --file, use auto, \
                 normal or single"
            );
        }
        let named = |channel: &&Channel| match &self.trigger {
            Some(name) => channel.name == *name,
            None => true,
        };
        let Some(channel) = channels.iter().find(named) else {
            let names: Vec<_> = channels.iter().map(|channel| channel.name.as_str()).collect();
            bail!(
                "--trigger {}: expected one of the channels: {}",
                self.trigger.as_deref().unwrap_or_default(),
                names.join(", ")
            );
        };
        let window_ns = attach::ns(self.seconds);
        Ok(Settings {
            mode,
            window_ns,
            pre_ns: (window_ns as f64 * self.pre_trigger).round() as u64,
            auto_ns: window_ns.max(AUTO_NS),
            channel: channel.place,
            condition: self.condition(),
            hysteresis: self.hysteresis,
        })
    }
}

/// Shortest time without a trigger after which `auto` captures (ns).
pub(crate) const AUTO_NS: u64 = 500_000_000;

fn number(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or("expected a number".to_owned())
}

fn distance(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|value| *value >= 0.0).ok_or("expected a number, 0 or more".to_owned())
}

fn band(text: &str) -> Result<Band, String> {
    let pair = text.split_once(':').and_then(|(low, high)| {
        let pair = (number(low.trim()).ok()?, number(high.trim()).ok()?);
        (pair.0 < pair.1).then_some(Band(pair.0, pair.1))
    });
    pair.ok_or("expected two numbers LOW:HIGH, the lower one first, such as -0.5:0.5".to_owned())
}

fn share(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|share| (0.0..=1.0).contains(share))
        .ok_or("expected a number from 0 to 1".to_owned())
}

fn window(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|seconds| (0.001..=100.0).contains(seconds))
        .ok_or("expected a time from 0.001 to 100 s".to_owned())
}

fn timeout(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|seconds| (0.001..=86_400.0).contains(seconds))
        .ok_or("expected a time from 0.001 to 86400 s".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: ScopeArgs,
    }

    fn settings(words: &[&str]) -> anyhow::Result<Settings> {
        let line = Line::try_parse_from(std::iter::once("scope").chain(words.iter().copied()))?;
        let channel =
            |name: &str, place| Channel { name: name.to_owned(), unit: "V".into(), place };
        line.args.settings(&[channel("a", (0, 0)), channel("b", (1, 2))])
    }

    #[test]
    fn the_command_line_gives_trigger_and_window() {
        let usual = settings(&[]).unwrap();
        assert_eq!((usual.mode, usual.channel), (Mode::Auto, (0, 0)));
        assert_eq!((usual.window_ns, usual.pre_ns), (1_000_000_000, 200_000_000));
        assert_eq!(usual.condition, Condition::Rising(0.0));
        let words = ["a", "b", "--trigger", "b", "--when", "falling", "--level", "-2.5"];
        let falling = settings(&words).unwrap();
        assert_eq!((falling.channel, falling.condition), ((1, 2), Condition::Falling(-2.5)));
        let words = ["--when", "leaves", "--band", "-1:2.5", "--seconds", "0.05", "--out", "x.svg"];
        let leaves = settings(&words).unwrap();
        assert_eq!((leaves.mode, leaves.condition), (Mode::Single, Condition::Leaves(-1.0, 2.5)));
        assert_eq!((leaves.window_ns, leaves.auto_ns), (50_000_000, AUTO_NS));
        assert_eq!(settings(&["--file", "x.mcap"]).unwrap().mode, Mode::Normal);
    }

    #[test]
    fn what_cannot_be_is_refused_and_says_what_can() {
        for (words, expected) in [
            (&["--when", "enters"][..], "--band"),
            (&["--when", "enters", "--band", "2:1"][..], "the lower one first"),
            (&["--seconds", "0"][..], "from 0.001 to 100 s"),
            (&["--pre-trigger", "2"][..], "from 0 to 1"),
            (&["--hysteresis=-1"][..], "0 or more"),
            (&["--level", "nan"][..], "expected a number"),
            (&["--timeout", "3"][..], "--out"),
            (&["--mode", "roll", "--file", "x.mcap"][..], "auto, normal or single"),
            (&["a", "--trigger", "c"][..], "expected one of the channels: a, b"),
        ] {
            let error = settings(words).unwrap_err().to_string();
            assert!(error.contains(expected), "{words:?}: {error}");
        }
    }

    #[test]
    fn the_channel_that_triggers_is_shown_too() {
        let channels = |words: &[&str]| {
            let words = std::iter::once("scope").chain(words.iter().copied());
            Line::try_parse_from(words).unwrap().args.channels()
        };
        assert_eq!(channels(&["a", "--trigger", "b"]), ["a", "b"]);
        assert_eq!(channels(&["--trigger", "handle_torque"]), [""; 0]);
    }
}
