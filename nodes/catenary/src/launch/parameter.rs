//! The element `<param>`: a parameter file, or values in the types that ROS 2 gives them.

use super::element::{Element, allow};
use super::substitution::{Scope, substitute};
use anyhow::{Context, Result, anyhow, bail, ensure};
use catenary_shell::Yaml;
use roxmltree::Node;
use std::path::Path;

/// What a `<param>` gives.
#[derive(Debug, PartialEq)]
pub enum Given {
    /// The path of a parameter file.
    File(String),
    /// Names and values, the values as YAML.
    Values(Vec<(String, String)>),
}

/// Reads a `<param>` of a `<node>`.
pub fn read(e: &Element<'_, '_, '_>) -> Result<Given> {
    match e.optional("from")? {
        Some(path) => {
            allow(e.node, &["from"], &[], &[])?;
            ensure!(Path::new(&path).is_file(), "from: expected a parameter file, found none at {path}");
            Ok(Given::File(path))
        }
        None => {
            let mut values = Vec::new();
            nested(e.node, e.scope, "", &mut values)?;
            Ok(Given::Values(values))
        }
    }
}

fn nested(node: Node<'_, '_>, scope: &Scope<'_>, outer: &str, values: &mut Vec<(String, String)>) -> Result<()> {
    allow(node, &["name", "value", "type"], &["from"], &["param"])?;
    let e = Element { node, scope };
    let name = format!("{outer}{}", e.required("name")?);
    let children: Vec<_> = node.children().filter(Node::is_element).collect();
    match (node.attribute("value"), &children[..]) {
        (Some(text), []) => {
            let text = substitute(text, scope).map_err(|e| anyhow!("value: {e}"))?;
            values.push((name, yaml(&text, e.node.attribute("type"))?));
        }
        (None, [_, ..]) => {
            ensure!(!node.has_attribute("type"), "type: expected it beside a value, got it beside <param>");
            for child in children {
                nested(child, scope, &format!("{name}."), values).context("<param>")?;
            }
        }
        _ => bail!("{name}: expected a value or <param> inside it"),
    }
    Ok(())
}

/// A parameter file for the node `whose`, or for every node with `/**`.
pub fn file(whose: &str, values: &[(String, String)]) -> String {
    let lines: String = values.iter().map(|(name, value)| format!("    {}: {value}\n", quoted(name))).collect();
    format!("{}:\n  ros__parameters:\n{lines}", quoted(whose))
}

/// A value as YAML that has one meaning only: as the YAML that it is, or as the type says.
fn yaml(text: &str, kind: Option<&str>) -> Result<String> {
    if kind == Some("str") {
        return Ok(quoted(text));
    }
    let bad = |expected: &str| anyhow!("value: expected {expected}, got `{text}`");
    let parsed =
        if text.is_empty() { Yaml::String(String::new()) } else { Yaml::parse(text).map_err(|_| bad("YAML"))? };
    match (kind, &parsed) {
        (None | Some("yaml"), Yaml::List(items)) => list(items, |_| true),
        (None | Some("yaml"), other) => scalar(other),
        (Some("bool"), Yaml::Bool(_)) | (Some("int"), Yaml::Integer(_)) | (Some("float"), Yaml::Float(_)) => scalar(&parsed),
        (Some("float"), Yaml::Integer(number)) => Ok(format!("{number}.0")),
        (Some("list_of_str"), Yaml::List(items)) => list(items, |item| matches!(item, Yaml::String(_))),
        (Some("list_of_bool"), Yaml::List(items)) => list(items, |item| matches!(item, Yaml::Bool(_))),
        (Some("list_of_int"), Yaml::List(items)) => list(items, |item| matches!(item, Yaml::Integer(_))),
        (Some("list_of_float"), Yaml::List(items)) => list(items, |item| matches!(item, Yaml::Float(_))),
        (Some(kind @ ("bool" | "int" | "float")), _) => Err(bad(kind)),
        (Some(kind @ ("list_of_str" | "list_of_bool" | "list_of_int" | "list_of_float")), _) => Err(bad(kind)),
        (Some(other), _) => bail!(
            "type: expected str, bool, int, float, list_of_str, list_of_bool, list_of_int, list_of_float or yaml, got `{other}`"
        ),
    }
    .with_context(|| format!("value: `{text}`"))
}

fn scalar(value: &Yaml) -> Result<String> {
    match value {
        Yaml::Bool(value) => Ok(value.to_string()),
        Yaml::Integer(value) => Ok(value.to_string()),
        Yaml::Float(value) => Ok(format!("{value:?}")),
        Yaml::String(value) => Ok(quoted(value)),
        other => bail!("expected a boolean, a number, a text or a list of them, got {}", other.describe()),
    }
}

/// A list of one kind of item; ROS 2 has no parameter without a type, so it has one item at least.
fn list(items: &[Yaml], is_allowed: impl Fn(&Yaml) -> bool) -> Result<String> {
    let kind = items.first().map(std::mem::discriminant);
    let is_uniform = items.iter().all(|item| Some(std::mem::discriminant(item)) == kind && is_allowed(item));
    ensure!(kind.is_some() && is_uniform, "expected a list of one item or more, all of one type");
    let items = items.iter().map(scalar).collect::<Result<Vec<_>>>()?;
    Ok(format!("[{}]", items.join(", ")))
}

/// A text in double quotes, as JSON and YAML both read it.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
