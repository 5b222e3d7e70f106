//! Searches with a stated noise that the recordings contradict.
#![allow(clippy::unwrap_used, reason = "a test")]

use catenary_core::camera::HALF_MASK_PX;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::{Fidelity, Frame, GripPose, GripTrajectory, Model, Track, seed};
use catenary_simulator::{BeamSimulator, Registry};
use effect_finder::{Finding, Question, Settings, Verdict, find};
use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::ops::ControlFlow;

/// Chain of links that cannot stretch and do not resist bending, with a mass at the end of each.
const LINKS: usize = 24;
const LENGTH_M: f64 = 0.24;
/// Damping of each angle by its difference to the next ones, 1/s. It ends the rattling of the last link.
const DAMPING: f64 = 4.0;
const STEPS_PER_S: usize = 2400;
const STEP_S: f64 = 1.0 / STEPS_PER_S as f64;
const GRAVITY_M_S2: f64 = 9.81;
const DURATION_S: f64 = 1.5;

/// Noise of the recordings, px.
const NOISE_PX: f64 = 0.2;

/// Place of the hand, x and z in m.
fn hand(time_s: f64) -> [f64; 2] {
    [0.40 + 0.04 * (1.0 - (TAU * time_s).cos()), 0.42 - 0.02 * (1.0 - (TAU * time_s / 1.5).cos())]
}

/// Acceleration of the hand, m/s^2.
fn pull(time_s: f64) -> [f64; 2] {
    [0.04 * TAU.powi(2) * (TAU * time_s).cos(), -0.02 * (TAU / 1.5).powi(2) * (TAU * time_s / 1.5).cos()]
}

/// Angular accelerations of the links, by Lagrange's equations of the second kind. Angles are from the vertical.
fn acceleration(time_s: f64, angle: &DVector<f64>, speed: &DVector<f64>) -> DVector<f64> {
    let link_m = LENGTH_M / LINKS as f64;
    let ([x, z], below) = (pull(time_s), |i: usize| (LINKS - i) as f64);
    let inertia = DMatrix::from_fn(LINKS, LINKS, |i, j| link_m * below(i.max(j)) * (angle[i] - angle[j]).cos());
    let force = DVector::from_fn(LINKS, |i, _| {
        let own = -below(i) * ((GRAVITY_M_S2 + z) * angle[i].sin() + x * angle[i].cos());
        let turns = |j: usize| link_m * below(i.max(j)) * (angle[i] - angle[j]).sin() * speed[j].powi(2);
        let drag = |j: Option<usize>| j.and_then(|j| speed.get(j)).map_or(0.0, |other| speed[i] - other);
        own - (0..LINKS).map(turns).sum::<f64>() - DAMPING * link_m * (drag(i.checked_sub(1)) + drag(Some(i + 1)))
    });
    inertia.cholesky().unwrap().solve(&force)
}

/// Places of the ends of all links in m, the hand first.
fn chain(time_s: f64, angle: &DVector<f64>) -> Vec<[f64; 2]> {
    let link_m = LENGTH_M / LINKS as f64;
    let mut places = vec![hand(time_s)];
    for a in angle.iter() {
        let [x, z] = places[places.len() - 1];
        places.push([x + link_m * a.sin(), z - link_m * a.cos()]);
    }
    places
}

/// Recording of the chain at `rate_hz`, with white noise of [`NOISE_PX`] on the keypoints.
fn recording(model: &Model, rate_hz: usize) -> MeasuredTrack {
    let (mut angle, mut speed) = (DVector::zeros(LINKS), DVector::zeros(LINKS));
    let mut rng = seed::rng(17, 0);
    let mut frames = Vec::new();
    let each = STEPS_PER_S / rate_hz;
    for step in 0..=(DURATION_S / STEP_S).round() as usize {
        let time_s = step as f64 * STEP_S;
        if step % each == 0 {
            let places = chain(time_s, &angle);
            let dlo = model.object.keypoint_fractions.map(|fraction| {
                let at = fraction * LINKS as f64;
                let (first, share) = (at.floor() as usize, at.fract());
                let [x, z] = [0, 1].map(|i| places[first][i] + share * (places[first + 1][i] - places[first][i]));
                let scaled = model.camera.view.scaled_from_world([x, 0.0, z]).unwrap();
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                scaled.map(|v| v + NOISE_PX / HALF_MASK_PX * normal())
            });
            let [x, z] = hand(time_s);
            frames.push(Frame { time_s, dlo, target: [0.0; 2], eef: [x, z, 0.0], action: [0.0; 2], wrench: None });
        }
        // Midpoint rule.
        let middle = acceleration(time_s, &angle, &speed);
        let (half_angle, half_speed) = (&angle + &speed * (0.5 * STEP_S), &speed + middle * (0.5 * STEP_S));
        let whole = acceleration(time_s + 0.5 * STEP_S, &half_angle, &half_speed);
        angle += half_speed * STEP_S;
        speed += whole * STEP_S;
    }
    let times: Vec<f64> = (0..=160).map(|i| 0.01 * f64::from(i)).collect();
    let pose = |t: &f64| {
        let [x_m, z_m] = hand(*t);
        GripPose { x_m, z_m, pitch_rad: 0.0 }
    };
    let grip = GripTrajectory::new(times.clone(), times.iter().map(pose).collect()).unwrap();
    MeasuredTrack {
        name: "chain".into(),
        track: Track { frames, end: End::Complete },
        grip,
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m: None,
        warnings: Vec::new(),
    }
}

fn model(stated_px: f64) -> Model {
    let mut model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar_place.yaml")).unwrap();
    model.camera.keypoint_noise_px = stated_px;
    model
}

fn found(model: &Model, measured: &[MeasuredTrack]) -> Finding {
    let settings = Settings {
        null_sets: 19,
        draws: 100,
        starts: 3,
        seed: 4,
        fidelity: Fidelity::Fast,
        finer_fidelity: None,
        ..Settings::default()
    };
    let simulator = BeamSimulator::with_effects(model, &Registry::complete(), 2).unwrap();
    find(Question::of(model, measured), &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding
}

#[test]
fn a_chain_is_no_bar_however_much_noise_is_stated() {
    let at = |stated_px: f64, rate_hz: usize| {
        let model = model(stated_px);
        found(&model, &[recording(&model, rate_hz)])
    };
    let right = at(NOISE_PX, 20);
    assert_eq!((right.verdict, right.noise_doubt), (Verdict::NoneOfThese, None), "{:?}", right.conclusions);
    // At 60 Hz the recording shows its noise; without that the bar would explain the chain with p = 1.
    let fast = at(25.0 * NOISE_PX, 60);
    let noise = fast.noise.unwrap();
    assert!((NOISE_PX..1.3 * NOISE_PX).contains(&noise.used_px) && !noise.is_unknown, "{noise:?}");
    assert!(![Verdict::NoGap, Verdict::CannotSee].contains(&fast.verdict), "{:?}", fast.conclusions);
    assert!(fast.noise_doubt.unwrap().starts_with("the model file states 5.00 px of keypoint noise"));
    // At 20 Hz the swing is too fast to tell noise from it.
    let slow = at(25.0 * NOISE_PX, 20);
    assert_eq!(slow.verdict, Verdict::CannotSee, "{:?}", slow.conclusions);
    assert!(slow.noise.is_some_and(|noise| noise.is_unknown && !noise.is_overruled()), "{:?}", slow.noise);
    assert!(slow.present.test.p_value > 0.9, "the stated noise hides all of it");
    let hidden_mm = slow.hidden_gap_mm.unwrap();
    assert!(hidden_mm > slow.present.rmse_mm, "{hidden_mm} mm, and the bar is {} mm off", slow.present.rmse_mm);
    let told = slow.conclusions.iter().any(|s| s.starts_with("cannot see: a gap of up to "));
    assert!(told, "{:?}", slow.conclusions);
}
