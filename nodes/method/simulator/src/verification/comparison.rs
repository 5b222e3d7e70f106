//! Comparison of a computed value with its reference.

use serde::Serialize;

/// Computed value and its reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Compared quantity, within its case.
    pub what: String,
    /// Unit of both numbers.
    pub unit: &'static str,
    /// Value of the simulator.
    pub computed: f64,
    /// Value of theory.
    pub reference: f64,
}

impl Comparison {
    pub(super) fn new(what: String, unit: &'static str, computed: f64, reference: f64) -> Self {
        Self { what, unit, computed, reference }
    }
}

/// Comparison with its promise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub case: &'static str,
    /// Compared quantity, within its case.
    pub what: String,
    /// Unit of both numbers.
    pub unit: &'static str,
    /// Value of the simulator.
    pub computed: f64,
    /// Value of theory.
    pub reference: f64,
    /// Computed over reference.
    pub ratio: f64,
    /// Promised distance of the ratio from one; none if nothing is promised.
    pub tolerance: Option<f64>,
    /// True if the promise is kept; none if nothing is promised. A NaN keeps no promise.
    pub passes: Option<bool>,
}

impl Row {
    pub(super) fn new(case: &'static str, c: Comparison, tolerance: Option<f64>) -> Self {
        let Comparison { what, unit, computed, reference } = c;
        let ratio = computed / reference;
        let passes = tolerance.map(|t| (ratio - 1.0).abs() <= t);
        Self { case, what, unit, computed, reference, ratio, tolerance, passes }
    }
}
