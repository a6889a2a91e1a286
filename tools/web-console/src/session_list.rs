//! The thread that reads the sessions from the recording, with their quality.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use ipc_types::LoggerRequest;
use operator::RigLink;
use recorder::SessionReport;
use runtime::RigName;

use crate::desk::Shared;

/// The logger flushes within this time of a session's end.
const FLUSHED: Duration = Duration::from_millis(800);
/// The thread's nice level: a whole recording is read, and a rig without real-time scheduling goes
/// first.
const NICE: i32 = 15;

/// Asks for the list to be made anew.
pub(crate) struct ReportRequest;

/// Makes the list anew whenever it is asked for.
pub(crate) fn serve(rig: &RigName, shared: &Arc<Shared>, requests: &Receiver<ReportRequest>) {
    // Of this thread alone.
    let _refused = rustix::process::nice(NICE);
    while let Ok(ReportRequest) = requests.recv() {
        std::thread::sleep(FLUSHED);
        // One list answers all that asked for it.
        while requests.try_recv().is_ok() {}
        match reports(rig) {
            Ok(Some(reports)) => {
                let mut desk = shared.desk();
                desk.reports = reports;
                shared.show(&desk);
            }
            // Nothing is recorded.
            Ok(None) => {}
            Err(error) => eprintln!("farreach console: the list of sessions: {error:#}"),
        }
    }
}

/// The sessions of the recording in progress.
fn reports(rig: &RigName) -> anyhow::Result<Option<Vec<SessionReport>>> {
    let link = RigLink::open(rig)?;
    let recording = link.logger(&LoggerRequest::Status)?.recording;
    recording.map(|recording| recorder::session_reports(Path::new(&recording))).transpose()
}
