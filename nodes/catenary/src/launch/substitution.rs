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
    let words = pieces(text, scope)?.into_iter().map(|p| match p {
        Piece::Text(text) => text,
        Piece::Value(value) => value,
    });
    Ok(words.collect())
}

/// The words of a command line. As with ROS 2's own launch the text between substitutions is split as a shell splits it, and
/// a substitution's value stays whole, spaces, quotes and all; so a substitution cannot stand within quotes, nor need it.
pub fn command_line(text: &str, scope: &Scope<'_>) -> Result<Vec<String>, String> {
    let mut words: Vec<String> = Vec::new();
    // Whether what comes next belongs to the last word.
    let mut open = false;
    for piece in pieces(text, scope)? {
        let (parts, begins, ends) = match &piece {
            Piece::Value(value) => (vec![value.clone()], false, false),
            Piece::Text(text) => {
                let split = shlex::split(text)
                    .ok_or_else(|| format!("`{text}`: a quote without its other; $(...) needs none around it"))?;
                (split, text.starts_with(char::is_whitespace), text.ends_with(char::is_whitespace))
            }
        };
        open &= !begins;
        for (i, part) in parts.into_iter().enumerate() {
            match words.last_mut() {
                Some(last) if open && i == 0 => last.push_str(&part),
                _ => words.push(part),
            }
            open = true;
        }
        open &= !ends;
    }
    if words.is_empty() { Err(format!("`{text}` is no command")) } else { Ok(words) }
}

/// A part of a text.
enum Piece {
    /// As it is written.
    Text(String),
    /// What a substitution stands for.
    Value(String),
}

/// The parts of `text`, in order; none is an empty text.
fn pieces(text: &str, scope: &Scope<'_>) -> Result<Vec<Piece>, String> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find("$(") {
        let inner = &rest[start + 2..];
        let end = closing(inner).ok_or_else(|| format!("`{text}`: `$(` without its `)`"))?;
        let expression = substitute(&inner[..end], scope)?;
        pieces.extend((start > 0).then(|| Piece::Text(rest[..start].to_owned())));
        pieces.push(Piece::Value(value(&expression, scope)?));
        rest = &inner[end + 1..];
    }
    pieces.extend((!rest.is_empty()).then(|| Piece::Text(rest.to_owned())));
    Ok(pieces)
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

    fn with_scope<T>(work: impl FnOnce(&Scope<'_>) -> T) -> T {
        let variables = [("bin", "/opt/bin"), ("which", "bin"), ("list", "[9.0, 1e3]"), ("it", "it's"), ("none", "")];
        let variables: BTreeMap<String, String> = variables.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        let environment = |name: &str| (name == "HOME").then(|| "/home/lab".to_owned());
        work(&Scope { variables: &variables, environment: &environment, directory: Path::new("/etc/launch") })
    }

    fn check(text: &str) -> Result<String, String> {
        with_scope(|scope| substitute(text, scope))
    }

    #[test]
    fn the_text_of_a_command_is_split_and_values_are_not() {
        let words = |text: &str| with_scope(|scope| command_line(text, scope));
        let cases: [(&str, &[&str]); 8] = [
            (
                "$(var bin)/cell -p theta:=$(var list) -p a:=1",
                &["/opt/bin/cell", "-p", "theta:=[9.0, 1e3]", "-p", "a:=1"],
            ),
            ("run $(var list)", &["run", "[9.0, 1e3]"]),
            ("run $(var list) $(var it) last", &["run", "[9.0, 1e3]", "it's", "last"]),
            ("run $(var bin)$(var which)x", &["run", "/opt/binbinx"]),
            ("run -p x:=$(var none) y", &["run", "-p", "x:=", "y"]),
            ("run $(var none) y", &["run", "", "y"]),
            ("  run '--a b'  \"c d\" ", &["run", "--a b", "c d"]),
            ("run 'a '$(var bin)", &["run", "a /opt/bin"]),
        ];
        for (text, expected) in cases {
            assert_eq!(words(text).unwrap(), expected, "{text}");
        }
        assert!(words("run 'theta:=$(var list)'").unwrap_err().contains("$(...) needs none around it"));
        assert!(words(" ").unwrap_err().contains("is no command"));
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
