//! Fingerprint of a model and of the program and machine that simulate it.

use crate::simulator::BeamSimulator;
use catenary_core::grip::GripPose;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripTrajectory, Model, SimulationRequest, Simulator, Track, identity};

/// Frame times of the probe episode in s.
const FRAME_TIMES_S: [f64; 5] = [0.0, 0.1, 0.2, 0.3, 0.4];

/// Returns the fingerprint of a model: equal if the model reads as equal, defaults included, and if a short episode of
/// it is equal to the bit. Processors and mathematical libraries may differ in the last place, and programs in more.
///
/// The value is [`identity::fingerprint`] of the model and of the episode's numbers. A model without an object has its error message in place of the numbers.
pub fn fingerprint(model: &Model) -> u64 {
    hash(model, &probe(model).map(|tracks| tracks.iter().flat_map(numbers).collect()))
}

/// Hashes a model and the outcome of its probe episode.
fn hash(model: &Model, outcome: &Result<Vec<f64>, String>) -> u64 {
    identity::fingerprint(&(model.left_out(), model, outcome))
}

/// Simulates the probe episode: the hand goes sideways and turns a little.
fn probe(model: &Model) -> Result<Vec<Track>, String> {
    let simulator = BeamSimulator::new(model, 1).map_err(|e| e.to_string())?;
    let pose = |x_m, pitch_rad| GripPose { x_m, z_m: 0.42, pitch_rad };
    // A swing of 0.4 s bends and stretches the object, with noise and drawn effects, at the cost of 100 steps.
    let path =
        GripTrajectory::new(vec![0.0, 0.4], vec![pose(0.40, 0.0), pose(0.43, 0.2)]).map_err(|e| e.to_string())?;
    let request = SimulationRequest {
        thetas: vec![model.theta.from_unit(&vec![0.5; model.theta.dimension()])],
        effects: Vec::new(),
        drive: Drive::Grip(path),
        start: StartShape::HangingAtRest,
        frame_times_s: FRAME_TIMES_S.to_vec(),
        target_m: None,
        fidelity: Fidelity::Fast,
        seed: 0,
        first_episode: 0,
        noise: true,
    };
    simulator.simulate(&request).map_err(|e| e.to_string())
}

/// Returns keypoints, target, hand pose, and the wrench if it is observed, of every frame.
fn numbers(track: &Track) -> Vec<f64> {
    let frame = |frame: &catenary_core::Frame| {
        let wrench = frame.wrench.map_or(Vec::new(), |wrench| wrench.to_vec());
        [frame.dlo.concat(), frame.target.to_vec(), frame.eef.to_vec(), wrench].concat()
    };
    track.frames.iter().flat_map(frame).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_text;
    use catenary_core::Goal;
    use catenary_core::model::{ArmLaw, Impedance, WrenchNoise};

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");
    const CABLE: &str = include_str!("../../../../launch_configs/models/measured_cable.yaml");

    #[test]
    fn equal_models_have_equal_fingerprints_and_changed_ones_have_others() {
        let of = |text: &str| fingerprint(&model_text::read(text).unwrap());
        assert_eq!(of(SOFT_BAR), of(SOFT_BAR));
        assert_eq!(of(SOFT_BAR), of(&format!("# a comment changes nothing\n{SOFT_BAR}")));
        assert_ne!(of(SOFT_BAR), of(CABLE));
        let line = SOFT_BAR.lines().find(|line| line.contains("density_kg_m3")).unwrap();
        let denser = format!("{}: 1234.5", line.split(':').next().unwrap());
        assert_ne!(of(SOFT_BAR), of(&SOFT_BAR.replace(line, &denser)));
    }

    #[test]
    fn fields_that_a_model_file_may_leave_out_change_the_hash() {
        let model = model_text::read(SOFT_BAR).unwrap();
        let mut goal = model.clone();
        goal.task.as_mut().unwrap().goal = Goal::PlaceTip { reward_range_m: 0.1 };
        let mut nominal = model.clone();
        nominal.nominal.insert("length_m".into(), 0.25);
        let outcome = Ok(Vec::new());
        let with_law = |law| {
            let mut model = model.clone();
            model.arm.law = ArmLaw::Impedance(law);
            model
        };
        let mut wrench = model.clone();
        wrench.observation.wrench = Some(WrenchNoise { force_sd_n: [1.0, 0.1], torque_sd_n_m: 0.05 });
        let mut alone = wrench.clone();
        alone.observation.keypoints = false;
        let stiff = with_law(Impedance::default());
        let slow = with_law(Impedance { max_speed_m_s: Some(0.1), ..Impedance::default() });
        let hashes = [&model, &goal, &nominal, &stiff, &slow, &wrench, &alone].map(|m| hash(m, &outcome));
        let different: std::collections::HashSet<u64> = hashes.into_iter().collect();
        assert_eq!(different.len(), hashes.len(), "{hashes:?}");
    }

    #[test]
    fn one_last_bit_of_the_probe_changes_the_hash() {
        for text in [SOFT_BAR, CABLE] {
            let model = model_text::read(text).unwrap();
            let tracks = probe(&model).unwrap();
            let bits = numbers(&tracks[0]);
            assert_eq!(bits.len(), FRAME_TIMES_S.len() * 13);
            let mut other = bits.clone();
            other[7] = other[7].next_up();
            assert_ne!(hash(&model, &Ok(bits)), hash(&model, &Ok(other)));
        }
    }
}
