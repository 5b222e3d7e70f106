//! Value of a `<param>`, in the type that a node receives from ROS 2's launch.
//!
//! Three readers follow one another there. Launch reads the attribute with Python: `yaml.safe_load`, or `int` and
//! `float` if the type asks for it. Launch then writes a parameter file with PyYAML, and rcl reads that file by rules
//! of its own. Thus `1e3` and `y` are texts in Python, are written without quotes, and arrive as the number 1000 and as
//! true.

use super::python::{self, Python, float_text, is_plain_text, safe_load};
use super::scope::Scope;
use super::substitution::{Text, text_of};
use anyhow::{Context, Result, anyhow, bail, ensure};
use catenary_shell::Yaml;

const TYPES: &str = "str, bool, int, float, list_of_str, list_of_bool, list_of_int, list_of_float or yaml";

/// Type that an element asks for.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Type of the YAML scalar itself.
    Any,
    Str,
    Bool,
    Int,
    Float,
}

impl Kind {
    /// True if launch accepts the value as this kind. Python's booleans count as integers.
    fn has(self, value: &Python) -> bool {
        match self {
            Self::Any => !matches!(value, Python::List(_) | Python::Other(_)),
            Self::Str => matches!(value, Python::Str(_)),
            Self::Bool => matches!(value, Python::Bool(_)),
            Self::Int => matches!(value, Python::Int(_) | Python::Bool(_)),
            Self::Float => matches!(value, Python::Float(_)),
        }
    }

    /// Like [`Kind::has`], but a boolean is no integer.
    fn strictly_has(self, value: &Python) -> bool {
        self.has(value) && (self != Self::Int || matches!(value, Python::Int(_)))
    }
}

/// Reads the attribute `value` of an element with the attributes `type` and `value-sep`.
pub fn read(text: &str, kind: Option<&str>, separator: Option<&str>, scope: &Scope<'_>) -> Result<Yaml> {
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
    let value = match separator {
        Some(_) if !is_list && item != Kind::Any => Err(anyhow!("expected {name}, but value-sep makes it a list")),
        Some(separator) => separated(text, separator, item, name, scope),
        None if is_list => list_of(text, item, name, scope),
        None => scalar_of(text, item, name, scope),
    };
    value.and_then(as_rcl_reads).with_context(|| format!("value: `{text}`"))
}

/// List of one type. Its items may be substitutions, the list itself may not.
fn list_of(text: &str, item: Kind, name: &str, scope: &Scope<'_>) -> Result<Python> {
    let bad = |got: &str| anyhow!("expected {name}, got {got}");
    match safe_load(text).map_err(|reason| anyhow!("expected {name}: {reason}"))? {
        // Python cannot infer the item type of an empty list.
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

/// List whose items stand between separators. Every item may contain substitutions.
fn separated(text: &str, separator: &str, kind: Kind, name: &str, scope: &Scope<'_>) -> Result<Python> {
    ensure!(!separator.is_empty(), "value-sep: expected a separator, got an empty text");
    let item = |part: &str| match (kind, safe_load(part)) {
        // A text that does not have the type of the items is kept: it may contain substitutions.
        (Kind::Int | Kind::Float, _) | (Kind::Any | Kind::Bool, Err(_)) | (Kind::Bool, Ok(Python::Str(_))) => {
            Ok(coerce(part, kind, name).unwrap_or_else(|_| Python::Str(part.to_owned())))
        }
        _ => coerce(part, kind, name),
    };
    items_of(text.split(separator).map(item).collect::<Result<_>>()?, kind, scope)
}

/// Single value; without a type, also a list.
fn scalar_of(text: &str, kind: Kind, name: &str, scope: &Scope<'_>) -> Result<Python> {
    // A text that cannot be parsed is kept: it may contain substitutions.
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

/// Items with their substitutions replaced. Returns an error unless they have one type.
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
    // Python accepts a boolean as an integer; rcl refuses it later.
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

/// Converts a text to the requested type.
fn coerce(text: &str, kind: Kind, name: &str) -> Result<Python> {
    let bad = || anyhow!("expected {name}, got `{text}`");
    match kind {
        Kind::Str => Ok(Python::Str(text.to_owned())),
        Kind::Int => python::int(text).map(Python::Int).ok_or_else(bad),
        Kind::Float => python::float(text).map(Python::Float).ok_or_else(bad),
        Kind::Bool if text == "1" => Ok(Python::Bool(true)),
        Kind::Bool if text == "0" => Ok(Python::Bool(false)),
        Kind::Bool => safe_load(text).ok().filter(|value| kind.has(value)).ok_or_else(bad),
        // YAML reads an empty text as null; ROS 2's launch keeps the text.
        Kind::Any if text.is_empty() => Ok(Python::Str(String::new())),
        Kind::Any => match safe_load(text).map_err(|reason| anyhow!("expected YAML: {reason}"))? {
            Python::Other(what) => bail!(
                "expected a boolean, a number, a text or a list of them, got {what}; type=\"str\" makes it a text"
            ),
            other => Ok(other),
        },
    }
}

/// Value that rcl reads from the file that PyYAML writes.
fn as_rcl_reads(value: Python) -> Result<Yaml> {
    match value {
        Python::Bool(value) => Ok(Yaml::Bool(value)),
        // rcl reads an integer beyond 64 bits as a floating-point number.
        Python::Int(value) => Ok(i64::try_from(value).map_or(Yaml::Float(value as f64), Yaml::Integer)),
        Python::Float(value) => Ok(Yaml::of_plain(&float_text(value))),
        // PyYAML quotes a text that it would misread as another type itself.
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
    use serde_json::Value;
    use std::collections::BTreeMap;
    use std::path::Path;

    /// Value of a row in the tables: its parameter type and its JSON, with infinities and NaN as text.
    fn expected(row: &Value) -> Option<Yaml> {
        let value = &row[1];
        let double = |v: &Value| v.as_str().map_or_else(|| Yaml::Float(v.as_f64().unwrap()), Yaml::of_plain);
        Some(match row[0].as_str()? {
            "DOUBLE" => double(value),
            "DOUBLE_ARRAY" => Yaml::List(value.as_array().unwrap().iter().map(double).collect()),
            "NOT_SET" => Yaml::List(Vec::new()),
            // JSON is YAML, and tells texts, integers and numbers with a fraction apart.
            _ => Yaml::parse(&value.to_string()).unwrap(),
        })
    }

    /// Compares a value with a row of a table. The comparison is by text, because NaN differs from itself.
    fn check(text: &str, kind: Option<&str>, separator: Option<&str>, row: &Value) {
        let variables = [("five", "5"), ("list", "[1, 2]"), ("word", "1e3"), ("bad", "''*''"), ("b", "true")];
        let variables: BTreeMap<String, String> = variables.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        let scope = Scope { variables: &variables, environment: &|_| None, file: Path::new("/x"), included: None };
        let got = read(text, kind, separator, &scope);
        let place = format!("{text:?}, type {kind:?}, separator {separator:?}: {got:?}");
        assert_eq!(format!("{:?}", got.as_ref().ok()), format!("{:?}", expected(row).as_ref()), "{place}");
        if let Err(error) = got {
            assert!(format!("{error:#}").contains("expected"), "{place}");
        }
    }

    /// Each row of `values.json` has a value, its type, and the parameter of a ROS 2 node, or null if launch or rcl refuse it.
    #[test]
    fn values_arrive_as_from_ros_2s_own_launch() {
        let rows: Vec<(String, Option<String>, Value)> = serde_json::from_str(include_str!("values.json")).unwrap();
        assert!(rows.len() > 400);
        rows.iter().for_each(|(text, kind, row)| check(text, kind.as_deref(), None, row));
    }

    /// Each row of `separated_values.json` has the separator, too.
    #[test]
    fn separated_values_arrive_as_from_ros_2s_own_launch() {
        let rows: Vec<(String, Option<String>, String, Value)> =
            serde_json::from_str(include_str!("separated_values.json")).unwrap();
        assert!(rows.len() > 150);
        rows.iter().for_each(|(text, kind, separator, row)| check(text, kind.as_deref(), Some(separator), row));
    }
}
