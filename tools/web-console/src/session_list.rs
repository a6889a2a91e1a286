//! The thread that reads the sessions from the recording, with their quality.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use crate::desk::Shared;

/// The logger flushes within this time of a session's end.
const FLUSHED: Duration = Duration::from_millis(800);
/// The thread's nice level: a whole recording is read, and a rig without real-time scheduling goes
/// first.
const NICE: i32 = 15;

/// Asks for the list to be made anew.
pub(crate) struct ReportRequest {
    /// The recording in progress.
    pub(crate) recording: PathBuf,
}

/// Makes the list anew whenever it is asked for.
pub(crate) fn serve(shared: &Arc<Shared>, requests: &Receiver<ReportRequest>) {
    // Of this thread alone.
    let _refused = rustix::process::nice(NICE);
    while let Ok(mut request) = requests.recv() {
        std::thread::sleep(FLUSHED);
        // Of several, the newest.
        while let Ok(newer) = requests.try_recv() {
            request = newer;
        }
        match recorder::session_reports(&request.recording) {
            Ok(reports) => {
                let mut desk = shared.desk();
                desk.reports = reports;
                shared.show(&desk);
            }
            Err(error) => eprintln!("farreach console: the list of sessions: {error:#}"),
        }
    }
}
