//! Rust source of parsed interfaces.

use crate::parse::{Base, Constant, Count, Field, Section};
use std::fmt::Write;

/// Rust keywords that occur as field names.
const KEYWORDS: [&str; 8] = ["type", "ref", "loop", "move", "match", "self", "use", "in"];

/// Structure to emit.
pub struct Emitted<'a> {
    /// Name of the Rust type.
    pub name: &'a str,
    /// Full name of the structure.
    pub type_name: &'a str,
    /// RIHS01 hash.
    pub hash: &'a str,
    /// ros2msg text with all nested definitions.
    pub definition: &'a str,
    /// Comment lines of the type.
    pub comment: &'a [String],
}

/// Returns the source of a structure: its type, its constants, `Interface`, and behind their features `ros2_client::Message`
/// and `Filled`.
pub fn structure(emitted: &Emitted<'_>, section: &Section) -> String {
    let mut out = String::new();
    let fallback = format!("`{}`.", emitted.type_name);
    doc(&mut out, "", emitted.comment, &fallback);
    let _ = writeln!(out, "#[derive(Debug, Clone, PartialEq, Default, ::serde::Serialize, ::serde::Deserialize)]");
    let _ = writeln!(out, "pub struct {} {{", emitted.name);
    for f in &section.fields {
        doc(&mut out, "    ", &f.comment, &format!("`{}`.", f.name));
        if is_bytes(f) {
            out.push_str("    #[serde(with = \"serde_bytes\")]\n");
        }
        let _ = writeln!(out, "    pub {}: {},", rust_name(&f.name), rust_type(f));
    }
    if section.fields.is_empty() {
        out.push_str("    /// Placeholder on the wire: IDL has no empty structure.\n");
        out.push_str("    pub structure_needs_at_least_one_member: u8,\n");
    }
    out.push_str("}\n");
    constants(&mut out, emitted.name, &section.constants);
    let name = emitted.name;
    let _ = writeln!(
        out,
        "impl crate::Interface for {name} {{\n    const TYPE_NAME: &'static str = {:?};\n    const TYPE_HASH: &'static str = {:?};\n    const DEFINITION: &'static str = {:?};\n}}",
        emitted.type_name, emitted.hash, emitted.definition
    );
    let _ = writeln!(out, "#[cfg(feature = \"ros2-client\")]\nimpl ros2_client::Message for {name} {{}}");
    filled(&mut out, name, &section.fields);
    out
}

/// Returns the source of the method `refusal` of a service or an action whose answer is `answer`; empty where the answer has no fields for a
/// failure and its reason.
pub fn refusal(answer: &str, fields: &[Field]) -> String {
    let field = |type_name: &str, names: &[&str]| {
        let is_it = |f: &&Field| {
            matches!(&f.base, Base::Primitive(p) if p == type_name)
                && matches!(f.count, Count::One)
                && names.contains(&f.name.as_str())
        };
        fields.iter().find(is_it).map(|f| rust_name(&f.name))
    };
    let flag = field("bool", &["success", "successful"]);
    let Some((flag, text)) = flag.zip(field("string", &["message", "reason", "failure_reason"])) else {
        return String::new();
    };
    let rest = if fields.len() > 2 { ", ..Default::default()" } else { "" };
    format!(
        "    fn refusal(reason: ::std::string::String) -> ::std::option::Option<{answer}> {{\n        Some({answer} {{ {flag}: false, {text}: reason{rest} }})\n    }}\n"
    )
}

/// Returns the source of the marker type of a service or an action. `parts` are its associated types (`Request = XRequest`, ...),
/// `refusal` comes from [`refusal`].
pub fn marker(
    name: &str,
    interface: &str,
    type_name: &str,
    hash: &str,
    comment: &[String],
    parts: &[(&str, String)],
    refusal: &str,
) -> String {
    let mut out = String::new();
    doc(&mut out, "", comment, &format!("`{type_name}`."));
    let _ = writeln!(out, "#[derive(Debug, Clone, Copy)]\npub enum {name} {{}}");
    let associated: String = parts.iter().map(|(part, ty)| format!("    type {part} = {ty};\n")).collect();
    let _ = writeln!(
        out,
        "impl crate::{interface} for {name} {{\n{associated}    const TYPE_NAME: &'static str = {type_name:?};\n    const TYPE_HASH: &'static str = {hash:?};\n{refusal}}}"
    );
    out
}

fn doc(out: &mut String, indent: &str, comment: &[String], fallback: &str) {
    let lines: Vec<&str> = comment.iter().map(|l| l.trim_matches(['=', '-', ' '])).filter(|l| !l.is_empty()).collect();
    if lines.is_empty() {
        let _ = writeln!(out, "{indent}/// {fallback}");
    }
    for line in lines {
        let line = without_html_link(line);
        let escaped = line.replace('[', "\\[").replace(']', "\\]").replace('<', "\\<");
        let words: Vec<String> = escaped.split(' ').map(linked).collect();
        let escaped = words.join(" ");
        // Markdown would turn a line that begins with a bullet into a list item.
        let escaped = if escaped.starts_with(['*', '+', '-']) { format!("\\{escaped}") } else { escaped };
        let _ = writeln!(out, "{indent}/// {escaped}");
    }
}

/// Replaces an HTML link, which rustdoc warns of, by its text and its address.
fn without_html_link(line: &str) -> String {
    let parts = line.split_once("<a href=\"").and_then(|(before, rest)| {
        let (address, rest) = rest.split_once("\">")?;
        let (text, after) = rest.split_once("</a>")?;
        Some(format!("{before}{text} {address} {}", after.trim_start()))
    });
    parts.unwrap_or_else(|| line.to_owned())
}

/// Returns `word`, as a link if it is a URL.
fn linked(word: &str) -> String {
    let is_address = word.starts_with("http://") || word.starts_with("https://");
    if is_address { format!("<{word}>") } else { word.to_owned() }
}

fn constants(out: &mut String, name: &str, constants: &[Constant]) {
    if constants.is_empty() {
        return;
    }
    let _ = writeln!(out, "impl {name} {{");
    for c in constants {
        doc(out, "    ", &c.comment, &format!("`{}`.", c.name));
        let (ty, value) = match c.type_name.as_str() {
            "string" => ("&'static str", format!("{:?}", c.value)),
            "float32" | "float64" if !c.value.contains(['.', 'e']) => {
                (primitive(&c.type_name), format!("{}.0", c.value))
            }
            other => (primitive(other), c.value.to_lowercase()),
        };
        let _ = writeln!(out, "    pub const {}: {ty} = {value};", c.name);
    }
    out.push_str("}\n");
}

/// Writes the implementation of `Filled`: a deterministic instance in which neighbouring values differ.
fn filled(out: &mut String, name: &str, fields: &[Field]) {
    let values: String = fields
        .iter()
        .map(|f| {
            let value = match f.count {
                Count::One => "crate::Filled::filled(counter)".to_owned(),
                Count::Array(_) => "std::array::from_fn(|_| crate::Filled::filled(counter))".to_owned(),
                // A sequence bounded by one cannot hold the two elements of the other sequences.
                Count::Bounded(1) => "vec![crate::Filled::filled(counter)]".to_owned(),
                Count::Bounded(_) | Count::Sequence => {
                    "(0..2).map(|_| crate::Filled::filled(counter)).collect()".to_owned()
                }
            };
            format!("            {}: {value},\n", rust_name(&f.name))
        })
        .collect();
    let values =
        if fields.is_empty() { "            structure_needs_at_least_one_member: 0,\n".to_owned() } else { values };
    let unused = if fields.is_empty() { "_counter" } else { "counter" };
    let _ = writeln!(
        out,
        "#[cfg(feature = \"filled\")]\nimpl crate::Filled for {name} {{\n    fn filled({unused}: &mut u32) -> Self {{\n        Self {{\n{values}        }}\n    }}\n}}"
    );
}

fn is_bytes(f: &Field) -> bool {
    matches!(&f.base, Base::Primitive(p) if p == "uint8") && matches!(f.count, Count::Sequence | Count::Bounded(_))
}

fn rust_name(name: &str) -> String {
    if KEYWORDS.contains(&name) { format!("r#{name}") } else { name.to_owned() }
}

fn primitive(name: &str) -> &'static str {
    match name {
        "bool" => "bool",
        "byte" | "char" | "uint8" => "u8",
        "int8" => "i8",
        "int16" => "i16",
        "uint16" => "u16",
        "int32" => "i32",
        "uint32" => "u32",
        "int64" => "i64",
        "uint64" => "u64",
        "float32" => "f32",
        "float64" => "f64",
        "string" => "::std::string::String",
        other => panic!("no Rust type for the primitive type {other}: add it to `primitive` in generate/rust.rs"),
    }
}

fn rust_type(f: &Field) -> String {
    let base = match &f.base {
        Base::Primitive(name) => primitive(name).to_owned(),
        Base::Message(package, name) => format!("crate::{package}::msg::{name}"),
    };
    match f.count {
        Count::One => base,
        Count::Array(n) => format!("[{base}; {n}]"),
        Count::Bounded(_) | Count::Sequence => format!("::std::vec::Vec<{base}>"),
    }
}
