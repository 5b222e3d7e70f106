//! Whether two simulators mean the same by a model: their programs, and the arithmetic of their machines.

use crate::simulator::BeamSimulator;
use catenary_core::grip::GripPose;
use catenary_core::hash::fnv1a;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripTrajectory, Model, SimulationRequest, Simulator, Track};

/// Moments of the episode that is compared, s.
const FRAME_TIMES_S: [f64; 5] = [0.0, 0.1, 0.2, 0.3, 0.4];

/// A number that is the same where a model is read as the same one, its defaults included, and where a short episode of it
/// comes out the same to the bit: processors and mathematical libraries may differ in a last place, and programs in more.
pub fn fingerprint(model: &Model) -> u64 {
    let episode = match probe(model) {
        Ok(tracks) => tracks.iter().flat_map(numbers).flat_map(f64::to_le_bytes).collect(),
        Err(refusal) => refusal.into_bytes(),
    };
    fnv1a(format!("{model:?}").bytes().chain(episode))
}

/// The episode: the hand goes sideways and turns a little.
fn probe(model: &Model) -> Result<Vec<Track>, String> {
    let simulator = BeamSimulator::new(model, 1).map_err(|e| e.to_string())?;
    let pose = |x_m, pitch_rad| GripPose { x_m, z_m: 0.42, pitch_rad };
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

/// What was seen of the object and the hand.
fn numbers(track: &Track) -> Vec<f64> {
    let frame = |frame: &catenary_core::Frame| [frame.dlo.concat(), frame.target.to_vec(), frame.eef.to_vec()].concat();
    track.frames.iter().flat_map(frame).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_text;

    const SOFT_BAR: &str = include_str!("../../../launch_configs/models/soft_bar.yaml");
    const CABLE: &str = include_str!("../../../launch_configs/models/measured_cable.yaml");

    #[test]
    fn it_is_the_same_for_the_same_model_and_another_for_any_change_of_it() {
        let of = |text: &str| fingerprint(&model_text::read(text).unwrap());
        assert_eq!(of(SOFT_BAR), of(SOFT_BAR));
        assert_eq!(of(SOFT_BAR), of(&format!("# a comment changes nothing\n{SOFT_BAR}")));
        assert_ne!(of(SOFT_BAR), of(CABLE));
        let line = SOFT_BAR.lines().find(|line| line.contains("density_kg_m3")).unwrap();
        let denser = format!("{}: 1234.5", line.split(':').next().unwrap());
        assert_ne!(of(SOFT_BAR), of(&SOFT_BAR.replace(line, &denser)));
    }

    #[test]
    fn the_probe_runs_and_a_last_place_of_it_changes_the_number() {
        for text in [SOFT_BAR, CABLE] {
            let tracks = probe(&model_text::read(text).unwrap()).unwrap();
            let bits = numbers(&tracks[0]);
            assert_eq!(bits.len(), FRAME_TIMES_S.len() * 13);
            let hash = |values: &[f64]| fnv1a(values.iter().flat_map(|v| v.to_le_bytes()));
            let mut other = bits.clone();
            other[7] = other[7].next_up();
            assert_ne!(hash(&bits), hash(&other));
        }
    }
}
