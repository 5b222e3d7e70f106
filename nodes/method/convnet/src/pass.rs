//! Values and gradients of one sample.

use crate::kernels::{self, Conv};
use crate::net::{BLOCK, Layer, Net, Shape};

/// Variance below which a value counts as constant.
const LEAST_VARIANCE: f32 = 1e-5;

/// Buffers for the values and the gradients of one sample. Reused from sample to sample.
#[derive(Debug, Clone)]
pub struct Pass {
    values: Vec<Vec<f32>>,
    pulls: Vec<Vec<f32>>,
    /// Mean and inverse deviation of each `Norm`.
    moments: Vec<[f32; 2]>,
    turned: Vec<f32>,
    back: Vec<f32>,
    part: Vec<f32>,
}

impl Pass {
    /// Buffers for a network.
    #[must_use]
    pub fn new(net: &Net) -> Self {
        let values = (0..=net.layers().len()).map(|k| vec![0.0; net.shape(k).len()]).collect();
        Self {
            values,
            pulls: Vec::new(),
            moments: vec![[0.0, 1.0]; net.layers().len()],
            turned: vec![],
            back: vec![],
            part: vec![],
        }
    }

    /// Planes of the input with their borders, to be filled inside of the borders.
    pub fn input(&mut self) -> &mut [f32] {
        &mut self.values[0]
    }

    /// Planes of value `k` with their borders.
    #[must_use]
    pub fn value(&self, k: usize) -> &[f32] {
        &self.values[k]
    }

    /// Planes of the result with their borders.
    #[must_use]
    pub fn output(&self) -> &[f32] {
        &self.values[self.values.len() - 1]
    }

    /// Computes all values from the input.
    ///
    /// # Panics
    /// If the number of weights or the buffers are not those of the network.
    pub fn run(&mut self, net: &Net, weights: &[f32]) {
        assert_eq!(weights.len(), net.weights(), "weights of another network");
        for (k, layer) in net.layers().iter().enumerate() {
            let (before, after) = self.values.split_at_mut(k + 1);
            let out = &mut after[0];
            let weights = &weights[net.place(k)];
            match *layer {
                Layer::Conv { from, channels, side, rectified } => {
                    let (input, shape) = (&before[from], net.shape(from));
                    kernels::conv(Conv { input, shape, weights, out, channels, side, rectified });
                }
                Layer::Norm { from } => self.moments[k] = normalise(&before[from], net.shape(from), weights, out),
                Layer::Join { a, b } => {
                    let (first, second) = out.split_at_mut(before[a].len());
                    first.copy_from_slice(&before[a]);
                    second.copy_from_slice(&before[b]);
                }
                Layer::Add { a, b } => {
                    for ((out, x), y) in out.iter_mut().zip(&before[a]).zip(&before[b]) {
                        *out = x + y;
                    }
                }
                Layer::Pack { from } => pack(&before[from], net.shape(from), out, |out, value| *out = value),
                Layer::Unpack { from } => unpack(&before[from], net.shape(from), out, |out, value| *out = value),
            }
        }
    }

    /// The result, and the gradient of the loss by it, to be filled inside of its borders before [`Pass::pull_back`].
    pub fn result(&mut self, net: &Net) -> (&[f32], &mut [f32]) {
        if self.pulls.is_empty() {
            self.pulls = self.values.iter().map(|v| vec![0.0; v.len()]).collect();
        }
        let last = net.layers().len();
        (&self.values[last], &mut self.pulls[last])
    }

    /// Adds the gradient of the loss by all weights to `gradient`, after [`Pass::run`] with the same weights.
    pub fn pull_back(&mut self, net: &Net, weights: &[f32], gradient: &mut [f32]) {
        self.lead_back(net, weights, gradient, false);
    }

    /// Does as [`Pass::pull_back`], and returns the gradient of the loss by the input, for a network that continues another one.
    pub fn pull_back_to_input(&mut self, net: &Net, weights: &[f32], gradient: &mut [f32]) -> &[f32] {
        self.lead_back(net, weights, gradient, true);
        &self.pulls[0]
    }

    fn lead_back(&mut self, net: &Net, weights: &[f32], gradient: &mut [f32], to_input: bool) {
        let count = net.layers().len();
        for pull in &mut self.pulls[..count] {
            pull.fill(0.0);
        }
        for k in (0..count).rev() {
            let (before, after) = self.pulls.split_at_mut(k + 1);
            let pull = &mut after[0];
            let (place, out) = (net.place(k), &self.values[k + 1]);
            match net.layers()[k] {
                Layer::Conv { from, channels, side, rectified } => {
                    if rectified {
                        for (pull, value) in pull.iter_mut().zip(out) {
                            *pull = if *value > 0.0 { *pull } else { 0.0 };
                        }
                    }
                    let shape = net.shape(from);
                    let part = &mut self.part;
                    kernels::weight_gradient(
                        &self.values[from],
                        shape,
                        pull,
                        [channels, side],
                        &mut gradient[place.clone()],
                        part,
                    );
                    // The input of the first network needs no gradient.
                    if from > 0 || to_input {
                        self.back.clear();
                        self.back.resize(shape.len().div_ceil(BLOCK * shape.plane()) * BLOCK * shape.plane(), 0.0);
                        turn(&weights[place], [channels, shape.channels, side], &mut self.turned);
                        let (input, weights, out) = (&pull[..], &self.turned[..], &mut self.back[..]);
                        let channels_back = shape.channels.next_multiple_of(BLOCK);
                        let shape_out = Shape { channels, ..shape };
                        kernels::conv(Conv {
                            input,
                            shape: shape_out,
                            weights,
                            out,
                            channels: channels_back,
                            side,
                            rectified: false,
                        });
                        for (to, add) in before[from].iter_mut().zip(&self.back) {
                            *to += add;
                        }
                    }
                }
                Layer::Norm { from } => {
                    let (value, shape) = (&self.values[from], net.shape(from));
                    pull_norm(
                        value,
                        shape,
                        self.moments[k],
                        &weights[place.clone()],
                        out,
                        pull,
                        &mut gradient[place],
                        &mut before[from],
                    );
                }
                Layer::Join { a, b } => {
                    let (first, second) = pull.split_at(before[a].len());
                    before[a].iter_mut().zip(first).for_each(|(to, add)| *to += add);
                    before[b].iter_mut().zip(second).for_each(|(to, add)| *to += add);
                }
                Layer::Add { a, b } => {
                    before[a].iter_mut().zip(&*pull).for_each(|(to, add)| *to += add);
                    before[b].iter_mut().zip(&*pull).for_each(|(to, add)| *to += add);
                }
                Layer::Pack { from } => unpack(pull, net.shape(k + 1), &mut before[from], |to, add| *to += add),
                Layer::Unpack { from } => pack(pull, net.shape(k + 1), &mut before[from], |to, add| *to += add),
            }
        }
    }
}

/// Writes the weights of the convolution that leads gradients back: inputs and outputs exchanged, kernels turned by half a turn, no
/// bias. Its outputs are filled up to a multiple of [`BLOCK`].
fn turn(weights: &[f32], [channels, inputs, side]: [usize; 3], turned: &mut Vec<f32>) {
    let area = side * side;
    let filled = inputs.next_multiple_of(BLOCK);
    turned.clear();
    turned.resize(filled * (channels * area + 1), 0.0);
    for o in 0..channels {
        for c in 0..inputs {
            for i in 0..area {
                turned[(c * channels + o) * area + area - 1 - i] = weights[(o * inputs + c) * area + i];
            }
        }
    }
}

/// Normalises, scales, shifts and rectifies; returns mean and inverse deviation.
fn normalise(value: &[f32], shape: Shape, weights: &[f32], out: &mut [f32]) -> [f32; 2] {
    let (scales, shifts) = weights.split_at(shape.channels);
    let count = (shape.channels * shape.height * shape.width) as f64;
    let (mut sum, mut squares) = (0.0_f64, 0.0_f64);
    // The border holds zeros, which change neither sum.
    for plane in value.chunks_exact(shape.step()) {
        let (mut s, mut q) = ([0.0_f32; 8], [0.0_f32; 8]);
        for chunk in plane.chunks(8) {
            for (l, v) in chunk.iter().enumerate() {
                s[l] += v;
                q[l] += v * v;
            }
        }
        sum += s.iter().map(|&v| f64::from(v)).sum::<f64>();
        squares += q.iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    let mean = sum / count;
    let variance = (squares / count - mean * mean).max(0.0) as f32;
    let (mean, inverse) = (mean as f32, 1.0 / (variance + LEAST_VARIANCE).sqrt());
    for c in 0..shape.channels {
        let (scale, shift) = (scales[c] * inverse, shifts[c] - scales[c] * inverse * mean);
        for y in 0..shape.height {
            let row = shape.row(c, y);
            for (out, v) in out[row.clone()].iter_mut().zip(&value[row]) {
                *out = (scale * v + shift).max(0.0);
            }
        }
    }
    [mean, inverse]
}

#[allow(clippy::too_many_arguments, reason = "one call, from the pass")]
fn pull_norm(
    value: &[f32],
    shape: Shape,
    [mean, inverse]: [f32; 2],
    weights: &[f32],
    out: &[f32],
    pull: &mut [f32],
    gradient: &mut [f32],
    to: &mut [f32],
) {
    let (scales, _) = weights.split_at(shape.channels);
    let (scale_gradient, shift_gradient) = gradient.split_at_mut(shape.channels);
    let count = (shape.channels * shape.height * shape.width) as f32;
    // Sums over all channels of the gradient by the normalised value, and of its product with that value.
    let (mut total, mut along) = (0.0_f32, 0.0_f32);
    for c in 0..shape.channels {
        let (mut sum, mut product) = (0.0_f32, 0.0_f32);
        for y in 0..shape.height {
            let row = shape.row(c, y);
            for ((pull, out), v) in pull[row.clone()].iter_mut().zip(&out[row.clone()]).zip(&value[row]) {
                *pull = if *out > 0.0 { *pull } else { 0.0 };
                sum += *pull;
                product += *pull * (v - mean) * inverse;
            }
        }
        shift_gradient[c] += sum;
        scale_gradient[c] += product;
        total += scales[c] * sum;
        along += scales[c] * product;
    }
    for c in 0..shape.channels {
        for y in 0..shape.height {
            let row = shape.row(c, y);
            for ((to, pull), v) in to[row.clone()].iter_mut().zip(&pull[row.clone()]).zip(&value[row]) {
                let normal = (v - mean) * inverse;
                *to += inverse * (scales[c] * pull - (total + normal * along) / count);
            }
        }
    }
}

/// Moves 2 x 2 pixels of each channel of `value` to four channels of `out`.
fn pack(value: &[f32], shape: Shape, out: &mut [f32], put: impl Fn(&mut f32, f32)) {
    let half = Shape { channels: 4 * shape.channels, height: shape.height / 2, width: shape.width / 2 };
    for c in 0..shape.channels {
        for y in 0..shape.height {
            let from = &value[shape.row(c, y)];
            for odd in 0..2 {
                let to = &mut out[half.row(4 * c + 2 * (y % 2) + odd, y / 2)];
                for (to, pair) in to.iter_mut().zip(from.chunks_exact(2)) {
                    put(to, pair[odd]);
                }
            }
        }
    }
}

/// Moves four channels of `value` to 2 x 2 pixels of one channel of `out`.
fn unpack(value: &[f32], shape: Shape, out: &mut [f32], put: impl Fn(&mut f32, f32)) {
    let double = Shape { channels: shape.channels / 4, height: 2 * shape.height, width: 2 * shape.width };
    for c in 0..double.channels {
        for y in 0..double.height {
            let to = &mut out[double.row(c, y)];
            for odd in 0..2 {
                let from = &value[shape.row(4 * c + 2 * (y % 2) + odd, y / 2)];
                for (pair, &v) in to.chunks_exact_mut(2).zip(from) {
                    put(&mut pair[odd], v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A network with every layer.
    fn net() -> Net {
        let conv = |from, channels, side, rectified| Layer::Conv { from, channels, side, rectified };
        let layers = vec![
            conv(0, 4, 3, true),        // 1
            Layer::Pack { from: 1 },    // 2: 16 channels
            conv(2, 8, 1, false),       // 3
            Layer::Norm { from: 3 },    // 4
            conv(4, 8, 3, false),       // 5
            Layer::Add { a: 4, b: 5 },  // 6
            Layer::Unpack { from: 6 },  // 7: 2 channels
            Layer::Join { a: 7, b: 1 }, // 8: 6 channels
            conv(8, 4, 3, false),       // 9
        ];
        Net::new(Shape { channels: 2, height: 4, width: 32 }, layers).unwrap()
    }

    fn filled(pass: &mut Pass, net: &Net, rng: &mut ChaCha8Rng) {
        let shape = net.shape(0);
        for c in 0..shape.channels {
            for y in 0..shape.height {
                pass.input()[shape.row(c, y)].iter_mut().for_each(|v| *v = rng.random_range(-1.0..1.0));
            }
        }
    }

    /// Loss: half the squares of the result.
    fn loss(pass: &mut Pass, net: &Net, weights: &[f32]) -> f64 {
        pass.run(net, weights);
        let shape = net.output();
        let rows = (0..shape.channels).flat_map(|c| (0..shape.height).map(move |y| shape.row(c, y)));
        rows.flat_map(|row| &pass.output()[row]).map(|&v| 0.5 * f64::from(v) * f64::from(v)).sum()
    }

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let net = net();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut weights = net.initial(&mut rng);
        // Biases and shifts away from zero, so that they are tested, too.
        weights.iter_mut().for_each(|w| *w += rng.random_range(-0.05..0.05));
        let mut pass = Pass::new(&net);
        filled(&mut pass, &net, &mut rng);
        let _ = loss(&mut pass, &net, &weights);
        let (output, pull) = pass.result(&net);
        pull.copy_from_slice(output);
        let mut gradient = vec![0.0; net.weights()];
        pass.pull_back(&net, &weights, &mut gradient);
        let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
        for _ in 0..20 {
            // A random direction: the rounding of single weights would drown their own derivative.
            let direction: Vec<f32> = weights.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
            let at = |h: f32| -> Vec<f32> { weights.iter().zip(&direction).map(|(w, d)| w + h * d).collect() };
            let h = 1e-3;
            let slope = (loss(&mut pass, &net, &at(h)) - loss(&mut pass, &net, &at(-h))) / (2.0 * f64::from(h));
            let expected: f32 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
            assert!((slope - f64::from(expected)).abs() < 0.01 * f64::from(norm), "{slope} {expected} of {norm}");
        }
    }

    #[test]
    fn the_gradient_by_the_input_is_that_of_the_loss() {
        let net = net();
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let weights = net.initial(&mut rng);
        let mut pass = Pass::new(&net);
        filled(&mut pass, &net, &mut rng);
        let _ = loss(&mut pass, &net, &weights);
        let (output, pull) = pass.result(&net);
        pull.copy_from_slice(output);
        let by_input = pass.pull_back_to_input(&net, &weights, &mut vec![0.0; net.weights()]).to_vec();
        let norm = by_input.iter().map(|g| g * g).sum::<f32>().sqrt();
        let start = pass.input().to_vec();
        for _ in 0..10 {
            let mut direction = vec![0.0_f32; start.len()];
            let shape = net.shape(0);
            for (c, y) in (0..shape.channels).flat_map(|c| (0..shape.height).map(move |y| (c, y))) {
                direction[shape.row(c, y)].iter_mut().for_each(|d| *d = rng.random_range(-1.0..1.0));
            }
            let h = 1e-3_f32;
            let mut at = |h: f32| {
                pass.input().iter_mut().zip(start.iter().zip(&direction)).for_each(|(x, (s, d))| *x = s + h * d);
                loss(&mut pass, &net, &weights)
            };
            let slope = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let expected: f32 = by_input.iter().zip(&direction).map(|(g, d)| g * d).sum();
            assert!((slope - f64::from(expected)).abs() < 0.01 * f64::from(norm), "{slope} {expected} of {norm}");
        }
    }

    #[test]
    fn a_convolution_is_its_sum() {
        let conv = Layer::Conv { from: 0, channels: 4, side: 3, rectified: false };
        let net = Net::new(Shape { channels: 2, height: 5, width: 16 }, vec![conv]).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let weights: Vec<f32> = (0..net.weights()).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut pass = Pass::new(&net);
        filled(&mut pass, &net, &mut rng);
        pass.run(&net, &weights);
        let (s, step) = (net.shape(0), net.shape(0).step());
        for (o, y, x) in [(0, 0, 0), (3, 4, 15), (2, 2, 7)] {
            let mut sum = weights[4 * 18 + o];
            for c in 0..2 {
                for r in 0..3 {
                    for k in 0..3 {
                        sum += weights[(o * 2 + c) * 9 + 3 * r + k]
                            * pass.value(0)[c * s.plane() + (y + r) * step + x + k];
                    }
                }
            }
            let found = pass.output()[net.output().row(o, y).start + x];
            assert!((found - sum).abs() < 1e-4, "{found} {sum}");
        }
    }

    #[test]
    fn packing_and_unpacking_is_the_identity() {
        let layers = vec![Layer::Pack { from: 0 }, Layer::Unpack { from: 1 }];
        let net = Net::new(Shape { channels: 3, height: 6, width: 32 }, layers).unwrap();
        let mut pass = Pass::new(&net);
        filled(&mut pass, &net, &mut ChaCha8Rng::seed_from_u64(1));
        pass.run(&net, &[]);
        assert_eq!(pass.output(), pass.value(0));
    }
}
