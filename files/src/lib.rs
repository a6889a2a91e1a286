//! Files that are written whole or not at all ([`replace`], [`create_new`]), and contents that
//! carry mark, version and checksum ([`Format`]).

mod format;

use std::fs::{OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tempfile::NamedTempFile;

pub use format::{Format, FormatError, LARGEST, fnv1a};

/// Writes `contents` to the file at `path`, in place of an older one. Whoever opens it finds the
/// old contents or the new ones, even after a power failure; processes that have the old file open
/// keep it. Rights are those that the umask leaves. A symbolic link stays; its target is replaced.
///
/// A device, pipe or socket (`/dev/null`, `/dev/stdout`) is written to: a file in its place would
/// take it from every process of the machine.
///
/// # Errors
/// The system's; a file at `path` is then as it was.
pub fn replace(path: &Path, contents: impl AsRef<[u8]>) -> io::Result<()> {
    let contents = contents.as_ref();
    // Absent, or not to be looked at: creating the file decides.
    let Ok(kind) = path.metadata().map(|found| found.file_type()) else {
        return replace_file(path, contents);
    };
    if kind.is_file() || kind.is_dir() {
        return replace_file(&path.canonicalize()?, contents);
    }
    OpenOptions::new().write(true).open(path)?.write_all(contents)
}

fn replace_file(path: &Path, contents: &[u8]) -> io::Result<()> {
    written(path, contents)?.persist(path).map(drop).map_err(|error| error.error)
}

/// Writes `contents` to a file that does not exist yet; otherwise like [`replace`].
///
/// # Errors
/// The system's; `AlreadyExists` where there is a file at `path`.
pub fn create_new(path: &Path, contents: impl AsRef<[u8]>) -> io::Result<()> {
    written(path, contents.as_ref())?.persist_noclobber(path).map(drop).map_err(|error| error.error)
}

/// A temporary file in the folder of `path`, its contents on the disk, which can take its place.
/// Dropping it removes it.
///
/// # Errors
/// The system's.
pub fn written(path: &Path, contents: &[u8]) -> io::Result<NamedTempFile> {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new()
        .prefix(".new-")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    file.write_all(contents)?;
    file.as_file().sync_all()?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::{FileTypeExt, symlink};

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_a_new_one_takes_no_old_ones_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        replace(&path, "one").unwrap();
        let mut reader = fs::File::open(&path).unwrap();
        replace(&path, "two").unwrap();
        assert_eq!(io::read_to_string(&mut reader).unwrap(), "one");
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        let error = create_new(&path, "three").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        create_new(&folder.path().join("b.json"), "three").unwrap();
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 2, "{left:?}");
        assert_eq!(
            replace(&folder.path().join("none/a"), "").unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
    }

    #[test]
    fn a_pipe_is_written_to_and_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        mknodat(CWD, &path, FileType::Fifo, Mode::RWXU, 0).unwrap();
        let kept = path.clone();
        let reader = std::thread::spawn(move || fs::read_to_string(kept).unwrap());
        replace(&path, "one").unwrap();
        assert!(path.metadata().unwrap().file_type().is_fifo());
        assert_eq!(reader.join().unwrap(), "one");
    }

    #[test]
    fn a_link_stays_and_its_target_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        fs::write(&target, "one").unwrap();
        symlink("target", &link).unwrap();
        replace(&link, "two").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&target).unwrap(), "two");
    }

    #[test]
    fn a_failed_replacement_leaves_the_old_file_and_no_temporary_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir_all(path.join("by a folder")).unwrap();
        assert!(replace(&path, "one").is_err());
        assert!(path.join("by a folder").is_dir());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
