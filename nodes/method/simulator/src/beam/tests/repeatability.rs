//! Repeatability: equal inputs give equal bits, and a parameter at zero is absent.

use super::*;
use catenary_core::GripTrajectory;

const DURATION_S: f64 = 2.0;

fn base() -> BeamParameters {
    let table = Table { damping_time_s: 0.0, ..Table::new(0.19, 0.4) };
    BeamParameters { table: Some(table), ..bar(0.25, 1e4) }
}

fn bits(beam: &Beam) -> Vec<u64> {
    let state = &beam.state;
    state.position.iter().chain(&state.velocity).flatten().map(|v| v.to_bits()).collect()
}

fn run(beam: &mut Beam, path: &GripTrajectory) -> Vec<u64> {
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    assert!(beam.hang_at_rest(at(0.0)).converged);
    beam.advance_to(DURATION_S, at);
    bits(beam)
}

fn fresh(p: BeamParameters, path: &GripTrajectory) -> Vec<u64> {
    run(&mut Beam::new(p, standard(), grip(0.0)).unwrap(), path)
}

#[test]
fn two_runs_are_equal_to_the_bit() {
    let path = episode::grip_path(3);
    assert_eq!(fresh(base(), &path), fresh(base(), &path));
}

#[test]
fn reset_beam_forgets_the_one_before() {
    let path = episode::grip_path(3);
    let other = BeamParameters {
        kelvin_voigt_time_s: 0.03,
        linear_drag_n_s_m2: 0.1,
        quadratic_drag_n_s2_m3: 0.5,
        overhang_m: 0.02,
        ..bar(0.3, 2e3)
    };
    let mut beam = Beam::new(other, standard(), grip(0.3)).unwrap();
    run(&mut beam, &episode::grip_path(4));
    beam.reset(base(), grip(0.0)).unwrap();
    assert_eq!(run(&mut beam, &path), fresh(base(), &path));
}

#[test]
fn times_asked_for_do_not_change_the_motion() {
    let path = episode::grip_path(3);
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    let mut beam = hanging(base(), standard(), at(0.0));
    for k in 1..=30 {
        beam.advance_to(f64::from(k) * DURATION_S / 30.0, at);
    }
    assert_eq!(bits(&beam), fresh(base(), &path));
}

#[test]
fn shape_between_two_steps_is_interpolated() {
    let path = |time_s: f64| GripState { x_m: 0.05 * (9.0 * time_s).sin(), ..grip(0.0) };
    let tip_at = |step_s: f64| {
        let p = BeamParameters { kelvin_voigt_time_s: 0.02, ..bar(0.25, 1e4) };
        let mut beam = hanging(p, Discretisation { time_step_s: step_s, ..standard() }, path(0.0));
        beam.advance_to(0.5013, path);
        beam.tip()
    };
    let (between, on_step) = (tip_at(2e-3), tip_at(1e-4));
    assert!((between[0] - on_step[0]).hypot(between[1] - on_step[1]) < 2e-4, "{between:?}, not {on_step:?}");
}

#[test]
fn each_effect_at_zero_is_the_base_beam_and_acts_otherwise() {
    let path = episode::grip_path(3);
    let plain = fresh(base(), &path);
    let table = base().table.unwrap();
    type Effect = (&'static str, f64, fn(&mut BeamParameters, f64));
    let effects: [Effect; 8] = [
        ("kelvin_voigt_time_s", 0.01, |p, m| p.kelvin_voigt_time_s = m),
        ("linear_drag_n_s_m2", 0.1, |p, m| p.linear_drag_n_s_m2 = m),
        ("quadratic_drag_n_s2_m3", 0.1, |p, m| p.quadratic_drag_n_s2_m3 = m),
        ("rest_curvature_per_m", 0.5, |p, m| p.rest_curvature_per_m = m),
        ("tip_mass_kg", 0.005, |p, m| p.tip_mass_kg = m),
        ("gravity tilt", 0.05, |p, m| p.gravity_m_s2 = [m.sin() * GRAVITY, -m.cos() * GRAVITY]),
        ("overhang_m", 0.01, |p, m| p.overhang_m = m),
        ("table.damping_time_s", 0.01, |p, m| p.table.as_mut().unwrap().damping_time_s = m),
    ];
    assert_eq!(table.damping_time_s, 0.0);
    for (name, magnitude, set) in effects {
        let mut p = base();
        set(&mut p, 0.0);
        assert_eq!(fresh(p, &path), plain, "{name} at zero is not the base beam");
        set(&mut p, magnitude);
        assert_ne!(fresh(p, &path), plain, "{name} at {magnitude} does nothing");
    }
}

#[test]
fn refusals_name_field_and_value() {
    let refused = |p: BeamParameters| Beam::new(p, standard(), grip(0.0)).unwrap_err().to_string();
    assert!(
        refused(BeamParameters { length_m: -0.2, ..base() }).contains("length_m: expected a positive number, got -0.2")
    );
    assert!(refused(BeamParameters { overhang_m: 0.2, ..base() }).contains("overhang_m"));
    assert!(refused(BeamParameters { gravity_m_s2: [f64::NAN, 0.0], ..base() }).contains("gravity_m_s2"));
    let coarse = Discretisation { elements: 1, ..standard() };
    assert!(Beam::new(base(), coarse, grip(0.0)).unwrap_err().to_string().contains("elements"));
    let mut beam = Beam::new(base(), standard(), grip(0.0)).unwrap();
    let reference = Discretisation::of(Fidelity::Reference);
    assert!(beam.reset_with(base(), reference, grip(0.0)).unwrap_err().to_string().contains("20 elements, got 40"));
}
