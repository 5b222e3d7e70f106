//! Labelled frames of a laboratory's own camera, for further training.

use catenary_core::RgbView;
use catenary_core::image::label;
use rand::{Rng, RngExt};
use serde::Serialize;

use super::generator::{Picture, seen_in_other_light};
use super::segmenter::{edges, shrink};
use super::size::SIDE;
use crate::{Crop, Error, colour_of_labels};

/// Frame with a label for each pixel, in the size of the network's input.
#[derive(Debug, Clone, Serialize)]
pub struct LabelledFrame {
    pixels: Vec<[f32; 3]>,
    labels: Vec<u8>,
    /// Colours of object and target in the frame; none for a label that it lacks.
    colours: [Option<[f32; 3]>; 2],
}

impl LabelledFrame {
    /// Frame of an image and the labels of its pixels, row by row. The largest square in the middle counts.
    ///
    /// # Errors
    /// [`Error::Labels`] if the labels do not fill the image, or if it holds no object.
    pub fn new(image: RgbView<'_>, labels: &[u8]) -> Result<Self, Error> {
        let of = |label: u8| -> Vec<bool> { labels.iter().map(|l| *l == label).collect() };
        let object = colour_of_labels(image, &of(label::DLO))?;
        let target = colour_of_labels(image, &of(label::TARGET)).ok();
        let mut pixels = vec![[0.0; 3]; SIDE * SIDE];
        shrink(image, Crop::CentredSquare, &mut pixels)?;
        let (columns, rows) = edges(image, Crop::CentredSquare)?;
        let width = image.width() as usize;
        // The label in the middle of a pixel of the network.
        let middle = |(first, end): (usize, usize)| (first + end - 1) / 2;
        let row =
            |&row: &(usize, usize)| columns.iter().map(move |&column| labels[middle(row) * width + middle(column)]);
        Ok(Self { pixels, labels: rows.iter().flat_map(row).collect(), colours: [Some(object), target] })
    }

    /// The frame, mirrored or not and in slightly other light, with the colours of clicks on it.
    pub(super) fn picture(&self, rng: &mut impl Rng) -> Picture {
        let (flips, turns) = ([0, 1].map(|_| rng.random_bool(0.5)), rng.random_bool(0.5));
        let from = |i: usize| {
            let [mut u, mut v] = [i % SIDE, i / SIDE];
            if flips[0] {
                u = SIDE - 1 - u;
            }
            if flips[1] {
                v = SIDE - 1 - v;
            }
            if turns { u * SIDE + v } else { v * SIDE + u }
        };
        let pixels: Vec<[f32; 3]> = (0..SIDE * SIDE).map(|i| self.pixels[from(i)]).collect();
        let labels = (0..SIDE * SIDE).map(|i| self.labels[from(i)]).collect();
        let clicked =
            self.colours.map(|colour| colour.unwrap_or_else(|| [0, 1, 2].map(|_| rng.random_range(0.0..1.0))));
        seen_in_other_light(&pixels, labels, clicked, rng)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{IMAGE_PX, Scene};
    use catenary_core::seed;

    #[test]
    fn a_frame_keeps_its_labels_and_a_turned_one_moves_with_its_pixels() {
        let image = Scene::hanging().image(1);
        // Blue pixels are the object.
        let is_blue = |rgb: &[u8]| rgb[2] > rgb[0].saturating_add(60);
        let labels: Vec<u8> =
            image.data.chunks_exact(3).map(|rgb| if is_blue(rgb) { label::DLO } else { label::BACKGROUND }).collect();
        let frame = LabelledFrame::new(image.view(), &labels).unwrap();
        for stream in 0..4 {
            let picture = frame.picture(&mut seed::rng(1, stream));
            let object: Vec<[f32; 3]> = picture
                .pixels
                .iter()
                .zip(&picture.labels)
                .filter(|(_, l)| **l == label::DLO)
                .map(|(p, _)| *p)
                .collect();
            let blue = object.iter().filter(|p| p[2] > p[0]).count();
            assert!(object.len() > 200 && blue > object.len() * 9 / 10, "{blue} of {}", object.len());
            assert!(picture.clicked[0][2] > picture.clicked[0][0], "{:?}", picture.clicked);
        }
    }

    #[test]
    fn a_frame_without_object_or_with_too_few_labels_is_refused() {
        let image = Scene::hanging().image(1);
        let labels = vec![label::BACKGROUND; (IMAGE_PX[0] * IMAGE_PX[1]) as usize];
        assert!(matches!(LabelledFrame::new(image.view(), &labels), Err(Error::Labels { .. })));
        assert!(matches!(LabelledFrame::new(image.view(), &labels[1..]), Err(Error::Labels { .. })));
    }
}
