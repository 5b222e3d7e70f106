//! Outline of a YAML text: its values with their places, so errors can name lines and values can be changed in place.

use serde_saphyr::granit_parser::{Event, Parser, Span, StructureStyle};
use std::ops::Range;

/// Greatest depth of nested collections. A model file has a depth of six; the limit keeps the recursion off deep
/// garbage.
const DEEPEST: usize = 32;

/// Value with its place in the text.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    /// Byte range of the value. A block spans from its first key or item to the end of its last value.
    pub(super) span: Range<usize>,
    /// Line of its first byte, from 1.
    pub(super) line: usize,
    /// Kind and content of the value.
    pub(super) content: Content,
}

/// Kind and content of a value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Content {
    /// Scalar, without quotes.
    Scalar(String),
    /// Map: `key: value` lines, or `{key: value}` in flow style.
    Map { flow: bool, entries: Vec<Entry> },
    /// List: `- item` lines, or `[item]` in flow style.
    List { flow: bool, items: Vec<Node> },
}

/// Key with its value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    pub(super) key: String,
    /// Byte range of the key.
    pub(super) span: Range<usize>,
    /// Line of the key, from 1.
    pub(super) line: usize,
    pub(super) value: Node,
}

impl Node {
    /// Parses a text. None if it is not YAML, or uses features that no model file needs (anchors, several documents).
    pub(super) fn of(text: &str) -> Option<Self> {
        let mut events = Parser::new_from_str(text).filter(|e| !matches!(e, Ok((Event::Comment(..), _))));
        loop {
            match events.next()?.ok()? {
                (Event::StreamStart | Event::DocumentStart(..), _) => {}
                (event, span) => return node(event, span, &mut events, 0),
            }
        }
    }

    /// Entries of a map; empty for other values.
    pub(super) fn entries(&self) -> &[Entry] {
        match &self.content {
            Content::Map { entries, .. } => entries,
            Content::Scalar(_) | Content::List { .. } => &[],
        }
    }

    /// Value of a key of a map.
    pub(super) fn get(&self, key: &str) -> Option<&Node> {
        self.entries().iter().find(|e| e.key == key).map(|e| &e.value)
    }

    /// Value of the key `name`, which identifies items of a list.
    pub(super) fn name(&self) -> Option<&str> {
        match &self.get("name")?.content {
            Content::Scalar(name) => Some(name),
            Content::Map { .. } | Content::List { .. } => None,
        }
    }

    /// Line of the value at `path`, such as `theta.length_m.prior`. Items of a list are addressed by name or index. An
    /// absent value has the line of the nearest value around it.
    pub(super) fn line_of(&self, path: &str) -> usize {
        let (mut node, mut line) = (self, self.line);
        for step in path.split('.') {
            let next = match &node.content {
                Content::Scalar(_) => None,
                Content::Map { entries, .. } => entries.iter().find(|e| e.key == step).map(|e| (&e.value, e.line)),
                Content::List { items, .. } => {
                    let named = items.iter().find(|i| i.name() == Some(step));
                    named.or_else(|| items.get(step.parse::<usize>().ok()?)).map(|i| (i, i.line))
                }
            };
            match next {
                Some(found) => (node, line) = found,
                None => break,
            }
        }
        line
    }

    /// Innermost value that contains the byte `at` in its key or content, with its path. The path of the whole is
    /// empty.
    pub(super) fn at(&self, at: usize) -> (String, &Node) {
        let mut steps: Vec<String> = Vec::new();
        let mut node = self;
        loop {
            let next = match &node.content {
                Content::Scalar(_) => None,
                Content::Map { entries, .. } => entries
                    .iter()
                    .find(|e| e.span.start <= at && at <= e.value.span.end.max(e.span.end))
                    .map(|e| (e.key.clone(), &e.value)),
                Content::List { items, .. } => items
                    .iter()
                    .enumerate()
                    .find(|(_, item)| item.span.start <= at && at <= item.span.end)
                    .map(|(i, item)| (item.name().map_or_else(|| i.to_string(), str::to_owned), item)),
            };
            let Some((step, inner)) = next else { return (steps.join("."), node) };
            steps.push(step);
            node = inner;
        }
    }
}

type Events<'a> = dyn Iterator<Item = Result<(Event<'a>, Span), serde_saphyr::granit_parser::ScanError>> + 'a;

fn node<'a>(event: Event<'a>, span: Span, events: &mut Events<'a>, depth: usize) -> Option<Node> {
    if depth > DEEPEST {
        return None;
    }
    let mut range = span.byte_range()?;
    let line = span.start.line();
    let content = match event {
        Event::Scalar(text, _, 0, None) => Content::Scalar(text.into_owned()),
        Event::MappingStart(style, 0, None) => {
            let mut entries: Vec<Entry> = Vec::new();
            let end = loop {
                let (key, at) = match events.next()?.ok()? {
                    (Event::MappingEnd, end) => break end,
                    (Event::Scalar(key, _, 0, None), at) => (key.into_owned(), at),
                    _ => return None,
                };
                let (event, span) = events.next()?.ok()?;
                let value = node(event, span, events, depth + 1)?;
                entries.push(Entry { key, span: at.byte_range()?, line: at.start.line(), value });
            };
            let flow = style == StructureStyle::Flow;
            // The parser ends a block at the next token, beyond comments and blank lines; it ends with its last value.
            let last = entries.last().map(|e| e.value.span.end.max(e.span.end));
            range.end = if flow { end.byte_range()?.end } else { last? };
            Content::Map { flow, entries }
        }
        Event::SequenceStart(style, 0, None) => {
            let mut items: Vec<Node> = Vec::new();
            let end = loop {
                match events.next()?.ok()? {
                    (Event::SequenceEnd, end) => break end,
                    (event, span) => items.push(node(event, span, events, depth + 1)?),
                }
            };
            let flow = style == StructureStyle::Flow;
            range.end = if flow { end.byte_range()?.end } else { items.last()?.span.end };
            Content::List { flow, items }
        }
        _ => return None,
    };
    Some(Node { span: range, line, content })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# head\nversion: 1\nobject:\n  section: {square: {side_m: 0.015}}   # gr\u{fc}n\n\ntheta:\n  # why\n  - {name: length_m, prior: {uniform: {low: 1, high: 2}}}\n  - name: tip\n    prior:\n      uniform: {low: 3,\n        high: 4}\n";

    #[test]
    fn lines_are_found_by_path_and_by_name() {
        let outline = Node::of(TEXT).unwrap();
        let expected = [
            ("version", 2),
            ("object", 3),
            ("object.section.square.side_m", 4),
            ("object.section.round", 4),
            ("theta", 6),
            ("theta.length_m.prior", 8),
            ("theta.0", 8),
            ("theta.tip", 9),
            ("theta.tip.prior.uniform.low", 11),
            ("theta.tip.prior.uniform.high", 12),
            ("camera.rate_hz", 2),
        ];
        for (path, line) in expected {
            assert_eq!(outline.line_of(path), line, "{path}");
        }
    }

    #[test]
    fn spans_are_those_of_the_text() {
        let outline = Node::of(TEXT).unwrap();
        let section = outline.get("object").unwrap().get("section").unwrap();
        assert_eq!(&TEXT[section.span.clone()], "{square: {side_m: 0.015}}");
        let theta = outline.get("theta").unwrap();
        assert!(TEXT[theta.span.clone()].ends_with("high: 4}"), "{}", &TEXT[theta.span.clone()]);
        let at = TEXT.find("high: 4").unwrap() + 6;
        let (path, value) = outline.at(at);
        assert_eq!(
            (path.as_str(), value.content.clone()),
            ("theta.tip.prior.uniform.high", Content::Scalar("4".into()))
        );
        assert_eq!(outline.at(0).0, "");
    }

    #[test]
    fn yaml_features_beyond_those_of_model_files_have_no_outline() {
        for text in [
            "",
            "a: [1",
            "a: &x 1\nb: *x\n",
            "a:\n\t- b",
            &"[".repeat(500),
            &format!("{}{}", "[".repeat(500), "]".repeat(500)),
        ] {
            assert_eq!(Node::of(text), None, "{text}");
        }
    }
}
