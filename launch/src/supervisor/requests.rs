//! What clients ask of the launcher while the rig is up.

use std::collections::BTreeMap;

use super::Supervisor;
use crate::Config;
use crate::control_socket::{Answer, Request};
use crate::status::RigState;

impl Supervisor {
    pub(super) fn receive_requests(&mut self) {
        for (client, request) in self.control.receive() {
            let answer = match request {
                Err(reason) => Answer::Refused { reason },
                Ok(Request::Status) => {
                    self.refresh_status();
                    Answer::Status { status: Box::new(self.status.clone()) }
                }
                Ok(Request::Stop) => {
                    self.stop_all("a request to stop");
                    Answer::Done
                }
                Ok(Request::Restart { unit }) => self.restart(&unit),
                Ok(Request::Change { environment, units }) => self.change(environment, &units),
                Ok(Request::Replace { unit, command }) => self.replace(&unit, command),
            };
            self.control.answer(client, &answer);
        }
    }

    /// Changes variables and restarts the units that are to see them. Nothing is changed where a
    /// unit is unknown, the rig is not up, or the new configuration cannot be written down.
    fn change(&mut self, environment: BTreeMap<String, String>, units: &[String]) -> Answer {
        if let Some(unknown) = units.iter().find(|unit| self.index_of(unit).is_none()) {
            return self.no_unit(unknown);
        }
        let mut config = self.config.clone();
        config.environment.extend(environment);
        if let Err(refused) = self.take_up(config) {
            return refused;
        }
        self.journal.say(&format!("variables changed; restarting {}", units.join(", ")));
        let answers = units.iter().map(|unit| self.restart(unit));
        answers.fold(Answer::Done, |worst, answer| match worst {
            Answer::Done => answer,
            refused => refused,
        })
    }

    /// Runs another program in place of a unit's own, or its own again where `command` is empty.
    /// Nothing is changed where the unit is unknown, the rig is not up, or the new configuration
    /// cannot be written down.
    fn replace(&mut self, name: &str, command: Vec<String>) -> Answer {
        let Some(index) = self.index_of(name) else { return self.no_unit(name) };
        let mut config = self.config.clone();
        let told = command.join(" ");
        let replaced = !command.is_empty();
        match replaced {
            true => config.replaced.insert(name.to_owned(), command),
            false => config.replaced.remove(name),
        };
        if let Err(refused) = self.take_up(config) {
            return refused;
        }
        self.status.units[index].replaced_by = replaced.then(|| told.clone());
        let what =
            if replaced { format!("replaced by {told}") } else { "its own again".to_owned() };
        self.journal.say(&format!("{name}: {what}"));
        self.restart(name)
    }

    /// Writes another configuration down and goes by it.
    fn take_up(&mut self, config: Config) -> Result<(), Answer> {
        if self.lifecycle.phase() != RigState::Up {
            let reason = "the rig is not up: it is being started or stopped".to_owned();
            return Err(Answer::Refused { reason });
        }
        self.run_dir
            .write_json(&self.run_dir.launch_json(), &config)
            .map_err(|error| Answer::Refused { reason: error.to_string() })?;
        self.config = config;
        Ok(())
    }

    fn no_unit(&self, name: &str) -> Answer {
        let known: Vec<&str> = self.config.units.iter().map(|unit| unit.name.as_str()).collect();
        let reason = format!("no unit `{name}`; there are: {}", known.join(", "));
        Answer::Refused { reason }
    }

    fn restart(&mut self, name: &str) -> Answer {
        let Some(index) = self.index_of(name) else { return self.no_unit(name) };
        let now = self.now();
        match self.lifecycle.restart(index, now) {
            Err(reason) => Answer::Refused { reason: reason.to_owned() },
            Ok(actions) => {
                for action in actions {
                    self.perform(action);
                }
                Answer::Done
            }
        }
    }
}
