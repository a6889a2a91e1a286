//! The loop round the screen: reads messages and keys, draws.

use std::sync::atomic::Ordering;
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyEvent, KeyEventKind};
use runtime::clock::{MILLISECOND_NS, now_ns};
use runtime::stop_on;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::scope::capture::{Capture, Mode};
use crate::scope::sampler::Sampler;
use crate::scope::screen::{self, Counts, Scene};
use crate::scope::view::{Action, View};
use crate::stream::{Progress, Source};

/// Shortest time between two pictures (ns).
const FRAME_NS: u64 = 50 * MILLISECOND_NS;
/// Time between two pictures where only the counts are new (ns).
const COUNTS_NS: u64 = 500 * MILLISECOND_NS;
/// A rolling picture is drawn anew when it has moved by this part of its width: drawing must not
/// take the processors from a rig that has no real-time scheduling.
const ROLLED: u64 = 400;
/// How long a key is waited for while nothing else is to be done.
const IDLE: Duration = Duration::from_millis(50);
/// Messages of a recording that are read between two looks at the keys.
const BATCH: usize = 4096;

/// Puts the terminal back as it was.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// Shows the screen until a key or a signal ends it.
///
/// # Errors
/// If the terminal cannot be used, or what the source says.
pub(crate) fn show(
    source: &mut dyn Source,
    sampler: Sampler,
    view: View,
    recorded: bool,
) -> anyhow::Result<()> {
    let stop = stop_on(&[SIGINT, SIGTERM, SIGHUP])?;
    let restore = Restore;
    let mut terminal = ratatui::try_init()?;
    let mut shown = Shown {
        sampler,
        view,
        capture: None,
        recorded,
        searching: true,
        ended: false,
        changed: true,
        quit: false,
    };
    let mut drawn_ns = 0;
    while !shown.quit && !stop.load(Ordering::Relaxed) {
        let mut wait = shown.read(source)?;
        while event::poll(wait)? {
            shown.event(&event::read()?);
            wait = Duration::ZERO;
        }
        let now = now_ns();
        if now >= drawn_ns + shown.frame_ns() {
            shown.roll();
            let streams = source.streams();
            let counts = Counts {
                received: streams.iter().map(|stream| stream.received()).sum(),
                lost: streams.iter().map(|stream| stream.lost()).sum(),
                out_of_order: shown.sampler.capturer.out_of_order(),
                early: shown.sampler.capturer.early(),
            };
            let scene = shown.scene(counts);
            terminal.draw(|frame| screen::draw(&scene, frame.area(), frame.buffer_mut()))?;
            drawn_ns = now;
            shown.changed = false;
        }
    }
    drop(restore);
    Ok(())
}

/// What is on the screen, and what becomes of it.
struct Shown {
    sampler: Sampler,
    view: View,
    capture: Option<Capture>,
    recorded: bool,
    /// Whether a recording is read on, to the next window.
    searching: bool,
    ended: bool,
    changed: bool,
    quit: bool,
}

impl Shown {
    /// Reads messages; how long a key may be waited for then.
    fn read(&mut self, source: &mut dyn Source) -> anyhow::Result<Duration> {
        if self.ended || self.recorded && !self.searching {
            return Ok(IDLE);
        }
        let messages = if self.recorded { BATCH } else { 1 };
        for _ in 0..messages {
            let sampler = &mut self.sampler;
            let progress = source.read(u64::MAX, &mut |message| {
                sampler.take(message);
            })?;
            let captured = match progress {
                Progress::UpTo(known_ns) => self.sampler.capturer.advance(known_ns),
                Progress::Ended => {
                    self.ended = true;
                    // A running rig ends it by a signal.
                    self.quit = !self.recorded;
                    self.sampler.capturer.finish()
                }
            };
            if let Some(capture) = captured.filter(|_| self.view.running) {
                self.view.fit(&capture);
                self.capture = Some(capture);
                self.searching = false;
                self.changed = true;
                break;
            }
            if self.ended {
                self.changed = true;
                break;
            }
        }
        // The source of a running rig has waited.
        Ok(Duration::ZERO)
    }

    fn rolls(&self) -> bool {
        self.view.settings.mode == Mode::Roll && self.view.running
    }

    /// Time from a picture to the next (ns).
    fn frame_ns(&self) -> u64 {
        match (self.changed, self.rolls()) {
            (true, _) => FRAME_NS,
            (false, true) => FRAME_NS.max(self.view.settings.window_ns / ROLLED),
            (false, false) => COUNTS_NS,
        }
    }

    /// In the rolling mode, shows the newest samples.
    fn roll(&mut self) {
        if self.rolls() {
            let capture = self.sampler.capturer.newest();
            self.view.fit(&capture);
            self.capture = Some(capture);
        }
    }

    fn event(&mut self, event: &Event) {
        self.changed = true;
        if let Event::Key(key) = event
            && key.kind != KeyEventKind::Release
        {
            self.key(*key);
        }
    }

    fn key(&mut self, key: KeyEvent) {
        match self.view.key(key) {
            Action::Nothing => {}
            Action::Set => {
                let capturer = &mut self.sampler.capturer;
                capturer.set(self.view.settings);
                self.capture = self.capture.as_ref().map(|capture| capturer.again(capture));
            }
            Action::Run => {
                self.sampler.capturer.rearm();
                self.searching = true;
            }
            Action::Force => self.capture = Some(self.sampler.capturer.newest()),
            Action::Quit => self.quit = true,
        }
        if let Some(capture) = &self.capture {
            self.view.fit(capture);
        }
    }

    fn scene(&self, counts: Counts) -> Scene<'_> {
        let doing = match (self.recorded, self.ended, self.searching) {
            (true, true, _) => "end of the recording",
            (true, false, false) => "space: next window",
            _ => self.sampler.capturer.doing(),
        };
        Scene {
            place: &self.sampler.place,
            view: &self.view,
            capture: self.capture.as_ref(),
            doing,
            counts,
        }
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{COMMAND, Message, MotorCommand};
    use ratatui::crossterm::event::{KeyCode, KeyModifiers};

    use super::*;
    use crate::scope::capture::{Capturer, Settings};
    use crate::scope::channel;
    use crate::scope::trigger::Condition;
    use crate::stream::{Arrived, Stamp, Stream};

    /// A recording of commands: volts[0] is 1 in each tenth of them, and the 26th is missing.
    struct Commands {
        streams: [Stream; 1],
        next: u64,
    }

    impl Source for Commands {
        fn streams(&self) -> &[Stream] {
            &self.streams
        }
        fn since_ns(&self) -> u64 {
            0
        }
        fn read(
            &mut self,
            _until_ns: u64,
            sink: &mut dyn FnMut(&Arrived<'_>),
        ) -> anyhow::Result<Progress> {
            self.next += if self.next == 25 { 2 } else { 1 };
            if self.next > 60 {
                return Ok(Progress::Ended);
            }
            let mut command = MotorCommand::default();
            command.volts[0] = f64::from(u8::from(self.next.is_multiple_of(10)));
            let time_ns = self.next * MILLISECOND_NS;
            command.stamp(1, 2, self.next, time_ns);
            let bytes = command.as_bytes();
            let sent = self.streams[0].see(bytes, 0);
            sink(&Arrived { stream: 0, bytes, sent, stamp: Stamp::Logged(time_ns) });
            Ok(Progress::UpTo(time_ns))
        }
        fn exit_code(&self) -> i32 {
            0
        }
    }

    #[test]
    fn a_recording_is_read_from_window_to_window() {
        let mut source = Commands { streams: [Stream::of_topic(&COMMAND.topic)], next: 0 };
        let wanted = channel::wanted(&["command.volts[0]".to_owned()], None).unwrap();
        let (channels, readers) = channel::bind(&wanted, source.streams()).unwrap();
        let settings = Settings {
            mode: Mode::Normal,
            window_ns: 8 * MILLISECOND_NS,
            pre_ns: 4 * MILLISECOND_NS,
            auto_ns: 1_000_000_000,
            channel: (0, 0),
            condition: Condition::Rising(0.5),
            hysteresis: 0.0,
        };
        let capturer = Capturer::new(settings, &[1], 100);
        let mut shown = Shown {
            sampler: Sampler::new("x.mcap".to_owned(), readers, capturer, 0),
            view: View::new(channels, settings, true),
            capture: None,
            recorded: true,
            searching: true,
            ended: false,
            changed: false,
            quit: false,
        };
        let space = KeyEvent::new(KeyCode::Char(' '), KeyModifiers::NONE);
        let mut found = Vec::new();
        for _ in 0..8 {
            shown.read(&mut source).unwrap();
            let at_ns = shown.capture.as_ref().map(|capture| capture.zero_ns);
            found.push((at_ns.unwrap() / MILLISECOND_NS, shown.ended));
            shown.key(space);
        }
        // The last window ends with the recording. After that, nothing more comes.
        let until_end = [10, 20, 30, 40, 50].map(|at| (at, false));
        assert_eq!(found[..5], until_end);
        assert_eq!(found[5..], [(60, true); 3]);
        let last = shown.capture.as_ref().unwrap();
        assert!(!last.whole && last.rows[0].len() == 5);
        let lost = shown.scene(Counts::default()).capture.unwrap().lost();
        assert_eq!((lost, source.streams[0].lost()), (0, 1));
        assert!(!shown.quit);
        shown.key(KeyEvent::new(KeyCode::Char('q'), KeyModifiers::NONE));
        assert!(shown.quit);
    }
}
