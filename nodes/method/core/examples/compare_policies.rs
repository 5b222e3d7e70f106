//! Figures of two sets of scores, for `tests/bench/rliable`: reads {"first": [[...]], "second": [[...]], "thresholds": [...],
//! "resamples": N} from its input, one row a stratum, and prints them as JSON.
#![allow(clippy::print_stdout, clippy::unwrap_used, clippy::disallowed_methods, reason = "an example")]

use catenary_core::comparison::Bootstrap;
use serde::Deserialize;

#[derive(Deserialize)]
struct Input {
    first: Vec<Vec<f64>>,
    second: Vec<Vec<f64>>,
    thresholds: Vec<f64>,
    resamples: usize,
}

fn main() {
    let input: Input = serde_json::from_reader(std::io::stdin()).unwrap();
    let bootstrap = Bootstrap { resamples: input.resamples, ..Bootstrap::default() };
    let figures = serde_json::json!({
        "interquartile_mean": bootstrap.interquartile_mean(&input.first),
        "probability_of_improvement": bootstrap.probability_of_improvement(&input.first, &input.second),
        "performance_profile": bootstrap.performance_profile(&input.first, &input.thresholds),
    });
    println!("{figures}");
}
