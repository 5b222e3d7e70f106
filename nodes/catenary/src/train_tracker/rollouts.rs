//! Simulated episodes as a camera sees them.

use anyhow::{Context, Result};
use catenary_core::model::Section;
use catenary_core::{Fidelity, GripPose, Model, seed};
use catenary_simulator::Registry;
use catenary_simulator::episode::{Conditions, EpisodeSimulation};
use keypoint_tracker::learned::view::{ObjectView, Rollout};
use rand::RngExt;
use std::f64::consts::TAU;

/// Views of an episode, and the time between them.
const VIEWS: u32 = 30;
const PERIOD_S: f64 = 0.1;
/// Largest amplitude of the hand's swing along x and z in m.
const REACH_M: [f64; 2] = [0.12, 0.1];
/// Points of a centre line.
const POINTS: usize = 49;

/// Views of the episodes `first` to `first + number` of a seed. The parameters are draws of the model's prior; the hand swings. `tell` is
/// called after each episode, and ends the work if it returns false.
pub fn rollouts(
    model: &Model,
    seed: u64,
    first: u64,
    number: u32,
    mut tell: impl FnMut(u32) -> bool,
) -> Result<Option<Vec<Rollout>>> {
    let mut simulation = EpisodeSimulation::new(model, Registry::shipped(), Fidelity::Fast)?;
    let half_m = 0.5
        * match model.object.section {
            Section::Square { side_m } => side_m,
            Section::Round { diameter_m } => diameter_m,
        };
    let mut all = Vec::with_capacity(number as usize);
    for episode in first..first + u64::from(number) {
        all.push(rollout(model, &mut simulation, half_m, seed::derive(seed, episode))?);
        if !tell(all.len() as u32) {
            return Ok(None);
        }
    }
    Ok(Some(all))
}

fn rollout(model: &Model, simulation: &mut EpisodeSimulation, half_m: f64, episode_seed: u64) -> Result<Rollout> {
    let mut rng = seed::rng(episode_seed, 0);
    let theta = model.theta.sample_prior(&mut rng);
    simulation.prepare(&Conditions { theta: &theta, effects: &[], seed: episode_seed, noise: true, target_m: None })?;
    let start = model.arm.start;
    let swing =
        REACH_M.map(|reach| [rng.random_range(0.0..reach), rng.random_range(0.15..1.2), rng.random_range(0.0..1.0)]);
    let at = |[reach, hz, phase]: [f64; 3], t: f64| reach * ((TAU * (hz * t + phase)).sin() - (TAU * phase).sin());
    let path = |t: f64| GripPose { x_m: start.x_m + at(swing[0], t), z_m: start.z_m + at(swing[1], t), ..start };
    simulation.hang(path(0.0));
    let mut views = Vec::with_capacity(VIEWS as usize);
    for k in 0..VIEWS {
        simulation.advance(f64::from(k) * PERIOD_S, path);
        views.push(view(simulation, half_m).context("the object is behind the camera")?);
    }
    Ok(views)
}

/// The object as the camera sees it now; none if a part of it is behind the camera.
fn view(simulation: &EpisodeSimulation, half_m: f64) -> Option<ObjectView> {
    let camera = simulation.camera();
    let seen = |x: f64, z: f64| camera.mask_from_world([x, 0.0, z]);
    let places: [[f64; 2]; POINTS] =
        simulation.visible_points_m(std::array::from_fn(|k| k as f64 / (POINTS - 1) as f64));
    let line: Vec<[f64; 2]> = places.iter().map(|[x, z]| seen(*x, *z)).collect::<Option<_>>()?;
    let [x, z] = places[POINTS / 2];
    let (middle, beside) = (seen(x, z)?, seen(x + half_m, z)?);
    Some(ObjectView { line, half_width: (beside[0] - middle[0]).hypot(beside[1] - middle[1]) })
}
