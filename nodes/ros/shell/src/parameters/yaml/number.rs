//! Numbers as C's `strtoll` and `strtod` read them. The whole text must be a number.
//!
//! Hand-written: `f64::from_str` knows neither hexadecimal numbers nor C's range errors.

/// Parses as `strtoll` with base 0: decimal, hexadecimal after `0x`, octal after `0`.
pub(super) fn c_integer(text: &str) -> Option<i64> {
    let (is_negative, digits) = signed(text);
    let (radix, digits) = match digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        Some(digits) => (16, digits),
        // A single 0 is decimal.
        None if digits.len() > 1 && digits.starts_with('0') => (8, &digits[1..]),
        None => (10, digits),
    };
    if digits.is_empty() || !digits.chars().all(|c| c.is_digit(radix)) {
        return None;
    }
    // In 128 bits: the magnitude of the smallest i64 does not fit into one.
    let magnitude = i128::from_str_radix(digits, radix).ok()?;
    i64::try_from(if is_negative { -magnitude } else { magnitude }).ok()
}

/// Parses as `strtod`, with YAML's words for infinity and NaN. Returns `None` out of range, as rcl.
pub(super) fn c_double(text: &str) -> Option<f64> {
    let infinity = |sign: &str| if sign == "-" { f64::NEG_INFINITY } else { f64::INFINITY };
    match text.split_once('.') {
        Some(("", "nan" | "NaN" | "NAN")) => return Some(f64::NAN),
        Some((sign @ ("" | "+" | "-"), "inf" | "Inf" | "INF")) => return Some(infinity(sign)),
        _ => {}
    }
    let (is_negative, digits) = signed(text);
    let lower = digits.to_ascii_lowercase();
    let magnitude = if lower == "inf" || lower == "infinity" {
        f64::INFINITY
    } else if is_nan(&lower) {
        f64::NAN
    } else if let Some(digits) = lower.strip_prefix("0x") {
        in_range(hexadecimal(digits)?)?
    } else {
        let is_decimal = lower.starts_with(|c: char| c.is_ascii_digit() || c == '.')
            && lower.chars().all(|c| c.is_ascii_digit() || ".e+-".contains(c));
        in_range((
            lower.parse().ok().filter(|_| is_decimal)?,
            significand(&lower).contains(|c| ('1'..='9').contains(&c)),
        ))?
    };
    Some(if is_negative { -magnitude } else { magnitude })
}

/// Splits off leading blanks and the sign.
fn signed(text: &str) -> (bool, &str) {
    let text = text.trim_start_matches([' ', '\t', '\n', '\u{b}', '\u{c}', '\r']);
    match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    }
}

fn is_nan(lower: &str) -> bool {
    let payload = lower.strip_prefix("nan(").and_then(|rest| rest.strip_suffix(')'));
    lower == "nan" || payload.is_some_and(|p| p.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'))
}

fn significand(decimal: &str) -> &str {
    decimal.split_once('e').map_or(decimal, |(digits, _)| digits)
}

/// Returns the number, unless `strtod` reports a range error. `is_nonzero` is true for a number with a digit other than 0.
fn in_range((number, is_nonzero): (f64, bool)) -> Option<f64> {
    (if is_nonzero { number.is_normal() } else { true }).then_some(number)
}

/// Parses the number after `0x` with its point and its power of two. Also returns true for a digit other than 0.
fn hexadecimal(lower: &str) -> Option<(f64, bool)> {
    let (digits, power) = lower.split_once('p').map_or((lower, None), |(digits, power)| (digits, Some(power)));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut exponent = match power {
        None => 0,
        // The power may have a sign, and must have a digit.
        Some(power) if signed(power).1.starts_with(|c: char| c.is_ascii_digit()) => {
            power.parse::<i64>().ok()?.clamp(-100_000, 100_000)
        }
        Some(_) => return None,
    };
    let mut significand: u128 = 0;
    for (i, c) in whole.chars().chain(fraction.chars()).enumerate() {
        let digit = u128::from(c.to_digit(16)?);
        if significand >> 120 == 0 {
            significand = significand << 4 | digit;
        } else {
            // Digits beyond the 31st matter only for a tie in rounding.
            significand |= u128::from(digit != 0);
            exponent += 4;
        }
        if i >= whole.len() {
            exponent -= 4;
        }
    }
    if significand == 0 {
        return Some((0.0, false));
    }
    let exponent = i32::try_from(exponent).ok()?;
    // Two steps, because the power of two alone may be out of range.
    let half = exponent / 2;
    Some((significand as f64 * 2f64.powi(half) * 2f64.powi(exponent - half), true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_numbers_have_their_value() {
        for (text, expected) in [
            ("0x1p3", Some(8.0)),
            ("-0x.8", Some(-0.5)),
            ("0x1.8p-1", Some(0.75)),
            ("0x8000000000000000", Some(9.223_372_036_854_776e18)),
            ("0x123456789abcdef0123456789abcdef0123456789", Some(1.662_864_085_140_938_4e48)),
            ("0x0p9999999", Some(0.0)),
            ("0x1p9999", None),
            ("0x1p-9999", None),
            ("0x", None),
            ("0x.", None),
            ("0xp1", None),
            ("0x1p", None),
            ("0x1p+", None),
            ("0xg", None),
        ] {
            assert_eq!(c_double(text), expected, "{text}");
        }
    }
}
