//! The element `<param>`: a parameter file, or values in the types that ROS 2 gives them.

use super::element::{Element, allow};
use super::python::float_text;
use super::substitution::Scope;
use super::value;
use anyhow::{Context, Result, bail, ensure};
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
            let value = value::read(text, e.node.attribute("type"), scope).with_context(|| name.clone())?;
            values.push((name, yaml(&value)));
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

/// A value as YAML that every reader takes for the same.
fn yaml(value: &Yaml) -> String {
    match value {
        Yaml::Bool(value) => value.to_string(),
        Yaml::Integer(value) => value.to_string(),
        Yaml::Float(value) => float_text(*value),
        Yaml::String(value) => quoted(value),
        Yaml::List(items) => format!("[{}]", items.iter().map(yaml).collect::<Vec<_>>().join(", ")),
    }
}

/// A text in double quotes, as JSON and YAML both read it.
fn quoted(text: &str) -> String {
    // YAML takes some of the characters that JSON leaves alone for line breaks, and refuses others.
    let is_special =
        |c: char| matches!(c, '\u{7f}'..='\u{9f}' | '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}');
    let escaped = |c: char| if is_special(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    serde_json::Value::from(text).to_string().chars().map(escaped).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_is_read_back() {
        for text in ["", "5", "it's \"x\"", "a\\b", "\u{7f}\u{85}\u{2028}\u{feff}", "\t\r\n\u{1}", "é 😀", "''*''"] {
            assert_eq!(Yaml::parse(&quoted(text)), Ok(Yaml::String(text.to_owned())), "{text:?}");
        }
    }
}
