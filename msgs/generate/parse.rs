//! Parser of .msg, .srv and .action files.

/// Element type of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum Base {
    /// Primitive by its name in .msg files: `float64`, `bool`, `string`, ...
    Primitive(String),
    /// Message, by package and name.
    Message(String, String),
}

/// Number of values of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Count {
    /// One value.
    One,
    /// Fixed number of values.
    Array(usize),
    /// Sequence with an upper bound.
    Bounded(usize),
    /// Unbounded sequence.
    Sequence,
}

/// Field of a section.
#[derive(Debug, Clone)]
pub struct Field {
    pub name: String,
    pub base: Base,
    /// Maximum length of a bounded string; 0: unbounded, or not a string.
    pub string_capacity: usize,
    pub count: Count,
    /// Default value in rosidl's form; empty: none. Neither the hash nor the Rust type depends on it.
    pub default_value: String,
    /// Comment lines that belong to the field.
    pub comment: Vec<String>,
}

/// Constant of a section.
#[derive(Debug, Clone)]
pub struct Constant {
    pub name: String,
    pub type_name: String,
    pub value: String,
    pub comment: Vec<String>,
}

/// Fields and constants between two `---` lines.
#[derive(Debug, Clone, Default)]
pub struct Section {
    pub comment: Vec<String>,
    pub fields: Vec<Field>,
    pub constants: Vec<Constant>,
}

const PRIMITIVES: [&str; 16] = [
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64",
    "uint64", "string", "wstring", "float128",
];

/// Returns the sections of an interface file of `package`: one for .msg, two for .srv, three for .action.
pub fn sections(text: &str, package: &str) -> Result<Vec<Section>, String> {
    let mut sections = vec![Section::default()];
    let mut pending: Vec<String> = Vec::new();
    let mut seen_member = false;
    for (number, raw) in text.lines().enumerate() {
        let line = raw.trim();
        let current = sections.last_mut().expect("there is always a section");
        if line == "---" {
            current.comment.append(&mut pending);
            sections.push(Section::default());
            seen_member = false;
        } else if let Some(comment) = line.strip_prefix('#') {
            pending.push(comment.trim().to_owned());
        } else if line.is_empty() {
            // A comment block before the first member and followed by a blank line describes the whole interface.
            if !seen_member {
                current.comment.append(&mut pending);
            }
            pending.clear();
        } else {
            seen_member = true;
            let comment = std::mem::take(&mut pending);
            member(line, package, comment, current).map_err(|e| format!("line {}: {e}: `{line}`", number + 1))?;
        }
    }
    Ok(sections)
}

fn member(line: &str, package: &str, mut comment: Vec<String>, section: &mut Section) -> Result<(), String> {
    let (type_text, rest) = line.split_once(char::is_whitespace).ok_or("expected TYPE NAME")?;
    let rest = rest.trim();
    let name_end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let name = rest[..name_end].to_owned();
    let after = rest[name_end..].trim_start();
    if let Some(value) = after.strip_prefix('=') {
        let (value, trailing) = split_comment(value);
        comment.extend((!trailing.is_empty()).then(|| trailing.to_owned()));
        let value = value.trim().trim_matches(['"', '\'']).to_owned();
        section.constants.push(Constant { name, type_name: type_text.to_owned(), value, comment });
        return Ok(());
    }
    // The text between the name and a comment is a default value.
    let (default, trailing) = split_comment(after);
    comment.extend((!trailing.is_empty()).then(|| trailing.to_owned()));
    let (base, string_capacity, count) = field_type(type_text, package)?;
    let default_value = default_value(default.trim(), &base);
    section.fields.push(Field { name, base, string_capacity, count, default_value, comment });
    Ok(())
}

/// Returns a default value in Python's form, as rosidl writes it: `1` of a float becomes `1.0`, `true` becomes `True`.
fn default_value(text: &str, base: &Base) -> String {
    match base {
        Base::Primitive(name) if name == "bool" => match text.to_lowercase().as_str() {
            "true" | "1" => "True".to_owned(),
            "false" | "0" => "False".to_owned(),
            _ => text.to_owned(),
        },
        Base::Primitive(name) if name.starts_with("float") && text.parse::<i64>().is_ok() => format!("{text}.0"),
        _ => text.to_owned(),
    }
}

/// Splits at the first `#`. As in rosidl, a `#` inside quotes also begins a comment.
fn split_comment(text: &str) -> (&str, &str) {
    text.split_once('#').map_or((text, ""), |(a, b)| (a, b.trim()))
}

fn field_type(text: &str, package: &str) -> Result<(Base, usize, Count), String> {
    let number = |t: &str| t.parse::<usize>().map_err(|_| format!("expected a size, got `{t}`"));
    let (element, count) = match text.strip_suffix(']').and_then(|t| t.split_once('[')) {
        None => (text, Count::One),
        Some((element, "")) => (element, Count::Sequence),
        Some((element, size)) => match size.strip_prefix("<=") {
            Some(bound) => (element, Count::Bounded(number(bound)?)),
            None => (element, Count::Array(number(size)?)),
        },
    };
    let (name, capacity) = match element.split_once("<=") {
        Some((name, bound)) => (name, number(bound)?),
        None => (element, 0),
    };
    let base = if PRIMITIVES.contains(&name) {
        Base::Primitive(name.to_owned())
    } else if let Some((package, message)) = name.split_once('/') {
        Base::Message(package.to_owned(), message.rsplit('/').next().unwrap_or(message).to_owned())
    // rosidl resolves a bare `Header` to std_msgs in every package.
    } else if name == "Header" {
        Base::Message("std_msgs".to_owned(), name.to_owned())
    } else {
        Base::Message(package.to_owned(), name.to_owned())
    };
    Ok((base, capacity, count))
}
