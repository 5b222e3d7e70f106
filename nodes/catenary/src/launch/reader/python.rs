//! Values of launch files as Python reads them: `yaml.safe_load`, `int` and `float`, which ROS 2's launch calls.

use catenary_shell::YamlEvents;
use libyaml_safer::EventData;
use std::collections::HashMap;

/// Python value.
#[derive(Clone, Debug, PartialEq)]
pub enum Python {
    /// `bool`.
    Bool(bool),
    /// `int`. Python's has no limit; a number beyond this type is refused.
    Int(i128),
    /// `float`.
    Float(f64),
    /// `str`.
    Str(String),
    /// `list`.
    List(Vec<Python>),
    /// Value that no parameter can have, in words: nothing, a map, a date, bytes.
    Other(&'static str),
}

impl Python {
    /// Description of the value for messages.
    pub fn describe(&self) -> String {
        match self {
            Self::Bool(value) => format!("the boolean {value}"),
            Self::Int(value) => format!("the integer {value}"),
            Self::Float(value) => format!("the number {value:?}"),
            Self::Str(value) => format!("the text {value:?}"),
            Self::List(_) => "a list".to_owned(),
            Self::Other(what) => (*what).to_owned(),
        }
    }
}

/// Equivalent of `yaml.safe_load`. Returns the error as text.
pub fn safe_load(text: &str) -> Result<Python, String> {
    // PyYAML does not accept a tab as white space. In quotes, blocks and comments a tab is ordinary text.
    if text.contains('\t') && !text.contains(['"', '\'', '|', '>', '#']) {
        return Err("found a tab that cannot start any token".to_owned());
    }
    let mut composer = Composer { events: YamlEvents::new(text), anchors: HashMap::new() };
    let mut document = None;
    loop {
        let event = composer.event()?;
        match event {
            EventData::StreamEnd => return Ok(document.unwrap_or(Python::Other("nothing"))),
            EventData::StreamStart { .. } | EventData::DocumentEnd { .. } => {}
            // `yaml.safe_load` raises an error for several documents.
            EventData::DocumentStart { .. } if document.is_some() => {
                return Err("expected one document, got several".to_owned());
            }
            EventData::DocumentStart { .. } => {
                let first = composer.event()?;
                document = Some(composer.value(first)?);
            }
            _ => return Err("expected a document".to_owned()),
        }
    }
}

struct Composer<'a> {
    events: YamlEvents<'a>,
    anchors: HashMap<String, Python>,
}

impl Composer<'_> {
    fn event(&mut self) -> Result<EventData, String> {
        self.events.next().unwrap_or_else(|| Err("expected a value, got the end".to_owned())).map(|event| event.data)
    }

    /// Value that begins with this event.
    fn value(&mut self, begin: EventData) -> Result<Python, String> {
        let (value, anchor) = match begin {
            EventData::Alias { anchor } => {
                return self.anchors.get(&anchor).cloned().ok_or_else(|| format!("found undefined alias {anchor:?}"));
            }
            EventData::Scalar { anchor, tag, value, plain_implicit, .. } => {
                // The tag `!` alone means the tag that a plain scalar would have.
                let tag = match tag.as_deref() {
                    Some(tag) if tag != "!" => tag,
                    None if !plain_implicit => "str",
                    _ => resolve(&value),
                };
                (tagged(&value, tag)?, anchor)
            }
            EventData::SequenceStart { anchor, tag, .. } => (self.list(tag.as_deref())?, anchor),
            EventData::MappingStart { anchor, tag, .. } => (self.map(tag.as_deref())?, anchor),
            _ => return Err("expected a value".to_owned()),
        };
        if let Some(anchor) = anchor {
            self.anchors.insert(anchor, value.clone());
        }
        Ok(value)
    }

    fn list(&mut self, tag: Option<&str>) -> Result<Python, String> {
        let mut items = Vec::new();
        loop {
            match self.event()? {
                EventData::SequenceEnd => break,
                begin => items.push(self.value(begin)?),
            }
        }
        match tag.map(short) {
            // An ordered map or a list of pairs is a list in Python, too.
            None | Some("!" | "seq") => Ok(Python::List(items)),
            Some("omap" | "pairs") if items.iter().all(|item| *item == Python::Other(MAP)) => Ok(Python::List(items)),
            Some(other) => Err(format!("could not make a list of the tag {other}")),
        }
    }

    fn map(&mut self, tag: Option<&str>) -> Result<Python, String> {
        loop {
            match self.event()? {
                EventData::MappingEnd => break,
                begin => {
                    let key = self.value(begin)?;
                    if matches!(key, Python::List(_) | Python::Other(MAP)) {
                        return Err("found unhashable key".to_owned());
                    }
                    let value = self.event()?;
                    self.value(value)?;
                }
            }
        }
        match tag.map(short) {
            None | Some("!" | "map" | "set") => Ok(Python::Other(MAP)),
            Some(other) => Err(format!("could not make a map of the tag {other}")),
        }
    }
}

const MAP: &str = "a map";

/// Tag without YAML's own prefix.
fn short(tag: &str) -> &str {
    tag.strip_prefix("tag:yaml.org,2002:").unwrap_or(tag)
}

/// Tag that YAML 1.1 gives a plain scalar.
fn resolve(text: &str) -> &'static str {
    match text {
        "yes" | "Yes" | "YES" | "no" | "No" | "NO" | "true" | "True" | "TRUE" | "false" | "False" | "FALSE" | "on"
        | "On" | "ON" | "off" | "Off" | "OFF" => "bool",
        "" | "~" | "null" | "Null" | "NULL" => "null",
        "<<" => "merge",
        "=" => "value",
        _ if is_integer(text) => "int",
        _ if is_float(text) => "float",
        _ if date(text).is_some() => "timestamp",
        _ => "str",
    }
}

/// True if PyYAML reads a plain scalar as a text, so that it writes the text without quotes.
pub fn is_plain_text(text: &str) -> bool {
    resolve(text) == "str" && !text.starts_with(char::is_whitespace)
}

fn tagged(text: &str, tag: &str) -> Result<Python, String> {
    let bad = |kind: &str| format!("`{text}` is no {kind}");
    match short(tag) {
        "str" => Ok(Python::Str(text.to_owned())),
        "null" => Ok(Python::Other("nothing")),
        "bool" => match text.to_ascii_lowercase().as_str() {
            "yes" | "true" | "on" => Ok(Python::Bool(true)),
            "no" | "false" | "off" => Ok(Python::Bool(false)),
            _ => Err(bad("boolean")),
        },
        "int" => yaml_integer(text).ok_or_else(|| bad("integer")),
        "float" => yaml_float(text).map(Python::Float).ok_or_else(|| bad("number")),
        "timestamp" if date(text) == Some(true) => Ok(Python::Other("a date")),
        "binary" => Ok(Python::Other("bytes")),
        other => Err(format!("could not make a value of the tag {other}")),
    }
}

fn unsigned(text: &str) -> &str {
    text.strip_prefix(['+', '-']).unwrap_or(text)
}

fn all(text: &str, is_allowed: impl Fn(char) -> bool) -> bool {
    text.chars().all(is_allowed)
}

fn is_digit(c: char) -> bool {
    c.is_ascii_digit()
}

/// True for parts of `minutes:seconds`, each below 60: YAML 1.1 has sexagesimal numbers.
fn is_sixtieths(text: &str) -> bool {
    let is_part = |part: &str| match part.as_bytes() {
        [ones] => ones.is_ascii_digit(),
        [b'0'..=b'5', ones] => ones.is_ascii_digit(),
        _ => false,
    };
    text.split(':').all(is_part)
}

fn is_integer(text: &str) -> bool {
    let digits = unsigned(text);
    let behind = |prefix: &str| digits.strip_prefix(prefix).filter(|rest| !rest.is_empty());
    let is_decimal =
        |text: &str| text.starts_with(|c: char| ('1'..='9').contains(&c)) && all(text, |c| is_digit(c) || c == '_');
    digits == "0"
        || is_decimal(digits)
        || behind("0b").is_some_and(|d| all(d, |c| "01_".contains(c)))
        || behind("0x").is_some_and(|d| all(d, |c| c.is_ascii_hexdigit() || c == '_'))
        || behind("0").is_some_and(|d| all(d, |c| ('0'..='7').contains(&c) || c == '_'))
        || digits.split_once(':').is_some_and(|(first, rest)| is_decimal(first) && is_sixtieths(rest))
}

fn is_float(text: &str) -> bool {
    let digits = unsigned(text);
    if matches!(digits, ".inf" | ".Inf" | ".INF") || matches!(text, ".nan" | ".NaN" | ".NAN") {
        return true;
    }
    let Some((whole, fraction)) = digits.split_once('.') else { return false };
    let is_number = |text: &str| text.starts_with(is_digit) && all(text, |c| is_digit(c) || c == '_');
    if let Some((first, rest)) = whole.split_once(':') {
        return is_number(first) && is_sixtieths(rest) && all(fraction, |c| is_digit(c) || c == '_');
    }
    // In YAML 1.1 an exponent needs a sign. A number that begins with its point has no sign.
    let (fraction, power) = fraction.split_once(['e', 'E']).map_or((fraction, None), |(f, power)| (f, Some(power)));
    let has_power = power.is_none_or(|power| {
        power.strip_prefix(['+', '-']).is_some_and(|digits| !digits.is_empty() && all(digits, is_digit))
    });
    let has_digits = if whole.is_empty() {
        text.starts_with('.') && is_number(fraction)
    } else {
        is_number(whole) && all(fraction, |c| is_digit(c) || c == '_')
    };
    has_power && has_digits
}

/// Value of an integer, or of a scalar that a tag makes an integer.
fn yaml_integer(text: &str) -> Option<Python> {
    let text = text.replace('_', "");
    let (sign, digits) = (if text.starts_with('-') { -1 } else { 1 }, unsigned(&text));
    let magnitude = if digits == "0" {
        0
    } else if let Some(digits) = digits.strip_prefix("0b") {
        i128::from_str_radix(digits, 2).ok()?
    } else if let Some(digits) = digits.strip_prefix("0x") {
        i128::from_str_radix(digits, 16).ok()?
    } else if digits.starts_with('0') {
        i128::from_str_radix(digits, 8).ok()?
    } else if digits.contains(':') {
        digits.split(':').try_fold(0_i128, |sum, part| Some(sum * 60 + part.parse::<i128>().ok()?))?
    } else {
        digits.parse().ok()?
    };
    Some(Python::Int(sign * magnitude))
}

fn yaml_float(text: &str) -> Option<f64> {
    let text = text.replace('_', "").to_lowercase();
    let (sign, digits) = (if text.starts_with('-') { -1.0 } else { 1.0 }, unsigned(&text));
    let magnitude = match digits {
        ".inf" => f64::INFINITY,
        ".nan" => f64::NAN,
        _ if digits.contains(':') => digits.split(':').try_fold(0.0, |sum, part| Some(sum * 60.0 + float(part)?))?,
        _ => float(digits)?,
    };
    Some(sign * magnitude)
}

/// `None` if a text does not have the form of a date or time; otherwise true if that date exists.
fn date(text: &str) -> Option<bool> {
    let numbers = |text: &str, separator: char, widths: &[&[usize]]| -> Option<Vec<u32>> {
        let parts: Vec<&str> = text.split(separator).collect();
        let fits = parts.len() == widths.len()
            && parts.iter().zip(widths).all(|(part, widths)| widths.contains(&part.len()) && all(part, is_digit));
        if fits { parts.iter().map(|part| part.parse().ok()).collect() } else { None }
    };
    let exists = |date: &[u32]| {
        let (year, month, day) = (date[0], date[1], date[2]);
        let is_leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
        let days = match month {
            4 | 6 | 9 | 11 => 30,
            2 => 28 + u32::from(is_leap),
            1..=12 => 31,
            _ => 0,
        };
        year > 0 && (1..=days).contains(&day)
    };
    if let Some(date) = numbers(text, '-', &[&[4], &[2], &[2]]) {
        return Some(exists(&date));
    }
    let (day, time) = text.split_once(['T', 't', ' ', '\t'])?;
    let day = numbers(day, '-', &[&[4], &[1, 2], &[1, 2]])?;
    let time = if text.contains(['T', 't']) { time } else { time.trim_start_matches([' ', '\t']) };
    let end = time.find(|c: char| !(is_digit(c) || c == ':' || c == '.')).unwrap_or(time.len());
    let (clock, zone) = time.split_at(end);
    let (clock, fraction) = clock.split_once('.').unwrap_or((clock, ""));
    let clock = numbers(clock, ':', &[&[1, 2], &[2], &[2]])?;
    if !all(fraction, is_digit) {
        return None;
    }
    let zone = zone.trim_start_matches([' ', '\t']);
    let offset = match zone {
        "" | "Z" => 0,
        _ => {
            let zone = zone.strip_prefix(['+', '-'])?;
            let (hours, minutes) = zone.split_once(':').unwrap_or((zone, "00"));
            numbers(hours, ':', &[&[1, 2]])?[0] * 60 + numbers(minutes, ':', &[&[2]])?[0]
        }
    };
    Some(exists(&day) && clock[0] < 24 && clock[1] < 60 && clock[2] < 60 && offset < 24 * 60)
}

/// Text without surrounding blanks and without underscores between digits. `None` if an underscore stands elsewhere.
fn digits(text: &str) -> Option<String> {
    let text = text.trim();
    let bytes = text.as_bytes();
    let is_between = |i: usize| {
        let is_digit_at = |i: Option<usize>| i.and_then(|i| bytes.get(i)).is_some_and(u8::is_ascii_digit);
        is_digit_at(i.checked_sub(1)) && is_digit_at(Some(i + 1))
    };
    let is_right = bytes.iter().enumerate().all(|(i, byte)| *byte != b'_' || is_between(i));
    is_right.then(|| text.replace('_', ""))
}

/// Equivalent of Python's `int(text)`.
pub fn int(text: &str) -> Option<i128> {
    digits(text)?.parse().ok()
}

/// Equivalent of Python's `float(text)`.
pub fn float(text: &str) -> Option<f64> {
    digits(text)?.parse().ok()
}

/// Number as PyYAML writes it.
pub fn float_text(number: f64) -> String {
    if number.is_nan() {
        return ".nan".to_owned();
    }
    if number.is_infinite() {
        return if number > 0.0 { ".inf" } else { "-.inf" }.to_owned();
    }
    let text = format!("{number:?}");
    match text.split_once('e') {
        Some((digits, power)) if !digits.contains('.') => format!("{digits}.0e{power}"),
        _ => text,
    }
}
