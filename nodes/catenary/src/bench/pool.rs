//! `catenary bench pool`: episodes per second, by fidelity and number of workers.

use super::cpu_time::cpu_time;
use super::episodes::batch;
use crate::inputs::model_file;
use crate::options::Output;
use crate::terminal::output;
use anyhow::Result;
use catenary_core::{Fidelity, Simulator};
use catenary_simulator::{BeamSimulator, workers};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Repetitions for each number of workers. The fastest counts, because other processes can only slow one down.
const TURNS: usize = 3;

#[derive(Debug, Serialize)]
struct Row {
    fidelity: &'static str,
    workers: usize,
    /// Episodes per second of wall time.
    episodes_per_second: f64,
    /// Episodes per second of the program's CPU time.
    episodes_per_core_second: f64,
    /// Episodes per second and worker, relative to one worker alone.
    scaling: f64,
    unconverged_steps: u64,
    /// Episodes whose start shape did not converge to rest.
    unconverged_equilibria: u64,
}

/// Measures the pool with one worker and with one per processor.
pub fn run(model: Option<&Path>, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(model)?;
    let mut counts = vec![1, workers::available()];
    counts.dedup();
    let mut rows: Vec<Row> = Vec::new();
    for (fidelity, episodes) in
        [(Fidelity::Fast, 100), (Fidelity::FineMesh, 20), (Fidelity::Standard, 100), (Fidelity::Reference, 20)]
    {
        let request = batch(&model, fidelity, episodes)?;
        let simulators = counts.iter().map(|n| BeamSimulator::new(&model, *n)).collect::<Result<Vec<_>, _>>()?;
        let mut best = vec![[f64::INFINITY; 2]; counts.len()];
        for _ in 0..TURNS {
            // Turns alternate between the pools, so that a slow minute of the machine hits all of them.
            for (simulator, best) in simulators.iter().zip(&mut best) {
                let (wall, cpu) = (Instant::now(), cpu_time());
                simulator.simulate(&request)?;
                let seconds = [wall.elapsed(), cpu_time() - cpu].map(|t| t.as_secs_f64());
                *best = [0, 1].map(|i| f64::min(best[i], seconds[i]));
            }
        }
        let alone_s = best[0][0];
        for ((count, simulator), [wall_s, cpu_s]) in counts.iter().zip(&simulators).zip(best) {
            rows.push(Row {
                fidelity: fidelity.name(),
                workers: *count,
                episodes_per_second: episodes as f64 / wall_s,
                episodes_per_core_second: episodes as f64 / cpu_s,
                scaling: alone_s / wall_s / *count as f64,
                unconverged_steps: simulator.unconverged_steps() / TURNS as u64,
                unconverged_equilibria: simulator.unconverged_equilibria() / TURNS as u64,
            });
        }
    }
    output::result(out, &rows, |rows| {
        let head = format!(
            "{:<10} {:>7} {:>11} {:>16} {:>8} {:>11} {:>11}",
            "fidelity", "workers", "episodes/s", "per core-second", "scaling", "unconverged", "not at rest"
        );
        let line = |r: &Row| {
            format!(
                "{:<10} {:>7} {:>11.1} {:>16.1} {:>8.2} {:>11} {:>11}",
                r.fidelity,
                r.workers,
                r.episodes_per_second,
                r.episodes_per_core_second,
                r.scaling,
                r.unconverged_steps,
                r.unconverged_equilibria
            )
        };
        std::iter::once(head).chain(rows.iter().map(line)).collect::<Vec<_>>().join("\n")
    })
}
