//! The parts of a recording: a logger that was killed goes on with another file.

use std::path::{Path, PathBuf};

/// The file of a part: `run.mcap`, `run.part2.mcap`, ...
pub fn part_path(path: &Path, part: u32) -> PathBuf {
    if part <= 1 {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(extension) => format!("{stem}.part{part}.{}", extension.to_string_lossy()),
        None => format!("{stem}.part{part}"),
    };
    path.with_file_name(name)
}

/// The files of all parts of a recording, which any of them may name, in their order.
pub fn parts_of(path: &Path) -> Vec<PathBuf> {
    let first = first_part(path);
    let further = (2..).map(|part| part_path(&first, part)).take_while(|part| part.exists());
    std::iter::once(first.clone()).chain(further).collect()
}

/// The first part, where the path is that of a later one and the first is there; else the path.
fn first_part(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let first = stem.rsplit_once(".part").filter(|(_, part)| part.parse::<u32>().is_ok());
    let first = first.map(|(stem, _)| match path.extension() {
        Some(extension) => path.with_file_name(format!("{stem}.{}", extension.to_string_lossy())),
        None => path.with_file_name(stem),
    });
    first.filter(|first| first.exists()).unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn the_file_of_a_part_has_its_number() {
        assert_eq!(part_path(Path::new("/d/run.mcap"), 1), Path::new("/d/run.mcap"));
        assert_eq!(part_path(Path::new("/d/run.mcap"), 3), Path::new("/d/run.part3.mcap"));
        assert_eq!(part_path(Path::new("run"), 2), Path::new("run.part2"));
    }

    #[test]
    fn any_part_names_them_all() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        for name in ["run.mcap", "run.part2.mcap", "run.part3.mcap", "run.part5.mcap"] {
            std::fs::write(path(name), "").unwrap();
        }
        let all = ["run.mcap", "run.part2.mcap", "run.part3.mcap"].map(path);
        for name in ["run.mcap", "run.part2.mcap", "run.part3.mcap"] {
            assert_eq!(parts_of(&path(name)), all, "{name}");
        }
        // A file of that name without a first part stands for itself.
        std::fs::write(path("other.part2.mcap"), "").unwrap();
        assert_eq!(parts_of(&path("other.part2.mcap")), [path("other.part2.mcap")]);
        assert_eq!(parts_of(&path("absent.mcap")), [path("absent.mcap")]);
    }
}
