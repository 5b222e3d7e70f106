//! Inner loops of convolutions.

use crate::net::{BLOCK, Shape};
use pulp::{Arch, Simd, WithSimd};

/// Convolution: weights [output][input][row][column], then biases.
pub(crate) struct Conv<'a> {
    pub(crate) input: &'a [f32],
    pub(crate) shape: Shape,
    pub(crate) weights: &'a [f32],
    pub(crate) out: &'a mut [f32],
    pub(crate) channels: usize,
    pub(crate) side: usize,
    pub(crate) rectified: bool,
}

impl WithSimd for Conv<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.side {
            1 => convolve::<S, 1>(simd, self),
            _ => convolve::<S, 3>(simd, self),
        }
    }
}

/// Computes a convolution.
pub(crate) fn conv(conv: Conv<'_>) {
    Arch::new().dispatch(conv);
}

/// Vectors of a row that are computed at once. With [`BLOCK`] channels they fill half of sixteen registers.
const VECTORS: usize = 2;

#[inline(always)]
fn convolve<S: Simd, const SIDE: usize>(simd: S, k: Conv<'_>) {
    let (s, step, plane, lanes) = (k.shape, k.shape.step(), k.shape.plane(), S::F32_LANES);
    let width = VECTORS * lanes;
    debug_assert!(s.width % width == 0, "LANES holds a multiple of every machine's vectors");
    let inputs = s.channels * SIDE * SIDE;
    let (weights, biases) = k.weights.split_at(k.channels * inputs);
    // The kernel's first row and column in the bordered plane.
    let first = (3 - SIDE) / 2;
    for (o, biases) in biases.chunks_exact(BLOCK).enumerate() {
        let kernels: [&[f32]; BLOCK] = std::array::from_fn(|b| &weights[(BLOCK * o + b) * inputs..][..inputs]);
        for y in 0..s.height {
            for x in (0..s.width).step_by(width) {
                let mut sums: [[S::f32s; VECTORS]; BLOCK] =
                    std::array::from_fn(|b| [simd.splat_f32s(biases[b]); VECTORS]);
                for c in 0..s.channels {
                    for row in 0..SIDE {
                        let start = c * plane + (y + row + first) * step + x + first;
                        let from = &k.input[start..start + width + SIDE - 1];
                        for column in 0..SIDE {
                            let (values, _) = S::as_simd_f32s(&from[column..column + width]);
                            let values: [S::f32s; VECTORS] = [values[0], values[1]];
                            let at = (c * SIDE + row) * SIDE + column;
                            for b in 0..BLOCK {
                                let weight = simd.splat_f32s(kernels[b][at]);
                                for v in 0..VECTORS {
                                    sums[b][v] = simd.mul_add_e_f32s(values[v], weight, sums[b][v]);
                                }
                            }
                        }
                    }
                }
                for (b, sums) in sums.into_iter().enumerate() {
                    let at = (BLOCK * o + b) * plane + (y + 1) * step + 1 + x;
                    let (out, _) = S::as_mut_simd_f32s(&mut k.out[at..at + width]);
                    for v in 0..VECTORS {
                        out[v] = if k.rectified { simd.max_f32s(sums[v], simd.splat_f32s(0.0)) } else { sums[v] };
                    }
                }
            }
        }
    }
}

/// Adds the gradient of a convolution's weights and biases to `gradient`. `pull` is the gradient of its result, with a border of
/// zeros. `part` is a buffer.
pub(crate) fn weight_gradient(
    input: &[f32],
    shape: Shape,
    pull: &[f32],
    [channels, side]: [usize; 2],
    gradient: &mut [f32],
    part: &mut Vec<f32>,
) {
    let (step, plane) = (shape.step(), shape.plane());
    // Rows follow one another with their borders; the zeros of `pull` there take no part in the sums.
    let numbers = shape.height * step - 2;
    let (weights, biases) = gradient.split_at_mut(channels * shape.channels * side * side);
    part.clear();
    part.resize(channels * shape.channels, 0.0);
    let first = (3 - side) / 2;
    for row in 0..side {
        for column in 0..side {
            let from = &input[(row + first) * step + column + first..];
            product_with_transpose(&pull[step + 1..], from, [channels, numbers, shape.channels], plane, part);
            for (i, sum) in part.iter().enumerate() {
                weights[(i * side + row) * side + column] += sum;
            }
        }
    }
    for (o, bias) in biases.iter_mut().enumerate() {
        for y in 0..shape.height {
            *bias += pull[shape.row(o, y)].iter().sum::<f32>();
        }
    }
}

/// Writes A B^T to `out`: A is `rows` x `numbers`, B is `columns` x `numbers`, both with `step` numbers from row to row.
fn product_with_transpose(a: &[f32], b: &[f32], [rows, numbers, columns]: [usize; 3], step: usize, out: &mut [f32]) {
    assert!(a.len() >= (rows - 1) * step + numbers && b.len() >= (columns - 1) * step + numbers);
    assert!(out.len() >= rows * columns);
    #[allow(unsafe_code, reason = "matrixmultiply takes raw pointers; the lengths were checked above")]
    // SAFETY: the asserts above hold for every element that the strides reach.
    unsafe {
        let (step, columns_step) = (step as isize, columns as isize);
        matrixmultiply::sgemm(
            rows,
            numbers,
            columns,
            1.0,
            a.as_ptr(),
            step,
            1,
            b.as_ptr(),
            1,
            step,
            0.0,
            out.as_mut_ptr(),
            columns_step,
            1,
        );
    }
}
