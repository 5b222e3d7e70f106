//! Truths outside of the prior's support.

use super::linear_gaussian::{FRAMES, LinearGaussian};
use super::*;
use crate::InferenceResult;
use crate::prior_support::{PriorSupport, SupportRule};
use catenary_core::episode::MeasuredTrack;
use catenary_core::posterior::Marginal;
use catenary_core::{GripTrajectory, Model};

/// Toy with exact standard deviations of 0.02 to 0.03.
const TOY: LinearGaussian = LinearGaussian { dimension: 2, noise: 0.03, mirrored: 0.0, rigid: false };

/// Toy with physical limits of its first parameter. Those of the second one are zero and one, the edges of its prior.
struct Limited([f64; 2]);

impl Simulator for Limited {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let [low, high] = self.0;
        let are_within = request.thetas.iter().all(|t| (low..=high).contains(&t[0]) && (0.0..=1.0).contains(&t[1]));
        assert!(are_within, "beyond the physical limits: {:?}", request.thetas);
        TOY.simulate(request)
    }

    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        Some(if name == "theta_0" { self.0 } else { [0.0, 1.0] })
    }
}

fn settings(prior_support: PriorSupport, seed: u64) -> Settings {
    Settings { iterations: 6, ensemble: 2, prior_support, seed, ..Settings::default() }
}

/// Result of an inference of `truth`: marginals, moves, states and the support of the last iteration.
struct Run {
    marginals: Vec<Marginal>,
    moves: Vec<SupportMove>,
    states: Vec<State>,
    space: ParameterSpace,
}

fn infer(truth: [f64; 2], limits: [f64; 2], settings: &Settings, from: Option<State>) -> Run {
    let (space, observed) = (TOY.space(), TOY.track(&truth, seed::derive(95, settings.seed)));
    let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), settings, 7).unwrap();
    if let Some(state) = from {
        sequential.resume(state).unwrap();
    }
    let mut states = Vec::new();
    while sequential.state().iterations().len() < settings.iterations {
        sequential.step(&Limited(limits), &mut |_| ControlFlow::Continue(())).unwrap();
        states.push(sequential.state().clone());
    }
    let iterations = sequential.state().iterations();
    Run {
        marginals: sequential.posterior().unwrap().marginals().unwrap(),
        moves: iterations.iter().flat_map(|i| i.moves.clone()).collect(),
        states,
        space: sequential.space().clone(),
    }
}

#[test]
fn the_support_reaches_a_truth_outside_of_it() {
    for (seed, truth) in [(1, [1.4, 0.5]), (2, [-0.3, 0.6])] {
        let run = |support| infer(truth, [-5.0, 5.0], &settings(support, seed), None);
        let (fixed, adaptive) = (run(PriorSupport::Fixed), run(PriorSupport::ADAPTIVE));
        assert_eq!((fixed.moves.len(), &fixed.space), (0, &TOY.space()));
        let off = |run: &Run| (run.marginals[0].mean - truth[0]).abs();
        assert!(off(&fixed) > 0.25, "{:?}", fixed.marginals);
        assert!(off(&adaptive) < 0.2, "{:?} after {:?}", adaptive.marginals, adaptive.moves);
        let interval = adaptive.marginals[0].q05..=adaptive.marginals[0].q95;
        assert!(interval.contains(&truth[0]), "{:?}", adaptive.marginals);
        assert!(adaptive.space.parameters()[0].prior.holds(truth[0]), "{:?}", adaptive.space);
        // The second parameter's edges are physical.
        assert!(adaptive.moves.iter().all(|m| m.parameter == "theta_0" && m.iteration <= 4), "{:?}", adaptive.moves);
        assert_eq!(adaptive.space.parameters()[1], TOY.space().parameters()[1]);
    }
}

#[test]
fn the_support_stays_at_a_physical_edge_and_about_a_truth_inside() {
    let limited = infer([1.4, 0.5], [0.0, 1.0], &settings(PriorSupport::ADAPTIVE, 1), None);
    assert!(limited.moves.is_empty() && limited.space == TOY.space(), "{:?}", limited.moves);
    // The posterior presses on the upper edge, which may move by a little only.
    let short = infer([1.4, 0.5], [0.0, 1.1], &settings(PriorSupport::ADAPTIVE, 1), None);
    assert_eq!(short.moves.len(), 1, "{:?}", short.moves);
    assert_eq!(short.space.parameters()[0].prior.bounds(), (0.0, 1.1));
    let inside = infer([0.5, 0.5], [-5.0, 5.0], &settings(PriorSupport::ADAPTIVE, 3), None);
    assert!(inside.moves.is_empty(), "{:?}", inside.moves);
    // Without moves, the posterior is that of the fixed support, to the bit.
    let fixed = infer([0.5, 0.5], [-5.0, 5.0], &settings(PriorSupport::Fixed, 3), None);
    assert_eq!(inside.marginals, fixed.marginals);
    let text = serde_json::to_string(&fixed.states[2]).unwrap();
    assert!(!text.contains("supports") && !text.contains("moves"), "a fixed support leaves no trace in the state");
}

#[test]
fn an_inference_whose_support_moved_continues_with_the_same_bits() {
    for rule in SupportRule::ALL {
        let settings = Settings { iterations: 4, ..settings(PriorSupport::Adaptive(rule), 1) };
        let whole = infer([1.3, 0.5], [-5.0, 5.0], &settings, None);
        assert!(!whole.moves.is_empty(), "{rule:?}");
        for made in [1, 2] {
            let read: State = serde_json::from_str(&serde_json::to_string(&whole.states[made - 1]).unwrap()).unwrap();
            let rest = infer([1.3, 0.5], [-5.0, 5.0], &settings, Some(read));
            assert_eq!(rest.states, whole.states[made..], "{rule:?} from iteration {made}");
        }
    }
}

#[test]
fn a_state_with_supports_of_other_parameters_is_refused() {
    let settings = Settings { iterations: 3, prior_support: PriorSupport::ADAPTIVE, ..quick() };
    let state = infer([1.3, 0.5], [-5.0, 5.0], &settings, None).states.remove(1);
    let refusal = |change: &dyn Fn(&mut serde_json::Value), settings: &Settings| {
        let mut value = serde_json::to_value(&state).unwrap();
        change(&mut value);
        let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
        let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), settings, 7).unwrap();
        sequential.resume(serde_json::from_value(value).unwrap()).unwrap_err().to_string()
    };
    let other = |v: &mut serde_json::Value| v["supports"][0][0]["name"] = "mass_kg".into();
    assert_eq!(
        refusal(&other, &settings),
        "supports: expected 2 with the parameters of the model, got 2 for 2 iterations"
    );
    let fewer = |v: &mut serde_json::Value| drop(v["supports"].as_array_mut().unwrap().pop());
    assert!(refusal(&fewer, &settings).starts_with("supports: expected 2 "));
    let fixed = Settings { prior_support: PriorSupport::Fixed, ..settings.clone() };
    assert!(refusal(&|_| (), &fixed).starts_with("supports: expected 0 "));
}

/// Toy over the unit coordinates of a model's parameters.
struct Mapped<'a>(&'a Model);

impl Simulator for Mapped<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let thetas = request.thetas.iter().map(|t| self.0.theta.to_unit(t)).collect();
        TOY.simulate(&SimulationRequest { thetas, ..request.clone() })
    }

    fn range_of(&self, _name: &str) -> Option<[f64; 2]> {
        Some([1e-3, 1e9])
    }
}

#[test]
fn a_user_hears_of_a_pressed_edge_or_of_the_moves_of_the_support() {
    let model = Model::from_yaml(include_str!("../../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    let measured = MeasuredTrack {
        name: "toy episode".into(),
        track: TOY.track(&[1.2, 0.5], 5),
        grip: GripTrajectory::new(vec![0.0, 1.0], vec![Default::default(); 2]).unwrap(),
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m: None,
        warnings: Vec::new(),
    };
    let infer = |prior_support| {
        let settings = Settings { predictive_draws: 0, ..settings(prior_support, 1) };
        let observed = std::slice::from_ref(&measured);
        let listen = &mut |_: &Progress<'_>| ControlFlow::Continue(());
        crate::infer(&model, observed, None, &settings, None, &Mapped(&model), listen).unwrap()
    };
    let says = |result: &InferenceResult, words: &str| {
        let is_said = result.warnings.iter().any(|w| w.starts_with("length_m: ") && w.contains(words));
        assert!(is_said, "{words:?}: {:?} at {:?}", result.warnings, result.marginals);
    };
    let fixed = infer(PriorSupport::Fixed);
    assert_eq!((fixed.support_moves(), &fixed.posterior.parameters), (Vec::new(), &model.theta));
    says(&fixed, "upper bound 0.305: the prior may be too narrow");
    says(&fixed, "with prior_support adaptive");
    let adaptive = infer(PriorSupport::ADAPTIVE);
    says(&adaptive, "the prior's support moved from [0.195, 0.305]: after iteration ");
    let (moves, used) = (adaptive.support_moves(), adaptive.posterior.parameters.parameters());
    assert_eq!(Some(used[0].prior.bounds().1), moves.last().map(|m| m.to[1]), "{moves:?}");
}
