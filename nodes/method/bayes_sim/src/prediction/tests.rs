//! Predictions in linear worlds, whose posteriors are known.

use super::*;
use crate::widening::Widening;
use catenary_core::camera::{Camera, Plane};
use catenary_core::grip::GripPose;
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::{Drive, Frame, GripTrajectory, Mixture, SimulationRequest, SimulatorError};
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use track_fit::toy;

const FRAMES: usize = 20;
const NOISE_M: f64 = 0.004;
/// Standard deviation of the displacement of an episode's picture.
const SHIFT_M: f64 = 0.003;
/// Motion by the first parameter over its prior, in every recording.
const FIRST_M: f64 = 0.05;
/// Motion by the second parameter, in recordings whose grip is at 1 m; none where it is at 0.
const SECOND_M: f64 = 0.2;

/// World with two parameters. Where the grip is at 1 m, keypoints move by the second parameter, and by `lacking_m`
/// that no model has.
struct World {
    lacking_m: f64,
}

/// Wave of parameter `p` in frame `i` at keypoint `k`.
fn wave(p: usize, i: usize, k: usize) -> f64 {
    (0.35 * i as f64 + 1.7 * p as f64).sin() * (k as f64 + 1.0) / 4.0
}

impl World {
    /// Track at unit coordinates `u` with the grip at `grip_m`; random numbers for what is drawn anew, none for no noise.
    fn track(&self, u: [f64; 2], grip_m: f64, mut rng: Option<&mut ChaCha8Rng>) -> Track {
        let mut normal = |sd: f64| rng.as_mut().map_or(0.0, |rng| sd * rng.sample::<f64, _>(StandardNormal));
        let shift_m = normal(SHIFT_M);
        let mut frame = |i: usize| {
            let dlo = std::array::from_fn(|k| {
                let second_m =
                    SECOND_M * u[1] * wave(1, i, k) + self.lacking_m * (0.8 * i as f64).cos() * (k as f64 + 1.0) / 4.0;
                let x_m = FIRST_M * u[0] * wave(0, i, k) + grip_m * second_m + shift_m + normal(NOISE_M);
                [x_m, 0.1 * (k as f64 + 1.0) + shift_m + normal(NOISE_M)]
            });
            Frame {
                time_s: 0.1 * i as f64,
                dlo,
                target: [0.0; 2],
                eef: [grip_m, 0.0, 0.0],
                action: [0.0; 2],
                wrench: None,
            }
        };
        Track { frames: (0..FRAMES).map(&mut frame).collect(), end: End::Complete }
    }

    fn measured(&self, u: [f64; 2], grip_m: f64, rng: &mut ChaCha8Rng) -> MeasuredTrack {
        let at = GripPose { x_m: grip_m, ..GripPose::default() };
        MeasuredTrack {
            name: "toy episode".into(),
            track: self.track(u, grip_m, Some(rng)),
            grip: GripTrajectory::new(vec![0.0, 5.0], vec![at; 2]).unwrap(),
            actions: Vec::new(),
            start: StartShape::HangingAtRest,
            target_m: None,
            warnings: Vec::new(),
        }
    }
}

/// Simulator of a world in which nothing is lacking.
struct Simulated(Model);

impl Simulator for Simulated {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let Drive::Grip(path) = &request.drive else { panic!("a path drives the toy") };
        let of = |(i, theta): (usize, &Vec<f64>)| {
            let u = self.0.theta.to_unit(theta);
            let mut rng = seed::rng(request.seed, request.first_episode + i as u64);
            World { lacking_m: 0.0 }.track([u[0], u[1]], path.at(0.0).x_m, request.noise.then_some(&mut rng))
        };
        Ok(request.thetas.iter().enumerate().map(of).collect())
    }
}

fn model() -> Model {
    let mut model = toy::model();
    model.camera.view = Camera::Plane(Plane { centre_m: [0.0; 2], side_m: 2.0, roll_rad: 0.0, distortion_k1: 0.0 });
    model.camera.keypoint_noise_px = NOISE_M * HALF_MASK_PX;
    model
}

/// Posterior of the first parameter from a recording with the grip at 0, mean and variance: the recording is linear in the
/// parameter and in the episode's displacement.
fn first_parameter(measured: &Track) -> [f64; 2] {
    let weight = NOISE_M.powi(-2);
    let [mut a, mut b, mut c] = [0.0, 0.0, SHIFT_M.powi(-2)];
    let mut right = [0.0; 2];
    for (i, frame) in measured.frames.iter().enumerate() {
        for (k, [x, y]) in frame.dlo.iter().enumerate() {
            let (slope, still) = (FIRST_M * wave(0, i, k), y - 0.1 * (k as f64 + 1.0));
            (a, b, c) = (a + weight * slope * slope, b + weight * slope, c + 2.0 * weight);
            right = [right[0] + weight * slope * x, right[1] + weight * (x + still)];
        }
    }
    let determinant = a * c - b * b;
    [(c * right[0] - b * right[1]) / determinant, c / determinant]
}

/// Result with a Gaussian posterior of these means and variances in unit coordinates.
fn inferred(mean: [f64; 2], variances: [f64; 2]) -> InferenceResult {
    let covariance = DMatrix::from_diagonal(&DVector::from_row_slice(&variances));
    let mixture = Mixture::new(&[1.0], vec![DVector::from_row_slice(&mean)], vec![covariance]).unwrap();
    let posterior = Posterior::new(model().theta, mixture).unwrap();
    InferenceResult {
        marginals: posterior.marginals().unwrap(),
        posterior,
        widening: Widening::default(),
        iterations: Vec::new(),
        mass_outside: 0.0,
        refinement: None,
        predictive: None,
        misfit: None,
        warnings: Vec::new(),
    }
}

/// Variance of a Gaussian that is nearly flat over a unit interval.
const FLAT: f64 = 4.0;

fn predicted(inferred: &InferenceResult, unseen: &MeasuredTrack, seed: u64) -> Prediction {
    let (model, settings) = (model(), Settings { seed, ..Settings::default() });
    let unseen = Unseen::new(&model, unseen, &[], None).unwrap();
    unseen.predicted(&model, (inferred, &settings), 0, &Simulated(model.clone()), &mut || Ok(())).unwrap()
}

/// Prediction of a recording with the grip at `grip_m` from the posterior of one with the grip at 0.
fn world(seed: u64, grip_m: f64, lacking_m: f64) -> Prediction {
    let mut rng = seed::rng(seed, 0);
    let (u, world) = ([rng.random_range(0.3..0.7), rng.random_range(0.0..1.0)], World { lacking_m });
    let seen = world.measured(u, 0.0, &mut rng);
    let [mean, variance] = first_parameter(&seen.track);
    let unseen = world.measured(u, grip_m, &mut rng);
    predicted(&inferred([mean, 0.5], [variance, FLAT]), &unseen, seed)
}

/// In 150 right worlds, bands hold what they say: the mean coverage scatters by 0.005. At most 2 % of right predictions are
/// called overconfident; more than 10 of 150 come with a probability of 0.03 %.
#[test]
fn predictions_of_a_right_model_hold_the_nominal_coverage() {
    for grip_m in [0.0, 1.0] {
        let all: Vec<Prediction> = (0..150).map(|seed| world(seed, grip_m, 0.0)).collect();
        let mean = |of: &dyn Fn(&Prediction) -> f64| all.iter().map(of).sum::<f64>() / 150.0;
        let (wide, half) = (mean(&|p| p.figures.coverage), mean(&|p| p.bands.coverage_50));
        assert!((wide - 0.9).abs() < 0.025 && (half - 0.5).abs() < 0.05, "{grip_m}: {wide} {half}");
        let alarms = all.iter().filter(|p| p.is_overconfident() || p.figures.is_improbable()).count();
        assert!(alarms <= 10, "{grip_m}: {alarms} of 150");
    }
}

#[test]
fn a_motion_that_the_model_lacks_gets_a_warning() {
    let all: Vec<Prediction> = (0..40).map(|seed| world(seed, 1.0, 0.2)).collect();
    let found = all.iter().filter(|p| p.is_overconfident()).count();
    assert!(found >= 38, "{found} of 40");
    let warning = &all.iter().find(|p| p.is_overconfident()).unwrap().warnings[0];
    for words in ["% of the unseen motion", "did not determine (youngs_modulus_pa)", "do not trust its certainty"] {
        assert!(warning.contains(words), "{words}: {warning}");
    }
}

/// A posterior that is sharp at the wrong place, in a motion that the fitted recording does not show.
#[test]
fn a_falsely_certain_posterior_gets_a_warning() {
    let mut rng = seed::rng(1, 0);
    let unseen = World { lacking_m: 0.0 }.measured([0.5, 0.9], 1.0, &mut rng);
    let certain = predicted(&inferred([0.5, 0.2], [1e-4, 1e-4]), &unseen, 1);
    assert!(certain.is_overconfident() && !certain.is_open(), "{certain:?}");
    let warning = &certain.warnings[0];
    assert!(warning.contains("narrower than the prior in every parameter"), "{warning}");
    let right = predicted(&inferred([0.5, 0.9], [1e-4, 1e-4]), &unseen, 1);
    assert_eq!(right.warnings, Vec::<String>::new(), "{right:?}");
}

#[test]
fn a_motion_that_the_recording_leaves_open_is_called_so() {
    let open = world(3, 1.0, 0.0);
    assert!(open.is_open() && open.undetermined == ["youngs_modulus_pa"], "{open:?}");
    let warning = &open.warnings[0];
    assert!(warning.contains("does not determine this motion"), "{warning}");
    assert!(warning.contains("youngs_modulus_pa, as wide as its prior") && !warning.contains("length_m"), "{warning}");
    // The second parameter is as open, and does not move a recording with the grip at 0.
    let told = world(3, 0.0, 0.0);
    assert!(told.warnings.is_empty() && told.undetermined == ["youngs_modulus_pa"], "{told:?}");
    assert!((told.noise_half_width_mm / (1.645 * 1e3 * NOISE_M) - 1.0).abs() < 0.1, "{told:?}");
}

#[test]
fn shares_are_those_of_the_sources() {
    let prediction = world(5, 1.0, 0.0);
    // Mean square of a wave over frames and keypoints; half of the coordinates move.
    let square = |p: usize| {
        let waves = (0..FRAMES).flat_map(|i| (0..4).map(move |k| wave(p, i, k).powi(2)));
        waves.sum::<f64>() / (4 * FRAMES) as f64
    };
    // A uniform coordinate has a variance of a twelfth.
    let parameters = 0.5 * SECOND_M.powi(2) / 12.0 * square(1);
    let total = parameters + SHIFT_M.powi(2) + NOISE_M.powi(2);
    let Shares { parameters: own, episode, noise, by_parameter } = &prediction.shares;
    for (found, expected) in [(own, parameters), (episode, SHIFT_M.powi(2)), (noise, NOISE_M.powi(2))] {
        assert!((found - expected / total).abs() < 0.08, "{:?} {}", prediction.shares, expected / total);
    }
    assert!(by_parameter[0] < 0.1 && by_parameter[1] > 0.8, "{by_parameter:?}");
}

#[test]
fn noise_that_the_fit_left_widens_the_bands() {
    let mut rng = seed::rng(2, 0);
    let unseen = World { lacking_m: 0.0 }.measured([0.5, 0.5], 0.0, &mut rng);
    let mut tracks = vec![unseen.track.clone(); 50];
    add_noise(&mut tracks, 0.02, 7);
    let off: Vec<f64> = tracks.iter().map(|t| t.frames[0].dlo[0][0] - unseen.track.frames[0].dlo[0][0]).collect();
    let sd = catenary_core::statistics::sd(&off);
    assert!((0.014..0.027).contains(&sd), "{sd}");
}

#[test]
fn a_recording_of_the_inference_and_one_out_of_view_are_refused() {
    let (model, mut rng) = (model(), seed::rng(4, 0));
    let mut measured = World { lacking_m: 0.0 }.measured([0.5; 2], 0.0, &mut rng);
    let seen = [measured.clone()];
    let refused = |measured: &MeasuredTrack| Unseen::new(&model, measured, &seen, None).unwrap_err().to_string();
    assert!(refused(&measured).contains("expected a recording that the inference does not see"));
    measured.track.frames.iter_mut().for_each(|f| f.dlo = [[9.0; 2]; 4]);
    assert!(refused(&measured).contains("outside of it"));
}
