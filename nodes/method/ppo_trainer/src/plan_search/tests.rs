//! Search on a task whose best plan is known.

use super::*;
use catenary_core::simulator::StartShape;
use catenary_core::task::MAX_DELTA_M;
use catenary_core::track::End;
use catenary_core::{Fidelity, Frame};

/// Simulator of a hand that carries a point at a distance `theta` to its right: four keypoints at the hand, at a third, at two thirds and there.
/// The target of an episode depends on its number.
struct Stick(Model);

impl Simulator for Stick {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let Drive::Policy(policy) = &request.drive else { unreachable!("a search drives by a policy") };
        let (task, view) = (self.0.task.unwrap(), self.0.camera.view);
        let seen = |[x, z]: [f64; 2]| view.scaled_from_world([x, 0.0, z]).unwrap();
        let episode = |(number, theta): (usize, &Vec<f64>)| {
            // Two episodes have each target.
            let n = ((request.first_episode as usize + number) / 2) as f64;
            let shift_m = task.target_jitter_m.min(0.01);
            let target = [task.target_m[0] + shift_m * (1.7 * n).sin(), task.target_m[1] + shift_m * (2.9 * n).cos()];
            let target = seen(target);
            let mut memory = catenary_core::policy::Memory::default();
            let mut at = [self.0.arm.start.x_m, self.0.arm.start.z_m];
            let mut frames: Vec<Frame> = Vec::new();
            for step in 0..=task.steps {
                let dlo = [0.0, 1.0, 2.0, 3.0].map(|share| seen([at[0] + theta[0] * share / 3.0, at[1]]));
                let time_s = step as f64 * task.step_period_s;
                frames.push(Frame { time_s, dlo, target, eef: [at[0], at[1], 0.0], action: [0.0; 2], wrench: None });
                if step < task.steps {
                    let observation = Observation::new(at, &dlo, target);
                    let action = policy.act(&observation, &mut memory);
                    at = [at[0] + action[0], at[1] + action[1]];
                }
            }
            let end = if task.allows(at) { End::StepLimit } else { End::LeftWorkspace };
            Track { frames, end }
        };
        Ok(request.thetas.iter().enumerate().map(episode).collect())
    }
}

fn model() -> Model {
    let text = include_str!("../../../../../launch_configs/models/soft_bar_place.yaml");
    Model::from_yaml(text).unwrap()
}

fn request(thetas: Vec<Vec<f64>>) -> SimulationRequest {
    SimulationRequest {
        thetas,
        effects: Vec::new(),
        drive: Drive::Actions(Vec::new()),
        start: StartShape::HangingAtRest,
        frame_times_s: Vec::new(),
        target_m: None,
        fidelity: Fidelity::Fast,
        seed: 1,
        first_episode: 0,
        noise: false,
    }
}

fn planned(thetas: Vec<Vec<f64>>) -> Planned {
    planned_for(model(), thetas)
}

fn planned_for(model: Model, thetas: Vec<Vec<f64>>) -> Planned {
    let mut shares: Vec<f64> = Vec::new();
    let found = search(&Stick(model.clone()), &model, &request(thetas), 3, &mut |share| {
        shares.push(share);
        ControlFlow::Continue(())
    });
    assert!(shares.is_sorted() && shares.iter().all(|s| (0.0..1.0).contains(s)), "{shares:?}");
    found.unwrap().unwrap()
}

#[test]
fn a_plan_meets_every_target_where_one_exists() {
    let model = model();
    let found = planned(vec![vec![0.2]; 16]);
    assert!(found.distance_m < 1e-3, "{found:?}");
    // Also targets that the search has not seen.
    let drive = Drive::Policy(Box::new(found.policy(&Judge::of(&model).unwrap())));
    let others = SimulationRequest { drive, first_episode: 100, ..request(vec![vec![0.2]; 50]) };
    let judge = Judge::of(&model).unwrap();
    for track in Stick(model).simulate(&others).unwrap() {
        let score = judge.score(&track);
        assert!(score.succeeded && score.distance_m < 6e-3, "{score:?}");
        let longest = track.frames.windows(2).map(|f| (f[1].eef[0] - f[0].eef[0]).abs()).fold(0.0, f64::max);
        assert!(longest <= MAX_DELTA_M + 1e-9 && track.end != End::LeftWorkspace);
    }
}

#[test]
fn a_plan_for_objects_that_differ_lies_between_them() {
    // Two lengths, 40 mm apart: no plan is nearer than 20 mm to both.
    let thetas = (0..16).map(|i| vec![0.18 + 0.04 * f64::from(i % 2)]).collect();
    let found = planned(thetas);
    assert!((0.019..0.024).contains(&found.distance_m), "{found:?}");
}

/// No episode tells how to follow a target that stands still, and an unseen one has it a little elsewhere, by the noise of the camera.
#[test]
fn a_plan_for_one_target_does_not_follow_it() {
    let mut model = model();
    model.task.as_mut().unwrap().target_jitter_m = 0.0;
    let found = planned_for(model, vec![vec![0.2]; 16]);
    assert!(found.distance_m < 1e-3, "{found:?}");
    assert!(found.plan.steps.iter().flatten().all(|[_, by_x, by_y]| *by_x == 0.0 && *by_y == 0.0), "{found:?}");
}

#[test]
fn a_search_ends_when_it_is_told_to_and_needs_an_episode_and_a_task() {
    let model = model();
    let simulator = Stick(model.clone());
    let one = request(vec![vec![0.2]]);
    assert_eq!(search(&simulator, &model, &one, 3, &mut |_| ControlFlow::Break(())).unwrap(), None);
    let ask = |model: &Model, request: &SimulationRequest| {
        search(&simulator, model, request, 3, &mut |_| ControlFlow::Continue(())).unwrap_err().to_string()
    };
    assert!(ask(&model, &request(Vec::new())).contains("at least one episode"));
    assert!(ask(&Model { task: None, ..model.clone() }, &one).contains("has no task"));
}
