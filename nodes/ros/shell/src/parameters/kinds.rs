//! Rust types of parameters, and their conversions.

use super::yaml::Yaml;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

/// Value of a parameter in ROS 2.
pub type Value = ros2_client::ParameterValue;

/// Returns a value in the form that a user writes.
pub(crate) fn in_words(value: &Value) -> String {
    match value {
        Value::NotSet => "not set".to_owned(),
        Value::Boolean(value) => value.to_string(),
        Value::Integer(value) => value.to_string(),
        Value::Double(value) => format!("{value:?}"),
        Value::String(value) => value.clone(),
        Value::ByteArray(values) => format!("{values:?}"),
        Value::BooleanArray(values) => format!("{values:?}"),
        Value::IntegerArray(values) => format!("{values:?}"),
        Value::DoubleArray(values) => format!("{values:?}"),
        Value::StringArray(values) => format!("{values:?}"),
    }
}

/// Rust type of a parameter.
pub trait ParamKind: Clone + Send + Sync + 'static {
    /// Storage of the present value: an atomic for numbers and booleans, otherwise a lock.
    type Cell: Send + Sync + 'static;

    /// Type in words, for messages and descriptions.
    const WORD: &'static str;

    /// Converts to a ROS 2 value.
    fn to_value(&self) -> Value;

    /// Converts from a ROS 2 value. An integer that a double represents exactly is accepted for a double; other types must match.
    fn from_value(value: &Value) -> Option<Self>;

    /// Converts from a value of a parameter file or of `-p`.
    fn from_yaml(yaml: &Yaml) -> Option<Self>;

    /// Creates a cell with this value.
    fn into_cell(self) -> Self::Cell;

    /// Returns the value in a cell.
    fn load(cell: &Self::Cell) -> Self;

    /// Replaces the value in a cell.
    fn store(cell: &Self::Cell, value: Self);
}

/// Returns the double that equals an integer; `None` beyond 2^53, where not every integer has one.
fn exact_double(integer: i64) -> Option<f64> {
    let double = integer as f64;
    // The mantissa of a double has 53 bits.
    (integer.unsigned_abs() <= 1 << 53).then_some(double)
}

fn yaml_list<T>(yaml: &Yaml, item: impl Fn(&Yaml) -> Option<T>) -> Option<Vec<T>> {
    match yaml {
        Yaml::List(items) => items.iter().map(item).collect(),
        _ => None,
    }
}

impl ParamKind for f64 {
    type Cell = AtomicU64;
    const WORD: &'static str = "a number (double)";

    fn to_value(&self) -> Value {
        Value::Double(*self)
    }

    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Double(number) => Some(*number),
            Value::Integer(integer) => exact_double(*integer),
            _ => None,
        }
    }

    fn from_yaml(yaml: &Yaml) -> Option<Self> {
        match yaml {
            Yaml::Float(number) => Some(*number),
            Yaml::Integer(integer) => exact_double(*integer),
            _ => None,
        }
    }

    fn into_cell(self) -> AtomicU64 {
        AtomicU64::new(self.to_bits())
    }

    fn load(cell: &AtomicU64) -> Self {
        Self::from_bits(cell.load(Ordering::Acquire))
    }

    fn store(cell: &AtomicU64, value: Self) {
        cell.store(value.to_bits(), Ordering::Release);
    }
}

impl ParamKind for i64 {
    type Cell = AtomicI64;
    const WORD: &'static str = "an integer";

    fn to_value(&self) -> Value {
        Value::Integer(*self)
    }

    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Integer(integer) => Some(*integer),
            _ => None,
        }
    }

    fn from_yaml(yaml: &Yaml) -> Option<Self> {
        match yaml {
            Yaml::Integer(integer) => Some(*integer),
            _ => None,
        }
    }

    fn into_cell(self) -> AtomicI64 {
        AtomicI64::new(self)
    }

    fn load(cell: &AtomicI64) -> Self {
        cell.load(Ordering::Acquire)
    }

    fn store(cell: &AtomicI64, value: Self) {
        cell.store(value, Ordering::Release);
    }
}

impl ParamKind for bool {
    type Cell = AtomicBool;
    const WORD: &'static str = "a boolean";

    fn to_value(&self) -> Value {
        Value::Boolean(*self)
    }

    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Boolean(boolean) => Some(*boolean),
            _ => None,
        }
    }

    fn from_yaml(yaml: &Yaml) -> Option<Self> {
        match yaml {
            Yaml::Bool(boolean) => Some(*boolean),
            _ => None,
        }
    }

    fn into_cell(self) -> AtomicBool {
        AtomicBool::new(self)
    }

    fn load(cell: &AtomicBool) -> Self {
        cell.load(Ordering::Acquire)
    }

    fn store(cell: &AtomicBool, value: Self) {
        cell.store(value, Ordering::Release);
    }
}

macro_rules! behind_a_lock {
    ($kind:ty, $word:literal, $variant:ident, $from_yaml:expr, $from_value:expr) => {
        impl ParamKind for $kind {
            type Cell = RwLock<$kind>;
            const WORD: &'static str = $word;

            fn to_value(&self) -> Value {
                Value::$variant(self.clone())
            }

            fn from_value(value: &Value) -> Option<Self> {
                let convert: fn(&Value) -> Option<$kind> = $from_value;
                convert(value)
            }

            fn from_yaml(yaml: &Yaml) -> Option<Self> {
                let convert: fn(&Yaml) -> Option<$kind> = $from_yaml;
                convert(yaml)
            }

            fn into_cell(self) -> RwLock<$kind> {
                RwLock::new(self)
            }

            fn load(cell: &RwLock<$kind>) -> Self {
                cell.read().unwrap_or_else(PoisonError::into_inner).clone()
            }

            fn store(cell: &RwLock<$kind>, value: Self) {
                *cell.write().unwrap_or_else(PoisonError::into_inner) = value;
            }
        }
    };
}

fn yaml_string(yaml: &Yaml) -> Option<String> {
    match yaml {
        Yaml::String(text) => Some(text.clone()),
        _ => None,
    }
}

behind_a_lock!(String, "a string", String, yaml_string, |value| match value {
    Value::String(text) => Some(text.clone()),
    _ => None,
});
behind_a_lock!(Vec<f64>, "a list of numbers (doubles)", DoubleArray, |yaml| yaml_list(yaml, f64::from_yaml), |value| {
    match value {
        Value::DoubleArray(numbers) => Some(numbers.clone()),
        Value::IntegerArray(integers) => integers.iter().map(|item| exact_double(*item)).collect(),
        _ => None,
    }
});
behind_a_lock!(
    Vec<i64>,
    "a list of integers",
    IntegerArray,
    |yaml| yaml_list(yaml, i64::from_yaml),
    |value| match value {
        Value::IntegerArray(integers) => Some(integers.clone()),
        _ => None,
    }
);
behind_a_lock!(
    Vec<String>,
    "a list of strings",
    StringArray,
    |yaml| yaml_list(yaml, yaml_string),
    |value| match value {
        Value::StringArray(items) => Some(items.clone()),
        _ => None,
    }
);
