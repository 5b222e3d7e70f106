//! Options of the form NAME=VALUE.

/// Parses NAME=VALUE with a finite value.
pub fn parameter_value(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name.trim(), value.trim().parse::<f64>().ok()?)));
    match parts {
        Some((name, value)) if !name.is_empty() && value.is_finite() => Ok((name.to_owned(), value)),
        _ => Err("expected NAME=VALUE with a finite number".to_owned()),
    }
}
