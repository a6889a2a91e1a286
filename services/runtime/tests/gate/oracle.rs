//! What may pass the gate, judged slowly from everything that ever arrived: the requirements of
//! docs/safety-case.md, not the gate's code, which forgets what it does not need.
//!
//! Two words of it:
//! - A token is *genuine* if it is of this session and from the sender that it names; a command, if
//!   it is of this session. A genuine message is *in order* if no earlier one of the same sender
//!   has a number as high, and none that was in order itself a later time (or, tokens, a higher
//!   epoch). What another sender said in between makes the order begin anew: within an epoch no
//!   other may speak at all.
//! - The *permission* begins with the first token since which all that were in order have permitted
//!   this epoch to this acquisition. A token for another acquisition interrupts it, as long as the
//!   gate has not opened.

use ipc_types::{AXES, EnableToken, Message, MotorCommand};
use runtime::gate::GateConfig;

/// What may be written is `Ok`; else why not.
type Judgement = Result<(), &'static str>;

fn ensure(holds: bool, what: &'static str) -> Judgement {
    if holds { Ok(()) } else { Err(what) }
}

/// A message that arrived.
#[derive(Clone)]
struct Heard<M> {
    message: M,
    /// Its place among all messages, tokens and commands.
    place: usize,
    genuine: bool,
    in_order: bool,
}

/// The messages of one topic that arrived, without those that only repeat one.
type Stream<M> = Vec<Heard<M>>;

/// Takes a message. `backwards`: whether any time in it is earlier than in the one before it.
fn hear<M: Message>(
    stream: &mut Stream<M>,
    message: &M,
    place: usize,
    genuine: bool,
    backwards: impl Fn(&M, &M) -> bool,
) {
    let newest = stream.last();
    let newest_in_order = stream.iter().rfind(|heard| heard.in_order);
    let is_repeated = [newest, newest_in_order]
        .into_iter()
        .flatten()
        .any(|heard| heard.message.as_bytes() == message.as_bytes());
    if is_repeated {
        return;
    }
    let of_this_sender = stream
        .iter()
        .rev()
        .filter(|heard| heard.genuine)
        .take_while(|heard| heard.message.incarnation() == message.incarnation());
    let follows = of_this_sender.fold(true, |follows, earlier| {
        follows
            && earlier.message.sequence() < message.sequence()
            && !(earlier.in_order && backwards(&earlier.message, message))
    });
    stream.push(Heard { message: *message, place, genuine, in_order: genuine && follows });
}

/// Everything that ever arrived.
#[derive(Clone)]
pub(crate) struct Oracle {
    config: GateConfig,
    tokens: Stream<EnableToken>,
    commands: Stream<MotorCommand>,
    arrived: usize,
    /// Since when the gate is open: the index of the newest token then.
    open_since: Option<usize>,
}

impl Oracle {
    pub(crate) fn new(config: GateConfig) -> Self {
        Self { config, tokens: vec![], commands: vec![], arrived: 0, open_since: None }
    }

    pub(crate) fn hear_token(&mut self, token: &EnableToken) {
        self.arrived += 1;
        let genuine =
            token.session == self.config.session && token.incarnation == token.watchdog_incarnation;
        hear(&mut self.tokens, token, self.arrived, genuine, |earlier, later| {
            later.issued_ns < earlier.issued_ns || later.epoch < earlier.epoch
        });
    }

    pub(crate) fn hear_command(&mut self, command: &MotorCommand) {
        self.arrived += 1;
        let genuine = command.session == self.config.session;
        hear(&mut self.commands, command, self.arrived, genuine, |earlier, later| {
            later.sample_tick < earlier.sample_tick
                || later.sample_time_ns < earlier.sample_time_ns
                || later.computed_ns < earlier.computed_ns
        });
    }

    /// Takes note of whether the gate is open now.
    pub(crate) fn became(&mut self, open: bool) {
        let newest = self.tokens.len().saturating_sub(1);
        self.open_since = open.then(|| self.open_since.unwrap_or(newest));
    }

    /// Epoch of the newest token.
    pub(crate) fn epoch(&self) -> u64 {
        self.tokens.last().map_or(0, |heard| heard.message.epoch)
    }

    /// Whether these volts may be written now.
    pub(crate) fn allows(&self, now_ns: u64, volts: [f64; AXES]) -> Judgement {
        let token = self.tokens.last().ok_or("no token")?;
        let command = self.commands.last().ok_or("no command")?;
        ensure(command.message.volts == volts, "not the newest command's volts")?;
        ensure(token.genuine && command.genuine, "session or token's sender")?;
        ensure(token.in_order, "token out of order")?;
        ensure(command.in_order, "command out of order")?;
        ensure(self.permits(token, token.message.epoch), "not permitted")?;
        ensure(
            token.message.control_incarnation == command.message.incarnation,
            "command's sender",
        )?;
        self.is_fresh(&token.message, &command.message, now_ns)?;
        self.epoch_is_one_watchdogs(&token.message)?;
        self.permission_is_unbroken(token.message.epoch, command.message.incarnation)
    }

    /// Whether a token permits this epoch to this acquisition.
    fn permits(&self, heard: &Heard<EnableToken>, epoch: u64) -> bool {
        let token = &heard.message;
        heard.in_order
            && token.enabled == 1
            && token.epoch == epoch
            && epoch > 0
            && token.acquisition_incarnation == self.config.acquisition_incarnation
    }

    /// SR-02, SR-05: neither old nor from the future.
    fn is_fresh(&self, token: &EnableToken, command: &MotorCommand, now_ns: u64) -> Judgement {
        let config = &self.config;
        let age = |then_ns: u64| i128::from(now_ns) - i128::from(then_ns);
        let future = -i128::from(config.future_ns);
        ensure(
            age(token.issued_ns) >= future && age(token.time_ns) >= future,
            "token from the future",
        )?;
        ensure(age(token.issued_ns) <= i128::from(config.token_life_ns), "token too old")?;
        ensure(age(token.valid_until_ns) <= 0, "token expired")?;
        let life = i128::from(token.valid_until_ns) - i128::from(token.issued_ns);
        ensure((0..=i128::from(config.token_life_ns)).contains(&life), "token's life")?;
        ensure(
            age(command.computed_ns) >= future && age(command.time_ns) >= future,
            "command from the future",
        )?;
        ensure(age(command.computed_ns) <= i128::from(config.command_life_ns), "command too old")?;
        let sample_age = age(command.sample_time_ns);
        ensure(
            sample_age >= future && sample_age <= i128::from(config.max_sample_age_ns),
            "sample's age",
        )
    }

    /// SR-03, SR-04, SR-07: since a token first named the epoch no other watchdog has spoken; no
    /// higher epoch was ever given, and none so high withdrawn, also by a token out of order.
    fn epoch_is_one_watchdogs(&self, token: &EnableToken) -> Judgement {
        let epoch = token.epoch;
        let of_any = || self.tokens.iter().filter(|heard| heard.genuine);
        ensure(
            !of_any().any(|heard| heard.message.enabled != 1 && heard.message.epoch >= epoch),
            "withdrawn before",
        )?;
        ensure(
            !of_any().any(|heard| heard.in_order && heard.message.epoch > epoch),
            "a higher epoch before",
        )?;
        let names_it = |heard: &&Heard<EnableToken>| heard.in_order && heard.message.epoch == epoch;
        let begun = of_any().find(names_it).map_or(0, |heard| heard.place);
        ensure(
            !of_any()
                .any(|heard| heard.place > begun && heard.message.incarnation != token.incarnation),
            "another watchdog in this epoch",
        )
    }

    /// SR-03 to SR-06, SR-08: nothing that ends an epoch has come since the permission began.
    fn permission_is_unbroken(&self, epoch: u64, control: u64) -> Judgement {
        let interrupted = self
            .tokens
            .iter()
            .rposition(|heard| heard.in_order && !self.permits(heard, epoch))
            .map_or(0, |index| index + 1);
        let permission: Vec<_> = self.tokens[interrupted..]
            .iter()
            .skip_while(|heard| !self.permits(heard, epoch))
            .collect();
        ensure(
            permission.iter().all(|heard| self.permits(heard, epoch)),
            "a token that is not genuine, or out of order, in this permission",
        )?;
        let begun = permission.first().map_or(0, |heard| heard.place);
        for heard in self.commands.iter().filter(|heard| heard.place > begun) {
            ensure(
                heard.genuine && heard.in_order,
                "a command of another session, or out of order, in this permission",
            )?;
            ensure(
                heard.message.incarnation == control,
                "a command of another control in this permission",
            )?;
            ensure(within_limits(&heard.message.volts), "volts beyond the limits before")?;
        }
        let opened = self.open_since.map_or(&[][..], |index| &self.tokens[index..]);
        ensure(
            opened.iter().all(|heard| {
                self.permits(heard, epoch) && heard.message.control_incarnation == control
            }),
            "another acquisition or control named since the gate opened",
        )
    }
}

/// Finite and within the limits of the gate's tests.
pub(crate) fn within_limits(volts: &[f64; AXES]) -> bool {
    volts
        .iter()
        .zip([5.0, 3.0, 0.0])
        .all(|(volts, limit)| volts.is_finite() && volts.abs() <= limit)
}
