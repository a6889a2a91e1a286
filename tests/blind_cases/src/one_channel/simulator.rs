//! The simulator of machines with one channel.
//!
//! Drives and oscillators move by the midpoint form of Störmer-Verlet steps of 50 µs or less: half
//! a step of position, a step of velocity with viscous friction implicit, half a step of position.
//! Dry friction is implicit too: where the force needed to stop is within its level, the machine
//! stops (Moreau's time stepping), or, for a smooth transition, the velocity solves a monotone
//! equation. A testing machine follows its reference through a filter of second order.

use super::Kind;
use super::effect::{Acts, Law, Now, Passing};
use super::machine::{Machine, Stick};
use super::movement::Movement;
use crate::random::Draw;

/// Longest step, s.
const LONGEST_S: f64 = 5e-5;
/// Fewest steps a row.
const FEWEST: usize = 10;
/// Least rate of position control, Hz; it is a multiple of that of the rows.
const CONTROL_HZ: f64 = 1000.0;

/// Disturbance of the machine and step of its encoder.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surroundings {
    /// Standard deviation of the disturbance (force).
    pub disturbance: f64,
    /// Its corner frequency, Hz.
    pub corner_hz: f64,
    /// Step of the encoder; 0 for none.
    pub count: f64,
    /// Largest command; 0 for none.
    pub limit: f64,
}

/// What the channels show, row by row, before the noise of the force channel.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Force, or input.
    pub force: Vec<f64>,
    /// Position, or output.
    pub position: Vec<f64>,
    /// True velocity.
    pub velocity: Vec<f64>,
    /// Dry friction over its level, from -1 to 1.
    pub direction: Vec<f64>,
    /// The force that each effect takes or adds.
    pub effects: Vec<Vec<f64>>,
}

/// Cycles of control a row.
fn cycles(row_hz: f64) -> usize {
    ((CONTROL_HZ / row_hz).ceil() as usize).max(1)
}

/// Steps a row: a whole number for each cycle of control.
pub fn steps(row_hz: f64) -> usize {
    let least = ((1.0 / (row_hz * LONGEST_S)).ceil() as usize).max(FEWEST);
    least.div_ceil(cycles(row_hz)) * cycles(row_hz)
}

/// A machine in a record.
struct Running<'a> {
    machine: &'a Machine,
    laws: &'a mut [Law],
    mass: f64,
    now: Now,
    bristle: f64,
    reaction: f64,
    direction: f64,
    taken: Vec<f64>,
    dry: Vec<f64>,
}

/// A signal through a chain of effects; what each took is added to its account.
fn pass(
    laws: &mut [Law],
    taken: &mut [f64],
    signal: f64,
    now: &Now,
    of: fn(&mut Law) -> Option<&mut Passing>,
    sign: f64,
) -> f64 {
    let mut value = signal;
    for (law, taken) in laws.iter_mut().zip(taken) {
        if let Some(passing) = of(law) {
            let next = passing(value, now);
            *taken += sign * (next - value);
            value = next;
        }
    }
    value
}

fn delivering(law: &mut Law) -> Option<&mut Passing> {
    if let Law::Delivers(passing) = law { Some(passing) } else { None }
}

fn measuring(law: &mut Law) -> Option<&mut Passing> {
    if let Law::Measures(passing) = law { Some(passing) } else { None }
}

/// What the position channel shows.
fn read(laws: &mut [Law], position: f64, now: &Now) -> f64 {
    laws.iter_mut().fold(position, |value, law| {
        if let Law::Counts(passing) = law { passing(value, now) } else { value }
    })
}

impl<'a> Running<'a> {
    fn new(machine: &'a Machine, laws: &'a mut [Law], step_s: f64) -> Self {
        let extra: f64 =
            laws.iter().map(|law| if let Law::Mass(mass) = law { *mass } else { 0.0 }).sum();
        let count = laws.len();
        Self {
            machine,
            laws,
            mass: machine.mass + extra,
            now: Now { step_s, ..Now::default() },
            bristle: 0.0,
            reaction: 0.0,
            direction: 0.0,
            taken: vec![0.0; count],
            dry: vec![0.0; count],
        }
    }

    /// The forces of all effects, and the levels of dry friction.
    fn acting(&mut self) -> Acts {
        let machine = self.machine;
        self.now.load = machine.mass * self.now.acceleration
            + machine.viscous * self.now.velocity
            + machine.stiffness * self.now.position
            + machine.offset;
        let mut all = Acts::dry(machine.coulomb);
        for (index, law) in self.laws.iter_mut().enumerate() {
            self.dry[index] = 0.0;
            match law {
                Law::Acts(acting) => {
                    let own = acting(&self.now);
                    all.force += own.force;
                    all.forward += own.forward;
                    all.backward += own.backward;
                    self.taken[index] = own.force;
                    self.dry[index] =
                        if self.now.velocity >= 0.0 { own.forward } else { own.backward };
                }
                Law::Mass(mass) => self.taken[index] = *mass * self.now.acceleration,
                _ => self.taken[index] = 0.0,
            }
        }
        all.forward = all.forward.max(0.0);
        all.backward = all.backward.max(0.0);
        all
    }

    /// Shares the dry friction among the effects.
    fn share(&mut self, acts: &Acts) {
        let level = if self.now.velocity >= 0.0 { acts.forward } else { acts.backward };
        self.direction = if level > 0.0 { (self.reaction / level).clamp(-1.0, 1.0) } else { 0.0 };
        for (taken, dry) in self.taken.iter_mut().zip(&self.dry) {
            *taken += self.direction * dry;
        }
    }

    /// A step under a force.
    fn step(&mut self, force: f64) {
        let (h, machine) = (self.now.step_s, self.machine);
        self.now.position += 0.5 * h * self.now.velocity;
        let acts = self.acting();
        let free = force - machine.stiffness * self.now.position - machine.offset - acts.force;
        let half = 0.5 * h * machine.viscous;
        let inertia = self.mass + half;
        let before = self.now.velocity;
        let wanted = (before * (self.mass - half) + h * free) / inertia;
        let (velocity, reaction) = self.slide(wanted, h / inertia, &acts);
        self.reaction = reaction;
        self.now.velocity = velocity;
        self.share(&acts);
        self.now.acceleration = (velocity - before) / h;
        self.now.position += 0.5 * h * velocity;
        self.now.time_s += h;
    }

    /// The share of dry friction of a part whose velocity is imposed. Rigid friction keeps its sign
    /// while the part is held.
    fn sliding(&mut self) -> f64 {
        let speed = self.now.velocity;
        let held = 1e-5 * self.machine.amplitude * self.machine.control_rad_s;
        self.bristle = match self.machine.stick {
            Stick::Rigid if speed.abs() < held => self.bristle,
            Stick::Rigid => speed.signum(),
            Stick::Tanh(width) => (speed / width).tanh(),
            Stick::Arctangent(width) => {
                (std::f64::consts::FRAC_PI_2 * speed / width).atan() * std::f64::consts::FRAC_2_PI
            }
            Stick::Bristle(travel) => bristle(self.bristle, speed * self.now.step_s, travel),
        };
        self.bristle
    }

    /// Velocity after dry friction, and the friction. `pace` is the change of velocity per force.
    fn slide(&mut self, wanted: f64, pace: f64, acts: &Acts) -> (f64, f64) {
        let level = if wanted >= 0.0 { acts.forward } else { acts.backward };
        let smooth: fn(f64) -> f64 = match self.machine.stick {
            Stick::Rigid => {
                let stopping = wanted / pace;
                return if stopping.abs() <= level {
                    (0.0, stopping)
                } else {
                    let reaction = level.copysign(wanted);
                    (wanted - pace * reaction, reaction)
                };
            }
            Stick::Bristle(travel) => {
                self.bristle = bristle(self.bristle, self.now.velocity * self.now.step_s, travel);
                let reaction = level * self.bristle;
                return (wanted - pace * reaction, reaction);
            }
            Stick::Tanh(_) => f64::tanh,
            Stick::Arctangent(_) => {
                |x| (std::f64::consts::FRAC_PI_2 * x).atan() * std::f64::consts::FRAC_2_PI
            }
        };
        let (Stick::Tanh(speed) | Stick::Arctangent(speed)) = self.machine.stick else {
            return (wanted, 0.0);
        };
        // Monotone between 0 and the wanted velocity.
        let (mut low, mut high) = (0.0, wanted);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            let beyond = middle + pace * level * smooth(middle / speed) - wanted;
            if (beyond > 0.0) == (wanted > 0.0) { high = middle } else { low = middle }
        }
        let velocity = 0.5 * (low + high);
        (velocity, level * smooth(velocity / speed))
    }
}

/// Dahl's law over a displacement in one direction, exactly.
pub fn bristle(state: f64, moved: f64, travel: f64) -> f64 {
    if moved == 0.0 {
        return state;
    }
    let side = moved.signum();
    side + (state - side) * (-moved.abs() / travel).exp()
}

/// A disturbance: white noise through a first-order low-pass.
struct Disturbance {
    value: f64,
    kept: f64,
    fresh: f64,
}

impl Disturbance {
    fn new(around: &Surroundings, step_s: f64, draw: &mut Draw) -> Self {
        let kept = (-std::f64::consts::TAU * around.corner_hz * step_s).exp();
        let fresh = (1.0 - kept * kept).sqrt() * around.disturbance;
        Self { value: around.disturbance * draw.normal(), kept, fresh }
    }

    fn next(&mut self, draw: &mut Draw) -> f64 {
        self.value = self.kept * self.value + self.fresh * draw.normal();
        self.value
    }
}

/// Runs a machine along a movement for some rows.
pub fn run(
    machine: &Machine,
    laws: &mut [Law],
    movement: &Movement,
    rows: usize,
    around: &Surroundings,
    seed: u64,
) -> Track {
    if machine.kind == Kind::Element {
        imposed(machine, laws, movement, rows, around, seed)
    } else {
        moved(machine, laws, movement, rows, around, seed)
    }
}

/// A drive under position control, or an oscillator under its input.
fn moved(
    machine: &Machine,
    laws: &mut [Law],
    movement: &Movement,
    rows: usize,
    around: &Surroundings,
    seed: u64,
) -> Track {
    let mut draw = Draw::new(seed);
    let steps = steps(machine.row_hz);
    let h = 1.0 / (machine.row_hz * steps as f64);
    let per_control = steps / cycles(machine.row_hz);
    let mut disturbance = Disturbance::new(around, h, &mut draw);
    let zero = draw.uniform(-0.5, 0.5) * around.count;
    let mut control = Control::new(machine, per_control as f64 * h, around.limit);
    let mut track = Track { effects: vec![Vec::new(); laws.len()], ..Track::default() };
    let mut running = Running::new(machine, laws, h);
    let (mut command, mut shown) = (0.0, 0.0);
    for step in 0..rows * steps {
        let time = running.now.time_s;
        if machine.kind == Kind::Oscillator {
            command = movement.at(time);
        }
        if step % per_control == 0 {
            let seen = read(running.laws, running.now.position, &running.now.clone());
            shown = counted(seen + zero, around.count);
            if machine.kind == Kind::Drive {
                command = control.command(|ahead| movement.at(time + ahead), shown);
            }
        }
        let now = running.now;
        // The state of this instant; what the effects take is known after the step.
        let (position, velocity) = (shown, now.velocity);
        let mut none = vec![0.0; running.laws.len()];
        let delivered = pass(running.laws, &mut none, command, &now, delivering, -1.0);
        let measured = pass(running.laws, &mut none, command, &now, measuring, 1.0);
        running.step(delivered + disturbance.next(&mut draw));
        if step % steps == 0 {
            track.force.push(measured);
            track.position.push(position);
            track.velocity.push(velocity);
            track.direction.push(running.direction);
            for ((all, taken), passed) in track.effects.iter_mut().zip(&running.taken).zip(&none) {
                all.push(taken + passed);
            }
        }
    }
    track
}

/// A part in a testing machine.
fn imposed(
    machine: &Machine,
    laws: &mut [Law],
    movement: &Movement,
    rows: usize,
    around: &Surroundings,
    seed: u64,
) -> Track {
    let mut draw = Draw::new(seed);
    let steps = steps(machine.row_hz);
    let h = 1.0 / (machine.row_hz * steps as f64);
    let mut disturbance = Disturbance::new(around, h, &mut draw);
    let zero = draw.uniform(-0.5, 0.5) * around.count;
    let rate = machine.control_rad_s;
    let mut track = Track { effects: vec![Vec::new(); laws.len()], ..Track::default() };
    let mut running = Running::new(machine, laws, h);
    for step in 0..rows * steps {
        let now = running.now;
        let wanted = movement.at(now.time_s);
        running.now.acceleration =
            rate * rate * (wanted - now.position) - 1.6 * rate * now.velocity;
        let acts = running.acting();
        let level = if now.velocity >= 0.0 { acts.forward } else { acts.backward };
        running.reaction = level * running.sliding();
        running.share(&acts);
        let now = running.now;
        let inertial = (running.mass - machine.mass) * now.acceleration;
        let force =
            now.load + acts.force + inertial + running.reaction + disturbance.next(&mut draw);
        let mut taken = std::mem::take(&mut running.taken);
        let measured = pass(running.laws, &mut taken, force, &now, measuring, 1.0);
        running.taken = taken;
        if step % steps == 0 {
            track.force.push(measured);
            let seen = read(running.laws, now.position, &now);
            track.position.push(counted(seen + zero, around.count));
            track.velocity.push(now.velocity);
            track.direction.push(running.direction);
            for (all, taken) in track.effects.iter_mut().zip(&running.taken) {
                all.push(*taken);
            }
        }
        running.now.velocity += h * now.acceleration;
        running.now.position += h * running.now.velocity;
        running.now.time_s += h;
    }
    track
}

/// A position in whole counts.
fn counted(position: f64, count: f64) -> f64 {
    if count > 0.0 { (position / count).round() * count } else { position }
}

/// Position control: proportional and derivative.
struct Control {
    gains: [f64; 2],
    cycle_s: f64,
    share: f64,
    speed: f64,
    last: Option<f64>,
    limit: f64,
}

impl Control {
    fn new(machine: &Machine, cycle_s: f64, limit: f64) -> Self {
        let rate = machine.control_rad_s;
        let damping = (1.4 * machine.mass * rate - machine.viscous).max(0.4 * machine.mass * rate);
        Self {
            gains: [machine.mass * rate * rate, damping],
            cycle_s,
            share: 1.0 - (-8.0 * rate * cycle_s).exp(),
            speed: 0.0,
            last: None,
            limit,
        }
    }

    fn command(&mut self, reference: impl Fn(f64) -> f64, shown: f64) -> f64 {
        let difference = (shown - self.last.unwrap_or(shown)) / self.cycle_s;
        self.last = Some(shown);
        self.speed += self.share * (difference - self.speed);
        let wanted = (reference(self.cycle_s) - reference(-self.cycle_s)) / (2.0 * self.cycle_s);
        let command =
            self.gains[0] * (reference(0.0) - shown) + self.gains[1] * (wanted - self.speed);
        if self.limit > 0.0 { command.clamp(-self.limit, self.limit) } else { command }
    }
}

#[cfg(test)]
#[path = "simulator_tests.rs"]
mod tests;
