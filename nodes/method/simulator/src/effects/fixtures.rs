//! Fixtures of the effects' tests.

use super::{Effect, Registry};
use crate::beam::{Beam, BeamParameters, Discretisation, GripState};
use crate::episode_model::{Companions, EpisodeModel};
use crate::imperfect_camera::ImperfectCamera;
use crate::parameters::Values;
use crate::parameters::tests::soft_bar;
use crate::simulator::BeamSimulator;
use catenary_core::model::{Section, WrenchNoise};
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripPose, GripTrajectory, Model, SimulationRequest, Simulator, Track};

/// Length in m and Young's modulus in Pa of the bar.
pub const THETA: [f64; 2] = [0.25, 2e4];
pub const DOWN: f64 = -std::f64::consts::FRAC_PI_2;
pub const GRAVITY: f64 = 9.81;

/// Request of an episode in which the bar swings, is pressed on the table and drags over it.
pub fn request(effects: &[(&str, f64)], drive: Drive, noise: bool) -> SimulationRequest {
    SimulationRequest {
        thetas: vec![THETA.to_vec()],
        effects: effects.iter().map(|(name, v)| ((*name).to_owned(), vec![*v])).collect(),
        drive,
        start: StartShape::HangingAtRest,
        frame_times_s: (0..25).map(|i| 0.1 * f64::from(i)).collect(),
        target_m: None,
        fidelity: Fidelity::Fast,
        seed: 3,
        first_episode: 0,
        noise,
    }
}

/// Simulates that episode with camera noise.
pub fn episode(effects: &[(&str, f64)], drive: Drive) -> Track {
    let request = request(effects, drive, true);
    BeamSimulator::new(&bare_bar(), 1).unwrap().simulate(&request).unwrap().remove(0)
}

/// Returns the shipped soft bar without effects of its own.
fn bare_bar() -> Model {
    let mut model = soft_bar();
    model.effects.clear();
    model
}

/// Returns five steps of the arm, down to the table and along it.
pub fn actions() -> Drive {
    Drive::Actions(vec![[0.03, -0.06], [0.02, -0.06], [0.0, -0.06], [0.05, -0.04], [0.05, 0.0]])
}

/// Makes the settings of the bar with a template at a place and a frequency, of the given Young's modulus in Pa.
pub fn template(template: &dyn Effect, magnitude: f64, [place, frequency_hz]: [f64; 2], e_pa: f64) -> EpisodeModel {
    let mut episode = base_of(e_pa);
    episode.templates = Companions { place, frequency_hz };
    template.apply(magnitude, &mut episode).unwrap();
    episode
}

/// Makes a beam at rest with `elements` elements and the episode's terms, held at the origin with the given tangent in rad.
pub fn held(episode: &EpisodeModel, elements: usize, tangent_rad: f64) -> Beam {
    let grip = GripState { tangent_rad, ..GripState::default() };
    let discretisation = Discretisation { elements, ..Discretisation::of(Fidelity::Standard) };
    let mut beam = Beam::new(episode.beam, discretisation, grip).unwrap();
    beam.reset_to(episode.beam, &episode.terms, grip).unwrap();
    assert!(beam.hang_at_rest(grip).converged);
    beam
}

/// Fails unless the grip carries the weight of an effect whose magnitude is a mass, on coarse and fine meshes.
#[track_caller]
pub fn carries_its_weight(effect: &dyn Effect) {
    for elements in [12, 20, 40] {
        let weight_n = |mass_kg| held(&episode_model(effect, mass_kg), elements, DOWN).grip_reaction().force_z_n;
        close(weight_n(0.02) - weight_n(0.0), 0.02 * GRAVITY, 1e-6);
    }
}

/// Fails unless the template changes no bit at magnitude zero, and some bit at a large magnitude.
#[track_caller]
pub fn template_at_zero_is_the_base(template: &dyn Effect) {
    let simulator = BeamSimulator::with_effects(&bare_bar(), &Registry::with_templates(), 1).unwrap();
    let track = |effects: &[(&str, f64)]| simulator.simulate(&request(effects, actions(), true)).unwrap().remove(0);
    is_the_base_at_zero(template, track);
}

/// Fails unless the effect changes no bit at magnitude zero, and some bit at a large magnitude.
#[track_caller]
pub fn zero_is_the_base(effect: &dyn Effect) {
    is_the_base_at_zero(effect, |effects| episode(effects, actions()));
}

/// Returns the wrenches without noise of that episode with effects, along a path, as a model that observes them sees them.
pub fn wrenches(effects: &[(&str, f64)]) -> Vec<[f64; 3]> {
    let mut model = bare_bar();
    model.observation.wrench = Some(WrenchNoise { force_sd_n: [1.0, 0.1], torque_sd_n_m: 0.05 });
    let request = request(effects, gliding(0.02), false);
    let track = BeamSimulator::new(&model, 1).unwrap().simulate(&request).unwrap().remove(0);
    track.frames.iter().map(|frame| frame.wrench.unwrap()).collect()
}

/// Returns the changes of the wrenches by an effect.
pub fn wrench_changes(effect: &dyn Effect, magnitude: f64) -> Vec<[f64; 3]> {
    let (base, changed) = (wrenches(&[]), wrenches(&[(effect.about().name, magnitude)]));
    base.iter().zip(&changed).map(|(a, b)| std::array::from_fn(|i| b[i] - a[i])).collect()
}

/// Fails unless the effect of the wrench's sensor changes no bit at magnitude zero and some bit at a large magnitude, and needs a model that
/// observes the wrench.
#[track_caller]
pub fn zero_is_the_base_of_a_wrench(effect: &dyn Effect) {
    let about = effect.about();
    assert_eq!(wrenches(&[(about.name, 0.0)]), wrenches(&[]), "{}", about.name);
    assert_ne!(wrenches(&[(about.name, about.prior.from_unit(0.9))]), wrenches(&[]), "{}", about.name);
    assert_eq!(effect.apply(0.1, &mut base()), Err(crate::episode_model::NO_WRENCH));
}

#[track_caller]
fn is_the_base_at_zero(effect: &dyn Effect, track: impl Fn(&[(&str, f64)]) -> Track) {
    let name = effect.about().name;
    let nothing = track(&[]);
    assert_eq!(track(&[(name, 0.0)]), nothing, "{name}");
    let much = effect.about().prior.from_unit(0.9);
    assert_ne!(track(&[(name, much)]), nothing, "{name} at {much} does nothing");
}

/// Makes the settings of the bar, undamped and without a table.
fn base() -> EpisodeModel {
    let mut model = bare_bar();
    model.parameters.remove("table_height_m");
    Values::resolve(Registry::shipped(), &model, &THETA, []).unwrap().episode_model(&model).unwrap()
}

/// Makes those settings with another Young's modulus in Pa.
fn base_of(youngs_modulus_pa: f64) -> EpisodeModel {
    let section = Section::Square { side_m: 0.015 };
    let beam = BeamParameters::from_youngs_modulus(THETA[0], section, 1055.0, youngs_modulus_pa, 0.45);
    EpisodeModel { beam, ..base() }
}

/// Makes the settings of the bar with one effect.
pub fn episode_model(effect: &dyn Effect, magnitude: f64) -> EpisodeModel {
    let mut episode = base();
    effect.apply(magnitude, &mut episode).unwrap();
    episode
}

/// Makes a beam of the given Young's modulus in Pa, changed by `change`, with one effect.
pub fn beam(
    effect: &dyn Effect,
    magnitude: f64,
    youngs_modulus_pa: f64,
    change: impl FnOnce(&mut BeamParameters),
) -> BeamParameters {
    let mut episode = base_of(youngs_modulus_pa);
    change(&mut episode.beam);
    effect.apply(magnitude, &mut episode).unwrap();
    episode.beam
}

/// Makes a beam at rest, held at the origin with the given tangent in rad.
pub fn at_rest(parameters: BeamParameters, tangent_rad: f64) -> Beam {
    let grip = GripState { tangent_rad, ..GripState::default() };
    let mut beam = Beam::new(parameters, Discretisation::of(Fidelity::Standard), grip).unwrap();
    assert!(beam.hang_at_rest(grip).converged);
    beam
}

/// State of a bar that hangs from the origin when its episode starts.
#[derive(Debug)]
pub struct Start {
    /// Displacement (x, z) in m of the tip from rest.
    pub tip_m: [f64; 2],
    /// Displacement (x, z) in m of the middle from rest.
    pub middle_m: [f64; 2],
    /// Speed of the tip along x in m/s over the first microsecond.
    pub tip_speed_m_s: f64,
}

/// Returns the start of an episode of the bar with one effect. Positive displacements of the effect are along +x.
pub fn start_of(effect: &dyn Effect, magnitude: f64) -> Start {
    let settings = episode_model(effect, magnitude);
    let grip = GripState { tangent_rad: DOWN, ..GripState::default() };
    let mut beam = at_rest(settings.beam, DOWN);
    let places = |beam: &Beam| beam.centre_line_at_deformed_fraction([1.0, 0.5]);
    let rest = places(&beam);
    beam.change_start(&settings.start);
    let first = places(&beam);
    beam.advance_to(1e-6, |_| grip);
    let later = places(&beam);
    let moved = |k: usize| [0, 1].map(|i| first[k][i] - rest[k][i]);
    Start { tip_m: moved(0), middle_m: moved(1), tip_speed_m_s: (later[0][0] - first[0][0]) / 1e-6 }
}

/// Returns the force in N along x that holds a bar at `speed_m_s` along x after `duration_s`, when the motion is
/// steady.
pub fn steady_drag_n(parameters: BeamParameters, speed_m_s: f64, duration_s: f64) -> f64 {
    let mut beam = at_rest(parameters, DOWN);
    beam.set_velocity([speed_m_s, 0.0]);
    beam.advance_to(duration_s, |t| GripState { x_m: speed_m_s * t, z_m: 0.0, tangent_rad: DOWN });
    beam.grip_reaction().force_x_n
}

/// Returns the image of (x, z) in m, scaled to -1 .. 1.
pub fn seen(effect: &dyn Effect, magnitude: f64, [x, z]: [f64; 2]) -> [f64; 2] {
    episode_model(effect, magnitude).camera.view.scaled_from_world([x, 0.0, z]).unwrap()
}

/// Fails unless a point that moves steadily along x at height `z_m` is seen at its place `age_s` ago.
#[track_caller]
pub fn is_seen_late(effect: &dyn Effect, magnitude: f64, z_m: f64, age_s: f64) {
    let (settings, now_s) = (episode_model(effect, magnitude).camera, 0.1);
    let mut camera = ImperfectCamera::new(&settings, settings.view, None, None);
    let place = |t: f64| [0.5 + 0.5 * t, z_m];
    (0..50).map(|i| 2e-3 * f64::from(i)).for_each(|t| camera.remember(t, [place(t); 4]));
    let [then, _] = seen(effect, magnitude, place(now_s - age_s));
    close(camera.capture(now_s, [place(now_s); 4])[0][0], then, 1e-4);
}

/// Makes the path of a grip that moves along x at `speed_m_s`, from (0.4, 0.42) m.
pub fn gliding(speed_m_s: f64) -> Drive {
    let pose = |x_m| GripPose { x_m, z_m: 0.42, pitch_rad: 0.0 };
    Drive::Grip(GripTrajectory::new(vec![0.0, 10.0], vec![pose(0.4), pose(0.4 + 10.0 * speed_m_s)]).unwrap())
}

/// Fails with both numbers unless `got` is within `share` of `expected`.
#[track_caller]
pub fn close(got: f64, expected: f64, share: f64) {
    assert!((got - expected).abs() <= share * expected.abs(), "got {got}, expected {expected} within {share}");
}
