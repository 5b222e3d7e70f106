//! Choice of the segmenter.

use crate::learned::{Clicked, LearnedParams, LearnedSegmenter, Weights, shipped_weights};
use crate::light_reference::Relit;
use crate::yolo::{YoloNetwork, YoloParams, YoloSegmenter};
use crate::{ColourParams, ColourSegmenter, Error, LightReference, Segmenter};

/// Way to segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// Thresholds on colour.
    #[default]
    Colour,
    /// Network that takes the object's colour as input.
    Learned,
    /// YOLOv8-seg network of the user, as in the paper.
    Yolo,
}

impl Backend {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Colour, Self::Learned, Self::Yolo];

    /// Value of the node's parameter `segmenter`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Learned => "learned",
            Self::Yolo => "yolo",
        }
    }

    /// Returns true if it tells nothing in images without colours.
    #[must_use]
    pub fn needs_colour(self) -> bool {
        self == Self::Colour
    }

    /// Backend of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|backend| backend.name() == name)
    }
}

/// Parameters of all segmenters.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmenterParams {
    /// Chosen segmenter.
    pub backend: Backend,
    /// Colours of the colour segmenter; crop and areas of all segmenters.
    pub colours: ColourParams,
    /// Colours of the object and of the target for the learned segmenter, RGB, 0 to 1.
    pub clicked: Clicked,
    /// Light in which the colours of both were taken; none: every image counts as lit like that one. The segmenter `yolo` needs none.
    pub light: Option<LightReference>,
    /// Probability from which a pixel is the object's or the target's, for the learned segmenter.
    pub min_probability: f32,
    /// Least certainty of the object's mask, for the learned segmenter.
    pub min_certainty: f32,
    /// Weights of the network; none: those that are shipped.
    pub weights: Option<Weights>,
    /// Parameters of the YOLOv8-seg segmenter.
    pub yolo: YoloParams,
}

impl Default for SegmenterParams {
    fn default() -> Self {
        let clicked = [[48, 92, 200], [40, 160, 70]].map(|rgb: [u8; 3]| rgb.map(|c| f32::from(c) / 255.0));
        let (backend, colours) = (Backend::default(), ColourParams::default());
        Self {
            backend,
            colours,
            clicked,
            light: None,
            min_probability: 0.5,
            min_certainty: 0.5,
            weights: None,
            yolo: YoloParams::default(),
        }
    }
}

impl SegmenterParams {
    /// Builds the chosen segmenter. `load` loads the network of `yolo`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a value out of range; [`Error::Weights`] for weights of another network; an error of `load`.
    pub fn build<E: From<Error>>(
        &self,
        load: impl FnOnce(&YoloParams) -> Result<Box<dyn YoloNetwork + Send>, E>,
    ) -> Result<Box<dyn Segmenter + Send>, E> {
        match self.backend {
            Backend::Colour => {
                let segmenter = ColourSegmenter::new(self.colours)?;
                Ok(match self.light {
                    Some(light) => Box::new(Relit::new(segmenter, light, self.colours.crop)),
                    None => Box::new(segmenter),
                })
            }
            Backend::Learned => {
                let weights = self.weights.clone().unwrap_or_else(shipped_weights);
                let ColourParams { crop, min_area_px, max_occlusion_px, min_piece_area_px, .. } = self.colours;
                let Self { clicked, light, min_probability, min_certainty, .. } = *self;
                let params = LearnedParams {
                    clicked,
                    light,
                    crop,
                    min_probability,
                    min_certainty,
                    min_area_px,
                    max_occlusion_px,
                    min_piece_area_px,
                };
                Ok(Box::new(LearnedSegmenter::new(params, weights)?))
            }
            Backend::Yolo => {
                let network = load(&self.yolo)?;
                Ok(Box::new(YoloSegmenter::new(self.yolo.clone(), self.colours, network)?))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_backend_has_its_name_and_only_yolo_loads_a_network() {
        for backend in Backend::ALL {
            assert_eq!(Backend::from_name(backend.name()), Some(backend));
            let params = SegmenterParams { backend, ..SegmenterParams::default() };
            let fault = || Error::Network { expected: "a file".into(), got: "none".into() };
            assert_eq!(params.build(|_| Err(fault())).err(), (backend == Backend::Yolo).then(fault), "{backend:?}");
        }
        assert_eq!(Backend::from_name("sam"), None);
    }
}
