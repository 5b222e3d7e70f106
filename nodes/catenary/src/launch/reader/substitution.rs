//! Substitutions in launch files, `$(NAME ARGUMENT...)`, with the meaning of ROS 2's own front end.

use super::functions;
use super::scope::Scope;

/// Replaces every substitution in `text`, inner ones first. Returns an error that names a substitution without value.
pub fn substitute(text: &str, scope: &Scope<'_>) -> Result<String, String> {
    evaluate(&parse(text)?, scope)
}

/// Text after substitution.
pub enum Text {
    /// Text that contained no substitution.
    Literal(String),
    /// Text whose substitutions were replaced.
    Substituted(String),
}

/// Like [`substitute`], and tells whether there was a substitution.
pub fn text_of(text: &str, scope: &Scope<'_>) -> Result<Text, String> {
    let pieces = parse(text)?;
    let is_literal = pieces.iter().all(|piece| matches!(piece, Piece::Text(_)));
    let text = evaluate(&pieces, scope)?;
    Ok(if is_literal { Text::Literal(text) } else { Text::Substituted(text) })
}

/// Text of an attribute without substitutions in ROS 2. A backslash before a character is removed.
pub fn literal(text: &str) -> String {
    unescape(text)
}

/// Words of a command line. As in ROS 2's launch, the text between substitutions is split like in a shell, and the
/// value of a substitution stays in one word, including its spaces and quotes. A substitution cannot stand within
/// quotes and does not need them.
pub fn words(text: &str, scope: &Scope<'_>) -> Result<Vec<String>, String> {
    let mut words: Vec<String> = Vec::new();
    // True while the next part continues the last word.
    let mut open = false;
    for piece in parse(text)? {
        let (parts, begins, ends) = match &piece {
            Piece::Call(..) => (vec![evaluate(&[piece], scope)?], false, false),
            Piece::Text(text) => {
                let split = shlex::split(text)
                    .ok_or_else(|| format!("`{text}`: unmatched quote; $(...) needs no quotes around it"))?;
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
    Ok(words)
}

/// Words of a command line. Returns an error if there is none.
pub fn command_line(text: &str, scope: &Scope<'_>) -> Result<Vec<String>, String> {
    let words = words(text, scope)?;
    if words.is_empty() { Err(format!("`{text}` is no command")) } else { Ok(words) }
}

/// Piece of a text.
enum Piece {
    /// Literal text with its escapes resolved.
    Text(String),
    /// Substitution: its spelling, its name, its arguments.
    Call(String, String, Vec<Vec<Piece>>),
}

fn evaluate(pieces: &[Piece], scope: &Scope<'_>) -> Result<String, String> {
    let values = pieces.iter().map(|piece| match piece {
        Piece::Text(text) => Ok(text.clone()),
        Piece::Call(written, name, arguments) => {
            let arguments = arguments.iter().map(|a| evaluate(a, scope)).collect::<Result<Vec<_>, _>>()?;
            functions::call(name, &arguments, scope).map_err(|reason| format!("`{written}`: {reason}"))
        }
    });
    values.collect()
}

/// Pieces of `text` in order; an empty text has none.
fn parse(text: &str) -> Result<Vec<Piece>, String> {
    let mut scanner = Scanner { text, at: 0 };
    scanner.pieces(None)
}

struct Scanner<'a> {
    text: &'a str,
    at: usize,
}

impl Scanner<'_> {
    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    /// Text and substitutions up to the end, or up to the closing quote.
    fn pieces(&mut self, quote: Option<char>) -> Result<Vec<Piece>, String> {
        let (mut pieces, mut plain) = (Vec::new(), String::new());
        loop {
            let mut characters = self.rest().chars();
            match characters.next() {
                None if quote.is_some() => return Err(format!("`{}`: unmatched quote", self.text)),
                None => break,
                Some(c) if Some(c) == quote => {
                    self.at += c.len_utf8();
                    break;
                }
                Some('$') if characters.next() == Some('(') => {
                    flush(&mut plain, &mut pieces);
                    pieces.push(self.call()?);
                }
                Some(c) => self.plain(c, &mut plain),
            }
        }
        flush(&mut plain, &mut pieces);
        Ok(pieces)
    }

    /// Reads one character of text, and the character that it escapes.
    fn plain(&mut self, c: char, plain: &mut String) {
        self.at += c.len_utf8();
        plain.push(c);
        if let Some(next) = self.rest().chars().next().filter(|_| c == '\\') {
            self.at += next.len_utf8();
            plain.push(next);
        }
    }

    /// Reads a substitution, from its dollar sign to its closing parenthesis.
    fn call(&mut self) -> Result<Piece, String> {
        let start = self.at;
        self.at += "$(".len();
        let end = self.rest().find(|c: char| !(c.is_ascii_alphanumeric() || "_-".contains(c)));
        let name = self.rest()[..end.unwrap_or(self.rest().len())].to_owned();
        if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
            return Err(format!("`{}`: expected the name of a substitution after `$(`", &self.text[start..]));
        }
        self.at += name.len();
        let mut arguments = Vec::new();
        loop {
            match self.rest().chars().next() {
                Some(')') => break,
                Some(' ') => {
                    self.at += 1;
                    arguments.push(self.argument(start)?);
                }
                Some(_) => {
                    return Err(format!("`{}`: expected a blank or `)` after a word", &self.text[start..]));
                }
                None => return Err(format!("`{}`: expected `)` after `$(`", self.text)),
            }
        }
        self.at += 1;
        Ok(Piece::Call(self.text[start..self.at].to_owned(), name, arguments))
    }

    /// Reads an argument of the substitution that began at `start`: a word, or a text in quotes.
    fn argument(&mut self, start: usize) -> Result<Vec<Piece>, String> {
        if let Some(quote) = self.rest().chars().next().filter(|c| "'\"".contains(*c)) {
            self.at += 1;
            let pieces = self.pieces(Some(quote))?;
            // An empty text is an argument, too.
            return Ok(if pieces.is_empty() { vec![Piece::Text(String::new())] } else { pieces });
        }
        let (mut pieces, mut plain) = (Vec::new(), String::new());
        while let Some(c) = self.rest().chars().next() {
            match c {
                '$' if self.rest().starts_with("$(") => {
                    flush(&mut plain, &mut pieces);
                    pieces.push(self.call()?);
                }
                ' ' | ')' => break,
                '(' | '\'' | '"' => {
                    return Err(format!("`{}`: `{c}` within a word; quote the word", &self.text[start..]));
                }
                c => self.plain(c, &mut plain),
            }
        }
        flush(&mut plain, &mut pieces);
        if pieces.is_empty() {
            return Err(format!("`{}`: expected one blank between words, and `)`", &self.text[start..]));
        }
        Ok(pieces)
    }
}

fn flush(plain: &mut String, pieces: &mut Vec<Piece>) {
    if !plain.is_empty() {
        pieces.push(Piece::Text(unescape(plain)));
        plain.clear();
    }
}

fn unescape(text: &str) -> String {
    let mut characters = text.chars();
    let mut unescaped = String::new();
    while let Some(c) = characters.next() {
        unescaped.push(if c == '\\' { characters.next().unwrap_or(c) } else { c });
    }
    unescaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::path::Path;

    fn with_scope<T>(work: impl FnOnce(&Scope<'_>) -> T) -> T {
        let variables = [("bin", "/opt/bin"), ("which", "bin"), ("list", "[9.0, 1e3]"), ("it", "it's"), ("none", "")];
        let variables: BTreeMap<String, String> = variables.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        let environment = |name: &str| (name == "HOME").then(|| "/home/lab".to_owned());
        let file = Path::new("/etc/launch/x.launch.xml");
        work(&Scope { variables: &variables, environment: &environment, file, included: None })
    }

    fn check(text: &str) -> Result<String, String> {
        with_scope(|scope| substitute(text, scope))
    }

    #[test]
    fn the_text_of_a_command_is_split_and_values_are_not() {
        let words = |text: &str| with_scope(|scope| command_line(text, scope));
        let cases: [(&str, &[&str]); 9] = [
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
            (r"run \$(var bin) $x", &["run", "$(var", "bin)", "$x"]),
        ];
        for (text, expected) in cases {
            assert_eq!(words(text).unwrap(), expected, "{text}");
        }
        assert!(words("run 'theta:=$(var list)'").unwrap_err().contains("$(...) needs no quotes around it"));
        assert!(words(" ").unwrap_err().contains("is no command"));
    }

    #[test]
    fn variables_environment_and_places_are_replaced() {
        assert_eq!(
            check("$(var bin)/camera -p $(env HOME)/x $(env NONE y) $(dirname)/p.yaml").unwrap(),
            "/opt/bin/camera -p /home/lab/x y /etc/launch/p.yaml"
        );
        assert_eq!(check("$(var $(var which)) $(filename)").unwrap(), "/opt/bin /etc/launch/x.launch.xml");
        assert_eq!(check("$(var no 'a b')$(env NONE '')$(env NONE \"x $(var which)\")").unwrap(), "a bx bin");
    }

    #[test]
    fn behind_an_include_a_path_that_ros_2_would_confuse_is_refused() {
        with_scope(|scope| {
            let other = |path| Scope { included: Some(Path::new(path)), ..*scope };
            assert_eq!(substitute("$(dirname)", &other("/etc/launch/y.xml")).unwrap(), "/etc/launch");
            assert!(substitute("$(filename)", &other("/etc/launch/y.xml")).unwrap_err().contains("<let>"));
            let error = substitute("$(dirname)", &other("/etc/y.xml")).unwrap_err();
            assert!(error.contains("/etc") && error.contains("before the <include>"), "{error}");
        });
    }

    #[test]
    fn conditions_are_those_of_ros_2() {
        for (text, expected) in [
            ("$(not true)", "false"),
            ("$(and yes 1)", "true"),
            ("$(or false off)", "false"),
            ("$(equals True 1)$(equals 1.0 1)$(equals a A)$(not-equals a b)", "truetruefalsetrue"),
            ("$(if $(equals $(var which) bin) yes no)$(if false yes)", "yes"),
        ] {
            assert_eq!(check(text).unwrap(), expected, "{text}");
        }
        assert!(check("$(not maybe)").unwrap_err().contains("maybe"));
        assert!(check("$(and true)").unwrap_err().contains("2 arguments"));
    }

    #[test]
    fn errors_name_the_substitution_without_value_or_meaning() {
        for (text, named) in [
            ("$(var nothing)", "nothing"),
            ("$(env NONE)", "NONE"),
            ("$(find-pkg-share no_such_package)", "AMENT_PREFIX_PATH"),
            ("$(find-exec no_such_program)", "no_such_program"),
            ("$(eval 1 + 1)", "expected one of var"),
            ("$(var bin", "expected `)`"),
            ("$(var  bin)", "one blank"),
            ("$(var bin )", "one blank"),
            ("$( var bin)", "name of a substitution"),
            ("$(dirname x)", "no argument"),
        ] {
            let error = check(text).unwrap_err();
            assert!(error.contains(named), "{text}: {error}");
        }
    }
}
