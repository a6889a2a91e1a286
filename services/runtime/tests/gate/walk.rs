//! Every sequence of a few events, from one state: bounded model checking of a state machine beside
//! its judge. The gate's tests and the watchdog's share it.

/// A state machine beside its judge.
pub(crate) trait Judged: Clone {
    /// One thing that may happen.
    type Event;

    /// Its name, for the report of a failure.
    fn name(event: &Self::Event) -> String;

    /// Lets it happen; an error says what the state machine did and must not do.
    fn perform(&mut self, event: &Self::Event) -> Result<(), String>;

    /// One more cycle, so that what came last shows; returns whether there is power at its end.
    fn end(&mut self) -> Result<bool, String>;
}

/// What a walk through all sequences has seen.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Walk {
    /// Sequences.
    pub(crate) sequences: u64,
    /// Those that end with power.
    pub(crate) powered: u64,
}

/// Length of the sequences: that of `FARREACH_DEPTH`, or the usual one.
pub(crate) fn depth(usual: usize) -> usize {
    set("FARREACH_DEPTH", usual)
}

/// Number of a property's cases: that of `PROPTEST_CASES`, or the usual one.
pub(crate) fn cases(usual: u32) -> u32 {
    set("PROPTEST_CASES", usual)
}

fn set<T: std::str::FromStr>(variable: &str, usual: T) -> T {
    std::env::var(variable).ok().and_then(|value| value.parse().ok()).unwrap_or(usual)
}

/// Goes through every sequence of `depth` events from here on.
pub(crate) fn every_sequence<J: Judged>(from: &J, events: &[J::Event], depth: usize) -> Walk {
    let mut walk = Walk::default();
    explore(from, events, depth, &mut Vec::new(), &mut walk);
    assert_eq!(walk.sequences, (events.len() as u64).pow(depth as u32));
    walk
}

fn explore<J: Judged>(
    from: &J,
    events: &[J::Event],
    depth: usize,
    path: &mut Vec<String>,
    walk: &mut Walk,
) {
    for event in events {
        path.push(J::name(event));
        let mut next = from.clone();
        if let Err(what) = next.perform(event) {
            panic!("{what} after {path:?}");
        }
        if depth > 1 {
            explore(&next, events, depth - 1, path, walk);
        } else {
            let powered =
                next.end().unwrap_or_else(|what| panic!("{what} after {path:?} and a cycle"));
            walk.sequences += 1;
            walk.powered += u64::from(powered);
        }
        path.pop();
    }
}
