//! Identity of an inference, by which a saved state is recognised.

use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Model, Policy, identity};

/// Version of the training method. A change of it invalidates saved states.
const METHOD: u32 = 2;

/// Fingerprint of everything that the outcome of an inference depends on except the simulator: program, model, measured
/// episodes, policy and settings.
pub fn fingerprint(model: &Model, measured: &[MeasuredTrack], policy: Option<&Policy>, settings: &Settings) -> u64 {
    identity::fingerprint(&(env!("CARGO_PKG_VERSION"), METHOD, model.left_out(), model, measured, policy, settings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::GripTrajectory;
    use catenary_core::simulator::StartShape;
    use catenary_core::track::Track;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

    #[test]
    fn each_part_changes_the_fingerprint() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let measured = MeasuredTrack {
            name: "toy episode".into(),
            track: Track::default(),
            grip: GripTrajectory::new(vec![0.0, 1.0], vec![Default::default(); 2]).unwrap(),
            actions: Vec::new(),
            start: StartShape::HangingAtRest,
            target_m: Some([0.5, 0.1]),
            warnings: Vec::new(),
        };
        let of = |model: &Model, measured: &[MeasuredTrack], settings: &Settings| {
            fingerprint(model, measured, None, settings)
        };
        let first = of(&model, std::slice::from_ref(&measured), &Settings::default());
        assert_eq!(first, of(&model, std::slice::from_ref(&measured), &Settings::default()));
        let other_seed = Settings { seed: 1, ..Settings::default() };
        let at_rest = StartShape::Measured { points_m: [[0.0; 2]; 4], velocities_m_s: [[0.0; 2]; 4] };
        let others = [
            of(&Model { name: "other".into(), ..model.clone() }, std::slice::from_ref(&measured), &Settings::default()),
            of(&model, &[measured.clone(), measured.clone()], &Settings::default()),
            of(&model, &[MeasuredTrack { target_m: None, ..measured.clone() }], &Settings::default()),
            of(&model, &[MeasuredTrack { start: at_rest, ..measured.clone() }], &Settings::default()),
            of(&model, &[measured], &other_seed),
        ];
        assert!(others.iter().all(|other| *other != first), "{others:?}");
    }
}
