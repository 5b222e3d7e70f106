//! Numbers for people.

/// A number with four figures.
pub fn figures(v: f64) -> String {
    if v != 0.0 && !(1e-3..1e5).contains(&v.abs()) {
        return format!("{v:.3e}");
    }
    let digits = 3 - v.abs().max(1e-3).log10().floor() as i32;
    format!("{v:.*}", digits.clamp(0, 6) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_with_four_figures() {
        assert_eq!(figures(0.24567), "0.2457");
        assert_eq!(figures(24567.8), "24568");
        assert_eq!(figures(1.5), "1.500");
        assert_eq!(figures(0.0), "0.000000");
        assert_eq!(figures(2.0e6), "2.000e6");
    }
}
