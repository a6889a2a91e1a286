#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]
use ipc_types::Mode;
use rig::{HandKind, RigFile};
use twin::{Aim, Twin};
const RIG: &str = include_str!("../../../launch/rigs/hydrostatic.toml");
const PRINTED: &str = include_str!("../../../launch/rigs/hydrostatic-printed.toml");
#[test]
fn explore() {
    for (name, text) in [("traced", RIG), ("printed", PRINTED)] {
    for (hk, hd) in [(0.0, 0.0), (0.3, 0.05), (5.0, 0.2), (20.0, 0.5)] {
        for (k, d, i) in [(0.0,0.0,0.0),(1.0,0.0,0.0),(5.0,0.0,0.0),(10.0,0.0,0.0),(-1.0,0.0,0.0),(-3.0,0.0,0.0),(0.0,0.1,0.0),(0.0,0.2,0.0),(0.0,0.3,0.0),(0.0,0.5,0.0),(0.0,1.0,0.0),(0.0,2.0,0.0),(0.0,-0.2,0.0),(0.0,-0.5,0.0),(0.0,0.0,0.005),(0.0,0.0,0.01),(0.0,0.0,0.02),(0.0,0.0,-0.005),(0.0,0.0,-0.01),(0.0,0.0,-0.02),(5.0,0.3,0.0)] {
            let mut rig = RigFile::parse(text, name).unwrap();
            let hand = &mut rig.simulation.hand;
            hand.kind = if hk == 0.0 { HandKind::Absent } else { HandKind::Passive };
            (hand.stiffness, hand.damping) = (hk, hd);
            print!("{name} hand {hk} field {k}/{d}/{i}:");
            for offset in [true, false] { for kick in [3.0,10.0] {
                if !offset { let f = rig.axes[0].control.force.as_mut().unwrap(); f.offset_slow_v = 0.0; f.offset_fast_v = 0.0; }
                let mut twin = Twin::new(&rig, &[]).unwrap();
                let (mut early, mut late) = (0.0f64, 0.0f64);
                let mut way=0.0f64;
                while twin.time_s() < 6.0 {
                    let t = twin.time_s();
                    let guided = t < 1.0;
                    let omega = std::f64::consts::TAU * 2.0;
                    let mut s = twin.setpoint(&if guided { Aim::sine(kick / omega, 2.0, t) } else { Aim::at_rest(0.0) });
                    if !guided { s.mode = Mode::Impedance.code(); s.stiffness[0] = k; s.damping[0] = d; s.inertia[0] = i; }
                    let m = twin.cycle(&s).unwrap();
                    let v = m.motion.slave_velocity_rad_s.abs();
                    if t > 1.1 && t < 1.6 { early = early.max(v); }
                    if t > 5.0 { late = late.max(v); way = way.max(m.motion.slave_position_rad.abs()); }
                }
                print!("  o{} kick{kick}: {early:.1} -> {late:.1} at {way:.2}", u8::from(offset));
            }}
            println!();
        }
    }}
}
