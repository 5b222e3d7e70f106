//! Heat maps: from log odds of cells to a place, and back.

use super::grid::{CELLS, KEYPOINTS, middle};
use convnet::Shape;

/// Probability of each cell that a keypoint lies in it.
#[derive(Debug, Clone)]
pub(super) struct Heat {
    pub(super) cells: [f32; CELLS * CELLS],
    /// Mean place, from -1 to 1.
    pub(super) mean: [f32; 2],
}

impl Heat {
    /// Heat of the keypoint `k` by the result of a network: softmax over the cells, and its mean.
    pub(super) fn of(shape: Shape, output: &[f32], k: usize) -> Self {
        let mut cells = [0.0; CELLS * CELLS];
        for (y, row) in cells.chunks_exact_mut(CELLS).enumerate() {
            row.copy_from_slice(&output[shape.row(k, y)]);
        }
        let most = cells.iter().copied().fold(f32::MIN, f32::max);
        cells.iter_mut().for_each(|c| *c = (*c - most).exp());
        let sum: f32 = cells.iter().sum();
        cells.iter_mut().for_each(|c| *c /= sum);
        let mut mean = [0.0; 2];
        for (i, p) in cells.iter().enumerate() {
            mean[0] += p * middle(i % CELLS);
            mean[1] += p * middle(i / CELLS);
        }
        Self { cells, mean }
    }

    /// Heat of all keypoints.
    pub(super) fn all(shape: Shape, output: &[f32]) -> [Self; KEYPOINTS] {
        std::array::from_fn(|k| Self::of(shape, output, k))
    }

    /// Mean square distance from the mean place.
    pub(super) fn spread(&self) -> f32 {
        let square = |i: usize| (middle(i % CELLS) - self.mean[0]).powi(2) + (middle(i / CELLS) - self.mean[1]).powi(2);
        self.cells.iter().enumerate().map(|(i, p)| p * square(i)).sum()
    }

    /// Adds the gradient of a loss by the log odds of keypoint `k` to `pull`, from its gradient by the mean place.
    pub(super) fn pull(&self, shape: Shape, by_mean: [f32; 2], k: usize, pull: &mut [f32]) {
        for y in 0..CELLS {
            for (x, to) in pull[shape.row(k, y)].iter_mut().enumerate() {
                let along = by_mean[0] * (middle(x) - self.mean[0]) + by_mean[1] * (middle(y) - self.mean[1]);
                *to += self.cells[y * CELLS + x] * along;
            }
        }
    }
}

/// Bell of height 1 around a place: exp(-d^2 / width^2).
pub(super) fn bell(place: [f32; 2], width: f32) -> [f32; CELLS * CELLS] {
    std::array::from_fn(|i| {
        let square = (middle(i % CELLS) - place[0]).powi(2) + (middle(i / CELLS) - place[1]).powi(2);
        (-square / (width * width)).exp()
    })
}
