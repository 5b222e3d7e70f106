//! Single-precision matrix products on row-major slices, by `matrixmultiply`, and the activation of the networks, by `wide`.

use wide::f32x8;

/// Transposition of an operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transpose {
    /// The operand as it is stored.
    No,
    /// The transposed operand.
    Yes,
}

/// `c = alpha * op(a) * op(b) + beta * c`, with `op(a)` of `m` x `k`, `op(b)` of `k` x `n`, `c` of `m` x `n`, all
/// row-major.
///
/// It runs on one thread. Equal inputs give equal bits on one machine.
///
/// # Panics
/// If the length of a slice does not match its shape.
#[allow(clippy::too_many_arguments, reason = "the BLAS signature of sgemm")]
pub fn gemm(
    (m, k, n): (usize, usize, usize),
    alpha: f32,
    a: &[f32],
    op_a: Transpose,
    b: &[f32],
    op_b: Transpose,
    beta: f32,
    c: &mut [f32],
) {
    // These checks make the raw pointers below sound.
    assert_eq!(a.len(), m * k, "left operand of a {m} x {k} x {n} product");
    assert_eq!(b.len(), k * n, "right operand of a {m} x {k} x {n} product");
    assert_eq!(c.len(), m * n, "result of a {m} x {k} x {n} product");
    let strides = |op, rows: usize, columns: usize| match op {
        Transpose::No => (columns as isize, 1),
        Transpose::Yes => (1, rows as isize),
    };
    let (rsa, csa) = strides(op_a, m, k);
    let (rsb, csb) = strides(op_b, k, n);
    #[allow(unsafe_code, reason = "matrixmultiply takes raw pointers; the lengths were checked above")]
    // SAFETY: each pointer covers exactly the elements that its shape and strides address, and `c` is borrowed mutably.
    unsafe {
        matrixmultiply::sgemm(
            m,
            k,
            n,
            alpha,
            a.as_ptr(),
            rsa,
            csa,
            b.as_ptr(),
            rsb,
            csb,
            beta,
            c.as_mut_ptr(),
            n as isize,
            1,
        );
    }
}

/// Hyperbolic tangent of every value, in place, eight at a time. Its error is below 3e-7.
pub fn tanh(values: &mut [f32]) {
    let (eights, rest) = values.as_chunks_mut::<8>();
    for v in eights {
        *v = f32x8::new(*v).tanh().to_array();
    }
    if rest.is_empty() {
        return;
    }
    // By the same polynomial, so that a value does not depend on its place.
    let mut last = [0.0; 8];
    last[..rest.len()].copy_from_slice(rest);
    rest.copy_from_slice(&f32x8::new(last).tanh().to_array()[..rest.len()]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_is_that_of_the_standard_library_and_does_not_depend_on_the_place() {
        let values: Vec<f32> =
            (-2003..=2003).map(|i| i as f32 * 0.01).chain([1e-8, -1e-5, 3e-4, 80.0, -1e30]).collect();
        let mut all = values.clone();
        tanh(&mut all);
        for (x, y) in values.iter().zip(&all) {
            assert!((y - x.tanh()).abs() < 3e-7, "{x}: {y} against {}", x.tanh());
            let mut alone = [*x];
            tanh(&mut alone);
            assert_eq!(alone[0], *y, "{x}");
        }
        let mut strange = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        tanh(&mut strange);
        assert!(strange[0].is_nan() && strange[1..] == [1.0, -1.0], "{strange:?}");
    }

    #[test]
    fn transposed_operands_give_the_same_product() {
        let a = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]; // 2 x 3
        let at = [1.0, 4.0, 2.0, 5.0, 3.0, 6.0];
        let b = [1.0, 0.0, 2.0, 1.0, 0.0, 3.0]; // 3 x 2
        let bt = [1.0, 2.0, 0.0, 0.0, 1.0, 3.0];
        let expected = [5.0, 11.0, 14.0, 23.0];
        for (x, ox) in [(&a, Transpose::No), (&at, Transpose::Yes)] {
            for (y, oy) in [(&b, Transpose::No), (&bt, Transpose::Yes)] {
                let mut c = [0.0; 4];
                gemm((2, 3, 2), 1.0, x, ox, y, oy, 0.0, &mut c);
                assert_eq!(c, expected);
            }
        }
    }
}
