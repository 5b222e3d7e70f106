//! Strand friction. An error would give small motions the stiffness of large ones, or let motion gain energy.

use super::*;

/// Strikes a beam without weight at time 0. Returns its tip's z every hundredth of a second.
fn struck(parameters: BeamParameters, speed_m_s: f64, seconds: f64) -> Vec<f64> {
    let parameters = BeamParameters { gravity_m_s2: [0.0, 0.0], ..parameters };
    let mut beam = Beam::new(parameters, standard(), grip(0.0)).unwrap();
    beam.set_velocity([0.0, speed_m_s]);
    let times = (1..=(100.0 * seconds) as usize).map(|i| 0.01 * i as f64);
    let tips = times.map(|t| {
        beam.advance_to(t, |_| grip(0.0));
        beam.tip()[1]
    });
    let tips = tips.collect();
    assert_eq!(beam.counters().unconverged_steps, 0);
    tips
}

fn with_friction(sticking_stiffness_n_m2: f64, slip_moment_n_m: f64) -> BeamParameters {
    BeamParameters { sticking_stiffness_n_m2, slip_moment_n_m, ..bar(0.25, 2e5) }
}

fn peak(tips: &[f64]) -> f64 {
    tips.iter().fold(0.0, |a: f64, z| a.max(z.abs()))
}

#[test]
fn without_sticking_stiffness_no_bit_changes() {
    assert_eq!(struck(with_friction(0.0, 0.1), 0.3, 0.5), struck(bar(0.25, 2e5), 0.3, 0.5));
}

#[test]
fn strands_that_stick_are_a_stiffer_beam() {
    let ei = bar(0.25, 2e5).bending_stiffness_n_m2;
    let stiff = BeamParameters { bending_stiffness_n_m2: 3.0 * ei, ..bar(0.25, 2e5) };
    let (friction, solid) = (struck(with_friction(2.0 * ei, 1.0), 0.05, 0.5), struck(stiff, 0.05, 0.5));
    for (a, b) in friction.iter().zip(&solid) {
        assert!((a - b).abs() < 1e-3 * peak(&solid), "{a} against {b}");
    }
}

/// Strands far stiffer than the beam change between sticking and slipping all the time.
#[test]
fn newton_does_not_cycle_between_sticking_and_slipping() {
    let ei = bar(0.25, 1e3).bending_stiffness_n_m2;
    let strands = BeamParameters { sticking_stiffness_n_m2: 250.0 * ei, slip_moment_n_m: 1e-6, ..bar(0.25, 1e3) };
    let p = BeamParameters { kelvin_voigt_time_s: 0.02, table: Some(Table::new(0.0, 0.5)), ..strands };
    for (discretisation, most) in [(standard(), 2), (Discretisation { tolerance_m: 1e-12, ..standard() }, 10)] {
        let path = episode::grip_path(1);
        let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
        let mut beam = hanging(p, discretisation, at(0.0));
        beam.advance_to(episode::DURATION_S, at);
        let counters = beam.counters();
        assert!(counters.unconverged_steps <= most, "tolerance {} m: {counters:?}", discretisation.tolerance_m);
    }
}

/// Releases a sagging bar with strand friction by removing its weight. Returns the extremes of its energy in the
/// following second, as shares of the initial energy, and the share that is lost in slip.
fn let_go(slip_moment_n_m: f64) -> ([f64; 2], f64) {
    let ei = bar(0.25, 2e5).bending_stiffness_n_m2;
    let d = Discretisation { time_step_s: 5e-4, ..standard() };
    let mut beam = hanging(with_friction(2.0 * ei, slip_moment_n_m), d, grip(0.0));
    beam.parameters.gravity_m_s2 = [0.0; 2];
    let start_j = beam.energy().total_j();
    let (mut least, mut most, mut slipped_j) = (start_j, start_j, 0.0);
    for _ in 0..2000 {
        let before = beam.increment.neutral_curvature.clone();
        beam.step(grip(0.0));
        let (friction, now) = (beam.increment.strand_friction, &beam.increment.neutral_curvature);
        for (k, element) in beam.mesh.elements.iter().enumerate() {
            slipped_j += element.length * friction.slipped(beam.state.strain[k][2], &before[k], &now[k]);
        }
        let energy_j = beam.energy().total_j();
        (least, most) = (energy_j.min(least), energy_j.max(most));
    }
    ([least / start_j, most / start_j], slipped_j / start_j)
}

#[test]
fn strands_that_stick_keep_the_energy() {
    let ([least, most], slipped) = let_go(1.0);
    assert!(least > 0.98 && most < 1.001 && slipped.abs() < 1e-9, "{least} to {most}, slip {slipped}");
}

#[test]
fn strands_that_slip_take_the_energy_that_their_cycles_enclose() {
    let ([least, most], slipped) = let_go(2e-3);
    assert!(slipped > 0.2 && most < 1.001, "{most}, slip {slipped}");
    assert!((1.0 - least - slipped).abs() < 0.02, "{} lost, slip {slipped}", 1.0 - least);
}

#[test]
fn strands_that_slip_stop_a_large_motion() {
    let ei = bar(0.25, 2e5).bending_stiffness_n_m2;
    let free = struck(bar(0.25, 2e5), 0.3, 3.0);
    let slipping = struck(with_friction(2.0 * ei, ei), 0.3, 3.0);
    let late = |tips: &[f64]| peak(&tips[tips.len() * 2 / 3..]);
    assert!(late(&free) > 0.8 * peak(&free), "{} of {}", late(&free), peak(&free));
    assert!(late(&slipping) < 0.5 * peak(&slipping), "{} of {}", late(&slipping), peak(&slipping));
}
