//! The value of a `<param>`, in the type that a node gets from ROS 2's launch.
//!
//! Three readers follow one another there. Launch reads the attribute with Python (`yaml.safe_load`, or `int` and
//! `float` where the type says so), writes a parameter file with PyYAML, and rcl reads that file with rules of its own:
//! `1e3` and `y` are texts in Python, are written without quotes, and arrive as the number 1000 and as true.

use super::python::{self, Python, float_text, is_plain_text, safe_load};
use super::substitution::{Scope, Text, text_of};
use anyhow::{Context, Result, anyhow, bail, ensure};
use catenary_shell::Yaml;

const TYPES: &str = "str, bool, int, float, list_of_str, list_of_bool, list_of_int, list_of_float or yaml";

/// The type that an element asks for.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// As the YAML that it is.
    Any,
    Str,
    Bool,
    Int,
    Float,
}

impl Kind {
    /// Whether launch takes the value for one of this kind; Python's booleans are integers.
    fn has(self, value: &Python) -> bool {
        match self {
            Self::Any => !matches!(value, Python::List(_) | Python::Other(_)),
            Self::Str => matches!(value, Python::Str(_)),
            Self::Bool => matches!(value, Python::Bool(_)),
            Self::Int => matches!(value, Python::Int(_) | Python::Bool(_)),
            Self::Float => matches!(value, Python::Float(_)),
        }
    }

    /// Like [`Kind::has`], with a boolean no integer.
    fn strictly_has(self, value: &Python) -> bool {
        self.has(value) && (self != Self::Int || matches!(value, Python::Int(_)))
    }
}

/// Reads the attribute `value` of an element with the attribute `type`.
pub fn read(text: &str, kind: Option<&str>, scope: &Scope<'_>) -> Result<Yaml> {
    let (item, is_list) = match kind {
        None | Some("yaml") => (Kind::Any, false),
        Some("str") => (Kind::Str, false),
        Some("bool") => (Kind::Bool, false),
        Some("int") => (Kind::Int, false),
        Some("float") => (Kind::Float, false),
        Some("list_of_str") => (Kind::Str, true),
        Some("list_of_bool") => (Kind::Bool, true),
        Some("list_of_int") => (Kind::Int, true),
        Some("list_of_float") => (Kind::Float, true),
        Some(other) => bail!("type: expected {TYPES}, got `{other}`"),
    };
    let name = kind.unwrap_or("yaml");
    let value = if is_list { list_of(text, item, name, scope) } else { scalar_of(text, item, name, scope) };
    value.and_then(as_rcl_reads).with_context(|| format!("value: `{text}`"))
}

/// A list of one type: its items may be substitutions, the list itself may not.
fn list_of(text: &str, item: Kind, name: &str, scope: &Scope<'_>) -> Result<Python> {
    let bad = |got: &str| anyhow!("expected {name}, got {got}");
    match safe_load(text).map_err(|reason| anyhow!("expected {name}: {reason}"))? {
        // Python cannot tell of what an empty list is.
        Python::List(items) if items.is_empty() && item != Kind::Str => Err(bad("an empty list, which has no type")),
        Python::List(items) => {
            let is_right = |value: &Python| item.has(value) || matches!(value, Python::Str(_));
            if let Some(other) = items.iter().find(|value| !is_right(value)) {
                return Err(bad(&format!("{} in it", other.describe())));
            }
            items_of(items, item, scope)
        }
        other => Err(bad(&other.describe())),
    }
}

/// A value, or with any type a list, too.
fn scalar_of(text: &str, kind: Kind, name: &str, scope: &Scope<'_>) -> Result<Python> {
    // What cannot be read stays a text: it may have substitutions in it.
    let value = coerce(text, kind, name).or_else(|error| match (kind, safe_load(text)) {
        (Kind::Any | Kind::Bool, Ok(Python::Str(_)))
        | (Kind::Any | Kind::Bool, Err(_))
        | (Kind::Int | Kind::Float, _) => Ok(Python::Str(text.to_owned())),
        _ => Err(error),
    })?;
    match value {
        Python::Str(text) => match text_of(&text, scope).map_err(|reason| anyhow!("{reason}"))? {
            Text::Literal(text) if matches!(kind, Kind::Any | Kind::Str) => Ok(Python::Str(text)),
            Text::Literal(text) => bail!("expected {name}, got `{text}`"),
            Text::Substituted(text) => coerce(&text, kind, name),
        },
        Python::List(items) => items_of(items, kind, scope),
        other => Ok(other),
    }
}

/// Items with their substitutions replaced, which must be of one type.
fn items_of(items: Vec<Python>, kind: Kind, scope: &Scope<'_>) -> Result<Python> {
    let uniform = "expected items all of one type";
    let mut written: Option<Python> = None;
    let mut values = Vec::new();
    for item in items {
        let (value, is_written) = match item {
            Python::Str(text) => match text_of(&text, scope).map_err(|reason| anyhow!("{reason}"))? {
                Text::Literal(text) => (Python::Str(text), true),
                Text::Substituted(text) => (coerce(&text, kind, "an item")?, false),
            },
            other => (other, true),
        };
        if is_written {
            ensure!(kind == Kind::Any || kind.strictly_has(&value), "{uniform}, got {}", value.describe());
            if let Some(first) = written.as_ref().filter(|first| !is_same_type(first, &value)) {
                bail!("{uniform}, got {} after {}", value.describe(), first.describe());
            }
            written.get_or_insert_with(|| value.clone());
        }
        values.push(value);
    }
    // Python takes a boolean for an integer; rcl refuses it later.
    let first = values.iter().find(|value| !matches!(value, Python::Str(_))).or(values.first());
    let fits = |value: &Python| {
        first.is_some_and(|first| {
            is_same_type(first, value) || matches!((first, value), (Python::Int(_), Python::Bool(_)))
        })
    };
    if let Some(other) = values.iter().find(|value| !fits(value) || matches!(value, Python::List(_) | Python::Other(_)))
    {
        bail!("{uniform}, got {}", other.describe());
    }
    Ok(Python::List(values))
}

fn is_same_type(a: &Python, b: &Python) -> bool {
    std::mem::discriminant(a) == std::mem::discriminant(b)
}

/// A text in the type that is asked for.
fn coerce(text: &str, kind: Kind, name: &str) -> Result<Python> {
    let bad = || anyhow!("expected {name}, got `{text}`");
    match kind {
        Kind::Str => Ok(Python::Str(text.to_owned())),
        Kind::Int => python::int(text).map(Python::Int).ok_or_else(bad),
        Kind::Float => python::float(text).map(Python::Float).ok_or_else(bad),
        Kind::Bool if text == "1" => Ok(Python::Bool(true)),
        Kind::Bool if text == "0" => Ok(Python::Bool(false)),
        Kind::Bool => safe_load(text).ok().filter(|value| kind.has(value)).ok_or_else(bad),
        Kind::Any if text.is_empty() => Ok(Python::Str(String::new())),
        Kind::Any => match safe_load(text).map_err(|reason| anyhow!("expected YAML: {reason}"))? {
            Python::Other(what) => bail!(
                "expected a boolean, a number, a text or a list of them, got {what}; type=\"str\" makes it a text"
            ),
            other => Ok(other),
        },
    }
}

/// The value that rcl reads from the file that PyYAML writes.
fn as_rcl_reads(value: Python) -> Result<Yaml> {
    match value {
        Python::Bool(value) => Ok(Yaml::Bool(value)),
        Python::Int(value) => Ok(i64::try_from(value).map_or(Yaml::Float(value as f64), Yaml::Integer)),
        Python::Float(value) => Ok(Yaml::of_plain(&float_text(value))),
        // PyYAML puts what is no text for itself, and so would be misread by itself, in quotes.
        Python::Str(text) if is_plain_text(&text) => Ok(match Yaml::of_plain(&text) {
            Yaml::String(_) => Yaml::String(text),
            other => other,
        }),
        Python::Str(text) => Ok(Yaml::String(text)),
        Python::Other(what) => bail!("expected a value, got {what}"),
        Python::List(items) => {
            let items = items.into_iter().map(as_rcl_reads).collect::<Result<Vec<_>>>()?;
            let differs = |item: &&Yaml| std::mem::discriminant(*item) != std::mem::discriminant(&items[0]);
            match items.iter().find(differs) {
                Some(other) => bail!(
                    "expected items all of one type, and a node reads {} after {}",
                    other.describe(),
                    items[0].describe()
                ),
                None => Ok(Yaml::List(items)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::collections::BTreeMap;
    use std::path::Path;

    /// A value as the table writes it: its type and itself, infinities and NaN in words.
    fn written(value: &Yaml) -> Value {
        let items = |items: &[Yaml]| -> Value { items.iter().map(|item| written(item)[1].take()).collect() };
        match value {
            Yaml::Bool(value) => json!(["BOOL", value]),
            Yaml::Integer(value) => json!(["INTEGER", value]),
            Yaml::Float(value) if value.is_finite() => json!(["DOUBLE", value]),
            Yaml::Float(value) => json!(["DOUBLE", value.to_string().to_lowercase()]),
            Yaml::String(value) => json!(["STRING", value]),
            Yaml::List(list) => match list.first() {
                None => json!(["NOT_SET", null]),
                Some(first) => json!([format!("{}_ARRAY", written(first)[0].as_str().unwrap()), items(list)]),
            },
        }
    }

    /// `values.json` has rows of a value, its type, and what a node of ROS 2 gets, null where launch or rcl refuse.
    #[test]
    fn values_arrive_as_ros_2s_own_launch_brings_them() {
        let rows: Vec<(String, Option<String>, Value)> = serde_json::from_str(include_str!("values.json")).unwrap();
        let variables = [("five", "5"), ("list", "[1, 2]"), ("word", "1e3"), ("bad", "''*''"), ("b", "true")];
        let variables: BTreeMap<String, String> = variables.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        let scope = Scope { variables: &variables, environment: &|_| None, file: Path::new("/x"), included: None };
        assert!(rows.len() > 400);
        for (text, kind, expected) in rows {
            let got = read(&text, kind.as_deref(), &scope);
            let got_written = got.as_ref().map_or(Value::Null, written);
            assert_eq!(got_written, expected, "{text:?}, type {kind:?}: {got:?}");
            if let Err(error) = got {
                assert!(format!("{error:#}").contains("expected"), "{text:?}: {error:#}");
            }
        }
    }
}
