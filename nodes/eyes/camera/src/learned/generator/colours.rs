//! Colours of things.

use rand::{Rng, RngExt};

/// Any colour: greys are as frequent as in a box of cables.
pub(super) fn any_colour(rng: &mut impl Rng) -> [f32; 3] {
    let value = rng.random_range(0.08_f32..0.95);
    let saturation = if rng.random_bool(0.3) { rng.random_range(0.0..0.15) } else { rng.random_range(0.3..1.0) };
    of_hue(rng.random_range(0.0..6.0), saturation, value)
}

/// RGB of a hue (0 to 6), saturation and value.
fn of_hue(hue: f32, saturation: f32, value: f32) -> [f32; 3] {
    [5.0_f32, 3.0, 1.0].map(|n| {
        let k = (n + hue) % 6.0;
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    })
}

/// Distance of two colours.
pub(super) fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>().sqrt()
}
