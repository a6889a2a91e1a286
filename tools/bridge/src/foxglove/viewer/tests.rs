#![allow(clippy::unwrap_used, clippy::expect_used)]

use serde_json::Value;

use super::*;

fn message(number: u8) -> Outgoing {
    Outgoing { wall_time_ns: u64::from(number), payload: vec![number] }
}

fn viewer() -> (Viewer, Outbox) {
    Viewer::new(1, "here".to_owned(), 2)
}

/// Subscription and last byte of the frames that wait.
fn waiting(outbox: &mut Outbox) -> Vec<(u8, u8)> {
    std::iter::from_fn(|| outbox.messages.try_recv().ok())
        .map(|frame| (frame[1], *frame.last().unwrap()))
        .collect()
}

fn texts(outbox: &mut Outbox) -> Vec<Value> {
    std::iter::from_fn(|| outbox.texts.try_recv().ok())
        .map(|text| serde_json::from_str(text.as_str()).unwrap())
        .collect()
}

const SUBSCRIBE: &str = r#"{"op":"subscribe","subscriptions":[{"id":9,"channelId":2}]}"#;

#[test]
fn only_what_is_subscribed_to_is_handed_on_after_its_history() {
    let (viewer, mut outbox) = viewer();
    let history = [message(1), message(2)];
    viewer.offer(1, history.iter(), &message(3), 7);
    assert!(waiting(&mut outbox).is_empty());
    viewer.request(Ok(SUBSCRIBE)).unwrap();
    // What was lost before it subscribed is none of its losses.
    viewer.offer(1, history.iter(), &message(4), 7);
    viewer.offer(1, history.iter(), &message(5), 2);
    viewer.offer(0, history.iter(), &message(6), 1);
    viewer.greet(1, history.iter());
    assert_eq!(waiting(&mut outbox), [(9, 1), (9, 2), (9, 4), (9, 5)]);
    assert_eq!(viewer.counts(), Counts { sent: 4, lost: 2, dropped: 0 });
    viewer.request(Ok(r#"{"op":"unsubscribe","subscriptionIds":[9]}"#)).unwrap();
    viewer.offer(1, history.iter(), &message(7), 3);
    assert!(waiting(&mut outbox).is_empty());
    assert_eq!(viewer.counts().lost, 2);
}

#[test]
fn a_new_subscription_has_the_history_although_nothing_is_published() {
    let (viewer, mut outbox) = viewer();
    viewer.request(Ok(SUBSCRIBE)).unwrap();
    let history = [message(1)];
    viewer.greet(1, history.iter());
    viewer.greet(1, history.iter());
    assert_eq!(waiting(&mut outbox), [(9, 1)]);
}

#[test]
fn a_viewer_that_does_not_read_loses_what_has_no_room_and_is_told() {
    let (viewer, mut outbox) = viewer();
    viewer.request(Ok(SUBSCRIBE)).unwrap();
    for _ in 0..WAITING + 5 {
        viewer.offer(1, [].iter(), &message(1), 0);
    }
    viewer.lost(1, 3);
    viewer.lost(0, 4);
    let counts = Counts { sent: WAITING as u64, lost: 3, dropped: 5 };
    assert_eq!(viewer.counts(), counts);
    viewer.tell_losses(|topic| ["sample", "command"][topic]);
    viewer.tell_losses(|topic| ["sample", "command"][topic]);
    let told = texts(&mut outbox);
    assert_eq!(told.len(), 1);
    assert_eq!((told[0]["level"].as_u64(), told[0]["id"].as_str()), (Some(1), Some("losses")));
    let text = told[0]["message"].as_str().unwrap();
    assert!(text.contains("command: 3 lost before the bridge, 5 dropped"), "{text}");
    assert_eq!(waiting(&mut outbox).len(), WAITING);
}

#[test]
fn what_cannot_be_done_is_refused_and_counted() {
    let (viewer, mut outbox) = viewer();
    viewer.request(Ok(SUBSCRIBE)).unwrap();
    for (wrong, part) in [
        (SUBSCRIBE, "already"),
        (r#"{"op":"subscribe","subscriptions":[{"id":8,"channelId":2}]}"#, "already"),
        (r#"{"op":"subscribe","subscriptions":[{"id":8,"channelId":3}]}"#, "expected one from 1"),
        (r#"{"op":"advertise","channels":[]}"#, "only sends"),
    ] {
        viewer.request(Ok(wrong)).unwrap();
        let told = texts(&mut outbox);
        assert_eq!(told[0]["level"], 2);
        assert!(told[0]["message"].as_str().unwrap().contains(part), "{told:?}");
    }
    viewer.request(Err("expected text")).unwrap();
    let ended = (0..REFUSED).find_map(|_| viewer.request(Ok("")).err());
    assert!(ended.unwrap().contains("too many"));
}
