//! Values between the centres of pixels.

/// Value at a place in pixels, from those at the centres of the four nearest pixels. Beyond the outer centres the outer values hold.
pub(super) fn bilinear([u, v]: [f32; 2], [width, height]: [usize; 2], value: impl Fn(usize, usize) -> f32) -> f32 {
    let last = [width - 1, height - 1].map(|n| n as f32);
    let at = [(u - 0.5).clamp(0.0, last[0]), (v - 0.5).clamp(0.0, last[1])];
    let (low, share) = (at.map(f32::floor), at.map(f32::fract));
    let high = [(low[0] + 1.0).min(last[0]), (low[1] + 1.0).min(last[1])];
    let row = |v: f32| {
        let of = |u: f32| value(u as usize, v as usize);
        of(low[0]) * (1.0 - share[0]) + of(high[0]) * share[0]
    };
    row(low[1]) * (1.0 - share[1]) + row(high[1]) * share[1]
}
