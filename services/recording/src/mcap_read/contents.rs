//! What is in a recording: counts and times of its topics, without reading all of it.

use std::collections::BTreeMap;

use super::block::Block;
use super::check::rate_hz;
use super::{Check, ReadError, Recording};

/// What is in one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct TopicContents {
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
}

impl TopicContents {
    /// Mean rate (Hz); `None` with fewer than two messages or no time between them.
    pub fn rate_hz(&self) -> Option<f64> {
        rate_hz(self.count, self.first_ns, self.last_ns)
    }
}

/// What is in a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contents {
    /// By topic; topics without messages are listed too.
    pub topics: Vec<TopicContents>,
    /// See [`Check::origin_ns`].
    pub origin_ns: Option<u64>,
}

impl Contents {
    /// First and last log time of all topics (ns since 1970).
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let filled = || self.topics.iter().filter(|topic| topic.count > 0);
        Some((filled().map(|t| t.first_ns).min()?, filled().map(|t| t.last_ns).max()?))
    }
}

impl Check {
    /// What was found in the recording.
    pub fn contents(&self) -> Contents {
        let topic = |check: &super::TopicCheck| TopicContents {
            topic: check.topic.clone(),
            schema_name: check.schema_name.clone(),
            count: check.count,
            first_ns: check.first_ns,
            last_ns: check.last_ns,
        };
        Contents { topics: self.topics.iter().map(topic).collect(), origin_ns: self.origin_ns }
    }
}

/// Log times by which chunks and messages are ordered: rising, or falling.
type Order = fn(u64) -> u64;
const RISING: Order = |time_ns| time_ns;
const FALLING: Order = |time_ns| !time_ns;

/// The first of the times of a block in an order; `None` where it holds no message.
fn first_of(block: &Block, order: Order) -> Option<u64> {
    let (first, last) = block.times?;
    block.channels.as_ref()?;
    Some(order(first).min(order(last)))
}

impl Recording {
    /// As [`Self::contents`]; a recording whose end does not tell it is read as a whole.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn contents_or_check(&self) -> Result<Contents, ReadError> {
        match self.contents()? {
            Some(contents) => Ok(contents),
            None => Ok(self.check()?.contents()),
        }
    }

    /// What is in the recording by the summary at its end: counts are those that the writer noted,
    /// and times come from the few chunks that can hold the first and last message of a channel,
    /// which are read. `None` where the summary is not there, does not say it, or contradicts what
    /// is read: [`Self::check`] tells it then.
    ///
    /// # Errors
    /// [`ReadError::Io`].
    pub fn contents(&self) -> Result<Option<Contents>, ReadError> {
        let Some(counts) = &self.counts else { return Ok(None) };
        let known = |block: &Block| block.channels.is_some() || block.times == Some((0, 0));
        if !counts.keys().all(|id| self.channels.contains_key(id)) || !self.blocks.iter().all(known)
        {
            return Ok(None);
        }
        let filled: Vec<u16> =
            counts.iter().filter(|(_, count)| **count > 0).map(|(id, _)| *id).collect();
        let (Some(firsts), Some(lasts)) =
            (self.ends_of(&filled, RISING)?, self.ends_of(&filled, FALLING)?)
        else {
            return Ok(None);
        };
        let mut topics: BTreeMap<&str, TopicContents> = BTreeMap::new();
        for (id, channel) in &self.channels {
            let topic = topics.entry(&channel.topic).or_default();
            topic.topic.clone_from(&channel.topic);
            topic.schema_name.clone_from(&channel.schema_name);
            let count = counts.get(id).copied().unwrap_or(0);
            if let (Some(&first_ns), Some(&last_ns)) = (firsts.get(id), lasts.get(id)) {
                let none = topic.count == 0;
                topic.first_ns = if none { first_ns } else { topic.first_ns.min(first_ns) };
                topic.last_ns = topic.last_ns.max(last_ns);
            }
            topic.count += count;
        }
        let first_ns = firsts.values().min().copied();
        let Some(origin_ns) = self.first_since(self.began_ns().unwrap_or(0))? else {
            return Ok(None);
        };
        let topics = topics.into_values().collect();
        Ok(Some(Contents { topics, origin_ns: origin_ns.or(first_ns) }))
    }

    /// The blocks that hold messages, by their first times in an order.
    fn ordered(&self, order: Order) -> Vec<(u64, &Block)> {
        let blocks = self.blocks.iter();
        let mut blocks: Vec<(u64, &Block)> =
            blocks.filter_map(|block| Some((first_of(block, order)?, block))).collect();
        blocks.sort_by_key(|(first, _)| *first);
        blocks
    }

    /// The first log time of each of these channels in an order; `None` where a chunk cannot be
    /// read, or a channel is not found.
    fn ends_of(
        &self,
        channels: &[u16],
        order: Order,
    ) -> Result<Option<BTreeMap<u16, u64>>, ReadError> {
        let mut found: BTreeMap<u16, u64> = BTreeMap::new();
        let mut buffer = Vec::new();
        for (first, block) in self.ordered(order) {
            // No message of this block, nor of those that follow, comes before this one.
            let open = |id: &&u16| found.get(*id).is_none_or(|time| *time > first);
            if !channels.iter().any(|id| open(&id)) {
                break;
            }
            let here = block.channels.as_deref().unwrap_or_default();
            if !here.iter().filter(|id| channels.contains(id)).any(|id| open(&id)) {
                continue;
            }
            let loaded = match self.load(block, &mut buffer) {
                Ok(loaded) => loaded,
                Err(error @ ReadError::Io { .. }) => return Err(error),
                Err(_) => return Ok(None),
            };
            for head in &loaded.heads {
                let time = order(head.header.log_time);
                let earliest = found.entry(head.header.channel_id).or_insert(time);
                *earliest = time.min(*earliest);
            }
        }
        let times: BTreeMap<u16, u64> =
            channels.iter().filter_map(|id| Some((*id, order(*found.get(id)?)))).collect();
        Ok((times.len() == channels.len()).then_some(times))
    }

    /// The log time of the first message that is not before `began_ns`; the outer `None` where a
    /// chunk cannot be read.
    fn first_since(&self, began_ns: u64) -> Result<Option<Option<u64>>, ReadError> {
        let mut found: Option<u64> = None;
        let mut buffer = Vec::new();
        for (first, block) in self.ordered(RISING) {
            if found.is_some_and(|found| found <= first) {
                break;
            }
            let ended = block.times.is_some_and(|(_, last)| last < began_ns);
            let time = match first >= began_ns {
                true => Some(first),
                false if ended => None,
                false => match self.load(block, &mut buffer) {
                    Ok(loaded) => {
                        let times = loaded.heads.iter().map(|head| head.header.log_time);
                        times.filter(|time| *time >= began_ns).min()
                    }
                    Err(error @ ReadError::Io { .. }) => return Err(error),
                    Err(_) => return Ok(None),
                },
            };
            found = found.into_iter().chain(time).min();
        }
        Ok(Some(found))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_without_messages_has_no_part_in_span_and_rate() {
        let topic = |count, first_ns, last_ns| TopicContents {
            count,
            first_ns,
            last_ns,
            ..TopicContents::default()
        };
        let contents = Contents {
            topics: vec![topic(0, 0, 0), topic(5, 3_000_000_000, 5_000_000_000)],
            origin_ns: None,
        };
        assert_eq!(contents.span_ns(), Some((3_000_000_000, 5_000_000_000)));
        assert_eq!(Contents::default().span_ns(), None);
        let rates: Vec<_> = contents.topics.iter().map(TopicContents::rate_hz).collect();
        assert_eq!(rates, [None, Some(2.0)]);
    }
}
