//! Colours from clicks or labels, and the parameter file with them.

use super::args::MaskArgs;
use super::frames::{self, Frame};
use super::plausible::{Shape, is_on};
use crate::exit::{Given, WrongInput};
use crate::report::number::percent;
use crate::terminal::output;
use anyhow::{Context, Result};
use camera::{
    Backend, ColourFit, ColourParams, ColourRange, LightReference, SegmenterParams, colour_of_clicks, colour_of_labels,
    fit_colours, pixels_of_clicks,
};
use catenary_core::image::label;
use catenary_core::{LabelMask, RgbImage};
use catenary_shell::Yaml;
use serde::Serialize;
use std::path::Path;

/// Gain between two pictures, less 1, from which on they are in other light.
const OTHER_LIGHT: f32 = 0.15;

/// Look that was fitted for a label.
#[derive(Debug, Serialize)]
pub struct Fitted {
    /// Label, `dlo` or `target`.
    label: &'static str,
    #[serde(flatten)]
    look: Colours,
    /// Reasons for which what has this look is no object or target.
    doubts: Vec<String>,
}

/// Look of the object or of the target, as a segmenter takes it.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Colours {
    /// Limits of the colour segmenter.
    Limits {
        hue_deg: [f64; 2],
        min_saturation: f64,
        min_chroma: u8,
        /// Share of the label's pixels that have the colours.
        found: f64,
        /// Share of the pixels with the colours that are not the label's.
        false_share: f64,
    },
    /// Colour of the learned segmenter, each part 0 to 255.
    Clicked { clicked_rgb: [u8; 3] },
}

impl Fitted {
    /// A line for the terminal.
    pub fn words(&self) -> String {
        let name = self.name();
        let said = match &self.look {
            Colours::Limits { hue_deg: [from, to], min_saturation, min_chroma, found, false_share } => format!(
                "{name}: hue {from:.0} to {to:.0} degrees, saturation from {min_saturation:.2}, chroma from {min_chroma}; {} of it has these colours, {} of what has them is something else",
                percent(*found),
                percent(*false_share)
            ),
            Colours::Clicked { clicked_rgb: [r, g, b] } => format!("{name}: red {r}, green {g}, blue {b} of 255"),
        };
        match self.doubts.as_slice() {
            [] => said,
            doubts => format!("{said}\n{name}: DOUBTFUL, what has this look is hardly it: {}", doubts.join("; ")),
        }
    }

    /// Word for the label.
    fn name(&self) -> &'static str {
        if self.label == "dlo" { "object" } else { "target" }
    }

    /// Sentence about what has the look and is hardly the object or target; none without doubts.
    pub fn doubt(&self) -> Option<String> {
        let say = || format!("what has the look of the {} is hardly it: {}", self.name(), self.doubts.join("; "));
        (!self.doubts.is_empty()).then(say)
    }

    /// Judges the look by the mask of the image that it was fitted to. `square` is the part of the image that the mask shows.
    pub fn judge(&mut self, arguments: &MaskArgs, mask: &LabelMask, square: [f64; 3]) {
        let (shape, clicks, label) = match self.label {
            "dlo" => (Shape::of_object(mask), &arguments.click, label::DLO),
            _ => (Shape::of_target(mask), &arguments.click_target, label::TARGET),
        };
        self.doubts = shape.doubts();
        if shape.is_there() && !clicks.is_empty() && !clicks.iter().any(|click| is_on(*click, mask, square, label)) {
            self.doubts.push("it is not at the click".to_owned());
        }
    }
}

/// Fits what the command line asks for, and puts it into `params`.
///
/// # Errors
/// A click outside the image, labels of another size, or an object without a colour, for the colour segmenter.
pub fn fit(arguments: &MaskArgs, first: &Frame, params: &mut SegmenterParams) -> Result<Vec<Fitted>> {
    let labels = arguments.labels.as_deref().map(|path| labels(path, &first.image)).transpose()?;
    let object = Marked { option: "--click", clicks: &arguments.click, labels: labels.as_deref() };
    let target = Marked { option: "--click-target", clicks: &arguments.click_target, labels: None };
    let mut fits = Vec::new();
    for (label, index, marked) in [("dlo", 0, object), ("target", 1, target)] {
        if marked.clicks.is_empty() && marked.labels.is_none() {
            continue;
        }
        let option = if marked.labels.is_some() { "--labels" } else { marked.option };
        let named = || format!("{option}: {}", first.name);
        let look = match params.backend {
            Backend::Colour => {
                let ColourFit { range, found, false_share } =
                    marked.limits(&first.image).with_context(named).given()?;
                *[&mut params.colours.dlo, &mut params.colours.target][index] = range;
                let ColourRange { hue_deg, min_saturation, min_chroma } = range;
                Colours::Limits { hue_deg, min_saturation, min_chroma, found, false_share }
            }
            // A network of the user needs no colour.
            Backend::Yolo => {
                return Err(WrongInput::error(format!("{option}: the segmenter yolo takes no colours")));
            }
            Backend::Learned => {
                let colour = marked.colour(&first.image).with_context(named).given()?;
                params.clicked[index] = colour;
                Colours::Clicked { clicked_rgb: rgb(colour) }
            }
        };
        fits.push(Fitted { label, look, doubts: Vec::new() });
    }
    if !fits.is_empty() {
        let light = LightReference::of(first.image.view(), params.colours.crop);
        let light = light.with_context(|| first.name.clone()).given()?;
        let changes = |before: LightReference| before.gains_to(&light).iter().any(|g| (g - 1.0).abs() > OTHER_LIGHT);
        if let [Fitted { label, .. }] = fits.as_slice()
            && params.light.is_some_and(changes)
        {
            let other = if *label == "dlo" { "target" } else { "object" };
            output::warn(&format!(
                "the colours of the {other} were taken in other light than that of {}: click on it in this picture, too",
                first.name
            ));
        }
        params.light = Some(light);
    }
    if let (Backend::Colour, [Fitted { label, .. }]) = (params.backend, fits.as_slice()) {
        give_way(&mut params.colours, label);
    }
    Ok(fits)
}

/// What a user marked as the object or the target.
struct Marked<'a> {
    option: &'static str,
    clicks: &'a [[u32; 2]],
    labels: Option<&'a [bool]>,
}

impl Marked<'_> {
    fn limits(&self, image: &RgbImage) -> Result<ColourFit, camera::Error> {
        match self.labels {
            Some(labels) => fit_colours(image.view(), labels),
            None => fit_colours(image.view(), &pixels_of_clicks(image.view(), self.clicks)?),
        }
    }

    fn colour(&self, image: &RgbImage) -> Result<[f32; 3], camera::Error> {
        match self.labels {
            Some(labels) => colour_of_labels(image.view(), labels),
            None => colour_of_clicks(image.view(), self.clicks),
        }
    }
}

/// Colours that nobody asked for give way to the fitted ones of `label`.
fn give_way(colours: &mut ColourParams, label: &str) {
    if !colours.dlo.meets(&colours.target) {
        return;
    }
    let (other, hue_deg) = if label == "dlo" {
        colours.target = colours.dlo.opposite();
        ("target", colours.target.hue_deg)
    } else {
        colours.dlo = colours.target.opposite();
        ("object", colours.dlo.hue_deg)
    };
    let [from, to] = hue_deg;
    output::warn(&format!(
        "the {other}'s colours were the fitted ones: its hue is now {from:.0} to {to:.0} degrees; click on it, too, if there is one"
    ));
}

/// True where a picture is white.
fn labels(path: &Path, of: &RgbImage) -> Result<Vec<bool>> {
    let image = frames::picture(path)?.image;
    if [image.width, image.height] != [of.width, of.height] {
        let (name, w, h) = (path.display(), of.width, of.height);
        let got = format!("{} x {}", image.width, image.height);
        return Err(WrongInput::error(format!("--labels {name}: expected {w} x {h} pixels, as the image, got {got}")));
    }
    Ok(image.data.chunks_exact(3).map(|rgb| rgb[0] >= 128).collect())
}

fn rgb(colour: [f32; 3]) -> [u8; 3] {
    colour.map(|c| (255.0 * c).round() as u8)
}

/// Values of the two nodes' parameters in a file, which the written file keeps: by node, with the parameters' names.
pub type Kept = [Vec<(String, Yaml)>; 2];

/// Parameter file of both nodes with these looks, and with the other values that the present file gives.
pub fn parameter_file(params: &SegmenterParams, tracker: keypoint_tracker::Backend, kept: &Kept) -> String {
    let mut camera = vec![("segmenter".to_owned(), params.backend.name().to_owned())];
    let ranges = [&params.colours.dlo, &params.colours.target];
    for ((label, range), clicked) in ["dlo", "target"].into_iter().zip(ranges).zip(params.clicked) {
        let mut add = |name: &str, value: String| camera.push((format!("{label}.{name}"), value));
        match params.backend {
            Backend::Colour => {
                let [from, to] = range.hue_deg;
                add("hue_deg", format!("[{from:.1}, {to:.1}]"));
                add("min_saturation", format!("{:.2}", range.min_saturation));
                add("min_chroma", range.min_chroma.to_string());
            }
            Backend::Yolo => {}
            Backend::Learned => {
                let [r, g, b] = rgb(clicked);
                add("clicked_rgb", format!("[{r}.0, {g}.0, {b}.0]"));
            }
        }
    }
    if let Some(light) = &params.light {
        let levels: Vec<String> = light.values().iter().map(|v| format!("{v:.1}")).collect();
        camera.push(("light_reference".to_owned(), format!("[{}]", levels.join(", "))));
    }
    // The file's own tracker and its weights give way to the one that ran.
    let given = |name: &str| kept[1].iter().find(|(given, _)| given == name).map(|(_, value)| words_of(value));
    let is_another = given("tracker").is_some_and(|given| given != format!("{:?}", tracker.name()));
    let mut tracking = Vec::new();
    if tracker != keypoint_tracker::Backend::default() || is_another {
        tracking.push(("tracker".to_owned(), tracker.name().to_owned()));
    }
    let mut lines = vec!["# Look of object and target, from `catenary mask`.".to_owned()];
    for ((node, mut own), kept) in [("camera", camera), ("keypoint_tracker", tracking)].into_iter().zip(kept) {
        let drops_weights = node == "keypoint_tracker" && is_another;
        let others = kept
            .iter()
            .filter(|(name, _)| !(own.iter().any(|(own, _)| own == name) || drops_weights && name == "weights"));
        let others: Vec<(String, String)> = others.map(|(name, value)| (name.clone(), words_of(value))).collect();
        own.extend(others);
        if !own.is_empty() {
            lines.extend([format!("{node}:"), "  ros__parameters:".to_owned()]);
            lines.extend(own.iter().map(|(name, value)| format!("    {name}: {value}")));
        }
    }
    lines.join("\n") + "\n"
}

/// Value as a parameter file has it.
pub fn words_of(value: &Yaml) -> String {
    match value {
        Yaml::Bool(value) => value.to_string(),
        Yaml::Integer(value) => value.to_string(),
        // With a point, as only that makes a number a float.
        Yaml::Float(value) => format!("{value:?}"),
        Yaml::String(text) => format!("{text:?}"),
        Yaml::List(items) => format!("[{}]", items.iter().map(words_of).collect::<Vec<_>>().join(", ")),
    }
}
