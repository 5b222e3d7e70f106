//! `catenary bench`: throughput of this machine, accuracy of the simulator against theory, and accuracy of posteriors
//! against hidden truths.

pub mod args;
mod calibration;
mod corruption;
mod costs;
mod cpu_time;
mod episodes;
mod fidelity;
mod inference;
mod networks;
mod policies;
mod pool;
mod runs;
mod sensitivities;
mod support;
mod training;

use anyhow::Result;
use args::{BenchArgs, Benchmark};

/// Runs one benchmark.
pub fn run(arguments: &BenchArgs) -> Result<()> {
    match &arguments.benchmark {
        Benchmark::Pool { model, output } => pool::run(model.as_deref(), output),
        Benchmark::Training { steps, output } => training::run(*steps, output),
        Benchmark::Policies(arguments) => policies::run(arguments),
        Benchmark::Sensitivities { model, episodes, output } => sensitivities::run(model.as_deref(), *episodes, output),
        Benchmark::Fidelity(arguments) => fidelity::run(arguments),
        Benchmark::Calibration(arguments) => calibration::run(arguments),
        Benchmark::Support(arguments) => support::run(arguments),
        Benchmark::Costs(arguments) => costs::run(arguments),
        Benchmark::Networks(arguments) => networks::run(arguments),
        Benchmark::Inference { seeds, output } => inference::run(*seeds, output),
    }
}
