//! Effects added from outside this crate, one for each hook, as a lab would add its own.
#![allow(clippy::unwrap_used, reason = "a test")]

use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripPose, GripTrajectory, Model, Prior, SimulationRequest, Simulator, Track};
use catenary_simulator::beam::{
    ElementMaterial, ElementPlace, ForceTerm, GripReaction, GripState, GripTerm, MaterialTerm, PointState,
};
use catenary_simulator::effects::{About, Effect, Hook};
use catenary_simulator::episode_model::{ActuationTerm, ObservationTerm};
use catenary_simulator::{BeamSimulator, EpisodeModel, Registry};
use std::sync::Arc;

/// Effect whose work is done by `terms`.
struct Own {
    name: &'static str,
    hook: Hook,
    terms: fn(f64, &mut EpisodeModel),
}

impl Effect for Own {
    fn about(&self) -> About {
        About {
            name: self.name,
            title: self.name,
            description: "an effect of the test's own",
            unit: "1",
            hook: self.hook,
            prior: Prior::Uniform { low: -1.0, high: 1.0 },
            range: [-10.0, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        (self.terms)(magnitude, episode);
        Ok(())
    }
}

/// Steady wind along x.
pub struct SideWind;

/// Force of the wind per length of the object in N/m.
struct Push(f64);

impl ForceTerm for Push {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        [self.0 * at.length_m, 0.0]
    }
}

impl Effect for SideWind {
    fn about(&self) -> About {
        About {
            name: "side_wind_n_m",
            title: "side wind",
            description: "steady force along x per length of the object",
            unit: "N/m",
            hook: Hook::Force,
            prior: Prior::Uniform { low: -0.5, high: 0.5 },
            range: [-10.0, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.forces.push(Arc::new(Push(magnitude)));
        Ok(())
    }
}

/// Joint at the middle of the object: the bending stiffness is less by this share.
struct Joint(f64);
impl MaterialTerm for Joint {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if (0.45..0.55).contains(&place.middle()) {
            element.stiffness[2] *= 1.0 - self.0;
        }
    }
}

/// A grip that turns with time, in rad/s.
struct Turning(f64);
impl GripTerm for Turning {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad += self.0 * time_s;
    }
}

/// Gain error of the targets, as a share of x.
struct Gain(f64);
impl ActuationTerm for Gain {
    fn target(&self, _: f64, [x, z]: [f64; 2]) -> [f64; 2] {
        [x * (1.0 + self.0), z]
    }
}

/// Drift of the picture in half masks per second.
struct Drift(f64);
impl ObservationTerm for Drift {
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]) {
        keypoints.iter_mut().for_each(|p| p[0] += self.0 * time_s);
    }
}

fn own() -> Registry {
    let effects = [
        Own { name: "joint", hook: Hook::Material, terms: |m, e| e.terms.materials.push(Arc::new(Joint(m))) },
        Own { name: "grip_turn_rad_s", hook: Hook::Boundary, terms: |m, e| e.terms.grips.push(Arc::new(Turning(m))) },
        Own { name: "target_gain", hook: Hook::Actuation, terms: |m, e| e.arm.terms.push(Arc::new(Gain(m))) },
        Own { name: "drift", hook: Hook::Observation, terms: |m, e| e.camera.terms.push(Arc::new(Drift(m))) },
    ];
    let first = Registry::shipped().clone().with(Arc::new(SideWind));
    effects.into_iter().fold(first, |registry, effect| registry.with(Arc::new(effect)))
}

fn model() -> Model {
    let mut model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    model.effects.clear();
    model.parameters.insert("kelvin_voigt_time_s".into(), 0.03);
    model
}

fn run(drive: Drive, effects: &[(&str, f64)]) -> Track {
    let request = SimulationRequest {
        thetas: vec![vec![0.25, 3e4]],
        effects: effects.iter().map(|(name, v)| ((*name).to_owned(), vec![*v])).collect(),
        drive,
        start: StartShape::HangingAtRest,
        frame_times_s: vec![0.0, 1.0, 2.0],
        target_m: None,
        fidelity: Fidelity::Fast,
        seed: 1,
        first_episode: 0,
        noise: false,
    };
    BeamSimulator::with_effects(&model(), &own(), 1).unwrap().simulate(&request).unwrap().remove(0)
}

fn moves() -> Drive {
    Drive::Actions(vec![[0.05, -0.03], [-0.02, -0.06], [0.04, 0.02]])
}

fn still() -> Drive {
    Drive::Grip(GripTrajectory::new(vec![0.0], vec![GripPose { x_m: 0.4, z_m: 0.42, pitch_rad: 0.0 }]).unwrap())
}

#[test]
fn an_effect_changes_no_bit_at_zero_and_some_bit_otherwise() {
    let base = run(moves(), &[]);
    for effect in own().effects().map(Effect::about).skip(Registry::shipped().effects().count()) {
        assert_eq!(run(moves(), &[(effect.name, 0.0)]), base, "{}", effect.name);
        assert_ne!(run(moves(), &[(effect.name, 0.3)]), base, "{} does nothing", effect.name);
    }
}

#[test]
fn wind_is_gravity_along_x() {
    let weight_n_m = 1055.0 * 0.015 * 0.015 * 9.81;
    let tilted = run(still(), &[("gravity_tilt_rad", 0.2)]);
    let factor = 0.2f64.tan();
    let blown = run(still(), &[("side_wind_n_m", weight_n_m * factor)]);
    let (a, b) = (tilted.frames[2].dlo[3], blown.frames[2].dlo[3]);
    // Tilted gravity is smaller along z by a factor of cos 0.2, that is 2 %.
    assert!((a[0] - b[0]).abs() < 0.02 && (a[1] - b[1]).abs() < 0.02, "{a:?} {b:?}");
}

#[test]
fn drift_moves_the_picture_by_its_magnitude() {
    let (base, drifting) = (run(still(), &[]), run(still(), &[("drift", 0.1)]));
    for (a, b) in base.frames.iter().zip(&drifting.frames) {
        assert!((b.dlo[2][0] - a.dlo[2][0] - 0.1 * a.time_s).abs() < 1e-12);
    }
}

#[test]
fn own_effects_act_beside_shipped_ones_and_names_are_unique() {
    let both = run(moves(), &[("side_wind_n_m", 0.5), ("arm_lag_s", 0.1)]);
    assert!(both != run(moves(), &[("side_wind_n_m", 0.5)]) && both != run(moves(), &[("arm_lag_s", 0.1)]));
    let twice = std::panic::catch_unwind(|| {
        own().with(Arc::new(Own { name: "joint", hook: Hook::Material, terms: |_, _| () }))
    });
    assert!(twice.is_err());
}

#[test]
fn readme_shows_an_effect_that_works() {
    let readme = include_str!("../README.md");
    let lines = readme.lines().skip_while(|line| *line != "/// Steady wind along x.");
    let code = lines.take_while(|line| !line.starts_with("let ")).collect::<Vec<_>>().join("\n");
    assert!(code.contains("impl Effect for SideWind"), "README has no example");
    assert!(include_str!("own_effect.rs").contains(code.trim_end()), "README's example is another one:\n{code}");
}
