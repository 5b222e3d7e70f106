//! Simulator of batches of episodes.

use crate::beam::Discretisation;
use crate::effects::Registry;
use crate::episode::{self, Conditions, EpisodeSimulation, StopCriterion, effects_of};
use crate::parameters::{ParameterError, known, range_of};
use crate::{sensitivity, workers};
use catenary_core::simulator::{DifferentiableSimulator, Drive, IsEnough, SimulatorError, TrackSensitivities, Until};
use catenary_core::{Fidelity, Model, SimulationRequest, Simulator, Track};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Latest time of a frame in s.
// Far longer than a recording of one motion; a bound, so that no request runs for ever.
const LATEST_FRAME_S: f64 = 3600.0;

/// Beam simulator of one model. Its workers share the memory of earlier episodes.
pub struct BeamSimulator {
    model: Model,
    registry: Registry,
    workers: usize,
    tolerance_m: Option<f64>,
    /// Simulations that no worker uses at present, by fidelity.
    idle: Mutex<Vec<(Fidelity, EpisodeSimulation)>>,
    unconverged_steps: AtomicU64,
    unconverged_equilibria: AtomicU64,
}

impl BeamSimulator {
    /// Makes a simulator with `workers` threads. Equal requests give equal bits for any number of them.
    ///
    /// # Errors
    /// [`ParameterError`] if the model makes no object.
    pub fn new(model: &Model, workers: usize) -> Result<Self, ParameterError> {
        Self::with_effects(model, Registry::shipped(), workers)
    }

    /// Makes a simulator as [`Self::new`] does, with the effects of another registry.
    ///
    /// # Errors
    /// [`ParameterError`] if the model makes no object.
    pub fn with_effects(model: &Model, registry: &Registry, workers: usize) -> Result<Self, ParameterError> {
        let registry = registry.with_expressions(model)?;
        crate::parameters::check_with(model, &registry)?;
        Ok(Self {
            model: model.clone(),
            registry,
            workers,
            tolerance_m: None,
            idle: Mutex::new(Vec::new()),
            unconverged_steps: AtomicU64::new(0),
            unconverged_equilibria: AtomicU64::new(0),
        })
    }

    /// Sets the tolerance in m of each time step, instead of the fidelity's own.
    pub fn with_tolerance(self, tolerance_m: f64) -> Self {
        Self { tolerance_m: Some(tolerance_m), ..self }
    }

    /// Returns the model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the number of time steps, in all batches so far, whose Newton iteration did not converge.
    pub fn unconverged_steps(&self) -> u64 {
        self.unconverged_steps.load(Ordering::Relaxed)
    }

    /// Returns the number of initial shapes, in all batches so far, that had not come to rest.
    pub fn unconverged_equilibria(&self) -> u64 {
        self.unconverged_equilibria.load(Ordering::Relaxed)
    }

    fn take_simulation(&self, fidelity: Fidelity) -> Result<EpisodeSimulation, ParameterError> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        match idle.iter().position(|(f, _)| *f == fidelity) {
            Some(i) => Ok(idle.swap_remove(i).1),
            None => {
                // Released first: the other workers must not wait while this one allocates.
                drop(idle);
                let discretisation = Discretisation::of(fidelity);
                let tolerance_m = self.tolerance_m.unwrap_or(discretisation.tolerance_m);
                EpisodeSimulation::with_discretisation(
                    &self.model,
                    &self.registry,
                    Discretisation { tolerance_m, ..discretisation },
                )
            }
        }
    }

    /// Simulates a batch. Each track ends as soon as `is_enough` holds for it.
    fn simulate_each(
        &self,
        request: &SimulationRequest,
        is_enough: IsEnough<'_>,
    ) -> Result<Vec<Track>, SimulatorError> {
        check(&self.model, request).map_err(SimulatorError::Input)?;
        let episodes: Vec<usize> = (0..request.thetas.len()).collect();
        let one = |_, index| self.simulate_one(request, index, &|frames| is_enough(index, frames));
        workers::map(episodes, self.workers, one).into_iter().collect()
    }

    fn simulate_one(
        &self,
        request: &SimulationRequest,
        index: usize,
        is_enough: StopCriterion<'_>,
    ) -> Result<Track, SimulatorError> {
        let input = |e: &dyn std::fmt::Display| SimulatorError::Input(format!("episode {index}: {e}"));
        let effects = effects_of(request, index);
        let mut simulation = self.take_simulation(request.fidelity).map_err(|e| input(&e))?;
        simulation.prepare(&Conditions::of(request, index, &effects)).map_err(|e| input(&e))?;
        let SimulationRequest { drive, start, frame_times_s, .. } = request;
        let track = episode::run(&mut simulation, drive, start, frame_times_s, is_enough).map_err(|e| input(&e))?;
        self.count(&simulation);
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push((request.fidelity, simulation));
        Ok(track)
    }

    /// Adds the unconverged steps and equilibria of the last episode to the totals.
    fn count(&self, simulation: &EpisodeSimulation) {
        let counters = simulation.beam().counters();
        self.unconverged_steps.fetch_add(counters.unconverged_steps, Ordering::Relaxed);
        self.unconverged_equilibria.fetch_add(counters.unconverged_equilibria, Ordering::Relaxed);
    }

    /// Simulates one episode with its derivatives by the parameters `names`.
    fn differentiate_one(
        &self,
        request: &SimulationRequest,
        index: usize,
        (is_first_part, names): (bool, &[&str]),
    ) -> Result<TrackSensitivities, SimulatorError> {
        let input = |e: &dyn std::fmt::Display| SimulatorError::Input(format!("episode {index}: {e}"));
        let simulations = (0..=names.len()).map(|_| self.take_simulation(request.fidelity));
        let mut simulations = simulations.collect::<Result<Vec<_>, _>>().map_err(|e| input(&e))?;
        let effects = effects_of(request, index);
        let conditions = Conditions::of(request, index, &effects);
        let SimulationRequest { drive, start, frame_times_s, .. } = request;
        let result = sensitivity::differentiate(&mut simulations, &conditions, drive, start, frame_times_s, names);
        let sensitivities = result.map_err(|e| input(&e))?;
        // Every part simulates the episode again, which must be counted once.
        if is_first_part {
            self.count(&simulations[0]);
        }
        let idle = simulations.into_iter().map(|simulation| (request.fidelity, simulation));
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).extend(idle);
        Ok(sensitivities)
    }
}

/// Rejects requests whose parts do not fit one another or the model. The message names the field.
pub(crate) fn check(model: &Model, request: &SimulationRequest) -> Result<(), String> {
    let (n, d) = (request.thetas.len(), model.theta.dimension());
    if let Some(bad) = request.thetas.iter().find(|t| t.len() != d) {
        return Err(format!("theta: expected {d} values an episode, got {}", bad.len()));
    }
    if let Some((name, values)) = request.effects.iter().find(|(_, v)| v.len() != n) {
        return Err(format!("effect `{name}`: expected {n} values, one an episode, got {}", values.len()));
    }
    if let Drive::Actions(actions) = &request.drive
        && let Some(i) = actions.iter().position(|a| !a.iter().all(|v| v.is_finite()))
    {
        return Err(format!("actions: expected finite numbers, got {:?} at step {i}", actions[i]));
    }
    let times = &request.frame_times_s;
    let follows = |i: usize| i == 0 || times[i] > times[i - 1];
    if let Some(i) = (0..times.len()).find(|&i| !(0.0..=LATEST_FRAME_S).contains(&times[i]) || !follows(i)) {
        return Err(format!(
            "frame_times: expected increasing times from 0 s to {LATEST_FRAME_S} s, got {} s at place {i}",
            times[i]
        ));
    }
    Ok(())
}

impl Simulator for BeamSimulator {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.simulate_each(request, &|_, frames| episode::never_stop(frames))
    }

    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        self.simulate_each(request, until.is_enough)
    }

    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        range_of(&self.registry, name).ok()
    }
}

impl DifferentiableSimulator for BeamSimulator {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        check(&self.model, request).map_err(SimulatorError::Input)?;
        for name in names {
            known(&self.registry, name).map_err(|e| SimulatorError::Input(e.to_string()))?;
        }
        // With more workers than episodes, the parameters of an episode are divided among workers.
        let episodes = request.thetas.len();
        let parts = self.workers.div_ceil(episodes.max(1)).clamp(1, names.len().max(1));
        let share = names.len().div_ceil(parts).max(1);
        let mut work: Vec<(usize, (bool, &[&str]))> = Vec::new();
        for index in 0..episodes {
            work.extend(names.chunks(share).enumerate().map(|(i, part)| (index, (i == 0, part))));
            if names.is_empty() {
                work.push((index, (true, names)));
            }
        }
        let per_episode = work.len() / episodes.max(1);
        let mut done =
            workers::map(work, self.workers, |_, (index, part)| self.differentiate_one(request, index, part))
                .into_iter();
        let mut all = Vec::new();
        for _ in 0..episodes {
            let mut whole = TrackSensitivities::default();
            for part in done.by_ref().take(per_episode) {
                let part = part?;
                whole.track = part.track;
                whole.derivatives.extend(part.derivatives);
                whole.changes.extend(part.changes);
            }
            all.push(whole);
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::tests::{cable, soft_bar};
    use catenary_core::model::WrenchNoise;
    use catenary_core::simulator::StartShape;
    use catenary_core::track::End;
    use catenary_core::{Frame, GripPose, GripTrajectory};

    fn request(drive: Drive, n: usize) -> SimulationRequest {
        SimulationRequest {
            thetas: (0..n).map(|i| vec![0.2 + 0.01 * i as f64, 1e4 * (1.0 + i as f64)]).collect(),
            effects: Vec::new(),
            drive,
            start: StartShape::HangingAtRest,
            frame_times_s: Vec::new(),
            target_m: None,
            fidelity: Fidelity::Fast,
            seed: 5,
            first_episode: 0,
            noise: true,
        }
    }

    fn still() -> Drive {
        Drive::Grip(GripTrajectory::new(vec![0.0], vec![GripPose { x_m: 0.4, z_m: 0.42, pitch_rad: 0.0 }]).unwrap())
    }

    #[test]
    fn the_number_of_workers_does_not_change_a_bit() {
        let request = request(Drive::Actions(vec![[0.03, -0.04]; 4]), 5);
        let tracks = |workers| BeamSimulator::new(&soft_bar(), workers).unwrap().simulate(&request).unwrap();
        let one = tracks(1);
        assert_eq!(one, tracks(2));
        assert_eq!(one, tracks(8));
        assert!(one[0].frames.len() == 5 && one[0] != one[1]);
    }

    #[test]
    fn an_episode_does_not_depend_on_earlier_ones_in_its_memory() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let all = simulator.simulate(&request(Drive::Actions(vec![[0.03, -0.04]; 2]), 3)).unwrap();
        let again = simulator.simulate(&request(Drive::Actions(vec![[0.03, -0.04]; 2]), 3)).unwrap();
        assert_eq!(all, again);
    }

    #[test]
    fn an_episode_that_is_stopped_early_is_the_beginning_of_the_whole() {
        let poses =
            vec![GripPose { x_m: 0.4, z_m: 0.42, pitch_rad: 0.0 }, GripPose { x_m: 0.5, z_m: 0.4, pitch_rad: 0.1 }];
        let mut path = request(Drive::Grip(GripTrajectory::new(vec![0.0, 1.0], poses).unwrap()), 4);
        path.frame_times_s = vec![0.0, 0.3, 0.5, 0.9, 1.2];
        let acted = request(Drive::Actions(vec![[0.03, -0.04]; 4]), 4);
        for request in [path, acted] {
            let whole = BeamSimulator::new(&soft_bar(), 1).unwrap().simulate(&request).unwrap();
            assert!(whole.iter().all(|t| t.frames.len() == 5));
            // Episode k of the first three ends after k + 1 frames; the fourth goes to its end.
            let until = Until { is_enough: &|place, frames| place < 3 && frames.len() > place, number: 1 };
            for workers in [1, 2] {
                let simulator = BeamSimulator::new(&soft_bar(), workers).unwrap();
                let tracks = simulator.simulate_until(&request, until).unwrap();
                for (place, (track, whole)) in tracks.iter().zip(&whole).enumerate() {
                    let count = if place < 3 { place + 1 } else { 5 };
                    let mut first = whole.frames[..count].to_vec();
                    first[count - 1].action = track.frames[count - 1].action;
                    assert_eq!(track.frames, first, "{place}");
                }
                assert_eq!(
                    simulator.simulate(&request).unwrap(),
                    whole,
                    "on simulations of episodes that ended sooner"
                );
            }
            if let Drive::Actions(actions) = &request.drive {
                let fewer = SimulationRequest { drive: Drive::Actions(actions[..2].to_vec()), ..request.clone() };
                for (track, whole) in
                    BeamSimulator::new(&soft_bar(), 1).unwrap().simulate(&fewer).unwrap().iter().zip(&whole)
                {
                    assert_eq!(track.frames[..2], whole.frames[..2]);
                    assert_eq!(track.frames[2], Frame { action: [0.0; 2], ..whole.frames[2] });
                }
            }
        }
    }

    #[test]
    fn a_still_grip_holds_a_still_object() {
        let mut r = request(still(), 2);
        (r.noise, r.frame_times_s) = (false, vec![0.0, 0.5, 1.0]);
        for track in BeamSimulator::new(&soft_bar(), 2).unwrap().simulate(&r).unwrap() {
            let moved =
                (0..4).map(|k| (track.frames[2].dlo[k][0] - track.frames[0].dlo[k][0]).abs()).fold(0.0, f64::max);
            assert!(moved < 1e-4, "moved by {moved} of half an image");
            assert_eq!(track.end, End::Complete);
        }
    }

    /// An observed wrench changes no bit of the keypoints. At rest it is the weight, at the lever of the bar's centre of mass.
    #[test]
    fn the_wrench_is_an_addition_and_at_rest_the_weight_at_its_lever() {
        let poses =
            vec![GripPose { x_m: 0.4, z_m: 0.9, pitch_rad: 0.0 }, GripPose { x_m: 0.43, z_m: 0.9, pitch_rad: 0.1 }];
        let mut request = request(Drive::Grip(GripTrajectory::new(vec![0.1, 0.4], poses).unwrap()), 2);
        request.thetas = vec![vec![0.25, 5e4]; 2];
        request.frame_times_s = vec![0.0, 0.051, 0.2, 0.333, 0.8];
        let observing = |drives| {
            let mut model = soft_bar();
            model.observation.wrench = drives;
            BeamSimulator::new(&model, 1).unwrap()
        };
        let noise = WrenchNoise { force_sd_n: [1.0, 0.1], torque_sd_n_m: 0.05 };
        let (without, mut with) =
            (observing(None).simulate(&request).unwrap(), observing(Some(noise)).simulate(&request).unwrap());
        assert!(with.iter().flat_map(|t| &t.frames).all(|f| f.wrench.is_some()));
        with.iter_mut().flat_map(|t| &mut t.frames).for_each(|f| f.wrench = None);
        assert_eq!(without, with);
        request.noise = false;
        let exact = observing(Some(noise)).simulate(&request).unwrap().remove(0);
        let [x, z, y] = exact.frames[0].wrench.unwrap();
        let weight_n = 9.81 * 1055.0 * 0.015 * 0.015 * 0.25;
        assert!(x.abs() < 1e-6 && (z + weight_n).abs() < 1e-3 * weight_n, "{x} {z}, {weight_n}");
        // The bar is gripped at its end and points to +x: its weight turns the hand about +y, by less than at half the length, as it sags.
        assert!(y > 0.2 * weight_n * 0.125 && y < weight_n * 0.125, "{y}");
    }

    #[test]
    fn a_shape_at_rest_that_is_not_found_is_counted() {
        let mut r = request(still(), 3);
        (r.noise, r.frame_times_s) = (false, vec![0.0]);
        // A bar of 10 m and 10 Pa, as heavy as lead, does not come to rest within the rounds of the descent.
        let mut model = soft_bar();
        model.parameters.insert("density_kg_m3".into(), 1.1e4);
        r.thetas[1] = vec![10.0, 10.0];
        let simulator = BeamSimulator::new(&model, 1).unwrap();
        simulator.simulate(&r).unwrap();
        assert_eq!(simulator.unconverged_equilibria(), 1, "one of the three is 10 m long and as soft as foam");
    }

    #[test]
    fn noise_has_the_model_s_standard_deviation() {
        let mut r = request(still(), 200);
        r.thetas = vec![vec![0.25, 2e4]; 200];
        r.frame_times_s = vec![0.0];
        r.effects = vec![("kelvin_voigt_time_s".into(), vec![0.02; 200]), ("table_friction".into(), vec![0.5; 200])];
        let mut model = soft_bar();
        model.camera.position_jitter_m = 0.0;
        let tracks = BeamSimulator::new(&model, 2).unwrap().simulate(&r).unwrap();
        let u: Vec<f64> = tracks.iter().map(|t| 128.0 * t.frames[0].dlo[1][0]).collect();
        let mean = u.iter().sum::<f64>() / 200.0;
        let sd = (u.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 199.0).sqrt();
        // The standard deviation of 200 draws is known to within 5 %.
        assert!((sd - model.camera.keypoint_noise_px).abs() < 0.12, "{sd} px");
    }

    #[test]
    fn the_range_of_a_parameter_or_an_effect_is_that_of_the_catalogue() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let of = |name| Simulator::range_of(&simulator, name);
        assert_eq!((of("length_m"), of("tip_mass")), (Some([0.01, 10.0]), None));
        assert_eq!(of("kelvin_voigt_time_s").map(|[low, _]| low), Some(0.0), "an effect");
    }

    #[test]
    fn requests_that_do_not_fit_the_model_are_refused_by_field() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let message = |change: fn(&mut SimulationRequest)| {
            let mut r = request(still(), 2);
            change(&mut r);
            simulator.simulate(&r).unwrap_err().to_string()
        };
        assert!(message(|r| r.thetas[0].clear()).contains("theta"));
        assert!(message(|r| r.frame_times_s = vec![0.1, 0.1]).contains("frame_times"));
        assert!(message(|r| r.frame_times_s = vec![0.0, 1e12]).contains("3600 s, got 1000000000000 s at place 1"));
        assert!(message(|r| r.frame_times_s = vec![f64::NAN]).contains("frame_times"));
        assert!(message(|r| r.effects = vec![("tip_mass_kg".into(), vec![])]).contains("tip_mass_kg"));
        assert!(message(|r| r.thetas[1][1] = -1.0).contains("youngs_modulus_pa"));
        assert!(message(|r| r.drive = Drive::Actions(vec![[0.0; 2], [f64::NAN, 0.0]])).contains("at step 1"));
        let no_task = BeamSimulator::new(&cable(), 1).unwrap();
        let mut r = request(Drive::Actions(vec![[0.0; 2]]), 1);
        r.thetas = vec![vec![0.1, 0.02, 0.0, 0.5, 0.05, 1.0, 0.0]];
        assert!(no_task.simulate(&r).unwrap_err().to_string().contains("task"));
    }
}
