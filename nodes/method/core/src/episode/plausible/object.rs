//! Plausible keypoints of the object.

use super::chain::{MOST_LEFT_OUT, Plausible, at, kept, left_out, longest_chain, points_m, take_out};
use super::edges::edge_faults;
use super::spikes::spikes;
use crate::keypoints::KeypointOrder;
use crate::{Camera, Keypoints};

/// Topic of the keypoints.
pub(crate) const KEYPOINTS: &str = "/dlo/keypoints";

/// Departure of a keypoint in the first or the last frame below which the frame is no fault, in m: three times the
/// distance that trackers slide.
const EDGE_M: f64 = 0.15;
/// Greatest speed of a keypoint in m/s: five times that of the fastest cable end in the recordings of two arms.
const KEYPOINT_M_S: f64 = 10.0;
/// Greatest acceleration of a keypoint in m/s^2: twice that of the fastest such end, 2 m/s, on a circle of 0.1 m.
const KEYPOINT_M_S2: f64 = 80.0;
/// Distance in m that a keypoint may move in no time: trackers slide along the object, and find it again elsewhere.
const KEYPOINT_SLACK_M: f64 = 0.05;

/// Keeps the frames with all four keypoints that an object can reach one after the other. `start_ns` is the stamp of
/// time 0.
///
/// # Errors
/// A sentence that names the defect that makes the whole stream unusable.
pub(crate) fn keypoints(
    samples: &[(f64, Keypoints)],
    camera: &Camera,
    start_ns: i64,
) -> Result<Plausible<Keypoints>, String> {
    // A keypoint that was not seen has no place that could be checked.
    let seen: Vec<(f64, Keypoints)> = samples.iter().filter(|(_, k)| k.dlo_seen()).copied().collect();
    check_pixels(&seen)?;
    let zeros = zero_warning(&seen, start_ns)?;
    let seen: Vec<(f64, Keypoints)> = seen.into_iter().filter(|(_, k)| zero_keypoint(k).is_none()).collect();
    let mut placed = Vec::new();
    let mut behind = Vec::new();
    for (time_s, k) in &seen {
        match points_m(k, camera) {
            Some(points) => placed.push((*time_s, (points, *k))),
            None => behind.push((*time_s, *k)),
        }
    }
    type Placed = (f64, ([[f64; 2]; 4], Keypoints));
    let follows = |a: &Placed, b: &Placed| farthest_m(&a.1.0, &b.1.0) <= KEYPOINT_M_S * (b.0 - a.0) + KEYPOINT_SLACK_M;
    let mut flags = longest_chain(&placed, 0.0, follows);
    let out_and_back =
        spikes(&kept(&placed, &flags), [KEYPOINT_M_S2, 0.0, KEYPOINT_SLACK_M], |[(a, _), (b, _), (c, _)]| {
            matched([a, b, c])
        });
    take_out(&mut flags, &out_and_back);
    let out = flags.iter().filter(|f| !**f).count() + behind.len();
    let mut warnings: Vec<String> = zeros.into_iter().collect();
    if out > 0 {
        let mut places: Vec<String> = left_out(&placed, &flags)
            .iter()
            .map(|((time_s, (points, k)), (other_s, (others, _)))| {
                let (apart_m, between_s) = (farthest_m(points, others), (time_s - other_s).abs());
                let at = at(*time_s, start_ns);
                format!(
                    "{at} with (u, v) {} px, {apart_m:.2} m from the frame {:.0} ms away",
                    pixels(k),
                    1e3 * between_s
                )
            })
            .collect();
        places.extend(
            behind
                .first()
                .map(|(t, k)| format!("{} with (u, v) {} px, behind the camera", at(*t, start_ns), pixels(k))),
        );
        let speeds = format!("{KEYPOINT_M_S} m/s and {KEYPOINT_M_S2} m/s^2");
        let (of, places) = (seen.len(), places.join(" to "));
        if out as f64 > MOST_LEFT_OUT * of as f64 {
            return Err(format!(
                "{KEYPOINTS}: {out} of {of} frames contradict the others: expected keypoints that move at most at {speeds}, got {places}: check tracker, camera and clock of their publisher"
            ));
        }
        warnings.push(format!(
            "{KEYPOINTS}: {out} of {of} frames left out, because no keypoint moves that far at {speeds}: {places}"
        ));
    }
    let mut kept = kept(&placed, &flags);
    // The last comes first, so the index of the first stays valid.
    for fault in edge_faults(&kept, EDGE_M, |[(a, _), (b, _), (c, _)]| matched([a, b, c])).into_iter().rev() {
        let which = if fault.index == 0 { "first" } else { "last" };
        let (time_s, (_, k)) = kept.remove(fault.index);
        warnings.push(format!(
            "{KEYPOINTS}: {which} frame left out, {} with (u, v) {} px: a keypoint is {:.2} m from where its neighbours lead, and all others at most {:.2} m",
            at(time_s, start_ns),
            pixels(&k),
            fault.departure,
            fault.usual
        ));
    }
    let kept = kept.into_iter().map(|(t, (_, k))| (t, k)).collect();
    Ok(Plausible { kept, warnings })
}

/// Index of the first keypoint at exactly (0, 0): the corner of the image, which no measured keypoint hits to the bit.
fn zero_keypoint(k: &Keypoints) -> Option<usize> {
    k.dlo_px.iter().position(|p| *p == [0.0, 0.0])
}

/// Warning about frames with zeros in place of keypoints that were not seen.
///
/// # Errors
/// A sentence if all frames have such zeros.
pub(crate) fn zero_warning(seen: &[(f64, Keypoints)], start_ns: i64) -> Result<Option<String>, String> {
    let zeros: Vec<(f64, usize)> = seen.iter().filter_map(|(t, k)| Some((*t, zero_keypoint(k)?))).collect();
    let Some((time_s, keypoint)) = zeros.first() else { return Ok(None) };
    let said = format!(
        "{KEYPOINTS}: {} of {} frames left out, whose dlo_u and dlo_v are 0 as if for a missing keypoint (the first is dlo_u[{keypoint}] {}): expected a score of 0 for a keypoint that was not seen",
        zeros.len(),
        seen.len(),
        at(*time_s, start_ns)
    );
    if zeros.len() == seen.len() { Err(said) } else { Ok(Some(said)) }
}

/// Pixel coordinates of the four keypoints, as text.
fn pixels(k: &Keypoints) -> String {
    k.dlo_px.map(|[u, v]| format!("({u:.1}, {v:.1})")).join(" ")
}

/// Points of three successive frames, matched as sets: the third to the first, and the second to the mean of both.
fn matched([a, b, c]: [&[[f64; 2]; 4]; 3]) -> Vec<[[f64; 2]; 3]> {
    let order = KeypointOrder::Unknown.closest(c, a);
    let c = order.map(|k| c[k]);
    let middle = std::array::from_fn(|k| [0.5 * (a[k][0] + c[k][0]), 0.5 * (a[k][1] + c[k][1])]);
    let order = KeypointOrder::Unknown.closest(b, &middle);
    (0..4).map(|k| [a[k], b[order[k]], c[k]]).collect()
}

/// Greatest distance in m between matched points of two frames.
fn farthest_m(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    // Trackers may flip the order between frames, so the frames are matched as sets.
    let order = KeypointOrder::Unknown.closest(b, a);
    let apart = |k: usize| (a[k][0] - b[order[k]][0]).hypot(a[k][1] - b[order[k]][1]);
    (0..4).map(apart).fold(0.0, f64::max)
}

/// Refuses coordinates in fractions of the image instead of pixels.
fn check_pixels(seen: &[(f64, Keypoints)]) -> Result<(), String> {
    let largest = |k: &Keypoints| k.dlo_px.as_flattened().iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let Some((_, first)) = seen.first() else { return Ok(()) };
    // In an image of a few pixels, all coordinates may lie within 1 px of the corner.
    if seen.iter().any(|(_, k)| largest(k) > 1.0 || k.image_width_px.min(k.image_height_px) < 16) {
        return Ok(());
    }
    let [u, v] = first.dlo_px[0];
    Err(format!(
        "{KEYPOINTS}: dlo_u, dlo_v: expected pixels of an image of {} x {}, got numbers within -1 to 1 in all {} frames, the first ({u}, {v}), as if in fractions of the image: multiply them by its size",
        first.image_width_px,
        first.image_height_px,
        seen.len()
    ))
}
