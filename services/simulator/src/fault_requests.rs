//! Faults of the simulated card and machine: the thread that answers requests builds what they
//! need, and the loop puts it in place between two scans.

use std::time::{Duration, Instant};

use ipc_types::{
    Event, EventKind, InjectedFault, Process, SIMULATOR_COMMANDS, Severity, SimulatorAnswer,
    SimulatorRequest,
};
use plant::coupled_axes::Plant;
use rig::RigFile;
use rtrb::{Consumer, Producer, RingBuffer};
use runtime::{RigName, ServiceError, Worker};

use crate::card::Card;
use crate::faults::{Fault, FaultFilter, FaultInjector, FaultNotice, Injection, MOST_FAULTS};

/// Orders that wait for the loop, which takes one in each cycle.
const WAITING: usize = 2 * MOST_FAULTS;
/// How long the loop may take to carry out an order.
const LIMIT: Duration = Duration::from_millis(500);
const POLL_PERIOD: Duration = Duration::from_millis(1);

/// What the loop is to do between two scans.
#[derive(Debug)]
struct Order {
    /// The machine that takes the place of the one before.
    plant: Option<Plant>,
    task: Task,
}

#[derive(Debug)]
#[allow(clippy::large_enum_variant)] // A box would be freed in the loop.
enum Task {
    /// Another machine, and what is told of it.
    Change(Event),
    /// A fault begins: what is told of its begin and its end.
    Begin(Injection, [Event; 2]),
    /// The fault of that number ends.
    End(u64),
}

/// A fault that was put in.
#[derive(Debug)]
struct Injected {
    number: u64,
    fault: Fault,
    told: InjectedFault,
    begun: bool,
}

/// What the thread works with.
#[derive(Debug)]
struct FaultHandler {
    injector: FaultInjector,
    orders: Producer<Order>,
    /// Machines that the loop has done with: the memory is freed here.
    done: Consumer<Plant>,
    notices: Consumer<FaultNotice>,
    /// Faults in force.
    injected: Vec<Injected>,
}

/// The loop's side.
#[derive(Debug)]
pub(crate) struct FaultLink {
    orders: Consumer<Order>,
    done: Producer<Plant>,
    notices: Producer<FaultNotice>,
    /// What is told of the faults in force, by their number.
    events: [Option<(u64, [Event; 2])>; MOST_FAULTS],
    _thread: Worker,
}

impl FaultLink {
    /// Starts the thread, for a machine with these effects.
    ///
    /// # Errors
    /// As [`Worker::serve`].
    pub(crate) fn serve(
        name: &RigName,
        rig: &RigFile,
        effects: &[String],
    ) -> Result<Self, ServiceError> {
        let (orders, waiting) = RingBuffer::new(WAITING);
        // One more than can be on the way.
        let (done, finished) = RingBuffer::new(2 * WAITING);
        let (notices, noticed) = RingBuffer::new(4 * MOST_FAULTS);
        let injector = FaultInjector::new(rig, effects);
        let handler = FaultHandler {
            injector,
            orders,
            done: finished,
            notices: noticed,
            injected: Vec::new(),
        };
        let idle = FaultHandler::take_notices;
        let thread = Worker::serve(name, SIMULATOR_COMMANDS, handler, idle, FaultHandler::answer)?;
        Ok(Self { orders: waiting, done, notices, events: [None; MOST_FAULTS], _thread: thread })
    }

    /// Carries out the next order, before a scan; returns what is told of it. Does not allocate.
    pub(crate) fn carry_out(&mut self, card: &mut Card) -> Option<Event> {
        let Order { plant, task } = self.orders.pop().ok()?;
        let (unneeded, event) = match task {
            Task::Change(event) => (plant.map(|plant| card.replace_plant(plant)), Some(event)),
            Task::Begin(injection, events) => {
                let (begun, unneeded) = card.begin_fault(&injection, plant);
                let free = self.events.iter_mut().find(|slot| slot.is_none());
                if let (true, Some(free)) = (begun, free) {
                    *free = Some((injection.number, events));
                }
                (unneeded, None)
            }
            Task::End(number) => {
                card.end_fault(number);
                (plant, None)
            }
        };
        if let Some(plant) = unneeded {
            // One that finds no room is freed here, and the loop is late then.
            let _room = self.done.push(plant);
        }
        event
    }

    /// What is told of a fault that has begun or ended. Does not allocate.
    pub(crate) fn tell(&mut self, notice: FaultNotice) -> Option<Event> {
        // A thread that has ended answers nobody.
        let _room = self.notices.push(notice);
        let of_number = |slot: &&mut Option<(u64, [Event; 2])>| {
            slot.as_ref().is_some_and(|(number, _)| *number == notice.number)
        };
        let slot = self.events.iter_mut().find(of_number)?;
        let event = slot.as_ref().map(|(_, events)| events[usize::from(notice.over)]);
        if notice.over {
            *slot = None;
        }
        event.map(|event| Event { a: notice.tick as f64, ..event })
    }
}

impl FaultHandler {
    fn answer(&mut self, request: SimulatorRequest) -> SimulatorAnswer {
        self.take_notices();
        let faults = match request {
            SimulatorRequest::Status => Ok(self.in_force(|_| true)),
            SimulatorRequest::Effects { effects } => self.change(effects).map(|()| Vec::new()),
            SimulatorRequest::Fault { fault, axis, for_s } => {
                self.begin(&fault, axis.as_deref(), for_s)
            }
            SimulatorRequest::ClearFaults { fault, axis } => {
                self.clear(fault.as_deref(), axis.as_deref())
            }
        };
        let (faults, error) = match faults {
            Ok(faults) => (faults, String::new()),
            Err(error) => (Vec::new(), error),
        };
        SimulatorAnswer { effects: self.injector.effects().to_vec(), faults, error }
    }

    fn in_force(&self, wanted: impl Fn(&Injected) -> bool) -> Vec<InjectedFault> {
        let begun = self.injected.iter().filter(|injected| injected.begun && wanted(injected));
        begun.map(|injected| injected.told.clone()).collect()
    }

    fn change(&mut self, effects: Vec<String>) -> Result<(), String> {
        let text = if effects.is_empty() { "none".to_owned() } else { effects.join(", ") };
        let event = told(EventKind::EffectsChanged, Severity::Warning, &text);
        let event = Event { a: effects.len() as f64, ..event };
        let before = self.injector.effects().to_vec();
        let plant = self.injector.change_effects(effects).map_err(|error| error.to_string())?;
        let ordered = self.order(Some(plant), Task::Change(event));
        if ordered.is_err() {
            // They were valid before.
            let _unused = self.injector.change_effects(before);
        }
        ordered
    }

    fn begin(
        &mut self,
        text: &str,
        axis: Option<&str>,
        for_s: Option<f64>,
    ) -> Result<Vec<InjectedFault>, String> {
        let rig = self.injector.rig();
        let fault = Fault::parse(text, axis, for_s, rig).map_err(|error| error.to_string())?;
        let axis = rig.axes.get(fault.axis).map_or_else(String::new, |axis| axis.name.clone());
        if self.injected.len() >= MOST_FAULTS {
            return Err(format!("{MOST_FAULTS} faults are in force: clear some"));
        }
        let (injection, plant) =
            self.injector.prepare(&fault).map_err(|error| error.to_string())?;
        let mut words = format!("{fault} on {axis}");
        if let Some(for_s) = for_s {
            words += &format!(", for {for_s} s");
        }
        let events = [EventKind::FaultBegun, EventKind::FaultEnded].map(|kind| Event {
            b: fault.axis as f64,
            c: fault.size,
            ..told(kind, Severity::Warning, &words)
        });
        let (number, fault_text) = (injection.number, fault.to_string());
        if let Err(error) = self.order(plant, Task::Begin(injection, events)) {
            self.injector.forget(number);
            return Err(error);
        }
        let told = InjectedFault { fault: fault_text, axis, ..InjectedFault::default() };
        self.injected.push(Injected { number, fault, told, begun: false });
        // A short one may be over before it is looked for.
        let mut begun = None;
        self.wait(|it| it.number == number && it.begun, &mut begun)?;
        Ok(begun.into_iter().collect())
    }

    fn clear(
        &mut self,
        text: Option<&str>,
        axis: Option<&str>,
    ) -> Result<Vec<InjectedFault>, String> {
        let filter = FaultFilter::parse(text, axis, self.injector.rig());
        let filter = filter.map_err(|error| error.to_string())?;
        let meant = self.injected.iter().filter(|injected| filter.means(&injected.fault));
        let numbers: Vec<u64> = meant.map(|injected| injected.number).collect();
        if let (true, Some(text)) = (numbers.is_empty(), text) {
            return Err(format!("no fault `{text}` is in force"));
        }
        let mut over = Vec::new();
        for number in numbers {
            self.order(None, Task::End(number))?;
            let mut ended = None;
            self.wait(
                |injected| injected.number == number && injected.told.ended_tick.is_some(),
                &mut ended,
            )?;
            over.extend(ended);
        }
        Ok(over)
    }

    fn order(&mut self, plant: Option<Plant>, task: Task) -> Result<(), String> {
        self.orders.push(Order { plant, task }).map_err(|_| not_taken())
    }

    /// Waits until the loop has told of a fault.
    fn wait(
        &mut self,
        is: impl Fn(&Injected) -> bool,
        found: &mut Option<InjectedFault>,
    ) -> Result<(), String> {
        let started = Instant::now();
        loop {
            self.follow_notices(|injected| {
                if found.is_none() && is(injected) {
                    *found = Some(injected.told.clone());
                }
            });
            if found.is_some() {
                return Ok(());
            }
            if started.elapsed() > LIMIT {
                return Err(not_taken());
            }
            std::thread::sleep(POLL_PERIOD);
        }
    }

    fn take_notices(&mut self) {
        while self.done.pop().is_ok() {}
        self.follow_notices(|_| {});
    }

    /// Takes what the loop has told of faults; `see` is called with each that is told of.
    fn follow_notices(&mut self, mut see: impl FnMut(&Injected)) {
        while let Ok(notice) = self.notices.pop() {
            let mut all = self.injected.iter_mut();
            let Some(injected) = all.find(|injected| injected.number == notice.number) else {
                continue;
            };
            if notice.over {
                injected.told.ended_tick = Some(notice.tick);
            } else {
                injected.begun = true;
                injected.told.begun_tick = notice.tick;
                let ticks = injected.fault.ticks;
                injected.told.until_tick = ticks.map(|ticks| notice.tick.saturating_add(ticks));
            }
            see(injected);
        }
        self.injected.retain(|injected| injected.told.ended_tick.is_none());
    }
}

fn told(kind: EventKind, severity: Severity, text: &str) -> Event {
    Event::new(Process::Simulator, kind, severity, text)
}

fn not_taken() -> String {
    "the simulated card has not taken the change: does it run?".to_owned()
}
