//! Segmentation by a YOLOv8-seg network that the user trained, as in the paper.

mod bilinear;
mod decode;

use std::path::PathBuf;

use catenary_core::image::label;
use catenary_core::{LabelMask, RgbView};

use self::bilinear::bilinear;
pub use self::decode::YoloOutput;
use self::decode::{Detection, detections, paint};
use crate::selection::{Selection, SelectionRules};
use crate::{ColourParams, Error, SegmentationReport, Segmenter};

/// Level of the border around an image that does not fill the network's input, 0 to 255, as `ultralytics` pads.
const BORDER: f32 = 114.0;

/// Parameters of [`YoloSegmenter`] beside those that all segmenters share.
#[derive(Debug, Clone, PartialEq)]
pub struct YoloParams {
    /// ONNX file, as `ultralytics` exports it.
    pub network: PathBuf,
    /// Shared library of the ONNX Runtime, from version 1.17 on.
    pub runtime: PathBuf,
    /// Number of the object's class, and of the target's; none: the network knows no target.
    pub classes: [Option<usize>; 2],
    /// Least confidence of a detection.
    pub min_confidence: f32,
    /// Overlap (intersection over union) of two boxes of a class from which the less confident one is dropped.
    pub max_overlap: f32,
}

impl Default for YoloParams {
    fn default() -> Self {
        Self {
            network: PathBuf::new(),
            runtime: "libonnxruntime.so".into(),
            classes: [Some(0), Some(1)],
            // Values of `ultralytics`.
            min_confidence: 0.25,
            max_overlap: 0.7,
        }
    }
}

/// Network of the YOLOv8-seg family.
pub trait YoloNetwork {
    /// Width and height of the input in pixels.
    fn input_px(&self) -> [usize; 2];

    /// Runs on an image: three planes (red, green, blue) of rows, 0 to 1.
    ///
    /// # Errors
    /// [`Error::Network`] if it cannot run, or gives something else than such a network.
    fn run(&mut self, planes: &[f32]) -> Result<YoloOutput<'_>, Error>;
}

/// Segmenter by a YOLOv8-seg network.
pub struct YoloSegmenter {
    network: Box<dyn YoloNetwork + Send>,
    params: YoloParams,
    shared: ColourParams,
    planes: Vec<f32>,
    logits: Vec<f32>,
    selection: Selection,
}

impl YoloSegmenter {
    /// Builds a segmenter. Of `shared`, crop, mask size and areas count.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the network's input is empty.
    pub fn new(params: YoloParams, shared: ColourParams, network: Box<dyn YoloNetwork + Send>) -> Result<Self, Error> {
        let [width, height] = network.input_px();
        if width == 0 || height == 0 {
            let got = format!("{width} x {height}");
            return Err(Error::Network { expected: "an input of some pixels".to_owned(), got });
        }
        let planes = vec![0.0; 3 * width * height];
        Ok(Self { network, params, shared, planes, logits: Vec::new(), selection: Selection::default() })
    }

    /// Writes the square of the image into the middle of the network's input, and returns how it lies there.
    fn fill(&mut self, image: RgbView<'_>) -> Result<Placed, Error> {
        let [left, top, side] = self.shared.crop.square(image.width(), image.height())?;
        let [width, height] = self.network.input_px();
        let placed = Placed::of(width, height);
        // Image pixels in a pixel of the input.
        let scale = side / f64::from(placed.side);
        self.planes.fill(BORDER / 255.0);
        let size = [image.width(), image.height()].map(|n| n as usize);
        for y in 0..height {
            for x in 0..width {
                let [u, v] = placed.in_square([x as f32 + 0.5, y as f32 + 0.5]);
                if !(0.0..placed.side).contains(&u) || !(0.0..placed.side).contains(&v) {
                    continue;
                }
                let at = [left + scale * f64::from(u), top + scale * f64::from(v)].map(|c| c as f32);
                for c in 0..3 {
                    let level = |u: usize, v: usize| f32::from(image.row(v as u32)[3 * u + c]);
                    self.planes[(c * height + y) * width + x] = bilinear(at, size, level) / 255.0;
                }
            }
        }
        Ok(placed)
    }
}

/// Place of a square in the network's input: the largest one in its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Placed {
    left: f32,
    top: f32,
    side: f32,
}

impl Placed {
    fn of(width: usize, height: usize) -> Self {
        let side = width.min(height);
        let border = |size: usize| ((size - side) / 2) as f32;
        Self { left: border(width), top: border(height), side: side as f32 }
    }

    /// Place in the square of a place in the input.
    fn in_square(self, [x, y]: [f32; 2]) -> [f32; 2] {
        [x - self.left, y - self.top]
    }

    /// Place in the input of a pixel's middle of a mask of `size` x `size` pixels.
    fn of_mask(self, size: u32, u: u32, v: u32) -> [f32; 2] {
        let scale = self.side / size as f32;
        [self.left + scale * (u as f32 + 0.5), self.top + scale * (v as f32 + 0.5)]
    }
}

impl Segmenter for YoloSegmenter {
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error> {
        let placed = self.fill(image)?;
        let size = self.shared.mask_size_px;
        (out.width, out.height) = (size, size);
        out.data.clear();
        out.data.resize((size * size) as usize, label::BACKGROUND);
        let input_px = self.network.input_px();
        let output = self.network.run(&self.planes)?;
        output.check(self.params.classes)?;
        // The target lies over the object.
        for (class, label) in self.params.classes.into_iter().zip([label::DLO, label::TARGET]) {
            let Some(class) = class else { continue };
            let found: Vec<Detection> = detections(&output, class, self.params.min_confidence, self.params.max_overlap);
            for detection in found {
                let place = |u: u32, v: u32| placed.of_mask(size, u, v);
                paint(&output, input_px, &detection, place, label, &mut self.logits, out);
            }
        }
        let ColourParams { min_area_px, max_occlusion_px, min_piece_area_px, .. } = self.shared;
        Ok(self.selection.select(out, &SelectionRules { min_area_px, max_occlusion_px, min_piece_area_px }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::RgbImage;

    /// Network that finds what is bright red in its input: one box, whose mask is the redness at every fourth pixel.
    struct RedFinder {
        size: [usize; 2],
        boxes: Vec<f32>,
        masks: Vec<f32>,
    }

    impl YoloNetwork for RedFinder {
        fn input_px(&self) -> [usize; 2] {
            self.size
        }

        fn run(&mut self, planes: &[f32]) -> Result<YoloOutput<'_>, Error> {
            let [width, height] = self.size;
            let plane = width * height;
            let is_red = |i: usize| planes[i] > 0.6 && planes[plane + i] < 0.3;
            let red: Vec<usize> = (0..plane).filter(|i| is_red(*i)).collect();
            let bound = |of: fn(usize, usize) -> usize, start: usize, least: bool| {
                let all = red.iter().map(|&i| of(i, width));
                if least { all.min() } else { all.max() }.unwrap_or(start) as f32
            };
            let (x0, x1) = (bound(|i, w| i % w, 0, true), bound(|i, w| i % w, 0, false) + 1.0);
            let (y0, y1) = (bound(|i, w| i / w, 0, true), bound(|i, w| i / w, 0, false) + 1.0);
            let sure = if red.is_empty() { 0.0 } else { 0.9 };
            // Centre, size, confidence of the two classes, then the 32 weights of the masks.
            self.boxes = vec![0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0, sure, 0.0];
            self.boxes.extend((0..32).map(|k| if k == 0 { 1.0 } else { 0.0 }));
            let (w, h) = (width / 4, height / 4);
            self.masks = vec![0.0; 32 * w * h];
            for i in 0..w * h {
                let at = (4 * (i / w) + 2) * width + 4 * (i % w) + 2;
                self.masks[i] = if is_red(at) { 8.0 } else { -8.0 };
            }
            Ok(YoloOutput { rows: 38, anchors: 1, boxes: &self.boxes, masks: &self.masks, masks_px: [w, h] })
        }
    }

    fn picture() -> RgbImage {
        let mut image = RgbImage::new(640, 480);
        for v in 200..240 {
            for u in 200..440 {
                let at = 3 * (v * 640 + u);
                image.data[at..at + 3].copy_from_slice(&[230, 20, 30]);
            }
        }
        image
    }

    #[test]
    fn a_detection_becomes_a_mask_at_its_place_for_square_and_wide_inputs() {
        for size in [[256, 256], [640, 480], [256, 320]] {
            let network = Box::new(RedFinder { size, boxes: vec![], masks: vec![] });
            let mut segmenter = YoloSegmenter::new(YoloParams::default(), ColourParams::default(), network).unwrap();
            let mut mask = LabelMask::new(1, 1);
            let report = segmenter.segment(picture().view(), &mut mask).unwrap();
            // The square in the middle begins at column 80: mask pixels are 480 / 256 image pixels.
            let scale = 256.0 / 480.0;
            let [u0, u1, v0, v1] = [120.0, 360.0, 200.0, 240.0].map(|edge: f64| scale * edge);
            let wrong = (0..256 * 256).filter(|i| {
                let (u, v) = (f64::from(i % 256) + 0.5, f64::from(i / 256) + 0.5);
                let near = |x: f64, edge: f64| (x - edge).abs() < 2.6;
                let is_edge = near(u, u0) || near(u, u1) || near(v, v0) || near(v, v1);
                let inside = (u0..u1).contains(&u) && (v0..v1).contains(&v);
                !is_edge && (mask.data[*i as usize] == label::DLO) != inside
            });
            assert_eq!(wrong.count(), 0, "{size:?}");
            assert!((report.dlo_pieces, report.target_area_px) == (1, 0), "{size:?} {report:?}");
        }
    }

    #[test]
    fn an_image_without_the_object_gives_an_empty_mask() {
        let network = Box::new(RedFinder { size: [256, 256], boxes: vec![], masks: vec![] });
        let mut segmenter = YoloSegmenter::new(YoloParams::default(), ColourParams::default(), network).unwrap();
        let mut mask = LabelMask::new(1, 1);
        let report = segmenter.segment(RgbImage::new(640, 480).view(), &mut mask).unwrap();
        assert_eq!(report, SegmentationReport { certainty: 1.0, ..SegmentationReport::default() });
        assert!(mask.data.iter().all(|l| *l == label::BACKGROUND));
    }

    #[test]
    fn a_class_that_the_network_lacks_is_named() {
        let network = Box::new(RedFinder { size: [256, 256], boxes: vec![], masks: vec![] });
        let params = YoloParams { classes: [Some(2), None], ..YoloParams::default() };
        let mut segmenter = YoloSegmenter::new(params, ColourParams::default(), network).unwrap();
        let error = segmenter.segment(picture().view(), &mut LabelMask::new(1, 1)).unwrap_err().to_string();
        assert!(error.contains("more than 2 classes") && error.contains("got 2"), "{error}");
    }
}
