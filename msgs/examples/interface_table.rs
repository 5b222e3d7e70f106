//! Prints every type with its hash, and for messages and parts of services and actions their text and the CDR bytes of a
//! counted instance, as JSON: what the tests against rclpy compare with.

use catenary_msgs::{Filled, Interface, to_cdr};
use serde_json::{Value, json};

fn row<T: Interface + Filled + serde::Serialize>() -> Value {
    let bytes = to_cdr(&T::filled(&mut 0)).expect("a counted instance is serialisable");
    let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
    json!({ "type_name": T::TYPE_NAME, "hash": T::TYPE_HASH, "definition": T::DEFINITION, "cdr": hex })
}

#[allow(clippy::print_stdout, reason = "the table is the program's result")]
fn main() {
    let mut rows: Vec<Value> = catenary_msgs::for_each_structure!(row);
    let markers = catenary_msgs::services_and_actions().iter();
    rows.extend(markers.map(|(type_name, hash)| json!({ "type_name": type_name, "hash": hash })));
    println!("{}", Value::Array(rows));
}
