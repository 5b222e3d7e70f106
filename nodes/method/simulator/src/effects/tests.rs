//! Tests of effects in combination.

use super::Registry;
use super::fixtures::{actions, episode};
use crate::parameters::tests::soft_bar;

#[test]
fn names_are_unique_and_priors_lie_within_their_ranges() {
    let all: Vec<_> = Registry::shipped().effects().map(|e| e.about()).collect();
    for (i, about) in all.iter().enumerate() {
        assert!(all[..i].iter().all(|other| other.name != about.name && other.title != about.title), "{}", about.name);
        let (low, high) = about.prior.bounds();
        assert!(about.prior.check().is_ok() && low >= about.range[0] && high <= about.range[1], "{}", about.name);
        // A companion does nothing at any value, so that it needs no zero.
        let holds_zero = about.range[0] <= 0.0 && about.range[1] > 0.0;
        assert!(holds_zero || Registry::shipped().is_companion(about.name), "{}", about.name);
    }
}

#[test]
fn all_effects_at_once_make_a_finite_track() {
    let registry = Registry::shipped();
    let concern = registry.effects().filter(|e| e.concerns(&soft_bar()));
    let magnitudes: Vec<(&str, f64)> = concern.map(|e| (e.about().name, e.about().prior.from_unit(0.7))).collect();
    let track = episode(&magnitudes, actions());
    assert!(track.frames.len() == 6 && track.frames.iter().flat_map(|f| f.dlo.as_flattened()).all(|v| v.is_finite()));
}

#[test]
fn the_order_in_which_effects_are_given_changes_nothing() {
    let (a, b) = (("camera_tilt_rad", 0.05), ("lens_distortion", -0.1));
    assert_eq!(episode(&[a, b], actions()), episode(&[b, a], actions()));
}
