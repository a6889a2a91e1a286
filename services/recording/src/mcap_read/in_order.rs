//! Work on the chunks of a recording on all processors, its results in the order of the file.

use std::num::NonZero;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{available_parallelism, scope};

use ipc_types::Message;

use super::{RawMessage, ReadError, Recorded, Recording, Selection};

/// Results that each thread may have ready before they are taken: memory holds these, the one that
/// is worked on, and the one that is taken.
const CHUNKS_AHEAD: usize = 2;
/// Most threads that read: the one that takes the results is busy by then.
const MOST_THREADS: usize = 16;

/// Threads that read a recording: one for each processor.
pub fn threads() -> usize {
    available_parallelism().map_or(1, NonZero::get).min(MOST_THREADS)
}

/// Does `work` for each number below `count` on so many threads, each with scratch memory of its
/// own, and hands the results to `take` in the order of the numbers, up to its first error. With
/// one thread, nothing runs beside the caller.
pub(super) fn in_order<T: Send, E>(
    threads: usize,
    count: usize,
    work: impl Fn(usize, &mut Vec<u8>) -> T + Sync,
    mut take: impl FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let threads = threads.min(count);
    if threads < 2 {
        let mut scratch = Vec::new();
        return (0..count).try_for_each(|at| take(work(at, &mut scratch)));
    }
    let work = &work;
    scope(|scope| {
        let start = |own: usize| -> Receiver<T> {
            let (sender, receiver) = sync_channel(CHUNKS_AHEAD);
            scope.spawn(move || {
                let mut scratch = Vec::new();
                for at in (own..count).step_by(threads) {
                    // Nobody takes the results any more.
                    if sender.send(work(at, &mut scratch)).is_err() {
                        break;
                    }
                }
            });
            receiver
        };
        let receivers: Vec<Receiver<T>> = (0..threads).map(start).collect();
        for at in 0..count {
            // A thread that panicked sends no more; the scope hands its panic on.
            let Ok(result) = receivers[at % threads].recv() else { break };
            take(result)?;
        }
        Ok(())
    })
}

impl Recording {
    /// Reads the chunks that `selection` wants on all processors: `work` turns the messages of each
    /// into a result, and `take` gets the results in the order of the file, up to its first error.
    /// A damaged chunk comes as an error. Memory holds a few chunks for each processor.
    ///
    /// # Errors
    /// Those of `take`.
    pub fn in_order<T: Send, E>(
        &self,
        selection: &Selection,
        work: impl Fn(Result<Vec<RawMessage>, ReadError>) -> T + Sync,
        take: impl FnMut(T) -> Result<(), E>,
    ) -> Result<(), E> {
        self.in_order_on(threads(), selection, work, take)
    }

    /// Reads the messages of one topic on all processors and hands them to `take` in the order of
    /// the file, up to its first error.
    ///
    /// # Errors
    /// Those of `take`, [`ReadError::NoTopic`], [`ReadError::Schema`], and [`ReadError::Damaged`]
    /// at the first damaged chunk.
    pub fn each<T: Message + Send, E: From<ReadError>>(
        &self,
        topic: &str,
        mut take: impl FnMut(Recorded<T>) -> Result<(), E>,
    ) -> Result<(), E> {
        let ids = self.channels_of(topic)?;
        let conversions = self.conversions::<T>(&ids)?;
        let selection = Selection { channels: Some(ids), ..Selection::default() };
        let work = |messages: Result<Vec<RawMessage>, ReadError>| {
            let converted = |raw: &RawMessage| self.converted::<T>(&conversions, raw);
            messages.map(|messages| messages.iter().filter_map(converted).collect::<Vec<_>>())
        };
        self.in_order(&selection, work, |found| {
            found?.into_iter().try_for_each(|message| take(message?))
        })
    }

    /// As [`Self::in_order`], on so many threads.
    pub(super) fn in_order_on<T: Send, E>(
        &self,
        threads: usize,
        selection: &Selection,
        work: impl Fn(Result<Vec<RawMessage>, ReadError>) -> T + Sync,
        take: impl FnMut(T) -> Result<(), E>,
    ) -> Result<(), E> {
        let wanted = |at: &usize| selection.wants_block(&self.blocks[*at]);
        let blocks: Vec<usize> = (0..self.blocks.len()).filter(wanted).collect();
        let work = |at: usize, buffer: &mut Vec<u8>| {
            work(self.messages_of(&self.blocks[blocks[at]], selection, buffer))
        };
        in_order(threads, blocks.len(), work, take)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn results_come_in_order_and_few_exist_at_a_time() {
        for threads in [1, 2, 3, 5] {
            let (alive, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let work = |at: usize, _: &mut Vec<u8>| {
                let now = alive.fetch_add(1, Ordering::SeqCst) + 1;
                most.fetch_max(now, Ordering::SeqCst);
                at
            };
            let mut taken = Vec::new();
            let take = |at: usize| {
                // The one who takes is slower than those who work.
                std::thread::yield_now();
                taken.push(at);
                alive.fetch_sub(1, Ordering::SeqCst);
                Ok::<(), ()>(())
            };
            in_order(threads, 500, work, take).unwrap();
            assert_eq!(taken, (0..500).collect::<Vec<_>>(), "{threads} threads");
            let most = most.load(Ordering::SeqCst);
            let bound = threads * (CHUNKS_AHEAD + 1) + 1;
            assert!(most <= bound, "{threads} threads held {most} results, expected {bound}");
        }
    }

    #[test]
    fn the_first_error_ends_it() {
        for threads in [1, 3] {
            let mut taken = 0;
            let found = in_order(
                threads,
                100_000,
                |at, _| at,
                |at| {
                    taken += 1;
                    if at == 7 { Err(at) } else { Ok(()) }
                },
            );
            assert_eq!((found, taken), (Err(7), 8));
        }
        assert_eq!(in_order(3, 0, |at, _| at, Err), Ok(()));
    }

    #[test]
    fn a_panic_of_a_thread_is_no_end_of_the_file() {
        let work = |at: usize, _: &mut Vec<u8>| assert_ne!(at, 40, "as is to be");
        let all = || in_order(2, 100, work, |()| Ok::<(), ()>(()));
        assert!(std::panic::catch_unwind(all).is_err());
    }
}
