//! Calls of liblsl: all of the crate's unsafe code.
//!
//! The library is looked for when it is needed, and not linked: who does not use it need not have
//! it. Signatures and sizes are those of its C interface (`lsl_c.h`), which has been the same since
//! version 1.13. It catches its own exceptions at that interface.

use std::ffi::{CStr, CString, c_char, c_double, c_ulong, c_void};
use std::path::Path;
use std::ptr::NonNull;

use anyhow::{Context as _, bail, ensure};
use libloading::Library;

/// An object of the library.
type Handle = *mut c_void;

/// Names under which it is installed.
const NAMES: [&str; 3] = ["liblsl.so.2", "liblsl.so.1", "liblsl.so"];
/// How long an outlet keeps what a receiver does not take (s; of a stream without a rate, as many
/// hundred samples).
const KEPT: i32 = 60;

/// The library's functions. It is never unloaded, since it has threads of its own.
#[derive(Clone, Copy)]
pub(crate) struct Liblsl {
    library_version: unsafe extern "C" fn() -> i32,
    local_clock: unsafe extern "C" fn() -> c_double,
    last_error: unsafe extern "C" fn() -> *const c_char,
    create_streaminfo: unsafe extern "C" fn(
        *const c_char,
        *const c_char,
        i32,
        c_double,
        i32,
        *const c_char,
    ) -> Handle,
    destroy_streaminfo: unsafe extern "C" fn(Handle),
    get_desc: unsafe extern "C" fn(Handle) -> Handle,
    append_child: unsafe extern "C" fn(Handle, *const c_char) -> Handle,
    append_child_value: unsafe extern "C" fn(Handle, *const c_char, *const c_char) -> Handle,
    create_outlet: unsafe extern "C" fn(Handle, i32, i32) -> Handle,
    destroy_outlet: unsafe extern "C" fn(Handle),
    push_chunk: unsafe extern "C" fn(Handle, *const c_double, c_ulong, *const c_double, i32) -> i32,
    push_text: unsafe extern "C" fn(Handle, *mut *const c_char, c_double, i32) -> i32,
}

/// What the values of a stream are, by the library's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// Numbers.
    Double = 2,
    /// Texts.
    Text = 3,
}

/// A stream as receivers see it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StreamInfo {
    pub(crate) name: String,
    /// Type of the content.
    pub(crate) kind: String,
    /// The same for the same stream of rig and computer, so that a receiver finds it again.
    pub(crate) source_id: String,
    /// Hz; 0: irregular.
    pub(crate) rate_hz: f64,
    pub(crate) format: Format,
    pub(crate) channels: Vec<ChannelInfo>,
    /// Further elements of the description.
    pub(crate) about: Vec<(&'static str, String)>,
}

/// A channel of a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelInfo {
    pub(crate) label: String,
    /// Empty where there is none.
    pub(crate) unit: String,
}

impl Liblsl {
    /// Loads the library from this file, or else from where the system has libraries.
    ///
    /// # Errors
    /// If there is none, with what to install; or it lacks a function.
    pub(crate) fn load(path: Option<&Path>) -> anyhow::Result<Self> {
        let library = match path {
            Some(path) => open(path).with_context(|| {
                format!("{}: expected liblsl, the library of Lab Streaming Layer", path.display())
            })?,
            None => NAMES.iter().find_map(|name| open(Path::new(name)).ok()).context(
                "liblsl, the library of Lab Streaming Layer, is not installed: take a package of \
                 https://github.com/sccn/liblsl/releases, `conda install -c conda-forge liblsl`, \
                 or `pip install pylsl` and --library .../pylsl/lib/liblsl.so",
            )?,
        };
        // SAFETY: each field has the type of the function of that name in the library's header, and
        // the library stays loaded.
        let functions = unsafe {
            Self {
                library_version: function(&library, "lsl_library_version")?,
                local_clock: function(&library, "lsl_local_clock")?,
                last_error: function(&library, "lsl_last_error")?,
                create_streaminfo: function(&library, "lsl_create_streaminfo")?,
                destroy_streaminfo: function(&library, "lsl_destroy_streaminfo")?,
                get_desc: function(&library, "lsl_get_desc")?,
                append_child: function(&library, "lsl_append_child")?,
                append_child_value: function(&library, "lsl_append_child_value")?,
                create_outlet: function(&library, "lsl_create_outlet")?,
                destroy_outlet: function(&library, "lsl_destroy_outlet")?,
                push_chunk: function(&library, "lsl_push_chunk_dtnp")?,
                push_text: function(&library, "lsl_push_sample_strtp")?,
            }
        };
        std::mem::forget(library);
        Ok(functions)
    }

    /// Its version: 118 for 1.18.
    pub(crate) fn version(&self) -> i32 {
        // SAFETY: it takes nothing and reads a constant.
        unsafe { (self.library_version)() }
    }

    /// Its clock (s).
    pub(crate) fn local_clock_s(&self) -> f64 {
        // SAFETY: it takes nothing and reads a clock.
        unsafe { (self.local_clock)() }
    }

    /// Makes a stream visible.
    ///
    /// # Errors
    /// If a text holds a zero byte, or the library cannot make it.
    pub(crate) fn outlet(&self, info: &StreamInfo) -> anyhow::Result<Outlet> {
        let (name, kind) = (text(&info.name)?, text(&info.kind)?);
        let (source_id, count) = (text(&info.source_id)?, i32::try_from(info.channels.len())?);
        ensure!(count > 0, "stream {}: it has no channel", info.name);
        // SAFETY: the texts end with a zero and live until the call returns.
        let made = unsafe {
            (self.create_streaminfo)(
                name.as_ptr(),
                kind.as_ptr(),
                count,
                info.rate_hz,
                info.format as i32,
                source_id.as_ptr(),
            )
        };
        let made = NonNull::new(made).with_context(|| self.failed(&info.name))?;
        let described = self.describe(made.as_ptr(), info);
        // SAFETY: `made` is a stream info, and the outlet copies it.
        let outlet = unsafe { (self.create_outlet)(made.as_ptr(), 0, KEPT) };
        // SAFETY: nobody uses it any more.
        unsafe { (self.destroy_streaminfo)(made.as_ptr()) };
        let outlet = NonNull::new(outlet).with_context(|| self.failed(&info.name))?;
        let outlet = Outlet { lsl: *self, outlet, info: info.clone() };
        described.map(|()| outlet)
    }

    /// Writes channels and the rest into the description of a stream info.
    fn describe(&self, made: Handle, info: &StreamInfo) -> anyhow::Result<()> {
        let value = |at: Handle, name: &str, value: &str| -> anyhow::Result<()> {
            let (name, value) = (text(name)?, text(value)?);
            // SAFETY: `at` is an element of the info, which lives; the texts live until it returns.
            unsafe { (self.append_child_value)(at, name.as_ptr(), value.as_ptr()) };
            Ok(())
        };
        // SAFETY: `made` is a stream info, and what comes is an element of it.
        let description = unsafe { (self.get_desc)(made) };
        // SAFETY: as above.
        let channels = unsafe { (self.append_child)(description, c"channels".as_ptr()) };
        for channel in &info.channels {
            // SAFETY: `channels` is an element of the info.
            let at = unsafe { (self.append_child)(channels, c"channel".as_ptr()) };
            value(at, "label", &channel.label)?;
            value(at, "unit", &channel.unit)?;
            value(at, "type", &info.kind)?;
        }
        info.about.iter().try_for_each(|(name, text)| value(description, name, text))
    }

    fn failed(&self, stream: &str) -> String {
        // SAFETY: it takes nothing, and returns a text of the library's own or null.
        let told = unsafe { (self.last_error)() };
        let told = match NonNull::new(told.cast_mut()) {
            // SAFETY: it is not null, ends with a zero, and is read before the next call.
            Some(told) => unsafe { CStr::from_ptr(told.as_ptr()) }.to_string_lossy().into_owned(),
            None => String::new(),
        };
        format!("liblsl cannot make the stream {stream} {told}")
    }
}

/// A stream that is visible for as long as this lives. It never waits for its receivers.
pub(crate) struct Outlet {
    lsl: Liblsl,
    outlet: NonNull<c_void>,
    info: StreamInfo,
}

impl Outlet {
    /// Sends samples: the values of all channels for each of the times (s, by the library's clock).
    ///
    /// # Errors
    /// If there are not as many values as channels and times, or the library does not take them.
    pub(crate) fn push(&mut self, values: &[f64], times_s: &[f64]) -> anyhow::Result<()> {
        let expected = self.info.channels.len() * times_s.len();
        ensure!(self.info.format == Format::Double, "{}: a stream of texts", self.info.name);
        ensure!(values.len() == expected, "{}: {} values", self.info.name, values.len());
        if values.is_empty() {
            return Ok(());
        }
        // SAFETY: the outlet lives; both slices live until the call returns, and have the lengths
        // that it reads: `values.len()` values, and one time for each of the channels' number.
        let code = unsafe {
            (self.lsl.push_chunk)(
                self.outlet.as_ptr(),
                values.as_ptr(),
                values.len() as c_ulong,
                times_s.as_ptr(),
                1,
            )
        };
        self.check(code)
    }

    /// Sends a text.
    ///
    /// # Errors
    /// If it is not a stream of one text, or the library does not take it.
    pub(crate) fn push_text(&mut self, told: &str, time_s: f64) -> anyhow::Result<()> {
        let fits = self.info.format == Format::Text && self.info.channels.len() == 1;
        ensure!(fits, "{}: expected a stream of one text", self.info.name);
        let told = text(told)?;
        let mut data = [told.as_ptr()];
        // SAFETY: the outlet lives and has one channel; the text ends with a zero and lives until
        // the call returns, which copies it.
        let code =
            unsafe { (self.lsl.push_text)(self.outlet.as_ptr(), data.as_mut_ptr(), time_s, 1) };
        self.check(code)
    }

    fn check(&self, code: i32) -> anyhow::Result<()> {
        if code != 0 {
            bail!("liblsl does not take data of the stream {} (error {code})", self.info.name);
        }
        Ok(())
    }
}

impl Drop for Outlet {
    fn drop(&mut self) {
        // SAFETY: the outlet lives, and this is its only handle.
        unsafe { (self.lsl.destroy_outlet)(self.outlet.as_ptr()) };
    }
}

fn open(path: &Path) -> Result<Library, libloading::Error> {
    // SAFETY: the library's initialisers run; whoever names a file, or installs one under these
    // names, trusts it as they trust this program.
    unsafe { Library::new(path) }
}

/// # Safety
/// `T` must be the type of the function of that name, which must not be called once the library is
/// unloaded.
unsafe fn function<T: Copy>(library: &Library, name: &str) -> anyhow::Result<T> {
    // SAFETY: the caller's promise.
    let found = unsafe { library.get::<T>(name) };
    found
        .map(|symbol| *symbol)
        .with_context(|| format!("liblsl has no function {name}: expected version 1.14 or newer"))
}

fn text(text: &str) -> anyhow::Result<CString> {
    CString::new(text).with_context(|| format!("{text:?}: a zero byte"))
}
