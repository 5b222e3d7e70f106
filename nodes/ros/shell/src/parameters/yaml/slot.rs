//! Values of one parameter, one of each type, as rcl stores them.

use super::value::Yaml;

/// Values of one parameter with their origins.
///
/// A second value of the same type replaces the first. A value of another type is kept beside it. The value in effect is the first
/// in the order of the types: boolean, integer, number, string, then lists of these.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slot {
    values: Vec<(Yaml, String)>,
    /// Rank of the last set value.
    last: u8,
}

impl Slot {
    /// Sets the value of its type.
    pub(crate) fn set(&mut self, value: Yaml, origin: &str) {
        self.last = rank(&value);
        let entry = (value, origin.to_owned());
        match self.values.binary_search_by_key(&rank(&entry.0), |(old, _)| rank(old)) {
            Ok(at) => self.values[at] = entry,
            Err(at) => self.values.insert(at, entry),
        }
    }

    /// Adds an item to the open list. `kind` is the first item of that list; `None` before the first.
    pub(crate) fn push(&mut self, item: Yaml, kind: &mut Option<Yaml>, origin: &str) -> Result<(), String> {
        let Some(first) = kind else {
            *kind = Some(item.clone());
            self.set(Yaml::List(vec![item]), origin);
            return Ok(());
        };
        if rank(first) != rank(&item) {
            return Err(format!("expected items all of one type, got {} after {}", item.describe(), first.describe()));
        }
        let is_open = |value: &Yaml| is_list_of(value, first);
        if let Some((Yaml::List(items), _)) = self.values.iter_mut().find(|(value, _)| is_open(value)) {
            items.push(item);
        }
        Ok(())
    }

    /// Ends the open list. An empty list has no type in ROS 2, and any other value takes precedence over it.
    pub(crate) fn end_list(&mut self, kind: Option<Yaml>, origin: &str) {
        if kind.is_none() {
            self.set(Yaml::List(Vec::new()), origin);
        }
    }

    /// Returns the value in effect, with its origin.
    pub(crate) fn value(&self) -> Option<&(Yaml, String)> {
        self.values.first()
    }

    /// Returns the last set value, if it is not in effect.
    pub(crate) fn hidden(&self) -> Option<&(Yaml, String)> {
        self.values.iter().skip(1).find(|(value, _)| rank(value) == self.last)
    }
}

/// Returns true if `value` is a list of items of the same type as `item`.
fn is_list_of(value: &Yaml, item: &Yaml) -> bool {
    matches!(value, Yaml::List(items) if items.first().is_some_and(|first| rank(first) == rank(item)))
}

fn rank(value: &Yaml) -> u8 {
    match value {
        Yaml::Bool(_) => 0,
        Yaml::Integer(_) => 1,
        Yaml::Float(_) => 2,
        Yaml::String(_) => 3,
        // An empty list comes after every typed one.
        Yaml::List(items) => items.first().map_or(8, |item| 4 + rank(item).min(3)),
    }
}
