//! The output of a recording.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The output: a file, or in tests something that fails on demand.
pub trait Output: Write + Send {
    /// Brings everything written so far to the disk.
    ///
    /// # Errors
    /// Those of the device.
    fn sync(&mut self) -> io::Result<()>;
}

impl Output for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// The buffered output, shared with the MCAP library's writer so that it can be synced and, after
/// an error, closed.
#[derive(Clone)]
pub(super) struct Shared(Arc<Mutex<Target>>);

pub(super) struct Target {
    /// `None` after an error: nothing may follow the torn record.
    output: Option<BufWriter<Box<dyn Output>>>,
    pub(super) bytes: u64,
}

impl Shared {
    pub(super) fn new(output: Box<dyn Output>) -> Self {
        Self(Arc::new(Mutex::new(Target {
            output: Some(BufWriter::with_capacity(128 * 1024, output)),
            bytes: 0,
        })))
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Target> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn sync(&self) -> io::Result<()> {
        match &mut self.lock().output {
            Some(output) => {
                output.flush()?;
                output.get_mut().sync()
            }
            None => Err(cut_off()),
        }
    }

    /// Closes the output and discards what is buffered.
    pub(super) fn cut(&self) {
        if let Some(output) = self.lock().output.take() {
            drop(output.into_parts());
        }
    }
}

fn cut_off() -> io::Error {
    io::Error::other("the recording was given up after an error")
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut target = self.lock();
        let written = target.output.as_mut().ok_or_else(cut_off)?.write(bytes)?;
        target.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock().output.as_mut().ok_or_else(cut_off)?.flush()
    }
}
