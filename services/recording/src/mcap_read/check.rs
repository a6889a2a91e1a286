//! Checks a whole recording: what is in it and what is missing.

use std::collections::BTreeMap;

use ipc_types::{Arrival, SAMPLE, SequenceTracker};

use super::filled_in::{FilledInFollower, Taken, TakenFields};
use super::{Channel, Damage, FilledIn, RawMessage, ReadError, Recording, Selection, threads};
use crate::mcap_write::END_RECORD;
use crate::schema::{LayoutField, unsigned};

/// The result for one topic.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct TopicCheck {
    /// Topic.
    pub topic: String,
    /// Message type.
    #[serde(rename = "type")]
    pub schema_name: String,
    /// Messages in the file.
    pub count: u64,
    /// Log time of the first (ns since 1970).
    pub first_ns: u64,
    /// Log time of the last (ns since 1970).
    pub last_ns: u64,
    /// Messages missing by their sequence, [`Self::gaps_before`] among them.
    pub gaps: u64,
    /// Number of gaps.
    pub gap_places: u64,
    /// Messages that are repeated or out of order.
    pub duplicates: u64,
    /// Incarnations of the sender.
    pub incarnations: u64,
    /// Messages that cannot be decoded.
    pub undecodable: u64,
    /// Why, for the first of them.
    pub problem: String,
    /// Messages that the logger itself dropped or the disk refused, from the end record.
    pub dropped: u64,
    /// The part of `gaps` that lies between the part before this one and its first message.
    pub gaps_before: u64,
}

impl TopicCheck {
    /// Mean rate (Hz); `None` with fewer than two messages or no time between them.
    pub fn rate_hz(&self) -> Option<f64> {
        rate_hz(self.count, self.first_ns, self.last_ns)
    }
}

/// See [`TopicCheck::rate_hz`].
pub(super) fn rate_hz(count: u64, first_ns: u64, last_ns: u64) -> Option<f64> {
    let span = last_ns.checked_sub(first_ns).filter(|&span| span > 0)?;
    (count > 1).then(|| (count - 1) as f64 / (span as f64 * 1e-9))
}

/// Continuity of the acquisition grid in topic `sample`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Ticks {
    /// First tick.
    pub first: u64,
    /// Last tick.
    pub last: u64,
    /// Ticks between them without a sample.
    pub missing: u64,
    /// Number of gaps that they make.
    pub holes: u64,
    /// Samples whose tick is not above the one before.
    pub backwards: u64,
}

/// The result of checking a recording.
#[derive(Clone, Debug, Default)]
pub struct Check {
    /// By topic; topics without messages are listed too.
    pub topics: Vec<TopicCheck>,
    /// Records and chunks that cannot be read.
    pub damage: Vec<Damage>,
    /// The acquisition grid; `None` without samples.
    pub ticks: Option<Ticks>,
    /// Whether the scans are those of the simulated card.
    pub simulated: bool,
    /// Scans that the simulated card filled in late; `None` where there was none, or the recording,
    /// of an older build, does not tell.
    pub filled_in: Option<FilledIn>,
    /// Whether footer and end mark are in place.
    pub complete: bool,
    /// See [`super::Tail::being_written`].
    pub being_written: bool,
    /// A recording of farreach's that ended cleanly; `true` for files of other programs.
    pub ended_cleanly: bool,
    /// Log time of the first message since the recording began (ns since 1970): the first of all,
    /// but for events that happened before. `None` without messages.
    pub origin_ns: Option<u64>,
}

impl Check {
    /// Whether anything is missing or damaged.
    pub fn data_lost(&self) -> bool {
        !(self.complete && self.ended_cleanly || self.being_written)
            || !self.damage.is_empty()
            || self.topics.iter().any(|t| t.gaps > 0 || t.dropped > 0 || t.undecodable > 0)
            || self.ticks.is_some_and(|ticks| ticks.missing > 0)
    }

    /// First and last log time of all topics (ns since 1970).
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let filled = || self.topics.iter().filter(|topic| topic.count > 0);
        Some((filled().map(|t| t.first_ns).min()?, filled().map(|t| t.last_ns).max()?))
    }

    /// Messages in the file.
    pub fn messages(&self) -> u64 {
        self.topics.iter().map(|topic| topic.count).sum()
    }
}

#[derive(Default)]
struct Follow {
    check: TopicCheck,
    tracker: SequenceTracker,
}

impl Follow {
    /// Counts one message by its log time and sequence number.
    fn count(&mut self, log_time_ns: u64, incarnation: u64, sequence: u64) {
        let check = &mut self.check;
        let first = check.count == 0;
        check.first_ns = if first { log_time_ns } else { check.first_ns.min(log_time_ns) };
        check.last_ns = check.last_ns.max(log_time_ns);
        check.count += 1;
        if let Arrival::Gap(missing) = self.tracker.observe(incarnation, sequence)
            && first
        {
            check.gaps_before = missing;
        }
    }

    fn undecodable(&mut self, problem: String) {
        self.check.undecodable += 1;
        if self.check.problem.is_empty() {
            self.check.problem = problem;
        }
    }

    fn finish(self) -> TopicCheck {
        TopicCheck {
            gaps: self.tracker.gaps(),
            gap_places: self.tracker.gap_places(),
            duplicates: self.tracker.duplicates(),
            incarnations: self.tracker.incarnations(),
            ..self.check
        }
    }
}

/// What the check takes from one message.
struct Seen {
    channel_id: u16,
    time_ns: u64,
    header_sequence: u64,
    /// What stands in it, or why it cannot be decoded.
    content: Result<Content, String>,
}

struct Content {
    incarnation: u64,
    sequence: u64,
    tick: Option<u64>,
    taken: Option<Taken>,
}

/// The fields that the check reads, of one channel.
struct Fields<'a> {
    incarnation: Option<&'a LayoutField>,
    sequence: Option<&'a LayoutField>,
    /// Of samples alone.
    tick: Option<&'a LayoutField>,
    taken: Option<TakenFields<'a>>,
}

impl<'a> Fields<'a> {
    fn of(channel: &'a Channel) -> Option<Self> {
        let layout = channel.layout.as_ref().ok()?;
        let is_sample = channel.topic == SAMPLE.topic.name;
        Some(Self {
            incarnation: layout.field("incarnation"),
            sequence: layout.field("sequence"),
            tick: layout.field("tick").filter(|_| is_sample),
            taken: TakenFields::of(&channel.topic, layout),
        })
    }

    fn read(&self, header_sequence: u64, body: &[u8]) -> Content {
        let read = |field: Option<&LayoutField>| unsigned(field?, body);
        Content {
            incarnation: read(self.incarnation).unwrap_or(0),
            sequence: read(self.sequence).unwrap_or(header_sequence),
            tick: read(self.tick),
            taken: self.taken.as_ref().and_then(|fields| fields.read(body)),
        }
    }
}

/// What was found so far, message by message in the order of the file.
struct Progress {
    followed: Vec<Follow>,
    /// Place in `followed` by number of the channel.
    topics: BTreeMap<u16, usize>,
    damage: Vec<Damage>,
    began_ns: u64,
    origin_ns: Option<u64>,
    ticks: Option<Ticks>,
    filled_in: FilledInFollower,
}

impl Progress {
    fn take(&mut self, seen: Seen) {
        let Some(follow) =
            self.topics.get(&seen.channel_id).and_then(|at| self.followed.get_mut(*at))
        else {
            let what = format!("a message of the unknown channel {}", seen.channel_id);
            self.damage.push(Damage { offset: 0, what });
            return;
        };
        let time_ns = seen.time_ns;
        if time_ns >= self.began_ns {
            self.origin_ns = Some(self.origin_ns.map_or(time_ns, |origin| origin.min(time_ns)));
        }
        match seen.content {
            Ok(content) => {
                follow.count(time_ns, content.incarnation, content.sequence);
                if let Some(taken) = content.taken {
                    self.filled_in.take(taken);
                }
                if let Some(tick) = content.tick {
                    step(&mut self.ticks, tick);
                }
            }
            Err(problem) => {
                follow.count(time_ns, 0, seen.header_sequence);
                follow.undecodable(problem);
            }
        }
    }
}

impl Recording {
    /// Reads every message: counts, times, gaps, duplicates, checksums, schemas, ticks. Chunks are
    /// read on all processors; the result is that of one.
    ///
    /// # Errors
    /// [`ReadError::Io`] only; damage is part of the result.
    pub fn check(&self) -> Result<Check, ReadError> {
        self.check_on(threads())
    }

    /// As [`Self::check`], on so many threads.
    ///
    /// # Errors
    /// [`ReadError::Io`].
    pub fn check_on(&self, threads: usize) -> Result<Check, ReadError> {
        let wrong = |source| ReadError::Io { path: self.path().to_owned(), source };
        let (followed, topics) = self.followed_topics();
        let mut progress = Progress {
            followed,
            topics,
            damage: self.damage.to_vec(),
            began_ns: self.began_ns().unwrap_or(0),
            origin_ns: None,
            ticks: None,
            filled_in: FilledInFollower::default(),
        };
        let whole = std::thread::scope(|scope| {
            // Beside the chunks, as it needs no more of them than their bytes.
            let whole = self.data_end.map(|end| scope.spawn(move || end.verify(&self.file)));
            self.follow(threads, &mut progress)?;
            let joined = whole.map(|whole| whole.join());
            joined
                .transpose()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                .transpose()
                .map_err(wrong)
        })?;
        let Progress { followed, mut damage, origin_ns, ticks, filled_in, .. } = progress;
        let topics: Vec<TopicCheck> = followed.into_iter().map(Follow::finish).collect();
        if damage.is_empty() {
            damage.extend(whole.flatten().or_else(|| self.miscounted(&topics)));
        }
        let first_ns = topics.iter().filter(|t| t.count > 0).map(|t| t.first_ns).min();
        Ok(Check {
            topics,
            damage,
            ticks,
            simulated: filled_in.simulated(),
            filled_in: filled_in.found(),
            complete: self.tail.complete,
            being_written: self.tail.being_written,
            ended_cleanly: self.ended_as_expected(),
            origin_ns: origin_ns.or(first_ns),
        })
    }

    /// Reads every message on so many threads, and takes what the check needs of it.
    fn follow(&self, threads: usize, progress: &mut Progress) -> Result<(), ReadError> {
        let fields: BTreeMap<u16, Fields<'_>> = self
            .channels
            .iter()
            .filter_map(|(id, channel)| Some((*id, Fields::of(channel)?)))
            .collect();
        let seen = |message: &RawMessage| {
            let header_sequence = u64::from(message.sequence());
            let fields = fields.get(&message.channel_id());
            let content = match self.decode(message) {
                Ok((_, body)) => {
                    let read = fields.map(|fields| fields.read(header_sequence, body));
                    read.ok_or_else(String::new)
                }
                Err(ReadError::Schema { source, .. }) => Err(source.to_string()),
                Err(other) => Err(other.to_string()),
            };
            let (channel_id, time_ns) = (message.channel_id(), message.log_time_ns());
            Seen { channel_id, time_ns, header_sequence, content }
        };
        let work = |messages: Result<Vec<RawMessage>, ReadError>| {
            messages.map(|messages| messages.iter().map(&seen).collect::<Vec<Seen>>())
        };
        self.in_order_on(threads, &Selection::default(), work, |found| {
            match found {
                Ok(found) => found.into_iter().for_each(|seen| progress.take(seen)),
                Err(ReadError::Damaged { offset, source, .. }) => {
                    progress.damage.push(Damage { offset, what: format!("chunk: {source}") });
                }
                Err(error) => return Err(error),
            }
            Ok(())
        })
    }

    /// Where the summary counts more or fewer messages than there are.
    fn miscounted(&self, topics: &[TopicCheck]) -> Option<Damage> {
        let counts = self.counts.as_ref()?;
        let counted = |topic: &str| {
            let channels = self.channels.iter().filter(|(_, channel)| channel.topic == topic);
            channels.filter_map(|(id, _)| counts.get(id)).sum::<u64>()
        };
        let wrong = topics.iter().find(|check| check.count != counted(&check.topic))?;
        let TopicCheck { topic, count, .. } = wrong;
        let what = format!(
            "the summary counts {} messages of {topic}, and there are {count}",
            counted(topic)
        );
        Some(Damage { offset: self.data_end.map_or(0, |end| end.offset), what })
    }

    /// The topics in the order of their names, with what the metadata say of their losses, and the
    /// place of each channel's. Channels of one topic (in merged files) count together.
    fn followed_topics(&self) -> (Vec<Follow>, BTreeMap<u16, usize>) {
        let mut topics: BTreeMap<&str, Follow> = BTreeMap::new();
        for channel in self.channels.values() {
            let Follow { check, .. } = topics.entry(&channel.topic).or_default();
            check.topic.clone_from(&channel.topic);
            check.schema_name.clone_from(&channel.schema_name);
            check.dropped = self.dropped(&channel.topic);
        }
        for (topic, position) in self.continues() {
            if let Some(follow) = topics.get_mut(topic.as_str()) {
                follow.tracker.resume(position.incarnation, position.next);
            }
        }
        let places: BTreeMap<&str, usize> = topics.keys().copied().zip(0..).collect();
        let place =
            |(id, channel): (&u16, &Channel)| Some((*id, *places.get(channel.topic.as_str())?));
        let of_channels = self.channels.iter().filter_map(place).collect();
        (topics.into_values().collect(), of_channels)
    }

    /// Messages of a topic that the logger itself dropped or the disk refused, by the end record.
    pub fn dropped(&self, topic: &str) -> u64 {
        let losses = self
            .records(END_RECORD)
            .flat_map(|end| ["dropped", "refused"].map(|loss| end.get(&format!("{topic}.{loss}"))));
        losses.filter_map(|count| count?.parse::<u64>().ok()).sum()
    }
}

fn step(ticks: &mut Option<Ticks>, tick: u64) {
    let Some(ticks) = ticks else {
        *ticks = Some(Ticks { first: tick, last: tick, ..Ticks::default() });
        return;
    };
    if tick <= ticks.last {
        ticks.backwards += 1;
        return;
    }
    let missing = tick - ticks.last - 1;
    ticks.missing += missing;
    ticks.holes += u64::from(missing > 0);
    ticks.last = tick;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(count: u64, first_ns: u64, last_ns: u64) -> TopicCheck {
        TopicCheck { count, first_ns, last_ns, ..TopicCheck::default() }
    }

    fn sound() -> Check {
        Check {
            topics: vec![topic(5, 100, 900), topic(0, 0, 0), topic(2, 50, 700)],
            ticks: Some(Ticks { first: 1, last: 9, ..Ticks::default() }),
            complete: true,
            ended_cleanly: true,
            ..Check::default()
        }
    }

    #[test]
    fn data_are_lost_where_anything_is_missing_or_damaged() {
        assert!(!sound().data_lost());
        assert!(!Check { ticks: None, ..sound() }.data_lost());
        // The end of a recording that is still being written is yet to come.
        let growing = Check { complete: false, ended_cleanly: false, ..sound() };
        assert!(!Check { being_written: true, ..growing }.data_lost());
        let spoilt: [fn(&mut Check); 7] = [
            |check| check.complete = false,
            |check| check.ended_cleanly = false,
            |check| check.damage.push(Damage { offset: 0, what: String::new() }),
            |check| check.topics[1].gaps = 1,
            |check| check.topics[1].dropped = 1,
            |check| check.topics[1].undecodable = 1,
            |check| check.ticks = check.ticks.map(|ticks| Ticks { missing: 1, ..ticks }),
        ];
        for (case, spoil) in spoilt.into_iter().enumerate() {
            let mut check = sound();
            spoil(&mut check);
            assert!(check.data_lost(), "case {case}");
        }
        // Disorder loses nothing.
        let mut disorder = sound();
        disorder.topics[0].duplicates = 1;
        disorder.ticks = disorder.ticks.map(|ticks| Ticks { backwards: 1, ..ticks });
        assert!(!disorder.data_lost());
    }

    #[test]
    fn span_rate_and_number_are_those_of_the_topics_with_messages() {
        assert_eq!((sound().span_ns(), sound().messages()), (Some((50, 900)), 7));
        let empty = Check { topics: vec![topic(0, 0, 0)], ..Check::default() };
        assert_eq!((empty.span_ns(), empty.messages()), (None, 0));
        assert_eq!(topic(5, 100, 900).rate_hz(), Some(5e6));
        assert_eq!(topic(2, 100, 100).rate_hz(), None, "no time between them");
        assert_eq!(topic(1, 100, 900).rate_hz(), None, "one message has no rate");
    }
}
