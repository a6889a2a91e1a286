//! One control step of one axis under each law: the mean by criterion, and before it each step
//! timed by itself, with its p99, beside a peer that is timed in turn: proportional and derivative
//! feedback with fig. 4.3A's feed-forward, written down as in plain C, without blends, modes,
//! checks or options. The bar is a p99 below 2 µs.
//!
//! ```text
//! $ cargo bench -p control
//! ```
#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use control::law::{Law, LawConfig, friction};
use criterion::{Criterion, criterion_group};
use hdrhistogram::Histogram;
use ipc_types::{Mode, Sample, Setpoint};
use learning::{Learner, LearnerConfig, LearningLaw, Published, Stop};
use rig::{CompensationKind, Observer, RigFile, SlaveLoop};

const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const RATE_HZ: u64 = 500;
/// Steps of each law in a turn, and turns. A turn is much shorter than a slice of the scheduler.
const STEPS: usize = 500;
const TURNS: usize = 400;
/// p99 of a step that must not be passed (ns).
const BAR_NS: u64 = 2_000;
const AMPLITUDE: f64 = 0.7;

/// Cycles of a sine of 1 Hz, as control sees them.
struct Input {
    samples: Vec<Sample>,
    setpoints: Vec<Setpoint>,
    next: usize,
}

impl Input {
    fn new(mode: Mode) -> Self {
        let steps = (10 * RATE_HZ) as usize;
        let (mut samples, mut setpoints) = (Vec::new(), Vec::new());
        for step in 0..steps {
            let omega = std::f64::consts::TAU;
            let (sine, cosine) = (omega * step as f64 / RATE_HZ as f64).sin_cos();
            let mut sample = Sample {
                master_present: 1,
                slave_present: 1,
                torque_present: 1,
                motor_present: 1,
                axes: 1,
                homed: 1,
                ..Sample::default()
            };
            sample.master_position[0] = 0.95 * AMPLITUDE * sine;
            sample.slave_position[0] = 0.8 * AMPLITUDE * sine;
            sample.slave_torque[0] = 2.0 * cosine;
            sample.motor_v[0] = 1.2 * cosine;
            let mut setpoint =
                Setpoint { incarnation: 1, mode: mode.code(), axes: 1, ..Setpoint::default() };
            if mode.is_force_controlled() {
                // A field with all its parts.
                (setpoint.stiffness[0], setpoint.damping[0]) = (1.0, 0.05);
                (setpoint.wall_min[0], setpoint.wall_max[0], setpoint.wall_stiffness[0]) =
                    (-0.3, 0.3, 5.0);
            } else {
                setpoint.position[0] = AMPLITUDE * sine;
                setpoint.velocity[0] = AMPLITUDE * omega * cosine;
                setpoint.acceleration[0] = -AMPLITUDE * omega * omega * sine;
                setpoint.peak_speed[0] = AMPLITUDE * omega;
            }
            samples.push(sample);
            setpoints.push(setpoint);
        }
        Self { samples, setpoints, next: 0 }
    }

    /// The next cycle, and its time.
    fn advance(&mut self) -> (u64, usize) {
        let now = 1_000_000_000 + self.next as u64 * (1_000_000_000 / RATE_HZ);
        let at = self.next % self.samples.len();
        self.next += 1;
        let (sample, setpoint) = (&mut self.samples[at], &mut self.setpoints[at]);
        sample.scan_time_ns = now;
        (setpoint.at_ns, setpoint.lease_until_ns) = (now, now + 100_000_000);
        (now, at)
    }
}

fn with(kind: CompensationKind, observer: bool, slave: bool) -> Law {
    let mut rig = RigFile::parse(RIG, "hydrostatic.toml").unwrap();
    let options = &mut rig.axes[0].control.options;
    options.compensation.kind = kind;
    options.observer = observer.then(Observer::default);
    options.slave = slave.then(SlaveLoop::default);
    Law::new(LawConfig::of_rig(&rig))
}

fn learner() -> Learner {
    let steps = RATE_HZ as usize;
    let desired: Vec<f64> = (0..steps)
        .map(|step| AMPLITUDE * (std::f64::consts::TAU * step as f64 / steps as f64).sin())
        .collect();
    let config = LearnerConfig {
        rate_hz: RATE_HZ as f64,
        cycles_per_block: 3,
        settling_cycles: 1,
        law: LearningLaw::Published(Published {
            gamma_p: 0.1,
            gamma_d: 0.01,
            cutoff_hz: 8.0,
            delay_s: 0.03,
        }),
        stop: Stop { growth: 1.5, patience: 5 },
        position_limits: (-2.0, 2.0),
        speed_limit: 26.0,
    };
    Learner::new(&desired, config).unwrap()
}

/// The peer: what § 4.1 asks for and no more.
struct Plain {
    last: f64,
    velocity: f64,
    weight: f64,
}

impl Plain {
    const P: f64 = 2.8648;
    const D: f64 = 0.44563;

    fn new() -> Self {
        let weight = 1.0 - (-std::f64::consts::TAU * 40.0 / RATE_HZ as f64).exp();
        Self { last: 0.0, velocity: 0.0, weight }
    }

    #[inline(never)]
    fn step(&mut self, position: f64, reference: [f64; 4]) -> f64 {
        let [x, v, a, peak] = reference;
        self.velocity += self.weight * ((position - self.last) * RATE_HZ as f64 - self.velocity);
        self.last = position;
        let feedback = Self::P * (x - position) + Self::D * (v - self.velocity);
        (feedback + friction(v, peak, 1.5, 1.2) + 8e-3 * a).clamp(-8.0, 8.0)
    }
}

type Step = Box<dyn FnMut(u64, &Sample, &mut Setpoint) -> f64>;

/// Something that makes one control step.
struct Case {
    name: &'static str,
    input: Input,
    step: Step,
    /// Each step (ns); each turn's mean (ns).
    steps: Histogram<u64>,
    turns: Vec<f64>,
}

impl Case {
    fn new(
        name: &'static str,
        mode: Mode,
        step: impl FnMut(u64, &Sample, &mut Setpoint) -> f64 + 'static,
    ) -> Self {
        let steps = Histogram::new_with_bounds(1, 1_000_000_000, 3).unwrap();
        Self { name, input: Input::new(mode), step: Box::new(step), steps, turns: Vec::new() }
    }

    fn law(name: &'static str, mode: Mode, mut law: Law) -> Self {
        Self::new(name, mode, move |now, sample, setpoint| {
            law.step(now, sample, Some(setpoint), true).volts[0]
        })
    }

    fn once(&mut self) -> f64 {
        let (now, at) = self.input.advance();
        (self.step)(
            now,
            black_box(&self.input.samples[at]),
            black_box(&mut self.input.setpoints[at]),
        )
    }

    /// One turn: every step timed by itself, then as many timed together.
    fn turn(&mut self) {
        for _ in 0..STEPS {
            let (now, at) = self.input.advance();
            let (sample, setpoint) = (&self.input.samples[at], &mut self.input.setpoints[at]);
            let began = Instant::now();
            black_box((self.step)(now, black_box(sample), black_box(setpoint)));
            self.steps.saturating_record(began.elapsed().as_nanos() as u64);
        }
        let began = Instant::now();
        for _ in 0..STEPS {
            black_box(self.once());
        }
        self.turns.push(began.elapsed().as_nanos() as f64 / STEPS as f64);
    }
}

fn cases() -> Vec<Case> {
    let mut plain = Plain::new();
    let (mut learner, mut law, mut step) =
        (learner(), with(CompensationKind::Printed, false, false), 0);
    vec![
        Case::new("peer: plain PD and feed-forward", Mode::Position, move |_, sample, setpoint| {
            let reference = [
                setpoint.position[0],
                setpoint.velocity[0],
                setpoint.acceleration[0],
                setpoint.peak_speed[0],
            ];
            plain.step(sample.master_position[0], reference)
        }),
        Case::law(
            "position, no compensation",
            Mode::Position,
            with(CompensationKind::None, false, false),
        ),
        Case::law(
            "position, printed",
            Mode::Position,
            with(CompensationKind::Printed, false, false),
        ),
        Case::law(
            "position, identified",
            Mode::Position,
            with(CompensationKind::Identified, false, false),
        ),
        Case::law(
            "position, identified, observer",
            Mode::Position,
            with(CompensationKind::Identified, true, false),
        ),
        Case::law(
            "position, identified, slave",
            Mode::Position,
            with(CompensationKind::Identified, false, true),
        ),
        Case::law(
            "position, all options",
            Mode::Position,
            with(CompensationKind::Identified, true, true),
        ),
        Case::law(
            "force control, full field",
            Mode::Impedance,
            with(CompensationKind::Printed, false, false),
        ),
        Case::new("position, learning reference", Mode::Position, move |now, sample, setpoint| {
            let point = learner.aim(step);
            setpoint.position[0] = point.position;
            setpoint.velocity[0] = point.velocity;
            setpoint.acceleration[0] = point.acceleration;
            setpoint.peak_speed[0] = learner.peak_speed();
            learner.record(step, sample.slave_position[0]);
            step = (step + 1) % learner.steps_per_block();
            law.step(now, sample, Some(setpoint), true).volts[0]
        }),
    ]
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|part| values[((values.len() - 1) as f64 * part).round() as usize])
}

/// Each law beside the peer, turn by turn.
fn beside_the_peer() -> bool {
    let mut cases = cases();
    for _ in 0..TURNS {
        for case in &mut cases {
            case.turn();
        }
    }
    let peer = cases[0].turns.clone();
    let mut within = true;
    println!(
        "{:<34}{:>8}  {:<22}{:>8}{:>8}{:>9}",
        "one step", "ns", "over the peer", "p50", "p99", "p99.9"
    );
    for case in &cases {
        let [_, mean, _] = quartiles(case.turns.clone());
        let [low, ratio, high] =
            quartiles(case.turns.iter().zip(&peer).map(|(own, peer)| own / peer).collect());
        let of = |share| case.steps.value_at_quantile(share);
        println!(
            "{:<34}{mean:>8.1}  {ratio:>5.2} ({low:.2} to {high:.2})   {:>8}{:>8}{:>9}",
            case.name,
            of(0.5),
            of(0.99),
            of(0.999)
        );
        within &= of(0.99) < BAR_NS;
    }
    println!("p50 to p99.9 in ns, with the clock's own share, which the peer has too.");
    within
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("control step");
    for mut case in cases() {
        group.bench_function(case.name, |bencher| bencher.iter(|| black_box(case.once())));
    }
    group.finish();
}

criterion_group!(benches, step);

fn main() {
    let within = beside_the_peer();
    println!("p99 below {BAR_NS} ns: {}", if within { "yes, each" } else { "no" });
    benches();
    Criterion::default().configure_from_args().final_summary();
}
