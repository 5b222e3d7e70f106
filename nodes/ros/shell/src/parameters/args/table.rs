//! Comparison with rclpy: the parameters of a node for the same arguments.

use super::*;
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};

/// Returns a value in the table's form: its type and the value, infinities and NaN in words.
fn written(value: &Yaml) -> Value {
    let items = |items: &[Yaml]| -> Value { items.iter().map(|item| written(item)[1].take()).collect() };
    match value {
        Yaml::Bool(value) => json!(["BOOL", value]),
        Yaml::Integer(value) => json!(["INTEGER", value]),
        Yaml::Float(value) if value.is_finite() => json!(["DOUBLE", value]),
        Yaml::Float(value) => json!(["DOUBLE", value.to_string().to_lowercase()]),
        Yaml::String(value) => json!(["STRING", value]),
        Yaml::List(list) => match list.first() {
            None => json!(["NOT_SET", null]),
            Some(first) => json!([format!("{}_ARRAY", written(first)[0].as_str().unwrap()), items(list)]),
        },
    }
}

/// Returns the values of `/cam`, or the refusal. A word that is an object stands for a parameter file with this text.
fn of_cam(words: &[Value]) -> Result<Value, ArgError> {
    let mut files = HashMap::new();
    let mut arguments = vec!["--ros-args".to_owned()];
    for word in words {
        match word.get("file").and_then(Value::as_str) {
            Some(text) => {
                let path = format!("f{}.yaml", files.len());
                arguments.extend(["--params-file".to_owned(), path.clone()]);
                files.insert(PathBuf::from(path), text.to_owned());
            }
            None => arguments.push(word.as_str().unwrap().to_owned()),
        }
    }
    let read = |path: &Path| files.get(path).cloned().ok_or_else(|| std::io::Error::other("no such file"));
    let (args, _) = RosArgs::parse_with(arguments, &read)?;
    let values: BTreeMap<_, _> =
        args.params_for("/", "cam").iter().map(|param| (param.name.clone(), written(&param.value))).collect();
    Ok(json!(values))
}

/// Each row of `rcl.json` holds arguments, rclpy's parameters for them (null: refused), and in some rows the word `refused`. That
/// word marks files on which rclpy confuses its state: a parameter gets no value or a wrong name, or is ignored.
#[test]
fn parameters_are_those_of_rclpy() {
    let rows: Vec<Vec<Value>> = serde_json::from_str(include_str!("rcl.json")).unwrap();
    // Guards against a truncated table.
    assert!(rows.len() > 400);
    for row in rows {
        let words = row[0].as_array().unwrap();
        let expected = if row.len() > 2 { &Value::Null } else { &row[1] };
        let got = of_cam(words);
        assert_eq!(got.as_ref().unwrap_or(&Value::Null), expected, "{words:?}: {got:?}");
        if let Err(error) = got {
            let error = error.to_string();
            let is_named = error.contains("expected") || error.contains("not YAML") || error.contains("no such file");
            assert!(is_named, "{words:?}: {error}");
        }
    }
}
