//! Who is told how much of a recording was read.

use std::sync::OnceLock;

use super::{Recording, Selection};

/// Is called with the bytes of each chunk that is read; nobody, at first.
#[derive(Default)]
pub(super) struct Watch(OnceLock<Box<dyn Fn(u64) + Send + Sync>>);

impl std::fmt::Debug for Watch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Watch").field(&self.0.get().is_some()).finish()
    }
}

impl Watch {
    pub(super) fn read(&self, bytes: u64) {
        if let Some(watch) = self.0.get() {
            watch(bytes);
        }
    }
}

impl Recording {
    /// From now on calls `watch` with the bytes of each chunk when it is read, from any thread; the
    /// first one that is given here.
    pub fn watch(&self, watch: impl Fn(u64) + Send + Sync + 'static) {
        let _ = self.watch.0.set(Box::new(watch));
    }

    /// Bytes of the chunks that hold what is selected.
    pub fn selected_bytes(&self, selection: &Selection) -> u64 {
        let wanted = self.blocks.iter().filter(|block| selection.wants_block(block));
        wanted.map(|block| block.length).sum()
    }
}
