//! Substitutions in launch files: `$(var NAME)`, `$(env NAME [DEFAULT])` and `$(dirname)`.

use std::collections::BTreeMap;
use std::path::Path;

/// What substitutions may refer to.
pub struct Scope<'a> {
    /// Arguments and `let` variables by name.
    pub variables: &'a BTreeMap<String, String>,
    /// Environment variables by name.
    pub environment: &'a dyn Fn(&str) -> Option<String>,
    /// Folder of the launch file.
    pub directory: &'a Path,
}

/// `text` with every substitution replaced, inner ones first; an error names the substitution that has no value.
pub fn substitute(text: &str, scope: &Scope<'_>) -> Result<String, String> {
    let mut result = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find("$(") {
        result.push_str(&rest[..start]);
        let inner = &rest[start + 2..];
        let end = closing(inner).ok_or_else(|| format!("`{text}`: `$(` without its `)`"))?;
        let expression = substitute(&inner[..end], scope)?;
        result.push_str(&value(&expression, scope)?);
        rest = &inner[end + 1..];
    }
    result.push_str(rest);
    Ok(result)
}

/// Position of the parenthesis that closes the one before `text`.
fn closing(text: &str) -> Option<usize> {
    let mut depth = 1;
    for (i, c) in text.char_indices() {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Some(i);
        }
    }
    None
}

fn value(expression: &str, scope: &Scope<'_>) -> Result<String, String> {
    let mut words = expression.split_whitespace();
    match (words.next(), words.next(), words.next()) {
        (Some("var"), Some(name), None) => scope
            .variables
            .get(name)
            .cloned()
            .ok_or_else(|| format!("`$({expression})`: no argument or variable `{name}`")),
        (Some("env"), Some(name), default) => (scope.environment)(name)
            .or_else(|| default.map(str::to_owned))
            .ok_or_else(|| format!("`$({expression})`: the environment variable is not set and there is no default")),
        (Some("dirname"), None, None) => Ok(scope.directory.display().to_string()),
        _ => Err(format!("`$({expression})`: expected var NAME, env NAME [DEFAULT] or dirname")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str) -> Result<String, String> {
        let variables =
            BTreeMap::from([("bin".to_owned(), "/opt/bin".to_owned()), ("which".to_owned(), "bin".to_owned())]);
        let environment = |name: &str| (name == "HOME").then(|| "/home/lab".to_owned());
        substitute(
            text,
            &Scope { variables: &variables, environment: &environment, directory: Path::new("/etc/launch") },
        )
    }

    #[test]
    fn variables_environment_and_dirname_are_replaced() {
        assert_eq!(
            check("$(var bin)/camera -p $(env HOME)/x $(env NONE y) $(dirname)/p.yaml").unwrap(),
            "/opt/bin/camera -p /home/lab/x y /etc/launch/p.yaml"
        );
        assert_eq!(check("$(var $(var which))").unwrap(), "/opt/bin");
    }

    #[test]
    fn what_has_no_value_is_named() {
        assert!(check("$(var nothing)").unwrap_err().contains("nothing"));
        assert!(check("$(env NONE)").unwrap_err().contains("NONE"));
        assert!(check("$(find-pkg-share x)").unwrap_err().contains("find-pkg-share"));
        assert!(check("$(var bin").unwrap_err().contains("without"));
    }
}
