//! An empty crate in place of bindgen.
//!
//! The build scripts of iceoryx2 depend on bindgen on every platform and call it on QNX only, so
//! that 16 crates were compiled for nothing. Should a later iceoryx2 call it on Linux, its build
//! script does not compile with this crate: remove the `[patch]` from the workspace then.
