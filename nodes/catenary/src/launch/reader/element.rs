//! Attributes of the elements of a launch file.

use super::functions::boolean;
use super::scope::Scope;
use super::substitution::substitute;
use anyhow::{Result, anyhow, bail};
use catenary_core::spelling::did_you_mean;
use roxmltree::Node;
use std::time::Duration;

/// XML element with the scope of its substitutions.
pub struct Element<'a, 'd, 'i> {
    /// XML node.
    pub node: Node<'d, 'i>,
    /// Scope of its substitutions.
    pub scope: &'a Scope<'a>,
}

impl Element<'_, '_, '_> {
    /// Value of an attribute after substitution; `None` if it is absent.
    pub fn optional(&self, attribute: &str) -> Result<Option<String>> {
        let Some(text) = self.node.attribute(attribute) else { return Ok(None) };
        substitute(text, self.scope).map(Some).map_err(|e| anyhow!("{attribute}: {e}"))
    }

    /// Value of a required attribute after substitution.
    pub fn required(&self, attribute: &str) -> Result<String> {
        self.optional(attribute)?.ok_or_else(|| anyhow!("the attribute `{attribute}` is missing"))
    }

    /// Evaluates `if` and `unless`; true if the element applies.
    pub fn condition(&self) -> Result<bool> {
        let holds = |attribute: &str| {
            let text = self.optional(attribute)?.map(|text| text.trim().to_ascii_lowercase());
            match text.as_deref() {
                None => Ok(None),
                Some("true" | "1") => Ok(Some(true)),
                Some("false" | "0") => Ok(Some(false)),
                Some(other) => bail!("{attribute}: expected true or false, got `{other}`"),
            }
        };
        match (holds("if")?, holds("unless")?) {
            // ROS 2's front end refuses both at once, too.
            (Some(_), Some(_)) => bail!("expected `if` or `unless`, got both"),
            (Some(holds), None) => Ok(holds),
            (None, prevented) => Ok(prevented != Some(true)),
        }
    }

    /// Value of an attribute in seconds. No substitution, as in ROS 2's front end.
    pub fn seconds(&self, attribute: &str) -> Result<Option<Duration>> {
        let Some(text) = self.node.attribute(attribute) else { return Ok(None) };
        seconds(attribute, text).map(Some)
    }
}

/// Parses a time in seconds, at most one day.
pub fn seconds(attribute: &str, text: &str) -> Result<Duration> {
    let value = text.trim().parse().ok().filter(|s| (0.0..=86_400.0).contains(s));
    let value = value.ok_or_else(|| anyhow!("{attribute}: expected seconds from 0 to 86400, got `{text}`"))?;
    Ok(Duration::from_secs_f64(value))
}

/// Parses a boolean.
pub fn flag(attribute: &str, text: &str) -> Result<bool> {
    boolean(text).map_err(|e| anyhow!("{attribute}: {e}"))
}

/// Returns an error for unknown attributes and children; `*` allows any child.
pub fn allow(node: Node<'_, '_>, attributes: &[&str], more: &[&str], children: &[&str]) -> Result<()> {
    let known = || attributes.iter().chain(more);
    if let Some(a) = node.attributes().find(|a| !known().any(|name| *name == a.name())) {
        let known: Vec<&str> = known().copied().collect();
        let (name, hint) = (a.name(), did_you_mean(a.name(), known.iter().copied()));
        bail!("unknown attribute `{name}`; it takes {}{hint}", known.join(", "));
    }
    let is_allowed = |name: &str| children.contains(&"*") || children.contains(&name);
    match node.children().find(|c| c.is_element() && !is_allowed(c.tag_name().name())) {
        Some(child) if children.is_empty() => bail!("expected nothing inside it, got <{}>", child.tag_name().name()),
        Some(child) => bail!("expected {} inside it, got <{}>", children.join(" or "), child.tag_name().name()),
        None => Ok(()),
    }
}
