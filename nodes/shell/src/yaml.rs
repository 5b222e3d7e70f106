//! A small untyped YAML value, for parameter files and `-p name:=value`.

use serde::Deserialize;
use serde::de::{Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// What a YAML document contains, with maps in the order of the file.
#[derive(Clone, Debug, PartialEq)]
pub enum Yaml {
    /// Nothing, `null` or `~`.
    Null,
    /// `true` or `false`.
    Bool(bool),
    /// An integer without point or exponent.
    Integer(i64),
    /// A number with point or exponent.
    Float(f64),
    /// A quoted or plain string.
    String(String),
    /// A list.
    List(Vec<Yaml>),
    /// A map, in the order of the file.
    Map(Vec<(String, Yaml)>),
}

impl Yaml {
    /// Reads one document. Booleans are those of YAML 1.1 (`yes`, `off`, `y`), and a leading zero makes a number octal,
    /// as in ROS 2; numbers must be finite.
    ///
    /// # Errors
    /// The parser's message, with line and column.
    pub fn parse(text: &str) -> Result<Self, String> {
        let options = serde_saphyr::options! { with_snippet: false, legacy_octal_numbers: true };
        serde_saphyr::from_str_with_options(text, options).map_err(|error| error.to_string())
    }

    /// The kind and the value in words, for messages: `the integer 3`.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Null => "nothing".to_owned(),
            Self::Bool(value) => format!("the boolean {value}"),
            Self::Integer(value) => format!("the integer {value}"),
            Self::Float(value) => format!("the number {value:?}"),
            Self::String(value) => format!("the string {value:?}"),
            Self::List(items) => format!("a list of {}", items.len()),
            Self::Map(_) => "a map".to_owned(),
        }
    }
}

impl<'de> Deserialize<'de> for Yaml {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(YamlVisitor)
    }
}

struct YamlVisitor;

impl<'de> Visitor<'de> for YamlVisitor {
    type Value = Yaml;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a YAML value")
    }

    fn visit_unit<E: Error>(self) -> Result<Yaml, E> {
        Ok(Yaml::Null)
    }

    fn visit_none<E: Error>(self) -> Result<Yaml, E> {
        Ok(Yaml::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Yaml, D::Error> {
        Yaml::deserialize(deserializer)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Yaml, E> {
        Ok(Yaml::Bool(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Yaml, E> {
        Ok(Yaml::Integer(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Yaml, E> {
        i64::try_from(value)
            .map(Yaml::Integer)
            .map_err(|_| E::custom(format!("expected an integer of at most 2^63 - 1, got {value}")))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Yaml, E> {
        Ok(Yaml::Float(value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Yaml, E> {
        Ok(Yaml::String(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Yaml, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Yaml::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Yaml, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Yaml::Map(entries))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalars_keep_their_yaml_types() {
        for (text, expected) in [
            ("3", Yaml::Integer(3)),
            ("-3", Yaml::Integer(-3)),
            ("0x10", Yaml::Integer(16)),
            ("010", Yaml::Integer(8)),
            ("1.", Yaml::Float(1.0)),
            ("-.5e-3", Yaml::Float(-0.0005)),
            ("Y", Yaml::Bool(true)),
            ("N", Yaml::Bool(false)),
            ("TRUE", Yaml::Bool(true)),
            ("2024-01-01", Yaml::String("2024-01-01".into())),
            ("!!str 1", Yaml::String("1".into())),
            ("3.0", Yaml::Float(3.0)),
            ("1e-3", Yaml::Float(1e-3)),
            ("true", Yaml::Bool(true)),
            ("off", Yaml::Bool(false)),
            ("\"3\"", Yaml::String("3".into())),
            ("measured", Yaml::String("measured".into())),
            ("", Yaml::Null),
            ("~", Yaml::Null),
            ("[1, 2.5]", Yaml::List(vec![Yaml::Integer(1), Yaml::Float(2.5)])),
        ] {
            assert_eq!(Yaml::parse(text).unwrap(), expected, "{text:?}");
        }
        assert!(Yaml::parse(".nan").unwrap_err().contains("non-finite"));
    }

    #[test]
    fn maps_keep_the_order_of_the_file() {
        let Yaml::Map(entries) = Yaml::parse("b: 1\na: {c: x}\n").unwrap() else {
            panic!("expected a map");
        };
        let keys: Vec<_> = entries.iter().map(|(key, _)| key.as_str()).collect();
        assert_eq!(keys, ["b", "a"]);
    }

    #[test]
    fn broken_yaml_and_duplicate_keys_are_errors() {
        assert!(Yaml::parse("a: [1").is_err());
        assert!(Yaml::parse("a: 1\na: 2\n").is_err());
    }
}
