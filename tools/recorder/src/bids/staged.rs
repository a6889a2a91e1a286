//! Files that are to be added to a dataset, all together or none.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;
use tempfile::{NamedTempFile, TempDir};

use crate::output::taken;

/// Beginning of the names of folders in which files are written apart.
const APART: &str = ".farreach-";
/// A file in such a folder that is locked for as long as its export runs.
const LOCK: &str = "lock";

/// Files that are written apart, until all of them are there.
pub(super) struct Staged {
    root: PathBuf,
    apart: TempDir,
    _lock: File,
    /// New files, from the dataset's folder.
    files: Vec<PathBuf>,
    /// Files that stay as they are where they are there.
    defaults: Vec<(PathBuf, String)>,
    /// Tables to which rows are added: header and row.
    rows: Vec<(PathBuf, [String; 2])>,
}

impl Staged {
    /// Nothing yet; `root` is the dataset's folder, which need not be there.
    pub(super) fn new(root: &Path) -> anyhow::Result<Self> {
        // On the same file system, so that files can be moved.
        let beside = match root.parent() {
            _ if root.is_dir() => root,
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let cannot = || format!("{}: cannot write there", beside.display());
        remove_abandoned(beside);
        let apart = TempDir::with_prefix_in(APART, beside).with_context(cannot)?;
        let lock = File::create_new(apart.path().join(LOCK)).with_context(cannot)?;
        // A file system without locks keeps what a killed export leaves.
        let _ = lock.try_lock();
        let (files, defaults, rows) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { root: root.to_owned(), apart, _lock: lock, files, defaults, rows })
    }

    /// The dataset's folder.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Where files are written apart.
    pub(super) fn apart(&self) -> &Path {
        self.apart.path()
    }

    /// Begins a new file of the dataset.
    ///
    /// # Errors
    /// Where it is there already, or cannot be written.
    pub(super) fn create(&mut self, file: PathBuf) -> anyhow::Result<BufWriter<File>> {
        let target = self.root.join(&file);
        if taken(&target) || self.files.contains(&file) {
            bail!(
                "{}: it is there already; files are never overwritten: give --run, --session, \
                 --subject or --task",
                target.display()
            );
        }
        let path = self.apart.path().join(&file);
        let name = || path.display().to_string();
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).with_context(name)?;
        }
        let created = File::create_new(&path).with_context(name)?;
        self.files.push(file);
        Ok(BufWriter::new(created))
    }

    /// A new file of the dataset with this JSON.
    ///
    /// # Errors
    /// Those of [`Self::create`].
    pub(super) fn json(&mut self, file: PathBuf, contents: &Value) -> anyhow::Result<()> {
        let mut file = self.create(file)?;
        writeln!(file, "{contents:#}")?;
        Ok(file.flush()?)
    }

    /// A file with these contents, unless it is there.
    pub(super) fn default(&mut self, file: &str, contents: String) {
        if self.defaults.iter().all(|(other, _)| other != Path::new(file)) {
            self.defaults.push((file.into(), contents));
        }
    }

    /// A row of a table; the columns that the table has beside those of `header` get `n/a`.
    pub(super) fn row(&mut self, table: impl Into<PathBuf>, header: &str, row: &str) {
        self.rows.push((table.into(), [header.to_owned(), row.to_owned()]));
    }

    /// Moves all files to their places.
    ///
    /// # Errors
    /// As moving does: what was moved is removed again, and no table is changed.
    pub(super) fn publish(self) -> anyhow::Result<()> {
        let mut made = Made::default();
        let published = self.tables(&mut made).and_then(|tables| {
            self.move_all(&mut made)?;
            for (path, table) in tables {
                table.persist(&path).with_context(|| path.display().to_string())?;
            }
            Ok(())
        });
        if published.is_err() {
            made.remove();
        }
        published
    }

    /// The tables with their new rows, each beside the one whose place it is to take.
    fn tables(&self, made: &mut Made) -> anyhow::Result<Vec<(PathBuf, NamedTempFile)>> {
        let mut tables: Vec<(PathBuf, String)> = Vec::new();
        for (table, [header, row]) in &self.rows {
            let path = self.root.join(table);
            if path.is_symlink() {
                bail!("{}: it is a link: unlock it, so that rows can be added", path.display());
            }
            let known = tables.iter().position(|(other, _)| *other == path);
            let before = match known {
                Some(at) => tables.swap_remove(at).1,
                None if path.exists() => fs::read_to_string(&path)
                    .with_context(|| format!("{}: cannot read", path.display()))?,
                None => format!("{header}\n"),
            };
            let after = with_row(&before, header, row)
                .with_context(|| format!("{}: cannot add a row", path.display()))?;
            tables.push((path, after));
        }
        let mut written = Vec::with_capacity(tables.len());
        for (path, contents) in tables {
            let name = || format!("{}: cannot write", path.display());
            let folder = path.parent().unwrap_or(Path::new("."));
            made.folder(folder).with_context(name)?;
            let file = files::written(&path, contents.as_bytes()).with_context(name)?;
            written.push((path, file));
        }
        Ok(written)
    }

    fn move_all(&self, made: &mut Made) -> anyhow::Result<()> {
        for file in &self.files {
            let (from, to) = (self.apart.path().join(file), self.root.join(file));
            let name = || format!("{}: cannot create", to.display());
            if let Some(folder) = to.parent() {
                made.folder(folder).with_context(name)?;
            }
            if taken(&to) {
                bail!("{}: it is there by now; files are never overwritten", to.display());
            }
            fs::rename(&from, &to).with_context(name)?;
            made.files.push(to);
        }
        for (file, contents) in &self.defaults {
            let path = self.root.join(file);
            if !taken(&path) {
                files::create_new(&path, contents).with_context(|| path.display().to_string())?;
                made.files.push(path);
            }
        }
        Ok(())
    }
}

/// What was made in a dataset.
#[derive(Default)]
struct Made {
    folders: Vec<PathBuf>,
    files: Vec<PathBuf>,
}

impl Made {
    /// Makes a folder, and those that it is in.
    fn folder(&mut self, folder: &Path) -> std::io::Result<()> {
        if folder.as_os_str().is_empty() || folder.is_dir() {
            return Ok(());
        }
        if let Some(parent) = folder.parent() {
            self.folder(parent)?;
        }
        fs::create_dir(folder)?;
        self.folders.push(folder.to_owned());
        Ok(())
    }

    /// Removes all of it, as far as that is possible.
    fn remove(self) {
        self.files.iter().for_each(|file| drop(fs::remove_file(file)));
        self.folders.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

/// Removes what exports that were killed have left.
fn remove_abandoned(folder: &Path) {
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        let lock = entry.path().join(LOCK);
        let ours = entry.file_name().to_string_lossy().starts_with(APART) && lock.is_file();
        // Another export holds its lock for as long as it runs.
        if ours && File::open(&lock).is_ok_and(|lock| lock.try_lock().is_ok()) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

/// A table with another row, unless it has one with the same first column.
fn with_row(table: &str, header: &str, row: &str) -> anyhow::Result<String> {
    let names: Vec<&str> = header.split('\t').collect();
    let values: Vec<&str> = row.split('\t').collect();
    // A byte-order mark, as spreadsheets write it, stays.
    let mut lines = table.trim_start_matches('\u{feff}').lines();
    let found: Vec<&str> = lines.next().unwrap_or_default().split('\t').collect();
    let [first, ..] = names.as_slice() else { bail!("it has no columns") };
    if found.first() != Some(first) {
        bail!("expected {first} as its first column, found \"{}\"", found.join(" "));
    }
    let key = values.first().copied().unwrap_or_default();
    if lines.any(|line| line.split('\t').next() == Some(key)) {
        return Ok(table.to_owned());
    }
    let value = |column: &&str| {
        let at = names.iter().position(|name| name == column)?;
        values.get(at).copied()
    };
    let cells: Vec<&str> = found.iter().map(|column| value(column).unwrap_or("n/a")).collect();
    let end = if table.ends_with('\n') { "" } else { "\n" };
    Ok(format!("{table}{end}{}\n", cells.join("\t")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_added_once_and_fits_the_table() -> anyhow::Result<()> {
        let before = "participant_id\tage\nsub-1\t33";
        let after = with_row(before, "participant_id", "sub-2")?;
        assert_eq!(after, "participant_id\tage\nsub-1\t33\nsub-2\tn/a\n");
        assert_eq!(with_row(&after, "participant_id", "sub-1")?, after);
        assert!(
            with_row("\u{feff}participant_id\tage\nsub-1\t3\n", "participant_id", "sub-2").is_ok()
        );
        assert!(with_row("age\n33\n", "participant_id", "sub-2").is_err());
        Ok(())
    }
}
