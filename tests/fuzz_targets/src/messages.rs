//! Messages of fixed layout, as they lie in shared memory.

use ipc_types::{
    Event, Message, ModelState, NewestModel, SequenceTracker, TOPICS, TypeVisitor, visit_type,
};

use crate::{Outcome, chosen};

/// Reads the bytes of a message.
struct Reading<'a>(&'a [u8]);

impl TypeVisitor for Reading<'_> {
    type Output = Outcome;

    fn visit<T: Message>(self) -> Outcome {
        let Self(bytes) = self;
        let expected = size_of::<T>();
        let length = bytes.len();
        let mut whole = bytes.to_vec();
        whole.resize(expected, 0);
        let message = T::from_bytes(&whole).expect("the length is right");
        assert_eq!(message.as_bytes(), whole);
        for field in T::FIELDS {
            let values = field.read_all(&whole).map(|value| (value, field.meaning(value)));
            assert_eq!(values.count(), field.count());
            let _text = (field.values_text(&whole), field.event_text(T::FIELDS, &whole));
        }
        let mut tracker = SequenceTracker::default();
        for sequence in [message.sequence(), message.time_ns(), message.sequence()] {
            tracker.observe(message.incarnation(), sequence);
        }
        tracker.resume(message.session(), message.sequence());
        tracker.observe(message.session(), message.time_ns());
        told(&whole, message.time_ns());
        match T::from_bytes(bytes) {
            Some(_) => Ok(()),
            None => Err(format!("expected {expected} bytes, found {length}")),
        }
    }
}

/// What people are told of events and of the model.
fn told(bytes: &[u8], now_ns: u64) {
    let mut newest = NewestModel::default();
    if let Some(event) = Event::from_bytes(bytes) {
        assert!(event.text().len() <= event.text.len());
        newest.see_event(&event);
    }
    if let Some(state) = ModelState::from_bytes(bytes) {
        newest.see_state(&state);
    }
    for rate_hz in [None, Some(2000.0)] {
        for status in newest.status(rate_hz, now_ns) {
            assert!(!status.sentence().is_empty());
        }
    }
}

/// The first byte chooses the topic.
pub(crate) fn read(bytes: &[u8]) -> Outcome {
    let (topic, bytes) = chosen(bytes, TOPICS.len());
    visit_type(TOPICS[topic].type_name, Reading(bytes)).expect("each topic has a type")
}

pub(crate) fn seeds() -> Vec<Vec<u8>> {
    let of = |(index, size): (usize, usize)| {
        [0, 1, 0xff].map(|byte| [&[index as u8][..], &vec![byte; size]].concat())
    };
    TOPICS.iter().map(|topic| topic.size).enumerate().flat_map(of).collect()
}
