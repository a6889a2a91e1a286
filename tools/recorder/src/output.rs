//! The output of a command.

use std::io::{self, BufWriter, IntoInnerError, Write};
use std::path::Path;

use anyhow::{Context, bail};

/// Written at a time (bytes).
const PIECE: usize = 128 << 10;

/// Refuses where one of the files to be written is there already, before any is written.
pub(crate) fn none_exists(paths: &[&Path]) -> anyhow::Result<()> {
    match paths.iter().find(|path| taken(path)) {
        Some(path) => bail!("{}: it is there already; files are never overwritten", path.display()),
        None => Ok(()),
    }
}

/// Whether there is anything of that name, and be it a link that leads nowhere: a file whose
/// contents were not fetched.
pub(crate) fn taken(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

/// Writes a file whole or not at all.
pub(crate) fn write_new(path: &Path, contents: impl AsRef<[u8]>) -> anyhow::Result<()> {
    files::create_new(path, contents)
        .with_context(|| format!("{}: cannot create; files are never overwritten", path.display()))
}

/// The folder that a file is in.
pub(crate) fn beside(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// As [`write_new`], of a file that is longer than the memory.
pub(crate) fn new_file(
    path: &Path,
    write: impl FnOnce(&mut (dyn Write + Send)) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let cannot = || format!("{}: cannot create; files are never overwritten", path.display());
    let file = files::written(path, b"").with_context(cannot)?;
    let mut output = BufWriter::with_capacity(PIECE, file);
    write(&mut output)?;
    let file = output.into_inner().map_err(IntoInnerError::into_error).with_context(cannot)?;
    file.as_file().sync_all().with_context(cannot)?;
    file.persist_noclobber(path).map_err(|error| error.error).with_context(cannot)?;
    Ok(())
}

/// Discards what is written once the reader has closed the pipe (`farreach rec verify FILE | head
/// -1`), so that a command comes to its end and its exit code does not depend on the reader.
pub(crate) struct Output<'a> {
    inner: &'a mut dyn Write,
    closed: bool,
}

impl<'a> Output<'a> {
    pub(crate) fn new(inner: &'a mut dyn Write) -> Self {
        Self { inner, closed: false }
    }

    /// Whether the reader is gone.
    pub(crate) fn closed(&self) -> bool {
        self.closed
    }

    fn unless_closed<T>(
        &mut self,
        done: T,
        write: impl FnOnce(&mut dyn Write) -> io::Result<T>,
    ) -> io::Result<T> {
        if self.closed {
            return Ok(done);
        }
        match write(self.inner) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                self.closed = true;
                Ok(done)
            }
            result => result,
        }
    }
}

impl Write for Output<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.unless_closed(bytes.len(), |inner| inner.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.unless_closed((), |inner| inner.flush())
    }
}
