//! Reasons for which no object was found, and other settings of the segmenter that find it.
//!
//! A thin object is removed by an opening that is right for a thick one, and a pale one by limits of colour. A user sees only
//! that nothing was found: the search for the parameter is this program's work.

use super::fit::{Kept, words_of};
use super::frames::Frame;
use super::plausible::{Shape, is_sure};
use anyhow::Result;
use camera::{Backend, ColourParams, ColourRange, Segmenter, SegmenterParams};
use catenary_core::LabelMask;
use catenary_shell::Yaml;
use keypoint_tracker::KeypointTracker;
use serde::Serialize;

/// Greatest number of images that other settings are tried on, spread over those without a sure object.
const TRIED: usize = 12;
/// Factors on the least saturation and chroma of a pale object, and degrees by which a sector of hue is widened to each side.
const PALER: f64 = 0.6;
const DIMMER: f64 = 0.5;
const WIDER_DEG: f64 = 15.0;
/// Least values that the parameters of the learned segmenter and of `yolo` are lowered to.
const LESS_PROBABLE: f32 = 0.3;
const LESS_CERTAIN: f32 = 0.2;

/// Setting that differs from the present one in some parameters.
#[derive(Debug, Clone)]
struct Setting {
    params: SegmenterParams,
    /// Parameters of the node that differ, by name.
    values: Vec<(String, Yaml)>,
}

impl Setting {
    fn with(&self, name: &str, value: Yaml, change: impl FnOnce(&mut SegmenterParams)) -> Self {
        let mut next = self.clone();
        change(&mut next.params);
        next.values.push((name.to_owned(), value));
        next
    }

    fn unopened(&self) -> Self {
        self.with("open_radius_px", Yaml::Integer(0), |params| params.colours.open_radius_px = 0)
    }

    fn paler(&self) -> Self {
        let range = self.params.colours.dlo;
        let saturation = (100.0 * PALER * range.min_saturation).round().max(1.0) / 100.0;
        let chroma = (DIMMER * f64::from(range.min_chroma)).round() as u8;
        self.with("dlo.min_saturation", Yaml::Float(saturation), |params| {
            params.colours.dlo.min_saturation = saturation
        })
        .with("dlo.min_chroma", Yaml::Integer(chroma.into()), |params| params.colours.dlo.min_chroma = chroma)
    }

    fn wider(&self) -> Self {
        let [from, to] = self.params.colours.dlo.hue_deg;
        let hue_deg = [from - WIDER_DEG, to + WIDER_DEG].map(|h| h.rem_euclid(360.0));
        let list = Yaml::List(hue_deg.map(Yaml::Float).to_vec());
        self.with("dlo.hue_deg", list, |params| params.colours.dlo.hue_deg = hue_deg)
    }

    fn learned(&self) -> Self {
        let name = Backend::Learned.name().to_owned();
        self.with("segmenter", Yaml::String(name), |params| params.backend = Backend::Learned)
    }
}

/// Other settings, those nearest to the present one first.
fn settings(present: &SegmenterParams) -> Vec<Setting> {
    let same = Setting { params: present.clone(), values: Vec::new() };
    match present.backend {
        Backend::Colour => {
            let mut all = vec![same.paler(), same.wider()];
            if present.colours.open_radius_px > 0 {
                let unopened = same.unopened();
                all = vec![unopened.clone(), same.paler(), unopened.paler(), same.wider(), unopened.paler().wider()];
            }
            // The colour of the learned segmenter is a parameter of its own: it may be that of another object.
            let is_default = present.colours.dlo == ColourParams::default().dlo;
            if is_default || present.clicked != SegmenterParams::default().clicked {
                all.push(same.learned());
            }
            all.retain(|setting| setting.params.colours.check().is_ok());
            all
        }
        Backend::Learned => {
            let (probable, certain) =
                (present.min_probability.min(LESS_PROBABLE), present.min_certainty.min(LESS_CERTAIN));
            let lower = |setting: &Setting| {
                let value = shortest(probable);
                setting.with("min_probability", value, |params| params.min_probability = probable)
            };
            let surer = same.with("min_certainty", shortest(certain), |p| p.min_certainty = certain);
            vec![surer.clone(), lower(&same), lower(&surer)]
        }
        Backend::Yolo => {
            let least = 0.5 * present.yolo.min_confidence;
            let value = shortest(least);
            vec![same.with("yolo.min_confidence", value, |params| params.yolo.min_confidence = least)]
        }
    }
}

/// Value in the fewest digits that are read back as the same `f32`.
fn shortest(value: f32) -> Yaml {
    Yaml::Float(value.to_string().parse().unwrap_or(f64::from(value)))
}

/// Another setting that finds the object where the present one does not.
#[derive(Debug, Serialize)]
pub struct Found {
    /// Parameters of the node `camera`, in the form of its parameter file.
    pub parameters: Vec<String>,
    /// Images in which it finds the object surely.
    pub images: Vec<String>,
    /// Number of images that it was tried on.
    pub tried: usize,
    #[serde(skip)]
    setting: Setting,
}

impl Found {
    /// Puts the setting into the parameters of the nodes, and into what a file keeps.
    pub fn apply(&self, params: &mut SegmenterParams, kept: &mut Kept) {
        *params = self.setting.params.clone();
        for (name, value) in &self.setting.values {
            kept[0].retain(|(known, _)| known != name);
            kept[0].push((name.clone(), value.clone()));
        }
    }

    /// A line for the terminal.
    pub fn words(&self) -> String {
        let (found, tried) = (self.images.len(), self.tried);
        format!(
            "with {} the object is found in {found} of {tried} images without a sure one ({})",
            self.parameters.join(", "),
            self.images.join(", ")
        )
    }
}

/// Tries other settings on images without a sure object. Returns the one that finds the object in most of them.
pub fn search(
    frames: &[&Frame],
    present: &SegmenterParams,
    build: impl Fn(&SegmenterParams) -> Result<Box<dyn Segmenter + Send>>,
    tracker: &mut dyn KeypointTracker,
) -> Option<Found> {
    let step = frames.len().div_ceil(TRIED).max(1);
    let tried: Vec<&Frame> = frames.iter().copied().step_by(step).collect();
    let mut best: Option<Found> = None;
    for setting in settings(present) {
        // A setting that cannot be built, such as a network that is not there, finds nothing.
        let Ok(mut segmenter) = build(&setting.params) else { continue };
        let mut finds = |frame: &&&Frame| {
            let mut mask = LabelMask::new(1, 1);
            let seen = segmenter.segment(frame.image.view(), &mut mask).ok().zip(tracker.track(&mask).ok());
            seen.is_some_and(|(_, keypoints)| is_sure(&keypoints.scores) && Shape::of_object(&mask).doubts().is_empty())
        };
        let images: Vec<String> = tried.iter().filter(|frame| finds(frame)).map(|frame| frame.name.clone()).collect();
        if images.len() > best.as_ref().map_or(0, |best| best.images.len()) {
            let parameters =
                setting.values.iter().map(|(name, value)| format!("{name}: {}", words_of(value))).collect();
            best = Some(Found { parameters, images, tried: tried.len(), setting });
        }
        if best.as_ref().is_some_and(|best| best.images.len() == tried.len()) {
            break;
        }
    }
    best
}

/// Reason for which no object was found in an image.
pub fn reason(
    frame: &Frame,
    present: &SegmenterParams,
    build: impl Fn(&SegmenterParams) -> Result<Box<dyn Segmenter + Send>>,
) -> String {
    // Pixels of the object with other parameters; none if nothing can be built from them.
    let area = |params: &SegmenterParams| {
        let mut mask = LabelMask::new(1, 1);
        let report = build(params).ok()?.segment(frame.image.view(), &mut mask).ok()?;
        Some((report.dlo_area_px, report.certainty))
    };
    let mut bare = present.clone();
    (bare.colours.min_area_px, bare.colours.min_piece_area_px) = (1, 1);
    match present.backend {
        Backend::Colour => {
            let left = area(&bare).map_or(0, |(area, _)| area);
            let radius = present.colours.open_radius_px;
            if left > 0 {
                let least = present.colours.min_area_px;
                return format!(
                    "{left} px of the mask have its colours, in pieces of fewer than {least} px each, into which the opening cuts a thin object (open_radius_px: {radius})"
                );
            }
            bare.colours.open_radius_px = 0;
            match area(&bare) {
                Some((area, _)) if area > 0 => format!(
                    "{area} px have its colours, but nothing is wider than {} px of the mask, which the opening keeps (open_radius_px: {radius})",
                    2 * radius
                ),
                _ => {
                    let ColourRange { hue_deg: [from, to], min_saturation, min_chroma } = present.colours.dlo;
                    format!(
                        "nothing has its colours (hue {from:.0} to {to:.0} degrees, saturation from {min_saturation:.2}, chroma from {min_chroma})"
                    )
                }
            }
        }
        Backend::Learned => {
            bare.min_certainty = 0.0;
            match area(&bare) {
                Some((area, certainty)) if area > 0 => {
                    format!(
                        "what may be it is certain to {certainty:.2}, less than min_certainty: {}",
                        present.min_certainty
                    )
                }
                _ => format!("nothing has its probability from min_probability: {} on", present.min_probability),
            }
        }
        Backend::Yolo => format!("no box has its class from yolo.min_confidence: {} on", present.yolo.min_confidence),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_settings_are_valid_and_the_nearest_come_first() {
        for backend in Backend::ALL {
            let present = SegmenterParams { backend, ..SegmenterParams::default() };
            let all = settings(&present);
            assert!(!all.is_empty());
            for setting in &all {
                assert!(setting.params != present && !setting.values.is_empty(), "{setting:?}");
                assert_eq!(setting.params.colours.check(), Ok(()));
            }
            let counts: Vec<usize> = all.iter().map(|setting| setting.values.len()).collect();
            assert_eq!(counts[0], 1, "{counts:?}");
        }
        let learned = SegmenterParams { backend: Backend::Learned, ..SegmenterParams::default() };
        let (name, value) = &settings(&learned)[0].values[0];
        assert_eq!((name.as_str(), value), ("min_certainty", &Yaml::Float(0.2)), "and not 0.2 as an f32");
        // A sector that would meet the target's is left out.
        let mut close = SegmenterParams::default();
        close.colours.target.hue_deg = [100.0, 185.0];
        assert!(settings(&close).iter().all(|s| s.values.iter().all(|(name, _)| name != "dlo.hue_deg")));
    }
}
