//! From the numbers of a YOLOv8-seg network to labels.

use catenary_core::LabelMask;

use super::bilinear::bilinear;
use crate::Error;

/// Numbers of a box: centre and size.
const BOX: usize = 4;
/// Number of mask prototypes.
const MASKS: usize = 32;

/// Results of the network for an image.
#[derive(Debug, Clone, Copy)]
pub struct YoloOutput<'a> {
    /// Numbers of each anchor: box (centre x and y, width, height, in input pixels), confidence of each class, weights of 32 masks.
    pub rows: usize,
    /// Number of anchors.
    pub anchors: usize,
    /// `rows` x `anchors` numbers.
    pub boxes: &'a [f32],
    /// 32 mask prototypes, as planes of rows.
    pub masks: &'a [f32],
    /// Width and height of a mask prototype.
    pub masks_px: [usize; 2],
}

impl YoloOutput<'_> {
    fn number(&self, row: usize, anchor: usize) -> f32 {
        self.boxes[row * self.anchors + anchor]
    }

    fn classes(&self) -> usize {
        self.rows.saturating_sub(BOX + MASKS)
    }

    /// Returns an error if the numbers are not those of a network with these classes.
    pub(super) fn check(&self, classes: [Option<usize>; 2]) -> Result<(), Error> {
        let plane = self.masks_px[0] * self.masks_px[1];
        if self.boxes.len() != self.rows * self.anchors || self.masks.len() != MASKS * plane || self.classes() == 0 {
            return Err(Error::Network {
                expected: "boxes with classes and the weights of 32 masks, and 32 masks".to_owned(),
                got: format!("{} x {} numbers, and {} of masks", self.rows, self.anchors, self.masks.len()),
            });
        }
        match classes.into_iter().flatten().find(|class| *class >= self.classes()) {
            None => Ok(()),
            Some(class) => {
                let expected = format!("more than {class} classes, by the parameters of the classes");
                Err(Error::Network { expected, got: self.classes().to_string() })
            }
        }
    }
}

/// Box of a detection, and where its numbers stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Detection {
    anchor: usize,
    confidence: f32,
    /// Left, top, right, bottom in input pixels.
    edges: [f32; 4],
}

impl Detection {
    fn area(&self) -> f32 {
        (self.edges[2] - self.edges[0]).max(0.0) * (self.edges[3] - self.edges[1]).max(0.0)
    }

    /// Intersection over union of two boxes.
    fn overlap(&self, other: &Self) -> f32 {
        let [a, b] = [&self.edges, &other.edges];
        let common = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0) * (a[3].min(b[3]) - a[1].max(b[1])).max(0.0);
        let all = self.area() + other.area() - common;
        if all > 0.0 { common / all } else { 0.0 }
    }

    fn holds(&self, [x, y]: [f32; 2]) -> bool {
        (self.edges[0]..self.edges[2]).contains(&x) && (self.edges[1]..self.edges[3]).contains(&y)
    }
}

/// Detections of a class, the most confident first. Of two that overlap, the less confident one is dropped.
pub(super) fn detections(
    output: &YoloOutput<'_>,
    class: usize,
    min_confidence: f32,
    max_overlap: f32,
) -> Vec<Detection> {
    let confidence = |anchor: usize, class: usize| output.number(BOX + class, anchor);
    // An anchor belongs to its most confident class.
    let is_its = |anchor: usize| {
        let own = confidence(anchor, class);
        own >= min_confidence && (0..output.classes()).all(|other| confidence(anchor, other) <= own)
    };
    let detection = |anchor: usize| {
        let [x, y, width, height] = [0, 1, 2, 3].map(|row| output.number(row, anchor));
        let edges = [x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height];
        Detection { anchor, confidence: confidence(anchor, class), edges }
    };
    let mut all: Vec<Detection> = (0..output.anchors).filter(|a| is_its(*a)).map(detection).collect();
    all.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let mut kept: Vec<Detection> = Vec::new();
    for one in all {
        if kept.iter().all(|k| k.overlap(&one) <= max_overlap) {
            kept.push(one);
        }
    }
    kept
}

/// Labels the pixels of a detection: those in its box whose mask is positive. `place` gives a mask pixel's place in the input.
pub(super) fn paint(
    output: &YoloOutput<'_>,
    input_px: [usize; 2],
    detection: &Detection,
    place: impl Fn(u32, u32) -> [f32; 2],
    label: u8,
    logits: &mut Vec<f32>,
    out: &mut LabelMask,
) {
    let [width, height] = output.masks_px;
    let plane = width * height;
    logits.clear();
    logits.resize(plane, 0.0);
    let first = output.rows - MASKS;
    for k in 0..MASKS {
        let weight = output.number(first + k, detection.anchor);
        for (sum, mask) in logits.iter_mut().zip(&output.masks[k * plane..(k + 1) * plane]) {
            *sum += weight * mask;
        }
    }
    let scale = [width as f32 / input_px[0] as f32, height as f32 / input_px[1] as f32];
    for v in 0..out.height {
        for u in 0..out.width {
            let at = place(u, v);
            if !detection.holds(at) {
                continue;
            }
            let logit = |u: usize, v: usize| logits[v * width + u];
            if bilinear([scale[0] * at[0], scale[1] * at[1]], output.masks_px, logit) > 0.0 {
                out.data[(v * out.width + u) as usize] = label;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Anchors of two classes: box and two confidences.
    fn output(anchors: &[[f32; 6]]) -> (Vec<f32>, usize) {
        let mut boxes = vec![0.0; 38 * anchors.len()];
        for (a, numbers) in anchors.iter().enumerate() {
            for (row, number) in numbers.iter().enumerate() {
                boxes[row * anchors.len() + a] = *number;
            }
        }
        (boxes, anchors.len())
    }

    #[test]
    fn of_overlapping_boxes_the_most_confident_stays_and_classes_do_not_mix() {
        let (boxes, anchors) = output(&[
            [50.0, 50.0, 40.0, 40.0, 0.6, 0.1],
            [52.0, 50.0, 40.0, 40.0, 0.9, 0.1],
            [150.0, 50.0, 40.0, 40.0, 0.5, 0.2],
            [50.0, 50.0, 40.0, 40.0, 0.3, 0.8],
            [200.0, 50.0, 40.0, 40.0, 0.2, 0.1],
        ]);
        let masks = vec![0.0; 32];
        let output = YoloOutput { rows: 38, anchors, boxes: &boxes, masks: &masks, masks_px: [1, 1] };
        let of = |class| detections(&output, class, 0.25, 0.7).iter().map(|d| d.anchor).collect::<Vec<_>>();
        assert_eq!((of(0), of(1)), (vec![1, 2], vec![3]));
        // Boxes shifted by 2 of 40 pixels overlap by 38 / 42.
        assert_eq!(detections(&output, 0, 0.25, 0.91).len(), 3);
    }

    #[test]
    fn numbers_of_another_network_are_refused() {
        let (boxes, masks) = (vec![0.0; 38], vec![0.0; 32]);
        let good = YoloOutput { rows: 38, anchors: 1, boxes: &boxes, masks: &masks, masks_px: [1, 1] };
        assert_eq!(good.check([Some(1), None]), Ok(()));
        // A detector without masks.
        assert!(YoloOutput { rows: 6, boxes: &boxes[..6], ..good }.check([Some(0), None]).is_err());
        assert!(YoloOutput { masks: &masks[..16], ..good }.check([Some(0), None]).is_err());
        assert!(good.check([Some(0), Some(2)]).is_err());
    }
}
