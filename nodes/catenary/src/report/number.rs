//! Numbers for people, with as many digits as are known.

/// `value` with `decimals` decimals. Thousands are separated by spaces from 10 000 on. Zero has no sign.
pub fn plain(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    let text = if is_zero { text.trim_start_matches('-').to_owned() } else { text };
    let (sign, digits) = text.strip_prefix('-').map_or(("", text.as_str()), |rest| ("-", rest));
    let (whole, fraction) = digits.split_at(digits.find('.').unwrap_or(digits.len()));
    if whole.len() < 5 || !whole.chars().all(|c| c.is_ascii_digit()) {
        return text;
    }
    let mut grouped = String::new();
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && (whole.len() - i).is_multiple_of(3) {
            grouped.push(' ');
        }
        grouped.push(digit);
    }
    format!("{sign}{grouped}{fraction}")
}

/// Number of decimals for `digits` significant digits of a number of this size.
fn decimals(size: f64, digits: i32) -> usize {
    if size == 0.0 || !size.is_finite() {
        return 0;
    }
    // The factor puts a number such as 999.9999, printed as 1000, into its decade.
    (digits - 1 - (size.abs() * 1.000_001).log10().floor() as i32).clamp(0, 9) as usize
}

/// `value` to two digits of its uncertainty `width`, and to at least two digits of its own.
pub fn rounded(value: f64, width: f64) -> String {
    // A value far below its uncertainty still shows a digit or two of its own.
    let own = if value == 0.0 { 0 } else { decimals(value, 2) };
    plain(value, decimals(width, 2).max(if width > 0.0 { own.min(decimals(width, 2) + 1) } else { own }))
}

/// `value` to at most `digits` significant digits, without trailing zeros.
pub fn significant(value: f64, digits: i32) -> String {
    let text = plain(value, decimals(value, digits));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Distance in mm, with a decimal below 10 mm.
pub fn millimetres(value: f64) -> String {
    plain(value, if value < 9.95 { 1 } else { 0 })
}

/// Share in percent.
pub fn percent(share: f64) -> String {
    let value = 100.0 * share;
    match value {
        // "0 %" and "100 %" are reserved for exact shares.
        v if v > 0.0 && v <= 0.5 => "< 1 %".to_owned(),
        v if (99.5..100.0).contains(&v) => "> 99 %".to_owned(),
        v => format!("{} %", plain(v, 0)),
    }
}

/// Writes a number with four significant figures.
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

    #[test]
    fn values_have_the_precision_of_their_intervals() {
        let interval = |value: f64, low: f64, high: f64| {
            let [value, low, high] = [value, low, high].map(|v| rounded(v, high - low));
            format!("{value} ({low} to {high})")
        };
        assert_eq!(interval(260.7312, 254.21, 267.08), "261 (254 to 267)");
        assert_eq!(interval(0.22713, 0.161, 0.291), "0.23 (0.16 to 0.29)");
        assert_eq!(interval(7.1234, 1.98, 29.7), "7.1 (2.0 to 30)");
        assert_eq!(interval(-1.671, -1.9, -1.5), "-1.67 (-1.90 to -1.50)");
        assert_eq!(interval(0.0, -0.01, 0.01), "0.000 (-0.010 to 0.010)");
        assert_eq!(interval(24_567.8, 21_000.0, 31_000.0), "24 568 (21 000 to 31 000)");
    }

    #[test]
    fn numbers_are_grouped_and_zero_has_no_sign() {
        assert_eq!(plain(-0.0004, 2), "0.00");
        assert_eq!(plain(1_234_567.0, 0), "1 234 567");
        assert_eq!(plain(9999.0, 0), "9999");
        assert_eq!(plain(f64::NAN, 1), "NaN");
        assert_eq!(
            (millimetres(38.26), millimetres(7.41), millimetres(9.97)),
            ("38".into(), "7.4".into(), "10".into())
        );
        assert_eq!((percent(0.974), percent(0.001), percent(0.0)), ("97 %".into(), "< 1 %".into(), "0 %".into()));
        assert_eq!((percent(0.999), percent(1.0)), ("> 99 %".into(), "100 %".into()));
        // Halves round to even numbers, which are the reserved ones here.
        assert_eq!((percent(0.005), percent(0.995)), ("< 1 %".into(), "> 99 %".into()));
    }
}
