//! Prints every type with its hash as JSON, for the tests against rclpy. Messages and the parts of services and actions also
//! get their text and the CDR bytes of a counted instance and of a default instance.

use catenary_msgs::{Filled, Interface, to_cdr};
use serde_json::{Value, json};

fn hex<T: serde::Serialize>(message: &T) -> String {
    let bytes = to_cdr(message).expect("a small instance is serialisable");
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn row<T: Interface + Filled + Default + serde::Serialize>() -> Value {
    json!({
        "type_name": T::TYPE_NAME,
        "hash": T::TYPE_HASH,
        "definition": T::DEFINITION,
        "cdr_filled_hex": hex(&T::filled(&mut 0)),
        "cdr_default_hex": hex(&T::default()),
    })
}

#[allow(clippy::print_stdout, reason = "the table is the program's result")]
fn main() {
    let mut rows: Vec<Value> = catenary_msgs::for_each_structure!(row);
    let markers = catenary_msgs::services_and_actions().iter();
    rows.extend(markers.map(|(type_name, hash)| json!({ "type_name": type_name, "hash": hash })));
    println!("{}", Value::Array(rows));
}
