//! The internal step of a transmission.

use super::{LineLaw, Midpoint, PendingStep, Plant};
use crate::effects::{Link, Moment, Side, SideLoad};
use crate::friction::{Advance, Load, advance, impose};
use crate::transmission::line_law::{Coupling, Middle};
use crate::transmission::{ImposedMotion, Input, sub_steps};

impl<L: LineLaw> Plant<L> {
    pub(super) fn step_with<const EFFECTS: bool, const LINKS: bool>(
        &mut self,
        input: Input,
        dt_s: f64,
    ) {
        let (count, step) = sub_steps(dt_s, self.constants.longest_step_s);
        for _ in 0..count {
            let pending = self.begin_with::<EFFECTS, LINKS>(input, step);
            let slave = advance(self.state.slave_velocity_rad_s, step, &pending.load);
            self.complete_with::<EFFECTS, LINKS>(&pending, slave);
        }
        self.read(input.motor_v, input.hand_torque_nm);
    }

    #[inline(always)]
    pub(super) fn begin_with<const EFFECTS: bool, const LINKS: bool>(
        &mut self,
        input: Input,
        step: f64,
    ) -> PendingStep {
        let at = self.midpoint(step);
        let per_volt = self.constants.torque_per_volt_nm;
        let motor_torque = if EFFECTS {
            self.effects.motor_torque(input.motor_v, per_volt, &at.moment)
        } else {
            per_volt * input.motor_v
        };
        let coupling = self.couple::<LINKS>(&at);
        let (mut load, effect_nm, _) = self.side::<EFFECTS>(Side::Master, &coupling, &at);
        load.force += motor_torque;
        let master = advance(self.state.master_velocity_rad_s, step, &load);
        self.count_side(&master, effect_nm, motor_torque * master.displacement);
        self.state.motor_torque_nm = motor_torque;
        self.reach_slave::<EFFECTS>(master, coupling, input.hand_torque_nm, at)
    }

    pub(super) fn step_imposed_with<const EFFECTS: bool, const LINKS: bool>(
        &mut self,
        target: ImposedMotion,
        hand_torque_nm: f64,
        dt_s: f64,
    ) {
        let (count, step) = sub_steps(dt_s, self.constants.longest_step_s);
        let (from, from_speed) = (self.state.master_position_rad, self.state.master_velocity_rad_s);
        for index in 1..=count {
            let part = index as f64 / count as f64;
            let (next, next_speed) = target.approach(from, from_speed, dt_s, part);
            let (position, speed) =
                (self.state.master_position_rad, self.state.master_velocity_rad_s);
            let mut at = self.midpoint(step);
            at.half[0] = 0.5 * (position + next);
            at.mean[0] = (next - position) / step;
            at.moment = Moment::middle(self.state.time_s, step, &at.half, &at.mean);
            let coupling = self.couple::<LINKS>(&at);
            let (load, effect_nm, _) = self.side::<EFFECTS>(Side::Master, &coupling, &at);
            let driven = impose(speed, next_speed, next - position, step, &load);
            self.count_side(&driven.moved, effect_nm, driven.work);
            self.state.motor_torque_nm = driven.force;
            let pending = self.reach_slave::<EFFECTS>(driven.moved, coupling, hand_torque_nm, at);
            let slave = advance(self.state.slave_velocity_rad_s, step, &pending.load);
            self.complete_with::<EFFECTS, LINKS>(&pending, slave);
        }
        self.read(0.0, hand_torque_nm);
    }

    /// Positions at the midpoint of the step, and velocities there as extrapolated.
    #[inline(always)]
    fn midpoint(&self, step: f64) -> Midpoint {
        let state = &self.state;
        let [first, second] = state.line_position_m;
        let positions = [state.master_position_rad, state.slave_position_rad, first, second];
        let [first, second] = state.line_velocity_m_s;
        let speeds = [state.master_velocity_rad_s, state.slave_velocity_rad_s, first, second];
        let half = std::array::from_fn(|index| positions[index] + 0.5 * step * speeds[index]);
        let mean = std::array::from_fn(|index| {
            let mean = speeds[index] + 0.5 * self.increments[index];
            let sticks = index < 2 || L::MIDDLE_STICKS;
            // A mass about to stop must not be extrapolated into the opposite direction.
            if sticks && mean * speeds[index] < 0.0 { 0.0 } else { mean }
        });
        Midpoint { half, mean, moment: Moment::middle(state.time_s, step, &half, &mean) }
    }

    /// The forces of the four links, each computed once.
    #[inline(always)]
    fn couple<const LINKS: bool>(&mut self, at: &Midpoint) -> Coupling {
        let mut coupling = Coupling::default();
        let (Midpoint { half, mean, moment }, constants) = (at, &self.constants);
        for line in 0..2 {
            for (index, end) in [(0, Side::Master), (1, Side::Slave)] {
                let displacement = constants.displacement[index];
                let deflection = half[2 + line] - displacement * half[index];
                let rate = mean[2 + line] - displacement * mean[index];
                let mut link = Link {
                    end,
                    line,
                    stiffness_n_per_m: constants.half_line_n_per_m[index],
                    damping_n_s_per_m: constants.link_damping_n_s_per_m,
                    displacement_m_per_rad: displacement,
                    deflection_m: deflection,
                    rate_m_s: rate,
                    fluid_position_m: half[2 + line],
                    fluid_velocity_m_s: mean[2 + line],
                    force_n: 0.0,
                    fluid_force_n: 0.0,
                    fluid_damping_n_s_per_m: 0.0,
                };
                if LINKS {
                    self.effects.links(end, |effect| effect.deflect(&mut link, moment));
                }
                coupling.declared[line][index] = self.law.force(&mut link, deflection, rate);
                if LINKS {
                    self.effects.links(end, |effect| effect.link(&mut link, moment));
                }
                coupling.reported_n[line][index] = self.law.limit(&mut link);
                coupling.end_n[line][index] = link.force_n;
                coupling.middle_n[line][index] = link.fluid_force_n;
                coupling.middle_damping[line][index] = link.fluid_damping_n_s_per_m;
            }
        }
        coupling
    }

    /// What acts on one side except motor and hand; its parts that effects add and that the lines
    /// transmit, N·m.
    #[inline(always)]
    fn side<const EFFECTS: bool>(
        &mut self,
        side: Side,
        coupling: &Coupling,
        Midpoint { half, mean, moment }: &Midpoint,
    ) -> (Load, f64, f64) {
        let index = side as usize;
        let transmitted_nm = self.constants.displacement[index]
            * (coupling.end_n[0][index] + coupling.end_n[1][index]);
        let friction = self.law.side_friction(side, half[index], mean[index], coupling);
        let mut load = SideLoad {
            side,
            position_rad: half[index],
            velocity_rad_s: mean[index],
            transmitted_nm,
            load: Load {
                force: transmitted_nm,
                inertia: self.constants.inertia[index],
                ..friction
            },
        };
        let effect_nm = if EFFECTS { self.effects.side(&mut load, moment) } else { 0.0 };
        (load.load, effect_nm, transmitted_nm)
    }

    #[inline(always)]
    fn reach_slave<const EFFECTS: bool>(
        &mut self,
        master: Advance,
        coupling: Coupling,
        hand_torque_nm: f64,
        at: Midpoint,
    ) -> PendingStep {
        let (mut load, effect_nm, transmitted_nm) =
            self.side::<EFFECTS>(Side::Slave, &coupling, &at);
        load.force += hand_torque_nm;
        PendingStep { load, effect_nm, transmitted_nm, hand_torque_nm, master, coupling, at }
    }

    /// Everything after the slave has moved: lines, energy, time.
    #[inline(always)]
    pub(super) fn complete_with<const EFFECTS: bool, const LINKS: bool>(
        &mut self,
        pending: &PendingStep,
        slave: Advance,
    ) {
        let PendingStep { master, coupling, at, .. } = pending;
        let (moment, step) = (&at.moment, at.moment.step_s);
        let sides = [master.displacement, slave.displacement];
        if EFFECTS {
            self.effects.moved(sides, moment);
        }
        self.count_side(&slave, pending.effect_nm, pending.hand_torque_nm * slave.displacement);
        let mut lines = [slave; 2];
        for (line, advanced) in lines.iter_mut().enumerate() {
            let middle = Middle {
                line,
                step_s: step,
                mass_kg: self.constants.middle_mass_kg,
                velocity_m_s: self.state.line_velocity_m_s[line],
                half_position_m: at.half[2 + line],
                mean_velocity_m_s: at.mean[2 + line],
            };
            let effects = &mut self.effects;
            let moved = self.law.advance_middle(&middle, coupling, |coefficient| {
                if LINKS { effects.fluid(coefficient, moment) } else { coefficient }
            });
            if LINKS {
                self.effects.flowed(line, moved.displacement, moment);
            }
            self.count_line::<LINKS>(line, &moved, coupling, (sides, step));
            *advanced = moved;
        }

        let state = &mut self.state;
        let increment = |before: f64, after: f64, sticks: bool| {
            if sticks && after == 0.0 { 0.0 } else { after - before }
        };
        let [first, second] = state.line_velocity_m_s;
        self.increments = [
            increment(state.master_velocity_rad_s, master.velocity, true),
            increment(state.slave_velocity_rad_s, slave.velocity, true),
            increment(first, lines[0].velocity, L::MIDDLE_STICKS),
            increment(second, lines[1].velocity, L::MIDDLE_STICKS),
        ];
        state.time_s += step;
        state.master_position_rad += master.displacement;
        state.master_velocity_rad_s = master.velocity;
        state.slave_position_rad += slave.displacement;
        state.slave_velocity_rad_s = slave.velocity;
        for (line, moved) in lines.iter().enumerate() {
            state.line_position_m[line] += moved.displacement;
            state.line_velocity_m_s[line] = moved.velocity;
        }
        state.line_force_n = coupling.reported_n;
        state.transmitted_torque_nm = pending.transmitted_nm;
    }

    /// Adds a side's losses and work to the energy balance.
    #[inline(always)]
    fn count_side(&mut self, moved: &Advance, effect_nm: f64, work_j: f64) {
        if !self.balances_energy {
            return;
        }
        self.energy.dissipated_j += moved.dissipated;
        self.energy.effects_j -= effect_nm * moved.displacement;
        self.energy.count_input(work_j);
    }

    /// Adds the losses of a line, and what effects took from it, to the energy balance.
    #[inline(always)]
    fn count_line<const LINKS: bool>(
        &mut self,
        line: usize,
        moved: &Advance,
        coupling: &Coupling,
        (sides, step): ([f64; 2], f64),
    ) {
        if !self.balances_energy {
            return;
        }
        self.energy.dissipated_j += moved.dissipated;
        for (end, angle) in sides.into_iter().enumerate() {
            let at_end = self.constants.displacement[end] * angle;
            let relative = moved.displacement - at_end;
            let declared = &coupling.declared[line][end];
            let lost = declared.damper_n * relative;
            self.energy.dissipated_j += lost;
            if LINKS {
                let on_middle = coupling.middle_n[line][end]
                    + coupling.middle_damping[line][end] * moved.displacement / step;
                let taken = on_middle * moved.displacement - coupling.end_n[line][end] * at_end;
                self.energy.effects_j +=
                    taken - declared.spring_n * (relative + declared.shift_m) - lost;
            }
        }
    }
}
