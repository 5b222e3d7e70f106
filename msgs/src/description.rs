//! Type descriptions (REP 2011), the content of a node's answers to `get_type_description`.

use crate::type_description_interfaces::msg::{
    Field, FieldType, IndividualTypeDescription, TypeDescription, TypeSource,
};
use std::collections::BTreeMap;

/// Field of a structure, with the members of `type_description_interfaces/msg/Field` and `FieldType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldInfo {
    /// Name.
    pub name: &'static str,
    /// Constant of `FieldType`.
    pub type_id: u8,
    /// Length of an array, maximum length of a bounded sequence, otherwise 0.
    pub capacity: u64,
    /// Maximum length of a bounded string, otherwise 0.
    pub string_capacity: u64,
    /// Full name of the nested structure; empty for a primitive.
    pub nested_type_name: &'static str,
    /// Default value in Python's form; empty: none.
    pub default_value: &'static str,
}

/// Structure: a message, a service, an action, or a type derived from a service or an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StructureInfo {
    /// Full name, such as `std_srvs/srv/SetBool_Request`.
    pub type_name: &'static str,
    /// RIHS01 hash of the type description.
    pub type_hash: &'static str,
    /// Fields in order.
    pub fields: &'static [FieldInfo],
}

/// Returns every structure of this crate, sorted by name.
pub fn structures() -> &'static [StructureInfo] {
    crate::STRUCTURES
}

fn find(type_name: &str) -> Option<&'static StructureInfo> {
    let found = structures().binary_search_by(|structure| structure.type_name.cmp(type_name));
    found.ok().map(|index| &structures()[index])
}

/// Returns the description of the structure called `type_name` and the sources of all types in it; `None` for a structure that
/// this crate does not have.
pub fn described(type_name: &str) -> Option<(TypeDescription, Vec<TypeSource>)> {
    let main = find(type_name)?;
    let mut referenced = BTreeMap::new();
    let mut open = vec![main];
    while let Some(structure) = open.pop() {
        for nested in structure.fields.iter().filter_map(|field| find(field.nested_type_name)) {
            if referenced.insert(nested.type_name, nested).is_none() {
                open.push(nested);
            }
        }
    }
    let sources = std::iter::once(main).chain(referenced.values().copied()).map(source).collect();
    let description = TypeDescription {
        type_description: individual(main),
        referenced_type_descriptions: referenced.into_values().map(individual).collect(),
    };
    Some((description, sources))
}

fn individual(structure: &StructureInfo) -> IndividualTypeDescription {
    let field = |field: &FieldInfo| Field {
        name: field.name.to_owned(),
        r#type: FieldType {
            type_id: field.type_id,
            capacity: field.capacity,
            string_capacity: field.string_capacity,
            nested_type_name: field.nested_type_name.to_owned(),
        },
        default_value: field.default_value.to_owned(),
    };
    IndividualTypeDescription {
        type_name: structure.type_name.to_owned(),
        fields: structure.fields.iter().map(field).collect(),
    }
}

/// Returns the interface file of a type, trimmed as rosidl does. Types derived from a service or an action have no file.
fn source(structure: &StructureInfo) -> TypeSource {
    let file = crate::SOURCES.iter().find(|(name, ..)| *name == structure.type_name);
    let (encoding, text) = file.map_or(("implicit", ""), |(_, encoding, text)| (*encoding, *text));
    TypeSource {
        type_name: structure.type_name.to_owned(),
        encoding: encoding.to_owned(),
        raw_file_contents: text.trim().to_owned(),
    }
}
