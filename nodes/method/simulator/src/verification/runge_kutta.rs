//! Runge-Kutta integration of ordinary differential equations along the arc length.

/// Integrates y' = `slope`(s, y) from `from` to `to` in `steps` equal steps. Returns y at the end.
pub(super) fn integrate<const N: usize>(
    [from, to]: [f64; 2],
    steps: usize,
    start: [f64; N],
    slope: impl Fn(f64, &[f64; N]) -> [f64; N],
) -> [f64; N] {
    let h = (to - from) / steps as f64;
    (0..steps).fold(start, |y, k| step(from + k as f64 * h, h, &y, &slope))
}

/// Makes one step of length `h` of the classical fourth-order Runge-Kutta rule.
pub(super) fn step<const N: usize>(
    s: f64,
    h: f64,
    y: &[f64; N],
    slope: impl Fn(f64, &[f64; N]) -> [f64; N],
) -> [f64; N] {
    let moved = |by: f64, d: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| y[i] + by * d[i]) };
    let k1 = slope(s, y);
    let k2 = slope(s + 0.5 * h, &moved(0.5 * h, &k1));
    let k3 = slope(s + 0.5 * h, &moved(0.5 * h, &k2));
    let k4 = slope(s + h, &moved(h, &k3));
    std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        let error = |steps: usize| {
            let [x, v] = integrate([0.0, 2.0], steps, [1.0, 0.0], |_, y| [y[1], -y[0]]);
            (x - 2.0_f64.cos()).hypot(v + 2.0_f64.sin())
        };
        let ratio = error(20) / error(40);
        assert!((14.0..18.0).contains(&ratio), "{ratio}");
    }
}
