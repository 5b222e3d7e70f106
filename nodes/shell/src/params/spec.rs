//! What a parameter means and which values it may have.

use super::kinds::Value;
use std::fmt;
use std::ops::RangeInclusive;
use std::sync::Arc;

type Check = Arc<dyn Fn(&Value) -> Result<(), String> + Send + Sync>;

/// A parameter's description, unit and limits. Numbers must be finite in any case.
#[derive(Clone)]
pub struct ParamSpec {
    pub(super) description: String,
    pub(super) unit: Option<String>,
    pub(super) range: Option<(f64, f64)>,
    pub(super) integer_range: Option<(i64, i64)>,
    pub(super) choices: Vec<String>,
    pub(super) read_only: bool,
    check: Option<Check>,
}

impl ParamSpec {
    /// A parameter without limits. The description says what larger and smaller values do.
    #[must_use]
    pub fn new(description: impl Into<String>) -> Self {
        Self {
            description: description.into(),
            unit: None,
            range: None,
            integer_range: None,
            choices: Vec::new(),
            read_only: false,
            check: None,
        }
    }

    /// The unit, in SI, which also stands in the name where it has one: `m`, `s`, `Hz`.
    #[must_use]
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = Some(unit.into());
        self
    }

    /// Doubles, or every item of a list of doubles, must lie in this range.
    #[must_use]
    pub fn range(mut self, range: RangeInclusive<f64>) -> Self {
        self.range = Some((*range.start(), *range.end()));
        self
    }

    /// Integers, or every item of a list of integers, must lie in this range.
    #[must_use]
    pub fn integer_range(mut self, range: RangeInclusive<i64>) -> Self {
        self.integer_range = Some((*range.start(), *range.end()));
        self
    }

    /// A string must be one of these.
    #[must_use]
    pub fn choices(mut self, choices: &[&str]) -> Self {
        self.choices = choices.iter().map(|&choice| choice.to_owned()).collect();
        self
    }

    /// The value is fixed once the node has started.
    #[must_use]
    pub fn read_only(mut self) -> Self {
        self.read_only = true;
        self
    }

    /// A further condition on the value; the error is the reason that the setter is told.
    #[must_use]
    pub fn check(mut self, check: impl Fn(&Value) -> Result<(), String> + Send + Sync + 'static) -> Self {
        self.check = Some(Arc::new(check));
        self
    }

    /// Whether a value of the right type is allowed; the error says what was expected and what came.
    pub(super) fn allows(&self, value: &Value) -> Result<(), String> {
        match value {
            Value::Double(number) => self.allows_number(*number)?,
            Value::DoubleArray(numbers) => {
                numbers.iter().try_for_each(|number| self.allows_number(*number))?;
            }
            Value::Integer(integer) => self.allows_integer(*integer)?,
            Value::IntegerArray(integers) => {
                integers.iter().try_for_each(|integer| self.allows_integer(*integer))?;
            }
            Value::String(text) if !self.choices.is_empty() && !self.choices.contains(text) => {
                return Err(format!("expected {}, got {text:?}", self.choices.join(" or ")));
            }
            _ => {}
        }
        self.check.as_ref().map_or(Ok(()), |check| check(value))
    }

    fn allows_number(&self, number: f64) -> Result<(), String> {
        if !number.is_finite() {
            return Err(format!("expected a finite number, got {number}"));
        }
        match self.range {
            Some((low, high)) if number < low || number > high => {
                Err(format!("expected {low} to {high}{}, got {number}", self.unit_suffix()))
            }
            _ => Ok(()),
        }
    }

    fn allows_integer(&self, integer: i64) -> Result<(), String> {
        match self.integer_range {
            Some((low, high)) if integer < low || integer > high => {
                Err(format!("expected {low} to {high}{}, got {integer}", self.unit_suffix()))
            }
            _ => Ok(()),
        }
    }

    fn unit_suffix(&self) -> String {
        self.unit.as_ref().map_or_else(String::new, |unit| format!(" {unit}"))
    }

    /// The limits in words, for `ros2 param describe`.
    pub(super) fn constraints(&self) -> String {
        let mut parts = Vec::new();
        if let Some(unit) = &self.unit {
            parts.push(format!("unit {unit}"));
        }
        if !self.choices.is_empty() {
            parts.push(format!("one of {}", self.choices.join(", ")));
        }
        parts.join("; ")
    }
}

impl ParamSpec {
    /// Description and limits in one line, for `--help`.
    pub(crate) fn in_words(&self) -> String {
        let mut limits = Vec::new();
        if let Some((low, high)) = self.range {
            limits.push(format!("{low} to {high}"));
        }
        if let Some((low, high)) = self.integer_range {
            limits.push(format!("{low} to {high}"));
        }
        let constraints = self.constraints();
        if !constraints.is_empty() {
            limits.push(constraints);
        }
        if self.read_only {
            limits.push("read-only".to_owned());
        }
        if limits.is_empty() {
            self.description.clone()
        } else {
            format!("{} ({})", self.description, limits.join("; "))
        }
    }
}

impl fmt::Debug for ParamSpec {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("ParamSpec")
            .field("description", &self.description)
            .field("constraints", &self.constraints())
            .field("read_only", &self.read_only)
            .finish_non_exhaustive()
    }
}
