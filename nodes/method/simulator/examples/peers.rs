//! Comparison with other simulators, catenary's part: the episode, the reference track, and the results of the beam and
//! of rapier's finite elements, as JSON on stdout. `tests/bench/peers/run` runs this, adds the others and prints the
//! table.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program whose failures are bugs")]

use catenary_core::camera::Plane;
use catenary_core::model::AxialLaw;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::task::DeltaAnchor;
use catenary_core::{Camera, Fidelity, GripTrajectory, Model, SimulationRequest, Simulator, Track};
use catenary_simulator::arm::ArmModel;
use catenary_simulator::beam::{BeamParameters, SectionProperties};
use catenary_simulator::episode_model::ArmSettings;
use catenary_simulator::rapier_fem::{FemDiscretisation, RapierFemSimulator};
use catenary_simulator::{BeamSimulator, Registry, parameters::Values};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};

const LENGTH_M: f64 = 0.2;
const YOUNGS_MODULUS_PA: f64 = 1e4;
const STEP_PERIOD_S: f64 = 0.5;
const FRAME_PERIOD_S: f64 = 0.25;
const SAMPLE_S: f64 = 1e-3;
/// Actions (dx, dz) in m: down to the table, drags towards -x with the tail behind, a lift, and once more.
const ACTIONS: [[f64; 2]; 16] = [
    [0.04, -0.04],
    [-0.03, -0.05],
    [0.06, -0.05],
    [0.0, -0.06],
    [-0.05, -0.03],
    [-0.04, -0.03],
    [-0.06, 0.0],
    [0.03, -0.02],
    [-0.05, 0.01],
    [0.04, 0.05],
    [0.05, 0.04],
    [0.06, -0.05],
    [-0.05, -0.03],
    [-0.06, 0.02],
    [0.03, 0.06],
    [0.06, 0.05],
];
/// Young's modulus in Pa of the cantilever.
const CANTILEVER_PA: f64 = 1e7;

/// Model of the soft bar with the linear law and without lateral contraction, as every peer can simulate it, seen in
/// its plane. The last keypoint is the tip.
fn model(grip_angle_rad: f64) -> Model {
    let mut model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
    model.object.axial_law = AxialLaw::Linear;
    model.object.keypoint_fractions = [0.25, 0.5, 0.75, 1.0];
    model.object.hidden_length_m = 0.0;
    model.object.grip_angle_rad = grip_angle_rad;
    model.effects.clear();
    model.camera.view = Camera::Plane(Plane { centre_m: [0.0; 2], side_m: 2.0, ..Plane::default() });
    for (name, value) in [("poisson_ratio", 0.0), ("kelvin_voigt_time_s", 0.02), ("table_friction", 0.5)] {
        model.parameters.insert(name.into(), value);
    }
    model
}

/// Returns the path of the grip when the model's arm executes the actions.
fn motion(model: &Model) -> GripTrajectory {
    let start = model.arm.start;
    let mut arm = ArmModel::new(&ArmSettings::new(model.arm.law, DeltaAnchor::LastTarget), [start.x_m, start.z_m]);
    let samples_a_step = (STEP_PERIOD_S / SAMPLE_S).round() as usize;
    let (mut times_s, mut poses) = (Vec::new(), Vec::new());
    for k in 0..=ACTIONS.len() * samples_a_step {
        let time_s = k as f64 * SAMPLE_S;
        if let (0, Some(delta)) = (k % samples_a_step, ACTIONS.get(k / samples_a_step)) {
            arm.set_delta(time_s, *delta);
        }
        arm.run_to(time_s);
        times_s.push(time_s);
        poses.push(arm.grip(time_s, start.pitch_rad));
    }
    GripTrajectory::new(times_s, poses).unwrap()
}

fn request(youngs_modulus_pa: f64, path: GripTrajectory, frames: usize, fidelity: Fidelity) -> SimulationRequest {
    SimulationRequest {
        thetas: vec![vec![LENGTH_M, youngs_modulus_pa]],
        effects: Vec::new(),
        drive: Drive::Grip(path),
        start: StartShape::HangingAtRest,
        frame_times_s: (0..frames).map(|k| FRAME_PERIOD_S * k as f64).collect(),
        target_m: None,
        fidelity,
        seed: 1,
        first_episode: 0,
        noise: false,
    }
}

/// Returns the keypoints (x, z) in m of every frame. The camera sees a square from -1 to 1 m.
fn points_m(track: &Track) -> Vec<[[f64; 2]; 4]> {
    track.frames.iter().map(|f| f.dlo.map(|[u, v]| [u, -v])).collect()
}

fn rms_mm(a: &[[[f64; 2]; 4]], b: &[[[f64; 2]; 4]]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    let squares: Vec<f64> = pairs.map(|(p, q)| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)).collect();
    1e3 * (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

fn core_seconds() -> f64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

/// Measures one simulator, made for a model by `make`, over `episodes` episodes.
fn row(
    name: &str,
    settings: &str,
    episodes: usize,
    fidelity: Fidelity,
    reference: &[[[f64; 2]; 4]],
    make: impl Fn(&Model) -> Box<dyn Simulator>,
) -> Value {
    let down = model(-std::f64::consts::FRAC_PI_2);
    let level = model(0.0);
    let still = GripTrajectory::new(vec![0.0], vec![level.arm.start]).unwrap();
    let at_rest = |model: &Model, youngs_modulus_pa: f64| {
        let tracks = make(model).simulate(&request(youngs_modulus_pa, still.clone(), 1, fidelity)).unwrap();
        level.arm.start.z_m - points_m(&tracks[0])[0][3][1]
    };
    let beam = object(YOUNGS_MODULUS_PA);
    let weight_n_m = 9.81 * beam.mass_per_length_kg_m;
    let area = beam.section.area_m2();
    let hanging = |e: f64| (at_rest(&down, e) - LENGTH_M) / (weight_n_m * LENGTH_M.powi(2) / (2.0 * e * area));
    let cantilever = at_rest(&level, CANTILEVER_PA)
        / (weight_n_m * LENGTH_M.powi(4) / (8.0 * CANTILEVER_PA * beam.section.second_moment_m4()));
    let simulator = make(&level);
    let asked = request(YOUNGS_MODULUS_PA, motion(&level), 33, fidelity);
    let started_s = core_seconds();
    let mut track = Track::default();
    for _ in 0..episodes {
        track = simulator.simulate(&asked).unwrap().remove(0);
    }
    let rate = episodes as f64 / (core_seconds() - started_s);
    json!({
        "simulator": name,
        "settings": settings,
        "episodes_per_core_second": rate,
        "hanging_ratio_1e3_pa": hanging(1e3),
        "hanging_ratio_5e4_pa": hanging(5e4),
        "cantilever_ratio_1e7_pa": cantilever,
        "track_rms_mm": rms_mm(&points_m(&track), reference),
    })
}

fn object(youngs_modulus_pa: f64) -> BeamParameters {
    let model = model(0.0);
    let values = Values::resolve(Registry::shipped(), &model, &[LENGTH_M, youngs_modulus_pa], []).unwrap();
    values.episode_model(&model).unwrap().beam
}

fn main() {
    let level = model(0.0);
    let path = motion(&level);
    let beam = |model: &Model| -> Box<dyn Simulator> { Box::new(BeamSimulator::new(model, 1).unwrap()) };
    let asked = request(YOUNGS_MODULUS_PA, path.clone(), 33, Fidelity::Reference);
    let reference = points_m(&beam(&level).simulate(&asked).unwrap()[0]);
    let mut rows = Vec::new();
    for (fidelity, settings, episodes) in [
        (Fidelity::Fast, "20 elements, 4 ms, BDF2", 40),
        (Fidelity::Standard, "20 elements, 2 ms, BDF2", 20),
        (Fidelity::Reference, "40 elements, 0.5 ms, BDF2", 1),
    ] {
        rows.push(row(&format!("catenary, {}", fidelity.name()), settings, episodes, fidelity, &reference, beam));
    }
    for fidelity in [Fidelity::Fast, Fidelity::Standard] {
        let d = FemDiscretisation::of(fidelity);
        let settings = format!(
            "{0}x{0}x{1} cubes of 5 linear tetrahedra, implicit Euler of {2} ms, contacts every {3} ms",
            d.cells_across,
            d.cells_along,
            1e3 * d.time_step_s / d.substeps as f64,
            1e3 * d.time_step_s
        );
        let name = format!("rapier 0.36 FEM, {}", fidelity.name());
        rows.push(row(&name, &settings, 1, fidelity, &reference, |model| {
            Box::new(RapierFemSimulator::new(model, 1).unwrap())
        }));
    }
    let o = object(YOUNGS_MODULUS_PA);
    let episode = json!({
        "length_m": LENGTH_M,
        "side_m": 2.0 * o.section.half_height_m(),
        "density_kg_m3": o.mass_per_length_kg_m / o.section.area_m2(),
        "youngs_modulus_pa": YOUNGS_MODULUS_PA,
        "cantilever_pa": CANTILEVER_PA,
        "poisson_ratio": 0.0,
        "kelvin_voigt_time_s": o.kelvin_voigt_time_s,
        "table_friction": o.table.unwrap().friction_coefficient,
        "keypoint_fractions": level.object.keypoint_fractions,
        "frame_times_s": asked.frame_times_s,
        "grip_period_s": SAMPLE_S,
        "grip_m": path.poses().iter().map(|p| [p.x_m, p.z_m]).collect::<Vec<_>>(),
        "reference_m": reference,
    });
    println!("{}", json!({ "episode": episode, "rows": rows }));
}
