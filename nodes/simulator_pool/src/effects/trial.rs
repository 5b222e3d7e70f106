//! Trials that the effects' own tests share.

use super::{Effect, Registry};
use crate::beam::{Beam, BeamParameters, Discretisation, GripState};
use crate::parameters::Values;
use crate::parameters::tests::soft_bar;
use crate::simulator::BeamSimulator;
use crate::view::Eye;
use crate::world::World;
use catenary_core::model::Section;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripPose, GripTrajectory, Model, SimulationRequest, Simulator, Track};

/// Length in m and Young's modulus in Pa of the trial's bar.
pub const THETA: [f64; 2] = [0.25, 2e4];
pub const DOWN: f64 = -std::f64::consts::FRAC_PI_2;
pub const GRAVITY: f64 = 9.81;

/// An episode in which the bar swings, is pressed on the table and drags over it; with camera noise. Effects as given.
pub fn episode(effects: &[(&str, f64)], drive: Drive) -> Track {
    let request = SimulationRequest {
        thetas: vec![THETA.to_vec()],
        effects: effects.iter().map(|(name, v)| ((*name).to_owned(), vec![*v])).collect(),
        drive,
        start: StartShape::HangingAtRest,
        frame_times_s: (0..25).map(|i| 0.1 * f64::from(i)).collect(),
        target_m: None,
        fidelity: Fidelity::Fast,
        seed: 3,
        first_episode: 0,
        noise: true,
    };
    BeamSimulator::new(&bare_bar(), 1).unwrap().simulate(&request).unwrap().remove(0)
}

/// The shipped soft bar without effects of its own.
fn bare_bar() -> Model {
    let mut model = soft_bar();
    model.effects.clear();
    model
}

/// Five steps of the arm down to the table and along it.
pub fn actions() -> Drive {
    Drive::Actions(vec![[0.03, -0.06], [0.02, -0.06], [0.0, -0.06], [0.05, -0.04], [0.05, 0.0]])
}

/// At magnitude zero, added to the world for real, the effect changes no bit.
#[track_caller]
pub fn zero_is_the_base(effect: &dyn Effect) {
    let name = effect.about().name;
    let nothing = episode(&[], actions());
    assert_eq!(episode(&[(name, 0.0)], actions()), nothing, "{name}");
    let much = effect.about().prior.from_unit(0.9);
    assert_ne!(episode(&[(name, much)], actions()), nothing, "{name} at {much} does nothing");
}

/// The world of the trial's bar, undamped and without a table.
fn base() -> World {
    let mut model = bare_bar();
    model.parameters.remove("table_height_m");
    Values::resolve(Registry::shipped(), &model, &THETA, []).unwrap().world(&model).unwrap()
}

/// The same with one effect.
pub fn world(effect: &dyn Effect, magnitude: f64) -> World {
    let mut world = base();
    effect.apply(magnitude, &mut world).unwrap();
    world
}

/// A bar of that Young's modulus in Pa, changed, with one effect.
pub fn beam(
    effect: &dyn Effect,
    magnitude: f64,
    youngs_modulus_pa: f64,
    change: impl FnOnce(&mut BeamParameters),
) -> BeamParameters {
    let mut world = base();
    let section = Section::Square { side_m: 0.015 };
    world.beam = BeamParameters::from_youngs_modulus(THETA[0], section, 1055.0, youngs_modulus_pa, 0.45);
    change(&mut world.beam);
    effect.apply(magnitude, &mut world).unwrap();
    world.beam
}

/// A beam at rest, held at the origin with that tangent.
pub fn at_rest(parameters: BeamParameters, tangent_rad: f64) -> Beam {
    let grip = GripState { tangent_rad, ..GripState::default() };
    let mut beam = Beam::new(parameters, Discretisation::of(Fidelity::Standard), grip).unwrap();
    assert!(beam.hang_at_rest(grip).converged);
    beam
}

/// Force in N along x that holds a bar in motion at `speed_m_s` along x after `duration_s`, which must be steady by then.
pub fn steady_drag_n(parameters: BeamParameters, speed_m_s: f64, duration_s: f64) -> f64 {
    let mut beam = at_rest(parameters, DOWN);
    beam.set_velocity([speed_m_s, 0.0]);
    beam.advance_to(duration_s, |t| GripState { x_m: speed_m_s * t, z_m: 0.0, tangent_rad: DOWN });
    beam.grip_reaction().force_x_n
}

/// Where the camera sees (x, z) in m, scaled to -1 .. 1.
pub fn seen(effect: &dyn Effect, magnitude: f64, [x, z]: [f64; 2]) -> [f64; 2] {
    world(effect, magnitude).view.camera.scaled_from_world([x, 0.0, z]).unwrap()
}

/// Fails unless a point that moves steadily along x at that height is seen where it was `age_s` ago.
#[track_caller]
pub fn is_seen_late(effect: &dyn Effect, magnitude: f64, z_m: f64, age_s: f64) {
    let (view, now_s) = (world(effect, magnitude).view, 0.1);
    let mut eye = Eye::new(&view, view.camera, None, None);
    let place = |t: f64| [0.5 + 0.5 * t, z_m];
    (0..50).map(|i| 2e-3 * f64::from(i)).for_each(|t| eye.remember(t, [place(t); 4]));
    let [then, _] = seen(effect, magnitude, place(now_s - age_s));
    close(eye.look(now_s, [place(now_s); 4])[0][0], then, 1e-4);
}

/// A grip that moves along x at `speed_m_s` from (0.4, 0.42) m on.
pub fn gliding(speed_m_s: f64) -> Drive {
    let pose = |x_m| GripPose { x_m, z_m: 0.42, pitch_rad: 0.0 };
    Drive::Grip(GripTrajectory::new(vec![0.0, 10.0], vec![pose(0.4), pose(0.4 + 10.0 * speed_m_s)]).unwrap())
}

/// Fails with both numbers unless `got` is within `share` of `expected`.
#[track_caller]
pub fn close(got: f64, expected: f64, share: f64) {
    assert!((got - expected).abs() <= share * expected.abs(), "got {got}, expected {expected} within {share}");
}

/// Effects act together: all at once, and any two.
mod together {
    use super::*;

    #[test]
    fn names_are_unique_and_priors_lie_within_their_ranges() {
        let all: Vec<_> = Registry::shipped().effects().map(|e| e.about()).collect();
        for (i, about) in all.iter().enumerate() {
            assert!(
                all[..i].iter().all(|other| other.name != about.name && other.title != about.title),
                "{}",
                about.name
            );
            let (low, high) = about.prior.bounds();
            assert!(about.prior.check().is_ok() && low >= about.range[0] && high <= about.range[1], "{}", about.name);
            assert!(about.range[0] <= 0.0 && about.range[1] > 0.0, "{}", about.name);
        }
    }

    #[test]
    fn all_effects_at_once_make_a_finite_track() {
        let magnitudes: Vec<(&str, f64)> =
            Registry::shipped().effects().map(|e| (e.about().name, e.about().prior.from_unit(0.7))).collect();
        let track = episode(&magnitudes, actions());
        assert!(
            track.frames.len() == 6 && track.frames.iter().flat_map(|f| f.dlo.as_flattened()).all(|v| v.is_finite())
        );
    }

    #[test]
    fn the_order_in_which_effects_are_given_changes_nothing() {
        let (a, b) = (("camera_tilt_rad", 0.05), ("lens_distortion", -0.1));
        assert_eq!(episode(&[a, b], actions()), episode(&[b, a], actions()));
    }
}
