//! Type descriptions and their RIHS01 hashes, as rosidl computes them (REP 2011).

use crate::parse::{Base, Count, Field, Section};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};

/// Structure with its full name (`package/kind/Name`) and its fields.
#[derive(Debug, Clone)]
pub struct Structure {
    pub name: String,
    pub fields: Vec<Field>,
}

/// Structures by full name.
#[derive(Default)]
pub struct Catalogue {
    structures: BTreeMap<String, Structure>,
}

/// Returns the full name of the structure that a field refers to. Types derived from a service or an action carry their kind
/// in the package part, as `package:kind`.
fn referred(base: &Base) -> Option<String> {
    match base {
        Base::Primitive(_) => None,
        Base::Message(package, name) => Some(match package.split_once(':') {
            Some((package, kind)) => format!("{package}/{kind}/{name}"),
            None => format!("{package}/msg/{name}"),
        }),
    }
}

fn nested(name: &str, package: &str, kind: &str, message: &str, count: Count) -> Field {
    let package = if kind == "msg" { package.to_owned() } else { format!("{package}:{kind}") };
    let base = Base::Message(package, message.to_owned());
    Field { name: name.to_owned(), base, string_capacity: 0, count, default_value: String::new(), comment: Vec::new() }
}

fn primitive(name: &str, type_name: &str) -> Field {
    let base = Base::Primitive(type_name.to_owned());
    Field {
        name: name.to_owned(),
        base,
        string_capacity: 0,
        count: Count::One,
        default_value: String::new(),
        comment: Vec::new(),
    }
}

impl Catalogue {
    fn add(&mut self, package: &str, kind: &str, name: &str, fields: Vec<Field>) {
        let name = format!("{package}/{kind}/{name}");
        self.structures.insert(name.clone(), Structure { name, fields });
    }

    /// Adds a message.
    pub fn message(&mut self, package: &str, kind: &str, name: &str, section: &Section) {
        self.add(package, kind, name, section.fields.clone());
    }

    /// Adds a service with its request, response and event; `kind` is `srv`, or `action` for the services of an action.
    pub fn service(&mut self, package: &str, kind: &str, name: &str, request: Vec<Field>, response: Vec<Field>) {
        let part = |suffix: &str| format!("{name}_{suffix}");
        self.add(package, kind, &part("Request"), request);
        self.add(package, kind, &part("Response"), response);
        let event = vec![
            nested("info", "service_msgs", "msg", "ServiceEventInfo", Count::One),
            nested("request", package, kind, &part("Request"), Count::Bounded(1)),
            nested("response", package, kind, &part("Response"), Count::Bounded(1)),
        ];
        self.add(package, kind, &part("Event"), event);
        let members = [("request_message", "Request"), ("response_message", "Response"), ("event_message", "Event")];
        let fields = members.map(|(field, suffix)| nested(field, package, kind, &part(suffix), Count::One));
        self.add(package, kind, name, fields.to_vec());
    }

    /// Adds an action with the types derived from its goal, result and feedback.
    pub fn action(&mut self, package: &str, name: &str, goal: &Section, result: &Section, feedback: &Section) {
        let part = |suffix: &str| format!("{name}_{suffix}");
        let own = |field: &str, suffix: &str| nested(field, package, "action", &part(suffix), Count::One);
        let goal_id = || nested("goal_id", "unique_identifier_msgs", "msg", "UUID", Count::One);
        for (suffix, section) in [("Goal", goal), ("Result", result), ("Feedback", feedback)] {
            self.add(package, "action", &part(suffix), section.fields.clone());
        }
        let stamp = nested("stamp", "builtin_interfaces", "msg", "Time", Count::One);
        let accepted = vec![primitive("accepted", "bool"), stamp];
        self.service(package, "action", &part("SendGoal"), vec![goal_id(), own("goal", "Goal")], accepted);
        let answer = vec![primitive("status", "int8"), own("result", "Result")];
        self.service(package, "action", &part("GetResult"), vec![goal_id()], answer);
        self.add(package, "action", &part("FeedbackMessage"), vec![goal_id(), own("feedback", "Feedback")]);
        let members = [
            ("goal", "Goal"),
            ("result", "Result"),
            ("feedback", "Feedback"),
            ("send_goal_service", "SendGoal"),
            ("get_result_service", "GetResult"),
            ("feedback_message", "FeedbackMessage"),
        ];
        self.add(package, "action", name, members.map(|(field, suffix)| own(field, suffix)).to_vec());
    }

    /// Returns the Rust source of a `StructureInfo` for every structure.
    pub fn rows(&self) -> Result<String, String> {
        let mut rows = String::new();
        for (name, structure) in &self.structures {
            let fields: String = fields(structure).iter().map(row).collect();
            let hash = self.hash(name)?;
            rows.push_str(&format!(
                "    StructureInfo {{ type_name: {name:?}, type_hash: {hash:?}, fields: &[{fields}] }},\n"
            ));
        }
        Ok(rows)
    }

    /// Returns the structure called `name`.
    pub fn get(&self, name: &str) -> Result<&Structure, String> {
        self.structures.get(name).ok_or_else(|| format!("no definition of `{name}`"))
    }

    /// Returns the full names of all structures that `name` refers to, directly or through others, in alphabetical order.
    pub fn references(&self, name: &str) -> Result<BTreeSet<String>, String> {
        let mut found = BTreeSet::new();
        let mut open = vec![name.to_owned()];
        while let Some(next) = open.pop() {
            for referred in self.get(&next)?.fields.iter().filter_map(|f| referred(&f.base)) {
                if found.insert(referred.clone()) {
                    open.push(referred);
                }
            }
        }
        Ok(found)
    }

    /// Returns the RIHS01 hash of `name`: SHA-256 of its type description in JSON, without default values (REP 2011).
    pub fn hash(&self, name: &str) -> Result<String, String> {
        let mut referenced = Vec::new();
        for r in self.references(name)? {
            referenced.push(description(self.get(&r)?));
        }
        // Byte for byte the JSON of rosidl, blanks included: the hash covers them.
        let json = format!(
            "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
            description(self.get(name)?),
            referenced.join(", ")
        );
        let digest = Sha256::digest(json.as_bytes());
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        Ok(format!("RIHS01_{hex}"))
    }
}

/// Returns the fields of a structure. IDL has no empty structure: rosidl adds one member to it.
fn fields(structure: &Structure) -> Vec<Field> {
    match structure.fields.is_empty() {
        true => vec![primitive("structure_needs_at_least_one_member", "uint8")],
        false => structure.fields.clone(),
    }
}

fn description(structure: &Structure) -> String {
    let fields: Vec<String> = fields(structure).iter().map(field).collect();
    format!("{{\"type_name\": \"{}\", \"fields\": [{}]}}", structure.name, fields.join(", "))
}

fn capacity(f: &Field) -> usize {
    match f.count {
        Count::Array(n) | Count::Bounded(n) => n,
        Count::One | Count::Sequence => 0,
    }
}

/// Returns the Rust source of a `FieldInfo`.
fn row(f: &Field) -> String {
    format!(
        "FieldInfo {{ name: {:?}, type_id: {}, capacity: {}, string_capacity: {}, nested_type_name: {:?}, default_value: {:?} }},",
        f.name,
        type_id(f),
        capacity(f),
        f.string_capacity,
        referred(&f.base).unwrap_or_default(),
        f.default_value
    )
}

fn field(f: &Field) -> String {
    let capacity = capacity(f);
    format!(
        "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \"string_capacity\": {}, \"nested_type_name\": \"{}\"}}}}",
        f.name,
        type_id(f),
        f.string_capacity,
        referred(&f.base).unwrap_or_default()
    )
}

/// Returns the type identifier of `type_description_interfaces/msg/FieldType`.
fn type_id(f: &Field) -> u32 {
    let base = match &f.base {
        Base::Message(..) => 1,
        Base::Primitive(name) => match (name.as_str(), f.string_capacity) {
            ("int8", _) => 2,
            ("uint8" | "char", _) => 3,
            ("int16", _) => 4,
            ("uint16", _) => 5,
            ("int32", _) => 6,
            ("uint32", _) => 7,
            ("int64", _) => 8,
            ("uint64", _) => 9,
            ("float32", _) => 10,
            ("float64", _) => 11,
            ("float128", _) => 12,
            ("bool", _) => 15,
            ("byte", _) => 16,
            ("string", 0) => 17,
            ("wstring", 0) => 18,
            ("string", _) => 21,
            _ => 22,
        },
    };
    base + match f.count {
        Count::One => 0,
        Count::Array(_) => 48,
        Count::Bounded(_) => 96,
        Count::Sequence => 144,
    }
}
