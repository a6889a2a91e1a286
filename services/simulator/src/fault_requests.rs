//! Faults of the simulated machine: the thread that answers requests builds the machine with them,
//! and the loop puts it in the place of the one before.

use ipc_types::{
    Event, EventKind, Process, SIMULATOR_COMMANDS, Severity, SimulatorAnswer, SimulatorRequest,
};
use plant::coupled_axes::Plant;
use rig::RigFile;
use rtrb::{Consumer, Producer, RingBuffer};
use runtime::{RigName, ServiceError, Worker};

use crate::card::plant_of;

/// Machines that wait for the loop, which takes one in each cycle.
const WAITING: usize = 2;

/// What the thread works with.
#[derive(Debug)]
struct FaultHandler {
    rig: RigFile,
    /// Effects of the machine at present, beside those of the rig file.
    effects: Vec<String>,
    plants: Producer<(Plant, Event)>,
    /// Machines that the loop has done with: the memory is freed here.
    done: Consumer<Plant>,
}

/// The loop's side.
#[derive(Debug)]
pub(crate) struct FaultLink {
    plants: Consumer<(Plant, Event)>,
    done: Producer<Plant>,
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
        let (plants, waiting) = RingBuffer::new(WAITING);
        // One more than can be on the way.
        let (done, finished) = RingBuffer::new(2 * WAITING);
        let handler =
            FaultHandler { rig: rig.clone(), effects: effects.to_vec(), plants, done: finished };
        let idle = |handler: &mut FaultHandler| while handler.done.pop().is_ok() {};
        let thread = Worker::serve(name, SIMULATOR_COMMANDS, handler, idle, FaultHandler::answer)?;
        Ok(Self { plants: waiting, done, _thread: thread })
    }

    /// The machine that takes the place of the one before, with what is told of it. Does not
    /// allocate.
    pub(crate) fn take(&mut self) -> Option<(Plant, Event)> {
        self.plants.pop().ok()
    }

    /// Gives a machine back. One that finds no room is freed by the loop, which is late then.
    pub(crate) fn give_back(&mut self, plant: Plant) {
        let _room = self.done.push(plant);
    }
}

impl FaultHandler {
    fn answer(&mut self, request: SimulatorRequest) -> SimulatorAnswer {
        let error = match request {
            SimulatorRequest::Status => String::new(),
            SimulatorRequest::Effects { effects } => self.change(effects).err().unwrap_or_default(),
        };
        SimulatorAnswer { effects: self.effects.clone(), error }
    }

    fn change(&mut self, effects: Vec<String>) -> Result<(), String> {
        let plant = plant_of(&self.rig, &effects).map_err(|error| error.to_string())?;
        let text = if effects.is_empty() { "none".to_owned() } else { effects.join(", ") };
        let (kind, severity) = (EventKind::EffectsChanged, Severity::Warning);
        let event = Event::new(Process::Simulator, kind, severity, &text);
        let event = Event { a: effects.len() as f64, ..event };
        self.plants.push((plant, event)).map_err(|_| {
            "the simulated card has not taken the change before: does it run?".to_owned()
        })?;
        self.effects = effects;
        Ok(())
    }
}
