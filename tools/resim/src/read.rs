//! The messages of the cores out of a recording, in the order of publishing.

use std::collections::BTreeMap;

use ipc_types::{
    COMMAND, ENABLE_LINE, EnableLine, EnableToken, Message, MotorCommand, SAMPLE, SCANNER,
    SCANNER_KEY, SETPOINT, Sample, ScannerPulse, Setpoint, TOKEN,
};
use recording::mcap_read::{Channel, ReadError, Recording, Selection, in_order_of_time};
use recording::schema::Conversion;
use thiserror::Error;

use crate::history::Recorded;

/// Fields without which a core cannot be run again, each with its type; recordings of older builds
/// lack them. The setpoints of some that have them do not name their inputs yet: these alone are
/// left out.
const NEEDED: [(&str, &str); 3] = [
    (MotorCommand::ROS_NAME, "held_incarnation"),
    (Sample::ROS_NAME, "gate_ns"),
    (EnableToken::ROS_NAME, "samples_received"),
];

/// The first of the missing fields without which messages of a type cannot be used.
fn needed<T: Message>(missing: &[&'static str]) -> Option<&'static str> {
    missing.iter().copied().find(|field| NEEDED.contains(&(T::ROS_NAME, *field)))
}

/// Why the messages cannot be read.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum Error {
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The messages do not name what they were computed from.
    #[error(
        "topic {topic}: expected the field {field}, found none: the recording is of an older \
         build, whose messages do not say from what they were computed"
    )]
    OlderBuild { topic: String, field: &'static str },
}

/// A topic of the cores.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Sample,
    Setpoint,
    Command,
    Token,
    Line,
    Pulse,
    Key,
}

impl Kind {
    fn of(topic: &str) -> Option<Self> {
        let kinds = [
            (SAMPLE.topic, Self::Sample),
            (SETPOINT.topic, Self::Setpoint),
            (COMMAND.topic, Self::Command),
            (TOKEN.topic, Self::Token),
            (ENABLE_LINE.topic, Self::Line),
            (SCANNER.topic, Self::Pulse),
            (SCANNER_KEY.topic, Self::Key),
        ];
        kinds.into_iter().find(|(own, _)| own.name == topic).map(|(_, kind)| kind)
    }

    /// Hands a message on, unless its body is too short for one.
    fn hand_on(self, conversion: &Conversion, body: &[u8], take: &mut impl FnMut(Recorded<'_>)) {
        match self {
            Self::Sample => hand_on(conversion, body, |it| Recorded::Sample(it), take),
            Self::Setpoint => hand_on(conversion, body, |it| Recorded::Setpoint(it), take),
            Self::Command => hand_on(conversion, body, |it| Recorded::Command(it), take),
            Self::Token => hand_on(conversion, body, |it| Recorded::Token(it), take),
            Self::Line => hand_on(conversion, body, |it| Recorded::Line(it), take),
            Self::Pulse => hand_on(conversion, body, |it| Recorded::Pulse(it), take),
            Self::Key => hand_on(conversion, body, |it| Recorded::Key(it), take),
        }
    }
}

fn hand_on<T: Message>(
    conversion: &Conversion,
    body: &[u8],
    recorded: impl for<'a> FnOnce(&'a T) -> Recorded<'a>,
    take: &mut impl FnMut(Recorded<'_>),
) {
    if let Some(message) = conversion.apply::<T>(body) {
        take(recorded(&message));
    }
}

/// How the messages of a channel are read.
fn conversion<T: Message>(recording: &Recording, channel: &Channel) -> Result<Conversion, Error> {
    let layout = channel.layout.as_ref().map_err(|source| ReadError::Schema {
        path: recording.path().to_owned(),
        topic: channel.topic.clone(),
        source: source.clone(),
    })?;
    let conversion = layout.conversion::<T>();
    match needed::<T>(&conversion.missing) {
        Some(field) => Err(Error::OlderBuild { topic: channel.topic.clone(), field }),
        None => Ok(conversion),
    }
}

/// Hands the messages of the cores to `take`; returns how many damaged chunks were left out.
///
/// # Errors
/// [`enum@Error`].
pub fn read(recording: &Recording, mut take: impl FnMut(Recorded<'_>)) -> Result<u64, Error> {
    let mut channels = BTreeMap::new();
    for (&id, channel) in &recording.channels {
        let Some(kind) = Kind::of(&channel.topic) else { continue };
        let conversion = match kind {
            Kind::Sample => conversion::<Sample>(recording, channel),
            Kind::Setpoint => conversion::<Setpoint>(recording, channel),
            Kind::Command => conversion::<MotorCommand>(recording, channel),
            Kind::Token => conversion::<EnableToken>(recording, channel),
            Kind::Line => conversion::<EnableLine>(recording, channel),
            Kind::Pulse | Kind::Key => conversion::<ScannerPulse>(recording, channel),
        };
        channels.insert(id, (kind, conversion?));
    }
    let wanted = channels.keys().copied().collect();
    let selection = Selection { channels: Some(wanted), ..Selection::default() };
    let mut damaged = 0;
    in_order_of_time(&[recording], &selection, |_, raw| {
        let raw = match raw {
            Ok(raw) => raw,
            Err(ReadError::Damaged { .. }) => {
                damaged += 1;
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        if let Some((kind, conversion)) = channels.get(&raw.channel_id()) {
            let (_, body) = recording.decode(&raw)?;
            kind.hand_on(conversion, body, &mut take);
        }
        Ok::<(), Error>(())
    })?;
    Ok(damaged)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setpoint_may_lack_what_a_token_may_not() {
        let missing = ["player_ns", "samples_received"];
        assert_eq!(needed::<EnableToken>(&missing), Some("samples_received"));
        assert_eq!(needed::<Setpoint>(&missing), None);
    }
}
