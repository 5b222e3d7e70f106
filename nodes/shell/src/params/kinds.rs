//! The Rust types that a parameter can have, and how they travel.

use crate::yaml::Yaml;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

/// A parameter's value as ROS 2 knows it.
pub type Value = ros2_client::ParameterValue;

/// A Rust type that a parameter can have.
pub trait ParamKind: Clone + Send + Sync + 'static {
    /// Where the present value lives; numbers and booleans are atomics.
    type Cell: Send + Sync + 'static;

    /// The type in words, for messages and descriptions.
    const WORD: &'static str;

    /// As a ROS 2 value.
    fn to_value(&self) -> Value;

    /// From a ROS 2 value. An integer is taken for a double, exactly; everything else must match.
    fn from_value(value: &Value) -> Option<Self>;

    /// From a value of a parameter file or of `-p`.
    fn from_yaml(yaml: &Yaml) -> Option<Self>;

    /// A cell with this value.
    fn into_cell(self) -> Self::Cell;

    /// The value in the cell.
    fn load(cell: &Self::Cell) -> Self;

    /// Replaces the value in the cell.
    fn store(cell: &Self::Cell, value: Self);
}

/// The double that is exactly this integer.
fn exact_double(integer: i64) -> Option<f64> {
    let double = integer as f64;
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
