//! Warm start of a network on new samples. The standardisation changes and the function of the raw inputs stays, so that the
//! training continues where it ended.

use super::{Activations, Network, Samples};
use crate::network::standard::Affine;
use rand::Rng;

impl Network {
    /// Returns this network standardised by `samples` with `weights`. The function stays the same, except for two
    /// approximations: the principal components become those of `samples`, which drops variation outside of their span; and
    /// the bend of the diagonals ([`super::head::DIAGONAL_LIMIT`]) is linearised about their mean.
    pub fn restarted<R: Rng>(&self, samples: &Samples, weights: &[f64], rng: &mut R) -> Self {
        let mut next = self.clone();
        next.standardise(samples, weights, rng);
        next.carry_inputs(self);
        let mut work = Activations::default();
        let raw = self.forward(&self.inputs(samples), &mut work);
        next.carry_outputs(self, &self.mean_outputs(raw, weights));
        next
    }

    /// Rewrites the first layer and the linear path from the inputs of `before` to the inputs of this network.
    fn carry_inputs(&mut self, before: &Network) {
        let layers = self.shape.layers();
        let (inputs, outputs) = layers[0];
        let (weights, biases) = self.shape.offsets()[0];
        let shifts = self.carry_rows(before, weights..weights + inputs * outputs);
        self.parameters[biases..biases + outputs].iter_mut().zip(&shifts).for_each(|(b, s)| *b += s);
        if self.shape.skip {
            let first = self.parameters.len() - self.shape.skip_count();
            let shifts = self.carry_rows(before, first..self.parameters.len());
            // The biases of the last layer stand directly before the linear path.
            self.parameters[first - shifts.len()..first].iter_mut().zip(&shifts).for_each(|(b, s)| *b += s);
        }
    }

    /// Converts rows of weights on the inputs of `before` to rows on this network's inputs. Returns the shift of each row's
    /// bias.
    fn carry_rows(&mut self, before: &Network, at: std::ops::Range<usize>) -> Vec<f32> {
        let (inputs, framed) = (self.shape.inputs(), self.shape.framed());
        let rows = at.len() / inputs;
        let (mut by_framed, mut by_plain) = (Vec::new(), Vec::new());
        for row in self.parameters[at.clone()].chunks_exact(inputs) {
            by_framed.extend_from_slice(&row[..framed]);
            by_plain.extend_from_slice(&row[framed..]);
        }
        let mut shifts = vec![0.0; rows];
        if framed > 0 {
            if let Some(projection) = &before.projection {
                by_framed = projection.apply_transposed(&by_framed);
            }
            let (from, to) = (&before.standard.columns, &self.standard.columns);
            carry_frames(from, to, self.shape.columns(), self.standard.presence, &mut by_framed, &mut shifts);
            if let Some(projection) = &self.projection {
                by_framed = projection.apply_inverse_transposed(&by_framed);
            }
        }
        carry_affine(&before.standard.plain, &self.standard.plain, &mut by_plain, &mut shifts);
        for (i, row) in self.parameters[at].chunks_exact_mut(inputs).enumerate() {
            row[..framed].copy_from_slice(&by_framed[i * framed..(i + 1) * framed]);
            row[framed..].copy_from_slice(&by_plain[i * (inputs - framed)..(i + 1) * (inputs - framed)]);
        }
        shifts
    }

    /// Weighted mean of the raw outputs (N x outputs).
    pub(super) fn mean_outputs(&self, raw: &[f32], weights: &[f64]) -> Vec<f64> {
        let total: f64 = weights.iter().sum();
        let mut mean = vec![0.0; self.shape.head.outputs()];
        for (row, weight) in raw.chunks_exact(mean.len()).zip(weights) {
            mean.iter_mut().zip(row).for_each(|(m, v)| *m += weight / total * f64::from(*v));
        }
        mean
    }

    /// Rewrites the head from the whitened coordinates of `before`, whose mean raw outputs are `mean`, to this network's.
    fn carry_outputs(&mut self, before: &Network, mean: &[f64]) {
        let head = self.shape.head;
        let ((from, spread), (to, narrow)) = (before.standard.theta(), self.standard.theta());
        // v = (u - from) / spread = (narrow v' + to - from) / spread.
        let shrink: Vec<f64> = narrow.iter().zip(spread).map(|(n, s)| n / s).collect();
        let shift: Vec<f64> = (0..head.dimension).map(|i| (from[i] - to[i]) / narrow[i]).collect();
        let mut changes = head.scaled(mean, &shrink);
        let means = head.offsets()[0];
        for (i, change) in changes[means..means + head.components * head.dimension].iter_mut().enumerate() {
            let axis = i % head.dimension;
            *change = (1.0 / shrink[axis], shift[axis]);
        }
        self.change_outputs(&changes);
    }

    /// Multiplies each raw output by the first of its `changes` and adds the second.
    pub(super) fn change_outputs(&mut self, changes: &[(f64, f64)]) {
        let last = self.shape.hidden.len();
        let (inputs, outputs) = self.shape.layers()[last];
        let (weights, biases) = self.shape.offsets()[last];
        let skip = self.parameters.len() - self.shape.skip_count();
        for (output, &(factor, term)) in changes.iter().enumerate() {
            let scale = |values: &mut [f32]| values.iter_mut().for_each(|v| *v *= factor as f32);
            scale(&mut self.parameters[weights + output * inputs..weights + (output + 1) * inputs]);
            if self.shape.skip {
                let width = self.shape.inputs();
                scale(&mut self.parameters[skip + output * width..skip + (output + 1) * width]);
            }
            let bias = &mut self.parameters[biases + output];
            *bias = (f64::from(*bias) * factor + term) as f32;
        }
        debug_assert_eq!(biases + outputs, skip, "the linear path follows the last layer");
    }
}

/// Converts rows of weights on columns standardised by `before` to rows on columns standardised by `after`. Adds the effect
/// of the new centres to the shift of each row. A column that is now constant gets weight zero. The effect of its constant
/// value goes into the shift.
fn carry_affine(before: &Affine, after: &Affine, rows: &mut [f32], shifts: &mut [f32]) {
    if before.centre.is_empty() {
        return;
    }
    for (row, shift) in rows.chunks_exact_mut(before.centre.len()).zip(shifts) {
        for (c, value) in row.iter_mut().enumerate() {
            *shift += carry(before, after, c, value);
        }
    }
}

/// Converts rows of weights on frames of `width` columns, as [`carry_affine`]. In both standardisations all columns of an
/// absent frame are zero, except its presence column. The effect of the other columns' centres is therefore carried by the
/// presence column.
fn carry_frames(
    before: &Affine,
    after: &Affine,
    width: usize,
    presence: Option<usize>,
    rows: &mut [f32],
    shifts: &mut [f32],
) {
    for (row, shift) in rows.chunks_exact_mut(before.centre.len()).zip(shifts) {
        for (frame, values) in row.chunks_exact_mut(width).enumerate() {
            let (mut of_frame, mut of_presence) = (0.0, 0.0);
            for (c, value) in values.iter_mut().enumerate() {
                let moved = carry(before, after, frame * width + c, value);
                *(if presence == Some(c) { &mut of_presence } else { &mut of_frame }) += moved;
            }
            if let Some(c) = presence {
                let (centre, inverse) = (after.centre[frame * width + c], after.inverse_scale[frame * width + c]);
                if inverse > 0.0 {
                    values[c] += of_frame / inverse;
                }
                of_frame *= centre;
            }
            *shift += of_frame + of_presence;
        }
    }
}

/// Converts the weight on column `c` from the standardisation `before` to `after`. Returns the effect of the new centre.
fn carry(before: &Affine, after: &Affine, c: usize, value: &mut f32) -> f32 {
    let by_raw = *value * before.inverse_scale[c];
    *value = if after.inverse_scale[c] > 0.0 { by_raw / after.inverse_scale[c] } else { 0.0 };
    by_raw * (after.centre[c] - before.centre[c])
}
