//! Tests of effects that a model file states.

use super::super::Registry;
use super::super::fixtures::{self, DOWN, GRAVITY, THETA};
use super::without_negative;
use crate::beam::{Beam, GripState};
use crate::model_text;
use crate::parameters::Values;
use crate::parameters::tests::soft_bar;
use catenary_core::simulator::{DifferentiableSimulator, Drive};
use catenary_core::{GripPose, GripTrajectory, Model, SimulationRequest, Simulator, Track};

const SOFT_BAR: &str = include_str!("../../../../../../launch_configs/models/soft_bar.yaml");

/// Shipped bar without a table, with one expression of the given fields.
fn stating(fields: &str) -> String {
    let bar = SOFT_BAR.replace("  table_height_m: 0.0\n", "");
    format!("{bar}\nexpressions:\n  - {{name: push_n_m, prior: {{uniform: {{low: -1.0, high: 1.0}}}}, {fields}}}\n")
}

fn model(fields: &str) -> Model {
    model_text::read(&stating(fields)).unwrap()
}

fn request(effects: &[(&str, f64)], drive: Drive) -> SimulationRequest {
    SimulationRequest {
        frame_times_s: (0..12).map(|i| 0.1 * f64::from(i)).collect(),
        ..fixtures::request(effects, drive, false)
    }
}

fn still() -> Drive {
    let pose = GripPose { x_m: 0.4, z_m: 0.5, pitch_rad: 0.0 };
    Drive::Grip(GripTrajectory::new(vec![0.0, 2.0], vec![pose; 2]).unwrap())
}

/// Hand that goes to and fro along x, twice a second, by 5 cm.
fn swinging() -> Drive {
    let times_s: Vec<f64> = (0..150).map(|i| 0.01 * f64::from(i)).collect();
    let pose = |t: &f64| GripPose { x_m: 0.4 + 0.05 * (12.0 * t).sin(), z_m: 0.5, pitch_rad: 0.0 };
    let poses = times_s.iter().map(pose).collect();
    Drive::Grip(GripTrajectory::new(times_s, poses).unwrap())
}

fn track(model: &Model, effects: &[(&str, f64)], drive: Drive) -> Track {
    let simulator = crate::BeamSimulator::new(model, 1).unwrap();
    simulator.simulate(&request(effects, drive)).unwrap().remove(0)
}

/// Beam with the model's terms, held at the origin along +x.
fn beam(model: &Model, given: &[(&str, f64)]) -> Beam {
    along(model, given, 0.0)
}

/// Beam with the model's terms that hangs from the origin.
fn hanging(model: &Model, given: &[(&str, f64)]) -> Beam {
    along(model, given, DOWN)
}

fn along(model: &Model, given: &[(&str, f64)], tangent_rad: f64) -> Beam {
    let registry = Registry::shipped().with_expressions(model).unwrap();
    let values = Values::resolve(&registry, model, &THETA, given.iter().copied()).unwrap();
    let episode = values.episode_model(model).unwrap();
    fixtures::held(&episode, 40, tangent_rad)
}

#[test]
fn zero_is_the_base_to_the_bit() {
    let (bare, stated) = (soft_bar(), "force_x_n_m: \"1 + x\", couple_n_m_m: \"s\", moment_n_m: \"curvature\"");
    let mut with = bare.clone();
    with.expressions = model(stated).expressions;
    let nothing = track(&bare, &[], fixtures::actions());
    assert_eq!(track(&with, &[], fixtures::actions()), nothing);
    assert_eq!(track(&with, &[("push_n_m", 0.0)], fixtures::actions()), nothing);
    assert_ne!(track(&with, &[("push_n_m", 0.01)], fixtures::actions()), nothing);
}

/// A force along the whole length is carried by the grip. The forces at the mesh's nodes add up to the integral of s^2 within
/// the trapezoidal rule's error.
#[test]
fn the_grip_carries_a_stated_force() {
    let model = model("force_z_n_m: \"-3 * s^2\"");
    let carried_n = |magnitude| beam(&model, &[("push_n_m", magnitude)]).grip_reaction().force_z_n;
    fixtures::close(carried_n(0.8) - carried_n(0.0), 0.8 * THETA[0], 2e-3);
}

/// A uniform field as a force is gravity: bit for bit another computation, and the same motion.
#[test]
fn a_uniform_force_moves_the_bar_as_gravity_does() {
    let model = model("force_x_n_m: \"1\"");
    let mass_per_length = 1055.0 * 0.015 * 0.015;
    let pushed = track(&model, &[("push_n_m", 0.1 * mass_per_length * GRAVITY)], still());
    let tilted = track(&model, &[("gravity_tilt_rad", 0.1_f64.asin())], still());
    for (a, b) in pushed.frames.iter().zip(&tilted.frames) {
        // The tilt of gravity takes half a per cent of its size along z.
        assert!((a.dlo[3][0] - b.dlo[3][0]).abs() < 2e-3, "{} and {}", a.dlo[3][0], b.dlo[3][0]);
    }
}

/// A couple C per length bends a weightless bar to the curvature C (L - s) / EI.
#[test]
fn a_couple_bends_a_weightless_bar_as_the_closed_form_says() {
    let model = model("couple_n_m_m: \"1\"");
    let registry = Registry::shipped().with_expressions(&model).unwrap();
    let values = Values::resolve(&registry, &model, &THETA, [("push_n_m", 1e-3)]).unwrap();
    let mut episode = values.episode_model(&model).unwrap();
    episode.beam.gravity_m_s2 = [0.0, -1e-6];
    let stiffness = THETA[1] * 0.015_f64.powi(4) / 12.0;
    let angle = fixtures::held(&episode, 40, 0.0).nodes()[40][2];
    fixtures::close(angle, 1e-3 * THETA[0] * THETA[0] / (2.0 * stiffness), 5e-3);
}

/// A moment in proportion to the curvature is bending stiffness: at rest, and in motion.
#[test]
fn a_moment_of_the_curvature_is_bending_stiffness() {
    let more = 0.3;
    let stiffness = THETA[1] * 0.015_f64.powi(4) / 12.0;
    let model = model(&format!("moment_n_m: \"{stiffness} * curvature\""));
    let stated = beam(&model, &[("push_n_m", more)]);
    let mut episode = Values::resolve(Registry::shipped(), &model, &THETA, []).unwrap().episode_model(&model).unwrap();
    episode.beam.bending_stiffness_n_m2 *= 1.0 + more;
    let stiffer = fixtures::held(&episode, 40, 0.0);
    for axis in 0..2 {
        assert!((stated.tip()[axis] - stiffer.tip()[axis]).abs() < 1e-6, "{:?} and {:?}", stated.tip(), stiffer.tip());
    }
    let swing = |mut beam: Beam| {
        beam.advance_to(0.4, |t| GripState { x_m: 0.1 * (8.0 * t).sin(), ..GripState::default() });
        beam.tip()
    };
    let (a, b) = (swing(stated), swing(stiffer));
    assert!((a[0] - b[0]).abs() < 1e-5 && (a[1] - b[1]).abs() < 1e-5, "{a:?} and {b:?}");
}

/// A moment of the curvature's rate damps a swing as Kelvin and Voigt's law does. The bar hardly stretches, because that law damps
/// stretches, too.
#[test]
fn a_moment_of_the_rate_damps_as_kelvin_voigt_does() {
    let stiffness = THETA[1] * 0.015_f64.powi(4) / 12.0;
    let model = model(&format!("moment_n_m: \"{} * curvature_rate\"", 0.02 * stiffness));
    let registry = Registry::shipped().with_expressions(&model).unwrap();
    let late = |effects: [(&str, f64); 2]| {
        let values = Values::resolve(&registry, &model, &THETA, effects).unwrap();
        let mut episode = values.episode_model(&model).unwrap();
        episode.beam.axial_stiffness_n *= 100.0;
        episode.beam.shear_stiffness_n *= 100.0;
        let mut beam = fixtures::held(&episode, 40, DOWN);
        let grip = |t: f64| GripState { x_m: 0.02 * (12.0 * t).sin(), tangent_rad: DOWN, ..GripState::default() };
        beam.advance_to(1.1, grip);
        beam.tip()[0]
    };
    let free = late([("kelvin_voigt_time_s", 0.0), ("push_n_m", 0.0)]);
    let stated = late([("kelvin_voigt_time_s", 0.0), ("push_n_m", 1.0)]);
    let damped = late([("kelvin_voigt_time_s", 0.02), ("push_n_m", 0.0)]);
    // The rate of a moment is that of one step, and Kelvin and Voigt's that of two: they differ in the second order.
    assert!((stated - damped).abs() < 0.05 * (free - damped).abs(), "{free}, {stated}, {damped}");
}

/// A stiff wall, of 2 MN/m per metre, stops the bar. An explicit force of a tenth of that stiffness would throw it away.
#[test]
fn a_stiff_wall_holds_the_bar_without_throwing_it() {
    let model = model(
        "force_x_n_m: \"-2e6 * max(0, x - wall_m) * step(s - 0.5)\", companions: [{name: wall_m, unit: m, prior: {uniform: {low: 0.0, high: 0.5}}}]",
    );
    // The hanging bar's lower half stops at the wall while the grip goes on by 5 cm.
    let wall_m = 0.02;
    let mut beam = hanging(&model, &[("push_n_m", 1.0), ("wall_m", wall_m)]);
    let (mut most, mut fastest) = (f64::MIN, 0.0_f64);
    for i in 1..=100 {
        let before = beam.tip();
        let grip = |t: f64| GripState { x_m: 0.05 * (6.0 * t).sin().abs(), tangent_rad: DOWN, ..GripState::default() };
        beam.advance_to(0.01 * f64::from(i), grip);
        most = most.max(beam.tip()[0] - wall_m);
        fastest = fastest.max((beam.tip()[0] - before[0]).hypot(beam.tip()[1] - before[1]) / 0.01);
    }
    assert!((-0.001..0.002).contains(&most) && fastest < 3.0, "{most} m beyond the wall, {fastest} m/s");
}

/// The derivative by a magnitude agrees with the difference of two simulations.
#[test]
fn derivatives_are_those_of_differences() {
    let model = model("force_x_n_m: \"sin(6 * t) * s - 0.5 * vx\", moment_n_m: \"0.001 * curvature^3\"");
    let simulator = crate::BeamSimulator::new(&model, 1).unwrap();
    let at = |magnitude: f64| request(&[("push_n_m", magnitude)], swinging());
    let value = |magnitude: f64| simulator.simulate(&at(magnitude)).unwrap().remove(0);
    let by = simulator.sensitivities(&at(0.3), &["push_n_m"]).unwrap().remove(0);
    let (up, down) = (value(0.3 + 1e-4), value(0.3 - 1e-4));
    for (i, (up, down)) in up.frames.iter().zip(&down.frames).enumerate() {
        let difference = (up.dlo[3][0] - down.dlo[3][0]) / 2e-4;
        let got = by.derivatives[0][i].dlo[3][0];
        // The largest derivative is 0.3.
        assert!((got - difference).abs() < 3e-3, "frame {i}: {got} and {difference}");
    }
}

#[test]
fn companions_precede_their_effect_and_have_medians() {
    let model = model(
        "force_x_n_m: \"sin(pace_hz * t)\", companions: [{name: pace_hz, unit: Hz, prior: {log_uniform: {low: 1.0, high: 4.0}}}]",
    );
    let registry = Registry::shipped().with_expressions(&model).unwrap();
    let names: Vec<&str> = registry.effects().map(|e| e.about().name).collect();
    assert!(names.ends_with(&["pace_hz", "push_n_m"]), "{names:?}");
    assert!(registry.is_companion("pace_hz") && registry.find("push_n_m").unwrap().companions() == ["pace_hz"]);
    fixtures::close(registry.find("pace_hz").unwrap().if_absent(), 2.0, 1e-12);
    // Extending twice changes nothing.
    assert_eq!(registry.with_expressions(&model).unwrap().effects().count(), registry.effects().count());
}

#[test]
fn errors_name_line_field_character_and_expectation() {
    let error = |fields: &str| model_text::read(&stating(fields)).unwrap_err().to_string();
    let e = error("force_x_n_m: \"2 * (s\"");
    assert!(
        e.contains("`expressions.push_n_m.force_x_n_m`: `2 * (s`: at character 7: expected an operator or `)`"),
        "{e}"
    );
    let e = error("moment_n_m: \"vx\"");
    assert!(e.contains("expected one of s, t, curvature, curvature_rate, pi"), "{e}");
    let e = error("title: nothing");
    assert!(
        e.contains("expected an expression: force_x_n_m, force_z_n_m, couple_n_m_m or moment_n_m, got none"),
        "{e}"
    );
    let taken = stating("force_x_n_m: \"1\"").replace("push_n_m", "tip_mass_kg");
    let e = model_text::read(&taken).unwrap_err().to_string();
    assert!(e.contains("expected a name that is free, got that of the effect `tip_mass_kg`"), "{e}");
}

#[test]
fn the_projection_of_a_matrix_has_no_negative_eigenvalue() {
    assert_eq!(without_negative([2.0, 0.5, 1.0]), [2.0, 0.5, 1.0]);
    assert_eq!(without_negative([-2.0, 0.0, -1.0]), [0.0; 3]);
    assert_eq!(without_negative([f64::NAN, 0.0, 1.0]), [0.0; 3]);
    let [xx, xz, zz] = without_negative([3.0, 0.0, -4.0]);
    assert!((xx - 3.0).abs() < 1e-12 && xz == 0.0 && zz.abs() < 1e-12);
    // Eigenvalues 1 +- sqrt(8): the projection has the larger one as its trace, and no determinant.
    let [xx, xz, zz] = without_negative([3.0, 2.0, -1.0]);
    assert!((xx + zz - (1.0 + 8.0_f64.sqrt())).abs() < 1e-12 && (xx * zz - xz * xz).abs() < 1e-12);
}

/// A simulator whose model states effects makes the terms anew for each episode.
#[test]
fn episodes_do_not_share_terms() {
    let model = model("force_x_n_m: \"1\"");
    let simulator = crate::BeamSimulator::new(&model, 1).unwrap();
    let mut both = request(&[("push_n_m", 0.2)], still());
    both.thetas = vec![THETA.to_vec(); 2];
    both.effects[0].1 = vec![0.2, 0.0];
    let tracks = simulator.simulate(&both).unwrap();
    let last = |track: &Track| track.frames[11].dlo[3];
    let alone = track(&model, &[], still());
    assert!((last(&tracks[1])[0] - last(&alone)[0]).abs() < 1e-9);
    assert!((last(&tracks[0])[0] - last(&alone)[0]).abs() > 1e-3);
}
