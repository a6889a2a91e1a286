//! Known solutions.

use super::super::machine::Demands;
use super::super::movement::Shape;
use super::*;

fn oscillator(viscous: f64, coulomb: f64, stick: Stick) -> Machine {
    Machine {
        mass: 0.01,
        viscous,
        stiffness: 1.0,
        offset: 0.0,
        coulomb,
        stick,
        ..Machine::drawn(Kind::Oscillator, Demands::default(), &mut Draw::new(1))
    }
}

/// From a place at rest, without a force; the rate of the steps is that of the rows.
fn released(machine: &Machine, from: f64, steps: usize) -> Vec<[f64; 2]> {
    let mut laws = [];
    let mut running = Running::new(machine, &mut laws, 5e-5);
    running.now.position = from;
    (0..steps)
        .map(|_| {
            running.step(0.0);
            [running.now.position, running.now.velocity]
        })
        .collect()
}

#[test]
fn free_decay_is_exponential() {
    let machine = oscillator(0.02, 0.0, Stick::Rigid);
    let path = released(&machine, 1.0, 40_000);
    let (rate, decay) = ((100.0_f64 - 1.0).sqrt(), 1.0);
    for (index, [place, _]) in path.iter().enumerate() {
        let time = (index + 1) as f64 * 5e-5;
        let known =
            (-decay * time).exp() * ((rate * time).cos() + decay / rate * (rate * time).sin());
        assert!((place - known).abs() < 2e-5, "{time}: {place} {known}");
    }
}

#[test]
fn energy_is_kept_without_friction() {
    let machine = oscillator(0.0, 0.0, Stick::Rigid);
    for [place, speed] in released(&machine, 1.0, 200_000) {
        let energy = 0.5 * (place * place + 0.01 * speed * speed);
        assert!((energy / 0.5 - 1.0).abs() < 1e-5, "{energy}");
    }
}

/// Each half swing loses twice the width of the dead band, and then it rests within the band.
#[test]
fn dry_friction_takes_a_constant_part_of_each_swing_and_then_holds() {
    for (stick, slack) in
        [(Stick::Rigid, 2e-4), (Stick::Tanh(1e-4), 2e-3), (Stick::Bristle(1e-4), 2e-3)]
    {
        let machine = oscillator(0.0, 0.08, stick);
        let path = released(&machine, 1.0, 60_000);
        let turns: Vec<f64> = path
            .windows(2)
            .filter(|two| two[0][1] != 0.0 && two[0][1] * two[1][1] <= 0.0)
            .map(|two| two[1][0].abs())
            .collect();
        for (number, turn) in turns.iter().take(5).enumerate() {
            let known = 1.0 - 0.16 * (number + 1) as f64;
            assert!((turn - known).abs() < slack, "{stick:?} {number}: {turn} {known}");
        }
        let last = path[59_999][0];
        assert!(last.abs() <= 0.0801, "{stick:?}: {last}");
    }
}

#[test]
fn a_rigid_machine_stands_still_below_its_friction() {
    let machine = Machine {
        kind: Kind::Drive,
        stiffness: 0.0,
        mass: 1.0,
        coulomb: 2.0,
        ..oscillator(0.1, 0.0, Stick::Rigid)
    };
    let mut laws = [];
    let mut running = Running::new(&machine, &mut laws, 5e-5);
    for _ in 0..1000 {
        running.step(1.99);
    }
    assert_eq!((running.now.position, running.now.velocity), (0.0, 0.0));
    for _ in 0..20_000 {
        running.step(3.0);
    }
    // v = (F - F_c)/c (1 - exp(-c t/m)) after one second.
    let known = 10.0 * (1.0 - (-0.1_f64).exp());
    assert!((running.now.velocity - known).abs() < 1e-5, "{}", running.now.velocity);
}

#[test]
fn accounts_of_effects_close_the_balance() {
    let mut draw = Draw::new(3);
    let drawn = Machine::drawn(Kind::Drive, Demands::default(), &mut draw);
    let machine = Machine { coulomb: 0.2 * drawn.force_scale(), stick: Stick::Rigid, ..drawn };
    let level = 0.1 * machine.force_scale();
    let mut laws = vec![
        Law::acts(move |now| Acts::force(level * (3.0 * now.position).sin())),
        Law::acts(move |_| Acts::dry(level)),
        Law::delivers(|force, _| 0.9 * force),
    ];
    let movement =
        Movement::drawn(Shape::Multisine, 4.0, machine.amplitude, machine.top_hz, &mut draw);
    let rows = (4.0 * machine.row_hz) as usize;
    let track = run(&machine, &mut laws, &movement, rows, &Surroundings::default(), 1);
    let h = 1.0 / machine.row_hz;
    let (mut rest, mut whole) = (0.0, 0.0);
    for row in 2..rows - 2 {
        let speed = track.velocity[row];
        let acceleration = (track.velocity[row + 1] - track.velocity[row - 1]) / (2.0 * h);
        // Where it reverses, the difference quotient is none.
        if track.direction[row - 1].abs() < 1.0
            || track.direction[row - 1] != track.direction[row + 1]
        {
            continue;
        }
        let sum: f64 = track.effects.iter().map(|all| all[row]).sum();
        let needs = machine.mass * acceleration
            + machine.viscous * speed
            + machine.offset
            + machine.coulomb * track.direction[row]
            + sum;
        rest += (track.force[row] - needs).powi(2);
        whole += track.force[row].powi(2);
    }
    assert!(rest < 1e-3 * whole, "{}", (rest / whole).sqrt());
}

#[test]
fn an_element_shows_the_force_of_its_spring_and_damper() {
    let mut draw = Draw::new(5);
    let machine =
        Machine { coulomb: 0.0, ..Machine::drawn(Kind::Element, Demands::default(), &mut draw) };
    let movement = Movement::drawn(Shape::Trapezoids, 4.0, machine.amplitude, 2.0, &mut draw);
    let rows = (4.0 * machine.row_hz) as usize;
    let track = run(&machine, &mut [], &movement, rows, &Surroundings::default(), 1);
    for row in 0..rows {
        let needs = machine.stiffness * track.position[row]
            + machine.viscous * track.velocity[row]
            + machine.offset;
        assert!((track.force[row] - needs).abs() < 1e-9 * needs.abs().max(1e-3));
    }
}
