//! The hand at the handle; as a subject it takes part in an experiment with sessions.

use std::collections::VecDeque;

use ipc_types::{AXES, BAR_MIDDLE, Light, Performance};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use rig::{Hand, HandKind};

/// Least and largest effort, in relation to that with which the first session begins.
const EFFORT: (f64, f64) = (0.1, 4.0);
/// What is seen and not yet reacted to; a bar is updated twice a second at most.
const SEEN: usize = 16;
/// Part of a relaxed hand's stiffness and damping under a red light.
const RELAXED: f64 = 0.1;

/// Something that a subject sees.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sight {
    /// The light turns green.
    Green,
    /// The light turns red.
    Red,
    /// A bar that compares this session with the one before.
    Bar(f64),
}

/// The hand, of whatever kind.
///
/// A subject moves the handle to and fro about where it is when the light turns green, with the
/// amplitude and frequency of the rig file, and lets go when it turns red. The stiffness and
/// damping with which it does are its effort. It corrects the effort by the bar (the lowest, of
/// two), some time after it saw it, and is never exact.
#[derive(Clone, Debug)]
pub struct Subject {
    hand: Hand,
    effort: f64,
    /// When it began to move, and where the handles were (rad or m).
    moving: Option<(u64, Option<[f64; AXES]>)>,
    seen: VecDeque<(u64, Sight)>,
    light: Option<Light>,
    update: Option<(u64, u32)>,
    generator: Pcg64Mcg,
}

impl Subject {
    /// The hand of the rig file; equal seeds give equal subjects.
    pub fn new(hand: Hand, seed: u64) -> Self {
        Self {
            hand,
            effort: 1.0,
            moving: None,
            seen: VecDeque::with_capacity(SEEN),
            light: None,
            update: None,
            generator: Pcg64Mcg::seed_from_u64(seed ^ 0x5ab_1ec7),
        }
    }

    /// Its effort, in relation to that with which it began.
    pub const fn effort(&self) -> f64 {
        self.effort
    }

    /// Shows it the light and the bars.
    pub fn see(&mut self, shown: &Performance) {
        if self.hand.kind != HandKind::Subject {
            return;
        }
        let light = Light::from_code(shown.light);
        if light != self.light {
            self.light = light;
            let sight = if light == Some(Light::Green) { Sight::Green } else { Sight::Red };
            self.react(shown.at_ns, sight);
        }
        let update = (shown.begun_ns, shown.update);
        let compares = light == Some(Light::Green) && shown.bars > 0 && shown.update > 0;
        if compares && self.update != Some(update) {
            self.update = Some(update);
            let bars = usize::from(shown.bars).min(shown.height.len());
            let lowest = shown.height[..bars].iter().copied().fold(f64::INFINITY, f64::min);
            self.react(shown.at_ns, Sight::Bar(lowest));
        }
    }

    /// Remembers what it saw until it reacts.
    fn react(&mut self, at_ns: u64, sight: Sight) {
        if self.seen.len() == SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((at_ns + (1e9 * self.hand.reaction_s) as u64, sight));
    }

    /// Reacts to what it saw, up to now.
    fn advance(&mut self, now_ns: u64) {
        while let Some((_, sight)) = self.seen.front().copied().filter(|(at, _)| *at <= now_ns) {
            self.seen.pop_front();
            match sight {
                Sight::Green => self.moving = Some((now_ns, None)),
                Sight::Red => self.moving = None,
                Sight::Bar(height) => {
                    let error = (BAR_MIDDLE - height) / BAR_MIDDLE;
                    let scatter = Normal::new(0.0, self.hand.variability)
                        .map_or(0.0, |normal| normal.sample(&mut self.generator));
                    self.effort *= (self.hand.correction * error + scatter).exp();
                    self.effort = self.effort.clamp(EFFORT.0, EFFORT.1);
                }
            }
        }
    }

    /// Torques on the handles (N·m or N) at their positions and velocities, at `now_ns`
    /// (CLOCK_MONOTONIC); `powered_s` after the motor got power, with which a moving hand starts.
    pub fn torques(
        &mut self,
        motion: &[(f64, f64); AXES],
        powered_s: f64,
        now_ns: u64,
    ) -> [f64; AXES] {
        if self.hand.kind != HandKind::Subject {
            return motion
                .map(|(position, velocity)| self.hand.torque(position, velocity, powered_s));
        }
        self.advance(now_ns);
        let Some((since_ns, centres)) = &mut self.moving else {
            let hand = Hand { kind: HandKind::Passive, ..self.hand };
            return motion
                .map(|(position, velocity)| RELAXED * hand.torque(position, velocity, 0.0));
        };
        let centres = *centres.get_or_insert(motion.map(|(position, _)| position));
        let since_s = now_ns.saturating_sub(*since_ns) as f64 * 1e-9;
        let hand = Hand { kind: HandKind::Moving, ..self.hand };
        let mut torques = [0.0; AXES];
        for ((torque, (position, velocity)), centre) in torques.iter_mut().zip(motion).zip(centres)
        {
            *torque = self.effort * hand.torque(position - centre, *velocity, since_s);
        }
        torques
    }
}
