//! Keypoints of drawn curves, whose true positions are known.

use super::*;
use crate::drawing::{at_fraction, curved, draw, draw_disc, hanging, mask_of, straight};
use catenary_core::image::label;
use catenary_core::seed;
use proptest::prelude::*;
use rand::RngExt;

const FRACTIONS: [f64; 4] = [0.125, 0.375, 0.625, 0.875];

fn track(mask: &LabelMask) -> Keypoints {
    GeometricTracker::new(TrackerParams::default()).unwrap().track(mask).unwrap()
}

/// Distance of two points.
fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Root mean square distance of two sets of keypoints in the given or the reverse order, whichever is smaller.
fn rms(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let mean = |order: [usize; 4]| (0..4).map(|k| apart(a[k], b[order[k]]).powi(2)).sum::<f64>() / 4.0;
    mean([0, 1, 2, 3]).min(mean([3, 2, 1, 0])).sqrt()
}

/// True keypoints of a curve.
fn truth(line: &[[f64; 2]]) -> [[f64; 2]; 4] {
    FRACTIONS.map(|f| at_fraction(line, f))
}

/// Named shapes that a bar may take.
fn shapes() -> Vec<(&'static str, Vec<[f64; 2]>)> {
    let mut shapes = vec![
        ("lying", straight([128.3, 200.2], 0.0, 90.0)),
        ("upright", straight([128.3, 120.2], std::f64::consts::FRAC_PI_2, 90.0)),
        ("half circle", curved([100.0, 100.0], 0.3, 94.0, |_| std::f64::consts::PI / 94.0)),
        ("three quarters of a circle", curved([100.0, 100.0], 0.3, 140.0, |_| 1.5 * std::f64::consts::PI / 140.0)),
        ("S", curved([60.0, 100.0], -0.8, 140.0, |s| if s < 70.0 { 0.03 } else { -0.03 })),
        ("chain", hanging([60.0, 190.0], 120.0, 200.0, 40.0)),
        ("chain on one side", hanging([100.0, 150.0], 150.0, 200.0, 18.0)),
        (
            "draped over the table",
            curved([120.0, 60.0], 1.5, 150.0, |s| if (60.0..95.0).contains(&s) { -0.043 } else { 0.0 }),
        ),
        ("long", curved([20.0, 60.0], 0.5, 260.0, |s| -0.012 * (s / 40.0).cos())),
    ];
    shapes.extend((0..12).map(|k| ("tilted", straight([128.0, 128.0], 0.13 + 0.26 * f64::from(k), 70.0))));
    shapes
}

#[test]
fn keypoints_lie_within_a_pixel_and_a_half_of_the_curve_for_all_shapes_and_widths() {
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0);
    for (name, line) in shapes() {
        for half_width in [1.0, 1.6, 2.15, 3.0, 5.0] {
            let found = track(&mask_of(&line, half_width));
            let rms = rms(&found.dlo_px, &truth(&line));
            (sum, worst, count) = (sum + rms * rms, worst.max(rms), count + 1.0);
            assert!(rms < 1.5, "{name}, half width {half_width}: {rms:.2} px");
            // A line of two pixels alternates between two and three: its width is less certain.
            let expected = if half_width < 1.5 { 0.3 } else { 0.6 };
            let least = found.scores.iter().copied().fold(1.0, f32::min);
            assert!(least > expected, "{name}, half width {half_width}: scores {:?}", found.scores);
        }
    }
    println!("keypoint error: RMS {:.3} px over {count} masks, worst mask {worst:.3} px", f64::sqrt(sum / count));
}

#[test]
fn rough_borders_move_keypoints_by_less_than_a_pixel_and_a_half() {
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0);
    for (name, line) in shapes() {
        for seed in 0..4 {
            let mut mask = mask_of(&line, 2.15);
            roughen(&mut mask, 0.12, seed);
            let rms = rms(&track(&mask).dlo_px, &truth(&line));
            (sum, worst, count) = (sum + rms * rms, worst.max(rms), count + 1.0);
            assert!(rms < 1.5, "{name}, seed {seed}: {rms:.2} px");
        }
    }
    println!("with rough borders: RMS {:.3} px over {count} masks, worst mask {worst:.3} px", f64::sqrt(sum / count));
}

/// Flips border pixels with the probability `share`, and inner pixels with a tenth of it.
fn roughen(mask: &mut LabelMask, share: f64, seed: u64) {
    let source = mask.clone();
    let mut rng = seed::rng(seed, 0);
    for v in 1..mask.height - 1 {
        for u in 1..mask.width - 1 {
            let near = [source.at(u - 1, v), source.at(u + 1, v), source.at(u, v - 1), source.at(u, v + 1)];
            let labelled = near.iter().filter(|&&l| l == label::DLO).count();
            let chance = match (labelled, source.at(u, v)) {
                (0, _) => 0.0,
                (4, label::DLO) => 0.1 * share,
                _ => share,
            };
            if rng.random_bool(chance) {
                mask.data[(v * mask.width + u) as usize] ^= label::DLO;
            }
        }
    }
}

#[test]
fn turning_the_mask_by_half_a_turn_turns_the_keypoints() {
    for (name, line) in shapes() {
        let mask = mask_of(&line, 2.15);
        let mut turned = mask.clone();
        turned.data.reverse();
        let expected = track(&mask).dlo_px.map(|[u, v]| [256.0 - u, 256.0 - v]);
        let rms = rms(&track(&turned).dlo_px, &expected);
        assert!(rms < 0.6, "{name}: {rms:.2} px");
    }
}

#[test]
fn a_gap_behind_the_gripper_is_bridged_and_counts_as_length() {
    for (from, to) in [(0.08, 0.2), (0.45, 0.6), (0.3, 0.42)] {
        let line = curved([70.0, 90.0], -0.3, 120.0, |s| 0.004 + 0.0001 * s);
        let mut mask = mask_of(&line, 2.15);
        let (a, b) = (at_fraction(&line, from), at_fraction(&line, to));
        for v in 0..256 {
            let (low, high) = (a[0].min(b[0]) as usize, a[0].max(b[0]) as usize);
            mask.data[v * 256 + low..v * 256 + high].fill(label::BACKGROUND);
        }
        let found = track(&mask);
        let rms = rms(&found.dlo_px, &truth(&line));
        assert!(rms < 1.5, "gap {from} to {to}: {rms:.2} px");
        for (k, fraction) in FRACTIONS.into_iter().enumerate() {
            // A keypoint in the gap has the factor 1/2.
            let hidden = (from..to).contains(&fraction);
            assert_eq!(found.scores[k] < 0.55, hidden, "gap {from} to {to}: {:?}", found.scores);
        }
    }
}

#[test]
fn a_stub_that_is_wider_than_long_still_ends_the_line() {
    let line = straight([128.0, 100.0], 0.0, 100.0);
    let mut mask = mask_of(&line, 2.15);
    // The line begins at u = 78: the gap leaves a stub of three columns.
    for v in 0..256 {
        mask.data[v * 256 + 81..v * 256 + 95].fill(label::BACKGROUND);
    }
    let rms = rms(&track(&mask).dlo_px, &truth(&line));
    assert!(rms < 1.0, "{rms:.2} px");
}

#[test]
fn a_second_object_far_away_or_beside_the_line_is_ignored() {
    let line = straight([128.0, 100.0], 0.2, 90.0);
    let clean = track(&mask_of(&line, 2.15));
    // The first lies beside the line and leads nowhere; the second is farther away than `max_gap_px`.
    for aside in [straight([128.0, 120.0], 0.2, 30.0), straight([128.0, 220.0], 0.2, 80.0)] {
        let mut mask = mask_of(&line, 2.15);
        draw(&mut mask, &aside, 2.15);
        let found = track(&mask);
        assert!(rms(&found.dlo_px, &truth(&line)) < 1.0);
        assert!(found.scores[0] < clean.scores[0]);
    }
}

#[test]
fn a_bar_that_crosses_or_touches_itself_is_followed_around() {
    // A loop of radius 16 between two straight arms, which cross at a right or at an acute angle.
    for turn in [1.5 * std::f64::consts::PI, 1.25 * std::f64::consts::PI] {
        let arc = 16.0 * turn;
        let line =
            curved([70.0, 150.0], 0.1, 100.0 + arc, |s| if (50.0..50.0 + arc).contains(&s) { 1.0 / 16.0 } else { 0.0 });
        let rms = rms(&track(&mask_of(&line, 2.15)).dlo_px, &truth(&line));
        assert!(rms < 2.0, "turn {turn:.2}: {rms:.2} px");
    }
    // A lasso: the end touches the middle of the line.
    let arc = 16.0 * 1.5 * std::f64::consts::PI;
    let line = curved([70.0, 150.0], 0.1, 66.0 + arc, |s| {
        if s > 50.0 { (1.0f64 / 16.0).min((50.0 + arc - s).max(0.0)) } else { 0.0 }
    });
    let rms = rms(&track(&mask_of(&line, 2.15)).dlo_px, &truth(&line));
    assert!(rms < 3.0, "lasso: {rms:.2} px");
}

#[test]
fn holes_are_filled() {
    let line = curved([70.0, 90.0], 0.2, 120.0, |_| 0.01);
    let mut mask = mask_of(&line, 3.5);
    for fraction in [0.2, 0.5, 0.77] {
        let [u, v] = at_fraction(&line, fraction).map(|c| c as usize);
        (v - 1..v + 1).for_each(|v| mask.data[v * 256 + u - 1..v * 256 + u + 2].fill(label::BACKGROUND));
    }
    let rms = rms(&track(&mask).dlo_px, &truth(&line));
    assert!(rms < 1.0, "{rms:.2} px");
}

#[test]
fn a_bar_cut_by_the_edge_is_tracked_as_far_as_it_is_seen_with_less_confidence() {
    // 100 px about u = 20: the first 30 px lie outside of the mask.
    let whole = straight([20.0, 100.0], 0.1, 100.0);
    let seen: Vec<_> = whole.iter().copied().filter(|p| p[0] > 0.0).collect();
    let found = track(&mask_of(&whole, 2.15));
    let rms = rms(&found.dlo_px, &truth(&seen));
    assert!(rms < 1.0, "{rms:.2} px");
    assert!(found.scores.iter().all(|&s| s < 0.55), "{:?}", found.scores);
}

#[test]
fn a_short_bar_lies_along_its_axis_and_a_round_blob_has_little_confidence() {
    for (length, angle) in [(8.0, 0.0), (12.0, 1.2), (17.0, -0.6)] {
        let line = straight([100.0, 100.0], angle, length);
        let found = track(&mask_of(&line, 2.5));
        assert!(rms(&found.dlo_px, &truth(&line)) < 1.0, "length {length}: {:?}", found.dlo_px);
    }
    let mut blob = LabelMask::new(256, 256);
    draw_disc(&mut blob, [120.0, 80.0], 9.0, label::DLO);
    assert_eq!(track(&blob).scores, [0.0; 4], "such keypoints count as not seen");
    let every = TrackerParams { min_score: 0.0, ..TrackerParams::default() };
    let found = GeometricTracker::new(every).unwrap().track(&blob).unwrap();
    assert!(found.scores.iter().all(|&s| s > 0.0 && s < 0.1), "{:?}", found.scores);
    assert!(found.dlo_px.iter().all(|&p| apart(p, [120.0, 80.0]) < 9.0));
}

#[test]
fn an_unseen_object_has_no_confidence_and_the_target_is_still_reported() {
    let mut mask = LabelMask::new(256, 256);
    draw_disc(&mut mask, [60.0, 200.0], 7.0, label::TARGET);
    // Five pixels are fewer than `min_area_px`.
    mask.data[1000..1005].fill(label::DLO);
    let found = track(&mask);
    assert!(!found.dlo_seen() && found.scores == [0.0; 4]);
    assert!(apart(found.target_px.unwrap(), [60.0, 200.0]) < 0.1);
    assert_eq!(found.target_score, 1.0);
    assert_eq!(track(&LabelMask::new(256, 256)).target_px, None);
}

#[test]
fn fractions_are_counted_from_the_chosen_end() {
    let line = straight([128.0, 128.0], 0.5, 80.0);
    let track_from = |start| {
        let params = TrackerParams { fractions: [0.25, 0.5, 0.75, 1.0], start, ..TrackerParams::default() };
        let mut tracker = GeometricTracker::new(params).unwrap();
        (tracker.track(&mask_of(&line, 2.15)).unwrap().dlo_px, tracker.centre_line_px().to_vec())
    };
    let (upper, centre_line) = track_from(PathStart::Upper);
    assert!(apart(upper[3], line[400]) < 1.0 && apart(upper[0], at_fraction(&line, 0.25)) < 1.0, "{upper:?}");
    assert!(apart(centre_line[0], line[0]) < 1.0);
    let rising = straight([128.0, 128.0], -0.5, 80.0);
    let params =
        TrackerParams { fractions: [0.25, 0.5, 0.75, 1.0], start: PathStart::Left, ..TrackerParams::default() };
    let left = GeometricTracker::new(params).unwrap().track(&mask_of(&rising, 2.15)).unwrap().dlo_px;
    assert!(apart(left[3], rising[400]) < 1.0, "{left:?}");
}

#[test]
fn a_mask_with_an_unknown_label_or_a_wrong_size_is_refused() {
    let mut tracker = GeometricTracker::new(TrackerParams::default()).unwrap();
    let mut mask = LabelMask::new(8, 4);
    mask.data[11] = 255;
    assert_eq!(tracker.track(&mask), Err(Error::UnknownLabel { label: 255, u: 3, v: 1 }));
    mask.data.truncate(5);
    assert_eq!(tracker.track(&mask), Err(Error::Size { width: 8, height: 4, got: 5 }));
}

#[test]
fn keypoints_do_not_depend_on_earlier_masks_to_the_bit() {
    let mut used = GeometricTracker::new(TrackerParams::default()).unwrap();
    for (_, line) in shapes() {
        let mask = mask_of(&line, 2.15);
        assert_eq!(used.track(&mask), Ok(track(&mask)));
    }
}

/// Returns true if every coordinate lies within 2 px of the mask and every score within 0 to 1.
fn is_sound(found: &Keypoints) -> bool {
    let inside = |p: &[f64; 2]| p.iter().all(|c| (-2.0..=258.0).contains(c));
    found.dlo_px.iter().all(inside)
        && found.target_px.iter().all(inside)
        && found.scores.iter().chain([&found.target_score]).all(|s| (0.0..=1.0).contains(s))
}

#[test]
fn any_mask_gives_finite_keypoints() {
    let mut rng = seed::rng(3, 0);
    for fill in 0..=2 {
        assert!(is_sound(&track(&LabelMask::from_data(256, 256, vec![fill; 65536]).unwrap())));
    }
    for share in [0.02, 0.1, 0.3, 0.45, 0.5, 0.6, 0.9] {
        for blur in 0..3 {
            let mut mask = LabelMask::new(256, 256);
            mask.data.iter_mut().for_each(|l| *l = if rng.random_bool(share) { rng.random_range(1..=2) } else { 0 });
            // Crude smoothing of the noise into blobs, from salt and pepper to large regions with holes.
            for _ in 0..blur {
                let source = mask.data.clone();
                (257..65536 - 257).for_each(|i| mask.data[i] = source[i - 1].min(source[i + 1]).max(source[i - 256]));
            }
            assert!(is_sound(&track(&mask)), "share {share}, blur {blur}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn small_masks_of_any_size_give_finite_keypoints(
        width in 1u32..20,
        height in 1u32..20,
        labels in proptest::collection::vec(0u8..=2, 400),
    ) {
        let mask = LabelMask::from_data(width, height, labels[..(width * height) as usize].to_vec()).unwrap();
        let params = TrackerParams { min_area_px: 1, min_piece_area_px: 1, min_target_area_px: 1, ..TrackerParams::default() };
        prop_assert!(is_sound(&GeometricTracker::new(params).unwrap().track(&mask).unwrap()));
    }

    #[test]
    fn keypoints_are_evenly_spaced_along_bars_of_any_shape(
        u in 115.0f64..141.0,
        v in 115.0f64..141.0,
        heading in -3.1f64..3.1,
        length in 45.0f64..110.0,
        bend in proptest::array::uniform3(-0.03f64..0.03),
    ) {
        let line = curved([u, v], heading, length, |s| bend[((3.0 * s / length) as usize).min(2)]);
        let found = track(&mask_of(&line, 2.15));
        let rms = rms(&found.dlo_px, &truth(&line));
        prop_assert!(rms < 1.5, "{rms}");
    }
}
