//! Rewriting of a model file: new values are put into the user's text.
//!
//! The old and the new model are written in one format and compared. The old text is changed at the differences alone.
//! Comments, order and the spelling of all other values stay.

use super::outline::{Content, Entry, Node};
use super::{Model, ModelError};
use std::ops::Range;

impl Model {
    /// Changes `text`, a model file, so that it describes this model. Reading the result gives this model, bit by bit.
    ///
    /// Values are changed in place, and new entries are added after the last of their kind. Comments, order and the
    /// spelling of everything else stay. A removed entry takes its own lines with it, including comments on them.
    ///
    /// If the text cannot be changed in place (a text with anchors, a model of another shape), the result is
    /// [`Model::to_yaml`], without comments.
    ///
    /// # Errors
    /// [`ModelError`] if `text` is no model file, or this model cannot be read back.
    pub fn rewrite(&self, text: &str) -> Result<String, ModelError> {
        let (before, after) = (Model::from_yaml(text)?.to_yaml()?, self.to_yaml()?);
        let says_this = |text: &str| Model::from_yaml(text).and_then(|m| m.to_yaml()).is_ok_and(|yaml| yaml == after);
        let ended = if text.ends_with('\n') { text.to_owned() } else { format!("{text}\n") };
        // The result is read back before it is used: an edit that went wrong must not reach the user's file.
        if let Some(changed) = Changes::between(&ended, &before, &after)
            && says_this(&changed)
        {
            return Ok(changed);
        }
        Model::from_yaml(&after)?;
        Ok(after)
    }
}

/// Edits of a text.
struct Changes<'a> {
    text: &'a str,
    edits: Vec<(Range<usize>, String)>,
}

impl<'a> Changes<'a> {
    /// Applies every difference between the texts `before` and `after` to `text`; none if it has no outline.
    fn between(text: &'a str, before: &str, after: &str) -> Option<String> {
        let mut changes = Self { text, edits: Vec::new() };
        changes.compare(&Node::of(text)?, &Node::of(before)?, &Node::of(after)?);
        let Self { mut edits, .. } = changes;
        // Edits run from the end to the beginning, so earlier byte ranges stay valid. Of insertions at one place the
        // last goes first, which keeps their order.
        edits.reverse();
        edits.sort_by_key(|(range, _)| std::cmp::Reverse((range.start, range.end)));
        let mut out = text.to_owned();
        for (range, new) in edits {
            out.replace_range(range, &new);
        }
        Some(out)
    }

    /// Edits the value `old` if `after` differs from `before`.
    fn compare(&mut self, old: &Node, before: &Node, after: &Node) {
        if same(before, after) {
            return;
        }
        match (&old.content, &before.content, &after.content) {
            (Content::Map { flow, entries }, Content::Map { .. }, Content::Map { entries: new, .. }) => {
                // A prior or camera of another kind is replaced as a whole: its fields differ.
                let is_kind = new.len() == 1 && entries.len() == 1 && new[0].key != entries[0].key;
                if is_kind || new.is_empty() {
                    self.replace(old, after);
                } else {
                    self.compare_maps(old, *flow, before, after);
                }
            }
            (Content::List { flow, items }, Content::List { items: b, .. }, Content::List { items: a, .. }) => {
                let named = items.iter().chain(b).chain(a).all(|item| item.name().is_some());
                if named && !a.is_empty() && !items.is_empty() {
                    self.compare_named(old, *flow, b, a);
                } else if items.len() == a.len() && b.len() == a.len() {
                    items.iter().zip(b).zip(a).for_each(|((old, b), a)| self.compare(old, b, a));
                } else {
                    self.replace(old, after);
                }
            }
            _ => self.replace(old, after),
        }
    }

    fn compare_maps(&mut self, old: &Node, flow: bool, before: &Node, after: &Node) {
        for entry in before.entries().iter().filter(|e| after.get(&e.key).is_none()) {
            match old.entries().iter().find(|e| e.key == entry.key) {
                Some(gone) if !flow => self.remove_lines(gone.span.start..gone.value.span.end),
                Some(_) => return self.replace(old, after),
                None => {}
            }
        }
        for entry in after.entries() {
            match (old.get(&entry.key), before.get(&entry.key)) {
                (Some(old), Some(before)) => self.compare(old, before, &entry.value),
                (Some(old), None) => self.replace(old, &entry.value),
                (None, _) => {}
            }
        }
        let is_new = |e: &&Entry| old.get(&e.key).is_none() && !before.get(&e.key).is_some_and(|b| same(b, &e.value));
        for entry in after.entries().iter().filter(is_new) {
            self.insert(old, flow, &format!("{}: {}", quoted(&entry.key), flow_text(&entry.value)));
        }
    }

    /// Compares a list of parameters or effects, whose items are matched by name.
    fn compare_named(&mut self, old: &Node, flow: bool, before: &[Node], after: &[Node]) {
        let Content::List { items, .. } = &old.content else { return };
        let of = |items: &'_ [Node], name: Option<&str>| items.iter().position(|i| i.name() == name);
        for gone in items.iter().filter(|i| of(after, i.name()).is_none()) {
            if flow {
                return self.replace(old, &Node { content: list(after), ..old.clone() });
            }
            self.remove_lines(gone.span.clone());
        }
        for new in after {
            match (of(items, new.name()), of(before, new.name())) {
                (Some(i), Some(b)) => self.compare(&items[i], &before[b], new),
                (Some(i), None) => self.replace(&items[i], new),
                (None, _) => {}
            }
        }
        for new in after.iter().filter(|new| of(items, new.name()).is_none()) {
            self.insert(old, flow, &flow_text(new));
        }
    }

    fn replace(&mut self, old: &Node, new: &Node) {
        self.edits.push((old.span.clone(), flow_text(new)));
    }

    /// Removes the whole lines of an entry.
    fn remove_lines(&mut self, span: Range<usize>) {
        let start = self.line_start(span.start);
        self.edits.push((start..self.line_end(span.end) + 1, String::new()));
    }

    /// Adds an entry or an item after the last one of a collection, in the style of the collection.
    fn insert(&mut self, collection: &Node, flow: bool, new: &str) {
        let (first, last, is_empty) = match &collection.content {
            Content::Map { entries, .. } => (
                entries.first().map(|e| e.span.start),
                entries.last().map(|e| e.value.span.end.max(e.span.end)),
                entries.is_empty(),
            ),
            Content::List { items, .. } => {
                (items.first().map(|i| i.span.start), items.last().map(|i| i.span.end), items.is_empty())
            }
            Content::Scalar(_) => return,
        };
        if flow {
            let comma = if is_empty { "" } else { ", " };
            let end = last.unwrap_or(collection.span.start + 1);
            self.edits.push((end..end, format!("{comma}{new}")));
        } else if let (Some(first), Some(last)) = (first, last) {
            // Text before the first entry on its line: the indentation, and the dash of an item.
            let margin = &self.text[self.line_start(first)..first];
            let margin = if margin.trim().is_empty() || margin.trim() == "-" { margin } else { "" };
            let margin = match &collection.content {
                Content::Map { .. } => margin.replace('-', " "),
                Content::List { .. } | Content::Scalar(_) => margin.to_owned(),
            };
            let end = self.line_end(last) + 1;
            self.edits.push((end..end, format!("{margin}{new}\n")));
        }
    }

    fn line_start(&self, at: usize) -> usize {
        self.text[..at].rfind('\n').map_or(0, |i| i + 1)
    }

    /// Place of the line break that ends the line of `at`. The text ends with a line break.
    fn line_end(&self, at: usize) -> usize {
        self.text[at..].find('\n').map_or(self.text.len() - 1, |i| at + i)
    }
}

fn list(items: &[Node]) -> Content {
    Content::List { flow: true, items: items.to_vec() }
}

/// True if two values are equal. Both come from [`Model::to_yaml`], so scalars are compared as text.
fn same(a: &Node, b: &Node) -> bool {
    match (&a.content, &b.content) {
        (Content::Scalar(a), Content::Scalar(b)) => a == b,
        (Content::Map { entries: a, .. }, Content::Map { entries: b, .. }) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.key == b.key && same(&a.value, &b.value))
        }
        (Content::List { items: a, .. }, Content::List { items: b, .. }) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        _ => false,
    }
}

/// Value on one line, in flow style.
fn flow_text(node: &Node) -> String {
    let join = |parts: Vec<String>| parts.join(", ");
    match &node.content {
        Content::Scalar(text) => quoted(text),
        Content::List { items, .. } => format!("[{}]", join(items.iter().map(flow_text).collect())),
        Content::Map { entries, .. } => {
            let entry = |e: &Entry| format!("{}: {}", quoted(&e.key), flow_text(&e.value));
            format!("{{{}}}", join(entries.iter().map(entry).collect()))
        }
    }
}

/// Scalar that is valid in every context: plain if it is a word or a number, else in double quotes.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.' | '+' | '-');
    let starts = text.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '.' || c == '_');
    let is_number = text.parse::<f64>().is_ok();
    if is_number || (starts && text.chars().all(plain)) {
        return text.to_owned();
    }
    let escaped: String = text.chars().flat_map(|c| c.escape_default()).collect();
    // Rust escapes characters as \u{...}; YAML has \u with four digits and \U with eight.
    let mut out = String::from("\"");
    let mut rest = escaped.as_str();
    while let Some(at) = rest.find("\\u{") {
        let (head, tail) = rest.split_at(at);
        let digits = tail[3..].split('}').next().unwrap_or_default();
        out.push_str(&head.replace("\\'", "'"));
        out.push_str(&format!("\\U{digits:0>8}"));
        rest = &tail[4 + digits.len()..];
    }
    out.push_str(&rest.replace("\\'", "'"));
    out.push('"');
    out
}
