//! Rates of a training.

/// Rate of step `step` of `steps`, from 0. It rises to `greatest` over the first 5 % of the steps, and falls to zero as a cosine.
pub(crate) fn rate(greatest: f32, step: usize, steps: usize) -> f32 {
    let warm = (steps as f32 / 20.0).max(1.0);
    let done = step as f32 / steps as f32;
    greatest * ((step + 1) as f32 / warm).min(1.0) * 0.5 * (1.0 + (std::f32::consts::PI * done).cos())
}

/// Shortens a gradient of more than length 1: a single odd sample must not undo many steps.
pub(crate) fn clip(gradient: &mut [f32]) {
    let length = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
    if length > 1.0 {
        gradient.iter_mut().for_each(|g| *g /= length);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_rises_and_falls() {
        let rates: Vec<f32> = (0..100).map(|step| rate(2.0, step, 100)).collect();
        let top = rates.iter().copied().fold(0.0, f32::max);
        assert!(rates[0] < 0.5 && top > 1.9 && top <= 2.0 && rates[99] < 0.01, "{rates:?}");
        let mut long = [3.0, 4.0];
        clip(&mut long);
        assert_eq!(long, [0.6, 0.8]);
        clip(&mut long[..1]);
        assert_eq!(long[0], 0.6);
    }
}
