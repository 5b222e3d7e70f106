//! Element `<param>`: a parameter file, or values with the types that ROS 2 gives them.

use super::element::{Element, allow};
use super::python::float_text;
use super::scope::Scope;
use super::value;
use anyhow::{Context, Result, bail, ensure};
use catenary_shell::Yaml;
use roxmltree::Node;
use std::path::Path;

/// Content of a `<param>`.
#[derive(Debug, PartialEq)]
pub enum Given {
    /// Path of a parameter file.
    File(String),
    /// Names and values; the values as YAML.
    Values(Vec<(String, String)>),
}

/// Reads a `<param>` of a `<node>`.
pub fn read(e: &Element<'_, '_, '_>) -> Result<Given> {
    match e.optional("from")? {
        Some(path) => {
            allow(e.node, &["from"], &[], &[])?;
            // A missing file is found here and not in the log of a failed node.
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
    allow(node, &["name", "value", "value-sep", "type"], &["from"], &["param"])?;
    let e = Element { node, scope };
    let name = format!("{outer}{}", e.required("name")?);
    let children: Vec<_> = node.children().filter(Node::is_element).collect();
    match (node.attribute("value"), &children[..]) {
        (Some(text), []) => {
            let attribute = |name| e.node.attribute(name);
            let value =
                value::read(text, attribute("type"), attribute("value-sep"), scope).with_context(|| name.clone())?;
            values.push((name, yaml(&value)));
        }
        (None, [_, ..]) => {
            for attribute in ["type", "value-sep"] {
                ensure!(
                    !node.has_attribute(attribute),
                    "{attribute}: expected it beside a value, got it beside <param>"
                );
            }
            for child in children {
                nested(child, scope, &format!("{name}."), values).context("<param>")?;
            }
        }
        _ => bail!("{name}: expected a value or <param> inside it"),
    }
    Ok(())
}

/// Parameter file for the node `whose`, or for every node with `/**`.
pub fn file(whose: &str, values: &[(String, String)]) -> String {
    let lines: String = values.iter().map(|(name, value)| format!("    {}: {value}\n", quoted(name))).collect();
    format!("{}:\n  ros__parameters:\n{lines}", quoted(whose))
}

/// Value as YAML that all YAML readers agree on.
fn yaml(value: &Yaml) -> String {
    match value {
        Yaml::Bool(value) => value.to_string(),
        Yaml::Integer(value) => value.to_string(),
        Yaml::Float(value) => float_text(*value),
        Yaml::String(value) => quoted(value),
        Yaml::List(items) => format!("[{}]", items.iter().map(yaml).collect::<Vec<_>>().join(", ")),
    }
}

/// Text in double quotes, valid in JSON and YAML.
fn quoted(text: &str) -> String {
    // YAML takes some characters that JSON does not escape for line breaks, and refuses others.
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
