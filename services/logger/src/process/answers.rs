//! What requests lead to.

use ipc_types::{EventKind, LoggerAnswer, LoggerRequest, Severity, TEXT};
use recording::mcap_write::key;
use runtime::PortError;
use runtime::clock::now_ns;

use super::requests::PendingRequest;
use super::{Logger, LoggerError};
use crate::recorder_front_end::RecorderError;

impl Logger {
    pub(super) fn answer(&mut self, request: PendingRequest) -> Result<(), LoggerError> {
        let PendingRequest { request, reply } = request;
        let result = match request {
            LoggerRequest::Status => {
                let _ = reply.send(self.recorder.status());
                return Ok(());
            }
            LoggerRequest::Start { path, metadata, split } => {
                self.report_replacements()?;
                let metadata = metadata.into_iter().collect();
                let request = self.start_request(path.into(), metadata, split);
                self.start(request).map(|()| self.start_reply = Some(reply.clone()))
            }
            LoggerRequest::Stop => {
                self.report_replacements()?;
                // Everything published before the request is in the buffers by now.
                self.drain()?;
                self.recorder.stop().map(|()| self.stop_reply = Some(reply.clone()))
            }
            LoggerRequest::NextPart => {
                let status = self.recorder.status();
                let error = match (&status.ring, &self.part_wanted) {
                    (None, _) => "there is no ring (farreach rec start --ring 30s FILE)",
                    (_, Some(_)) => "somebody else asked for the next part: try again",
                    (Some(_), None) => {
                        self.part_wanted = Some(reply);
                        return Ok(());
                    }
                };
                let _ = reply.send(LoggerAnswer { error: error.to_owned(), ..status });
                return Ok(());
            }
            LoggerRequest::Run { metadata } => {
                self.run = metadata.into_iter().collect();
                self.run.insert(key::TIME_NS.to_owned(), now_ns().to_string());
                let noted = self.recorder.note_run(self.run.clone());
                let _ = reply.send(self.recorder.status());
                noted
            }
            LoggerRequest::Tag { author, text } => {
                let error = self.tag(&author, &text)?.err().unwrap_or_default();
                let _ = reply.send(LoggerAnswer { error, ..self.recorder.status() });
                return Ok(());
            }
        };
        match result {
            Ok(()) => Ok(()),
            Err(error @ RecorderError::Thread { .. }) => Err(error.into()),
            Err(error) => {
                // Fails only where the client is gone.
                let _ =
                    reply.send(LoggerAnswer { error: error.to_string(), ..self.recorder.status() });
                Ok(())
            }
        }
    }

    /// Puts a note into the recording. The inner error is why not.
    fn tag(&mut self, author: &str, text: &str) -> Result<Result<(), String>, PortError> {
        if !self.recorder.writing() {
            let status = self.recorder.status();
            let error = status.recording.map(|_| status.error).filter(|error| !error.is_empty());
            return Ok(Err(error.unwrap_or_else(|| RecorderError::NotRecording.to_string())));
        }
        let text = match tag_text(author, text) {
            Ok(text) => text,
            Err(error) => return Ok(Err(error)),
        };
        self.service.event(EventKind::Note, Severity::Info, [0.0; 3], &text)?;
        // As all events it comes from shared memory: on its way to the file before the answer.
        self.drain()?;
        Ok(Ok(()))
    }
}

/// The text of a note: who gives it, and what it says.
fn tag_text(author: &str, text: &str) -> Result<String, String> {
    let (author, text) = (author.trim(), text.trim());
    for (what, found) in [("author", author), ("text", text)] {
        if found.is_empty() {
            return Err(format!("tag: expected some text as {what}, found none"));
        }
        if found.chars().any(char::is_control) {
            return Err(format!("tag: {what}: expected a line of text, found a control character"));
        }
    }
    let whole = format!("{author}: {text}");
    match whole.len() {
        found if found > TEXT => Err(format!(
            "tag: expected at most {TEXT} bytes with the author, found {found}: `{whole}`; \
             shorten it"
        )),
        _ => Ok(whole),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_a_line_that_an_event_holds_whole() {
        assert_eq!(tag_text("anna", " elbow moved\n").unwrap(), "anna: elbow moved");
        let longest = "ä".repeat((TEXT - "anna: ".len()) / 2);
        assert_eq!(tag_text("anna", &longest).unwrap().len(), TEXT);
        for (author, text, expected) in [
            ("anna", " ", "text"),
            ("", "moved", "author"),
            ("anna", "a\tb", "control character"),
            ("anna", &format!("{longest}."), "found 121"),
        ] {
            let error = tag_text(author, text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
