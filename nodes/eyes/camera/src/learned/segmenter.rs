//! The trained network as a segmenter.

use catenary_core::image::label;
use catenary_core::{LabelMask, RgbView};
use convnet::{Net, Pass, WeightsError};

use super::network::{Clicked, Weights, fill, network, row};
use super::size::SIDE;
use crate::selection::{Selection, SelectionRules};
use crate::{Crop, Error, LightReference, SegmentationReport, Segmenter};

/// Log odds below which a pixel adds nothing: all pixels of a mask with them are less than one.
const NEGLIGIBLE: f32 = -9.0;

/// Parameters of [`LearnedSegmenter`]. Lengths and areas are in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedParams {
    /// Colours of the object and of the target at a click, RGB, 0 to 1.
    pub clicked: Clicked,
    /// Light in which these colours were taken; none: every image counts as lit like that one.
    pub light: Option<LightReference>,
    /// Part of the image that becomes the mask.
    pub crop: Crop,
    /// Probability from which a pixel is the object's or the target's.
    pub min_probability: f32,
    /// Least certainty of the object's mask, 0 to 1. An object with less counts as not found.
    pub min_certainty: f32,
    /// Least area of the object and of the target. Smaller regions are dropped as noise.
    pub min_area_px: usize,
    /// Largest distance at which two pieces of the object are both kept, whatever lies between.
    pub max_occlusion_px: u32,
    /// Least area of a piece that is kept beside the largest one.
    pub min_piece_area_px: usize,
}

/// Segmenter by the trained network. After the first image of a size nothing is allocated.
#[derive(Debug, Clone)]
pub struct LearnedSegmenter {
    params: LearnedParams,
    net: Net,
    weights: Weights,
    pass: Pass,
    /// Mean colours of the mask's pixels, 0 to 1.
    pixels: Vec<[f32; 3]>,
    selection: Selection,
}

impl LearnedSegmenter {
    /// Builds a segmenter.
    ///
    /// # Errors
    /// [`Error::Weights`] for weights of another network; [`Error::Parameter`] for a value out of range.
    pub fn new(params: LearnedParams, weights: Weights) -> Result<Self, Error> {
        let net = network();
        if weights.len() != net.weights() {
            return Err(WeightsError { expected: net.weights(), got: weights.len().to_string() }.into());
        }
        if !(params.min_probability > 0.0 && params.min_probability < 1.0) {
            let got = params.min_probability.to_string();
            return Err(Error::Parameter { field: "min_probability", expected: "more than 0 and less than 1", got });
        }
        if !(0.0..=1.0).contains(&params.min_certainty) {
            let got = params.min_certainty.to_string();
            return Err(Error::Parameter { field: "min_certainty", expected: "0 to 1", got });
        }
        let pass = Pass::new(&net);
        Ok(Self { params, net, weights, pass, pixels: vec![[0.0; 3]; SIDE * SIDE], selection: Selection::default() })
    }
}

impl Segmenter for LearnedSegmenter {
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error> {
        shrink(image, self.params.crop, &mut self.pixels)?;
        let mut clicked = self.params.clicked;
        if let Some(light) = self.params.light {
            // The colours that a click would give now. The image keeps its light: clipped pixels cannot be recovered.
            let gains = light.gains_to(&LightReference::of(image, self.params.crop)?);
            clicked = clicked.map(|colour| std::array::from_fn(|c| (gains[c] * colour[c]).min(1.0)));
        }
        let (net, pixels) = (&self.net, &self.pixels);
        fill(net, self.pass.input(), &clicked, |i| pixels[i]);
        self.pass.run(net, &self.weights);
        (out.width, out.height) = (SIDE as u32, SIDE as u32);
        out.data.clear();
        out.data.resize(SIDE * SIDE, label::BACKGROUND);
        let least = (self.params.min_probability / (1.0 - self.params.min_probability)).ln();
        for (v, labels) in out.data.chunks_exact_mut(SIDE).enumerate() {
            let (object, target) = (row(net, &self.pass, 0, v), row(net, &self.pass, 1, v));
            for ((out, &object), &target) in labels.iter_mut().zip(object).zip(target) {
                if object >= least && object >= target {
                    *out = label::DLO;
                } else if target >= least {
                    *out = label::TARGET;
                }
            }
        }
        let LearnedParams { min_area_px, max_occlusion_px, min_piece_area_px, .. } = self.params;
        let report = self.selection.select(out, &SelectionRules { min_area_px, max_occlusion_px, min_piece_area_px });
        let certainty = self.certainty(out);
        if certainty >= self.params.min_certainty {
            return Ok(SegmentationReport { certainty, ..report });
        }
        // An object of which a part is in doubt has its keypoints elsewhere.
        out.data.iter_mut().filter(|l| **l == label::DLO).for_each(|l| *l = label::BACKGROUND);
        let dropped_px = report.dropped_px + report.dlo_area_px;
        Ok(SegmentationReport { dlo_area_px: 0, dlo_pieces: 0, dropped_px, certainty, ..report })
    }
}

impl LearnedSegmenter {
    /// Expected intersection over union of the object's mask with the object: the probabilities in the mask, over its area and the
    /// probabilities outside.
    fn certainty(&self, mask: &LabelMask) -> f32 {
        let (mut inside, mut area, mut outside) = (0.0, 0.0, 0.0);
        for (v, labels) in mask.data.chunks_exact(SIDE).enumerate() {
            for (label, odds) in labels.iter().zip(row(&self.net, &self.pass, 0, v)) {
                if *label == label::DLO {
                    inside += 1.0 / (1.0 + (-odds).exp());
                    area += 1.0;
                } else if *odds > NEGLIGIBLE {
                    outside += 1.0 / (1.0 + (-odds).exp());
                }
            }
        }
        if area == 0.0 { 1.0 } else { inside / (area + outside) }
    }
}

/// Columns and rows of the image that belong to those of the mask, each from its first to its end.
pub(super) type Edges = [(usize, usize); SIDE];

/// Columns and rows of the image for the mask's. A mask pixel counts the image pixels whose centres lie in it, at least the nearest one.
pub(super) fn edges(image: RgbView<'_>, crop: Crop) -> Result<(Edges, Edges), Error> {
    let [left, top, side] = crop.square(image.width(), image.height())?;
    let edges = |start: f64, most: u32| -> Edges {
        let scale = side / SIDE as f64;
        std::array::from_fn(|i| {
            let low = (start + scale * i as f64).round() as usize;
            let high = (start + scale * (i + 1) as f64).round() as usize;
            let low = low.min(most as usize - 1);
            (low, high.clamp(low + 1, most as usize))
        })
    };
    Ok((edges(left, image.width()), edges(top, image.height())))
}

/// Writes the mean colours of the mask's pixels.
pub(super) fn shrink(image: RgbView<'_>, crop: Crop, pixels: &mut [[f32; 3]]) -> Result<(), Error> {
    let (columns, rows) = edges(image, crop)?;
    for (out, &(first, end)) in pixels.chunks_exact_mut(SIDE).zip(&rows) {
        out.fill([0.0; 3]);
        for v in first..end {
            let row = image.row(v as u32);
            for (out, &(from, to)) in out.iter_mut().zip(&columns) {
                let share = 1.0 / (255.0 * ((end - first) * (to - from)) as f32);
                for rgb in row[3 * from..3 * to].as_chunks::<3>().0 {
                    (0..3).for_each(|c| out[c] += share * f32::from(rgb[c]));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour_of_clicks;
    use crate::learned::shipped_weights;
    use crate::scene::Scene;

    #[test]
    fn a_shrunk_image_has_the_mean_colours() {
        let image = Scene::hanging().image(1);
        let mut pixels = vec![[0.0; 3]; SIDE * SIDE];
        shrink(image.view(), Crop::CentredSquare, &mut pixels).unwrap();
        // Wall in the upper left corner, table in the lower left one.
        let close = |p: [f32; 3], level: f32| p.iter().all(|c| (c - level / 255.0).abs() < 0.06);
        assert!(close(pixels[0], 222.0) && close(pixels[SIDE * (SIDE - 1)], 135.0), "{:?}", pixels[0]);
    }

    fn params() -> LearnedParams {
        LearnedParams {
            clicked: [[0.2, 0.3, 0.8], [0.2, 0.6, 0.3]],
            light: None,
            crop: Crop::CentredSquare,
            min_probability: 0.5,
            min_certainty: 0.0,
            min_area_px: 20,
            max_occlusion_px: 40,
            min_piece_area_px: 6,
        }
    }

    /// Intersection over union of the bar with the truth, by the shipped weights. The colour is that of a click on the bar in `clicked_in`.
    fn overlap(scene: &Scene, clicked_in: &Scene, seed: u64) -> f64 {
        let click = |scene: &Scene| colour_of_clicks(scene.image(seed + 50).view(), &[[361, 249]]).unwrap();
        // As `catenary mask` fits them: colour and light of one picture.
        let light = LightReference::of(clicked_in.image(seed + 50).view(), Crop::CentredSquare).ok();
        let params = LearnedParams { clicked: [click(clicked_in), [0.9, 0.1, 0.9]], light, ..params() };
        let mut mask = LabelMask::new(1, 1);
        let mut segmenter = LearnedSegmenter::new(params, shipped_weights()).unwrap();
        segmenter.segment(scene.image(seed).view(), &mut mask).unwrap();
        let truth = scene.truth();
        let pairs = mask.data.iter().zip(&truth.data).map(|(a, b)| (*a == label::DLO, *b == label::DLO));
        let (mut both, mut either) = (0.0, 0.0);
        for (a, b) in pairs {
            both += f64::from(u8::from(a && b));
            either += f64::from(u8::from(a || b));
        }
        both / either
    }

    #[test]
    fn the_shipped_weights_find_a_bar_of_any_colour_in_other_light_than_that_of_the_click() {
        for (k, hue_shift_deg) in [-150.0, -90.0, -30.0, 0.0, 60.0, 120.0].into_iter().enumerate() {
            let clicked_in = Scene { hue_shift_deg, target: None, ..Scene::hanging() };
            for (gain, noise) in [(1.0, 4.0), (0.6, 4.0), (1.0, 20.0)] {
                let scene = Scene { gain, noise, ..clicked_in.clone() };
                let found = overlap(&scene, &clicked_in, k as u64);
                println!("hue shifted by {hue_shift_deg} degrees, gain {gain}, noise {noise}: {found:.3}");
                // The bar is four pixels wide: half a pixel on both sides changes the overlap by a fifth.
                assert!(found > 0.70, "hue shifted by {hue_shift_deg} degrees, gain {gain}, noise {noise}: {found:.3}");
            }
        }
    }

    #[test]
    fn weights_of_another_network_and_a_bad_threshold_are_refused() {
        let params = params();
        assert!(matches!(LearnedSegmenter::new(params, vec![0.0; 3]), Err(Error::Weights(_))));
        let weights = vec![0.0; network().weights()];
        let bad = LearnedParams { min_probability: 1.0, ..params };
        assert!(matches!(LearnedSegmenter::new(bad, weights.clone()), Err(Error::Parameter { .. })));
        // Weights of zero give even odds everywhere, and then everything is the object.
        let mut mask = LabelMask::new(1, 1);
        let report = LearnedSegmenter::new(params, weights.clone())
            .unwrap()
            .segment(Scene::hanging().image(1).view(), &mut mask)
            .unwrap();
        assert_eq!((report.dlo_area_px, report.certainty), (SIDE * SIDE, 0.5));
        // Even odds are too little if more is asked for.
        let strict = LearnedParams { min_certainty: 0.6, ..params };
        let report = LearnedSegmenter::new(strict, weights)
            .unwrap()
            .segment(Scene::hanging().image(1).view(), &mut mask)
            .unwrap();
        assert_eq!((report.dlo_area_px, report.dropped_px, report.certainty), (0, SIDE * SIDE, 0.5));
        assert!(mask.data.iter().all(|l| *l != label::DLO));
    }
}
