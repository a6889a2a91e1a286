//! The faults that are active now: by age and absence of messages, and those held since they were
//! seen.

use ipc_types::{TripCause, WatchdogState};
use rig::WithoutLogger;

use super::config::homing_time_ns;
use super::faults::{FaultSet, PRIORITY};
use super::message_monitor::{age_ns, lacks_realtime, takes_volts};
use super::{Interlock, Peers, TOKEN_HISTORY};

impl Interlock {
    /// Whether the newest sample is recent enough for the enable line to keep toggling.
    pub(super) fn samples_are_fresh(&self, now_ns: u64) -> bool {
        self.samples.newest.as_ref().is_some_and(|sample| {
            now_ns.saturating_sub(sample.scan_time_ns) <= self.config.enable_line_pause_ns
        })
    }

    /// Updates the set of active faults.
    pub(super) fn update_faults(&mut self, now_ns: u64, peers: Peers) {
        let config = &self.config;
        let mut active = FaultSet::NONE;
        let mut momentary = std::mem::take(&mut self.momentary);

        let gap_ns = self.last_step_ns.map(|last| now_ns.checked_sub(last));
        momentary.insert_if(
            gap_ns.is_some_and(|gap| gap.is_none_or(|gap| gap > config.token_life_ns)),
            TripCause::WatchdogLate,
        );
        self.last_step_ns = Some(now_ns);
        let unpowered_since_ns = *self.unpowered_since_ns.get_or_insert(now_ns);

        if let Some(sample) = &self.samples.newest {
            let age = age_ns(now_ns, sample, sample.scan_time_ns, config);
            momentary.insert_if(age.is_none(), TripCause::SampleBackwards);
            active.insert_if(
                age.is_none_or(|age| age > config.peer_lost_ns),
                TripCause::AcquisitionLost,
            );
            // Trips before the card removes motor power by itself: the enable line has been silent
            // for nearly the card's timeout.
            let line_silent_ns = now_ns.saturating_sub(self.toggled_at_ns);
            let line_silent =
                self.state == WatchdogState::Enabled && line_silent_ns > config.enable_line_gap_ns;
            let fresh = self.samples_are_fresh(now_ns);
            active.insert_if(
                line_silent,
                if fresh { TripCause::WatchdogLate } else { TripCause::AcquisitionLost },
            );
            active.insert_if(self.echo_lost(sample.token_sequence, now_ns), TripCause::EchoLost);
            active.insert_if(!takes_volts(sample), TripCause::NoOutput);
            active.insert_if(
                lacks_realtime(sample, self.commands.newest.as_ref(), config),
                TripCause::NotRealtime,
            );
            // Nothing but our line keeps the motor's power on, and it has been still for as long.
            let unpowered = self.state != WatchdogState::Enabled
                && now_ns.saturating_sub(unpowered_since_ns) > config.echo_lost_ns;
            active.insert_if(
                unpowered && takes_volts(sample) && sample.motor_power == 1,
                TripCause::MotorPowered,
            );
            // The gate must write 0 V within `echo_lost_ns` of the end of permission; checked from
            // the samples, independently of the gate. The limit is then 0 V, hence the cause.
            let overdue = unpowered && sample.output_v.iter().any(|&volts| volts != 0.0);
            active.insert_if(overdue, TripCause::VoltageLimit);
        } else {
            active.insert(TripCause::AcquisitionLost);
        }
        if let Some(command) = &self.commands.newest {
            let age = age_ns(now_ns, command, command.computed_ns, config);
            momentary.insert_if(age.is_none(), TripCause::CommandBackwards);
            active
                .insert_if(age.is_none_or(|age| age > config.peer_lost_ns), TripCause::ControlLost);
            let sample_age_ns = now_ns.saturating_sub(command.sample_time_ns);
            active.insert_if(sample_age_ns > config.echo_lost_ns, TripCause::CommandStale);
            active.insert_if(self.echo_lost(command.token_sequence, now_ns), TripCause::EchoLost);
        } else {
            active.insert(TripCause::ControlLost);
        }
        active.insert_if(!peers.launcher_alive, TripCause::LauncherLost);
        active.insert_if(!peers.keeper_alive, TripCause::KeeperLost);
        let logger_needed = config.without_logger != WithoutLogger::Allow;
        active.insert_if(logger_needed && !peers.logger_alive, TripCause::LoggerLost);
        active.insert_if(
            self.state == WatchdogState::Enabled
                && !self.gate_opened
                && now_ns.saturating_sub(self.enabled_at_ns) > config.gate_open_ns,
            TripCause::GateNotOpen,
        );
        active.insert_if(
            self.state == WatchdogState::Enabled
                && homing_time_ns(&config.axes, self.samples.homed())
                    .is_some_and(|most| now_ns.saturating_sub(self.enabled_at_ns) > most),
            TripCause::HomingTime,
        );

        for &cause in PRIORITY {
            let held_until_ns = &mut self.held_until_ns[usize::from(cause.code())];
            if momentary.contains(cause) {
                *held_until_ns = now_ns.saturating_add(config.hold_ns);
            }
            active.insert_if(momentary.contains(cause) || now_ns < *held_until_ns, cause);
        }
        self.active = active;
    }

    /// Whether the token sequence echoed by a peer is too old or was never issued by this
    /// watchdog.
    fn echo_lost(&self, echoed: u64, now_ns: u64) -> bool {
        match self.sequence.checked_sub(echoed) {
            // Tokens issued so far have sequences below `sequence`.
            None | Some(0) => true,
            Some(behind) if behind > TOKEN_HISTORY as u64 => true,
            Some(_) => {
                now_ns.saturating_sub(self.issued_ns[echoed as usize % TOKEN_HISTORY])
                    > self.config.echo_lost_ns
            }
        }
    }
}
