//! Run of the benchmark of supports.

use serde::{Deserialize, Serialize};

/// One line of runs.jsonl: a case and its inference.
#[derive(Debug, Serialize, Deserialize)]
pub struct Line {
    /// Number of the case.
    pub case: usize,
    /// Group of the case, such as `outside` or `dlo_0`.
    pub group: String,
    /// Rule of the support.
    pub rule: String,
    /// Hidden theta, D.
    pub truth: Vec<f64>,
    /// Distance of each truth from the prior support, in its widths (D); 0 inside.
    pub beyond: Vec<f64>,
    /// True for each parameter whose 90 % interval contains the truth.
    pub inside_90: Vec<bool>,
    /// Error of each mean in widths of the prior support.
    pub error: Vec<f64>,
    /// Width of each 90 % interval in widths of the prior support.
    pub width: Vec<f64>,
    /// Error of each mean in the parameter's unit.
    pub absolute: Vec<f64>,
    /// Error of the decimal logarithm of each mean.
    pub decades: Vec<f64>,
    /// True for each parameter whose support at the end contains the truth.
    pub held: Vec<bool>,
    /// Number of moves of the support, over parameters and iterations.
    pub moves: usize,
    /// Wall time of the inference, s.
    pub wall_s: f64,
}
