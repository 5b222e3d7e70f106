//! Names of nodes, topics and services: validity, expansion, wildcards.

use thiserror::Error;

/// Invalid name.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum NameError {
    /// Name that breaks a rule.
    #[error("expected {expected}, got {name:?}")]
    Invalid {
        /// Expected form.
        expected: &'static str,
        /// The name.
        name: String,
    },
}

fn invalid(expected: &'static str, name: &str) -> NameError {
    NameError::Invalid { expected, name: name.to_owned() }
}

fn is_token(token: &str) -> bool {
    !token.is_empty()
        && !token.starts_with(|c: char| c.is_ascii_digit())
        && token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// Checks the base name of a node: letters, digits and underscores, no digit at the start.
///
/// # Errors
/// [`NameError::Invalid`].
pub fn check_node_name(name: &str) -> Result<(), NameError> {
    if is_token(name) {
        Ok(())
    } else {
        Err(invalid("a node name of letters, digits and _ that does not start with a digit", name))
    }
}

/// Normalises a namespace to the form `/`, `/a` or `/a/b`.
///
/// # Errors
/// [`NameError::Invalid`] for empty or ill-formed tokens.
pub fn normalise_namespace(namespace: &str) -> Result<String, NameError> {
    let body = namespace.strip_prefix('/').unwrap_or(namespace);
    if body.is_empty() {
        return Ok("/".to_owned());
    }
    if body.split('/').all(is_token) {
        Ok(format!("/{body}"))
    } else {
        Err(invalid("a namespace such as / or /lab/left", namespace))
    }
}

/// Returns the fully qualified name of a node.
#[must_use]
pub fn node_path(namespace: &str, name: &str) -> String {
    if namespace == "/" { format!("/{name}") } else { format!("{namespace}/{name}") }
}

/// Expands a topic or service name: `/a` stays, `a` is put under the namespace, `~/a` under the node.
///
/// # Errors
/// [`NameError::Invalid`] for empty or ill-formed tokens.
pub fn expand(name: &str, namespace: &str, node: &str) -> Result<String, NameError> {
    let absolute = if let Some(rest) = name.strip_prefix("~/") {
        format!("{}/{rest}", node_path(namespace, node))
    } else if name.starts_with('/') {
        name.to_owned()
    } else {
        node_path(namespace, name)
    };
    // ROS 2 reserves double underscores in topic names.
    let valid = absolute[1..].split('/').all(|token| is_token(token) && !token.contains("__"));
    if valid { Ok(absolute) } else { Err(invalid("a name such as image, /panda/enable or ~/state", name)) }
}

/// Returns true for a fully qualified node name in which `*` or `**` may replace tokens, as in parameter files.
#[must_use]
pub fn is_pattern(pattern: &str) -> bool {
    pattern.strip_prefix('/').is_some_and(|body| body.split('/').all(|t| t == "*" || t == "**" || is_token(t)))
}

/// Returns true if `-p` accepts this as a parameter name: parts separated by dots; a part consists of tokens separated by
/// slashes.
#[must_use]
pub fn is_parameter_name(name: &str) -> bool {
    let is_part = |part: &str| !part.is_empty() && part.split('/').all(|token| token.is_empty() || is_token(token));
    name.split('.').all(is_part)
}

/// Returns true if a fully qualified node name matches a pattern of a parameter file. `*` stands for one token, `**` for any
/// number of tokens. A pattern without a leading slash starts at the root.
#[must_use]
pub fn matches_pattern(pattern: &str, node_path: &str) -> bool {
    let tokens =
        |text: &str| -> Vec<String> { text.split('/').filter(|token| !token.is_empty()).map(str::to_owned).collect() };
    matches_tokens(&tokens(pattern), &tokens(node_path))
}

fn matches_tokens(pattern: &[String], path: &[String]) -> bool {
    match pattern.split_first() {
        None => path.is_empty(),
        // `**` may also stand for no token.
        Some((first, rest)) if first == "**" => (0..=path.len()).any(|skipped| matches_tokens(rest, &path[skipped..])),
        Some((first, rest)) => path
            .split_first()
            .is_some_and(|(token, path_rest)| (first == "*" || first == token) && matches_tokens(rest, path_rest)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_expand_as_in_ros_2() {
        assert_eq!(expand("image", "/", "camera").unwrap(), "/image");
        assert_eq!(expand("dlo/mask", "/lab", "camera").unwrap(), "/lab/dlo/mask");
        assert_eq!(expand("/dlo/mask", "/lab", "camera").unwrap(), "/dlo/mask");
        assert_eq!(expand("~/state", "/lab", "camera").unwrap(), "/lab/camera/state");
        assert_eq!(expand("~/state", "/", "camera").unwrap(), "/camera/state");
    }

    #[test]
    fn ill_formed_names_are_refused() {
        for name in ["", "/", "a/", "a//b", "2a", "a b", "a__b", "~a"] {
            assert!(expand(name, "/", "camera").is_err(), "{name:?} was accepted");
        }
        assert!(check_node_name("camera_1").is_ok());
        assert!(check_node_name("1camera").is_err());
        assert!(check_node_name("").is_err());
    }

    #[test]
    fn namespaces_are_normalised() {
        assert_eq!(normalise_namespace("").unwrap(), "/");
        assert_eq!(normalise_namespace("/").unwrap(), "/");
        assert_eq!(normalise_namespace("lab").unwrap(), "/lab");
        assert_eq!(normalise_namespace("/lab/left").unwrap(), "/lab/left");
        assert!(normalise_namespace("/lab/").is_err());
    }

    #[test]
    fn parameter_names_have_parts_between_dots_and_slashes() {
        for name in ["a", "_a1", "a.b.c", "a/b", "qos_overrides./x.depth"] {
            assert!(is_parameter_name(name), "{name:?}");
        }
        for name in ["", "5a", "a-b", "a ", ".a", "a.", "a..b", "~a", "ä", "a:b", "*"] {
            assert!(!is_parameter_name(name), "{name:?}");
        }
    }

    #[test]
    fn wildcards_match_as_in_parameter_files() {
        assert!(matches_pattern("/**", "/camera"));
        assert!(matches_pattern("/**", "/lab/left/camera"));
        assert!(matches_pattern("camera", "/camera"));
        assert!(!matches_pattern("camera", "/lab/camera"));
        assert!(matches_pattern("/*/camera", "/lab/camera"));
        assert!(!matches_pattern("/*/camera", "/lab/left/camera"));
        assert!(matches_pattern("/**/camera", "/camera"));
        assert!(matches_pattern("/**/camera", "/lab/left/camera"));
        assert!(!matches_pattern("/**/camera", "/lab/tracker"));
    }
}
