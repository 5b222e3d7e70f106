//! Namespaces of nodes in launch files.

use anyhow::{Result, anyhow};
use catenary_shell::names;

/// Variable that holds the pushed namespace; ROS 2's front end uses the same name.
pub const VARIABLE: &str = "ros_namespace";

/// Absolute namespace `inner` below `outer`. An absolute `inner` replaces `outer`. `None` if both are absent.
pub fn join(outer: Option<&str>, inner: Option<&str>) -> Result<Option<String>> {
    let joined = match (outer, inner) {
        (None, None) => return Ok(None),
        (Some(outer), None) => outer.to_owned(),
        (Some(outer), Some(inner)) if !outer.is_empty() && !inner.starts_with('/') => {
            format!("{}/{inner}", outer.trim_end_matches('/'))
        }
        (_, Some(inner)) => inner.to_owned(),
    };
    let trimmed = joined.trim_end_matches('/');
    names::normalise_namespace(trimmed).map(Some).map_err(|e| anyhow!("namespace: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_join_as_in_ros_2() {
        for (outer, inner, expected) in [
            (None, None, None),
            (None, Some("lab"), Some("/lab")),
            (Some("/lab"), None, Some("/lab")),
            (Some("/lab"), Some("left"), Some("/lab/left")),
            (Some("/lab"), Some("/left"), Some("/left")),
            (Some("/"), Some("left/"), Some("/left")),
        ] {
            assert_eq!(join(outer, inner).unwrap().as_deref(), expected, "{outer:?} {inner:?}");
        }
        assert!(join(None, Some("a b")).unwrap_err().to_string().contains("a b"));
    }
}
