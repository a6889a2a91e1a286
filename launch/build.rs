//! Lists the unit files, which are compiled into the binary.

use std::fmt::Write as _;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let directory = std::path::absolute("units")?;
    println!("cargo::rerun-if-changed={}", directory.display());
    let mut list = String::new();
    for entry in std::fs::read_dir(directory)? {
        let (name, path) = entry.map(|entry| (entry.file_name(), entry.path()))?;
        let _infallible = writeln!(list, "({name:?}, include_str!({path:?})),");
    }
    let output = std::env::var_os("OUT_DIR").ok_or(std::io::ErrorKind::NotFound)?;
    std::fs::write(Path::new(&output).join("units.rs"), format!("&[{list}]"))
}
