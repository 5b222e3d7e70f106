//! Description and limits of a parameter.

use super::kinds::Value;
use std::fmt;
use std::ops::RangeInclusive;
use std::sync::Arc;

type Check = Arc<dyn Fn(&Value) -> Result<(), String> + Send + Sync>;

/// Description, unit and limits of a parameter. Numbers must always be finite.
#[derive(Clone)]
pub struct ParamSpec {
    pub(crate) description: String,
    pub(super) unit: Option<String>,
    pub(crate) range: Option<(f64, f64)>,
    pub(crate) integer_range: Option<(i64, i64)>,
    pub(super) choices: Vec<String>,
    pub(crate) read_only: bool,
    check: Option<Check>,
}

impl ParamSpec {
    /// Creates a specification without limits. The description says what larger and smaller values do.
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

    /// Sets the SI unit, which the name also carries: `m`, `s`, `Hz`.
    #[must_use]
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = Some(unit.into());
        self
    }

    /// Sets the range of a double, or of every item of a list of doubles.
    #[must_use]
    pub fn range(mut self, range: RangeInclusive<f64>) -> Self {
        self.range = Some((*range.start(), *range.end()));
        self
    }

    /// Sets the range of an integer, or of every item of a list of integers.
    #[must_use]
    pub fn integer_range(mut self, range: RangeInclusive<i64>) -> Self {
        self.integer_range = Some((*range.start(), *range.end()));
        self
    }

    /// Sets the allowed strings.
    #[must_use]
    pub fn choices(mut self, choices: &[&str]) -> Self {
        self.choices = choices.iter().map(|&choice| choice.to_owned()).collect();
        self
    }

    /// Fixes the value once the node has started.
    #[must_use]
    pub fn read_only(mut self) -> Self {
        self.read_only = true;
        self
    }

    /// Adds a condition on the value. Its error is reported to the setter.
    #[must_use]
    pub fn check(mut self, check: impl Fn(&Value) -> Result<(), String> + Send + Sync + 'static) -> Self {
        self.check = Some(Arc::new(check));
        self
    }

    /// Checks a value of the right type. The error names the expected and the given value.
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

    /// Returns the limits in words, for `ros2 param describe`.
    pub(crate) fn constraints(&self) -> String {
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
    /// Returns description and limits in one line, for `--help`.
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
