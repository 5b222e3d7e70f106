//! Environments of a model's task for another program: `serve_env MODEL ENVIRONMENTS SEED [THETA...]`. Each line of its input is
//! `[]`, a reset, or a list of actions (dx, dz) in m, one an environment. Each line of its output is the observations of a reset, or for
//! each environment its observation, reward, end (0 none, 1 terminated, 2 truncated) and last observation. Without THETA the prior is
//! drawn at each reset.
#![allow(clippy::print_stdout, clippy::unwrap_used, clippy::disallowed_methods, reason = "an example")]

use catenary_core::{Env, Fidelity, seed};
use catenary_simulator::{VectorEnv, model_text};
use std::io::{BufRead, Write};

/// Draws of the prior, of which each reset picks one.
const DRAWS: usize = 1024;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let model = model_text::read(&std::fs::read_to_string(&words[0]).unwrap()).unwrap();
    let (count, of): (usize, u64) = (words[1].parse().unwrap(), words[2].parse().unwrap());
    let theta: Vec<f64> = words[3..].iter().map(|w| w.parse().unwrap()).collect();
    let mut rng = seed::rng(of, 0);
    let rows = if theta.is_empty() {
        (0..DRAWS).map(|_| model.theta.sample_prior(&mut rng)).collect()
    } else {
        vec![theta; count]
    };
    let mut env = VectorEnv::open(&model, count, rows, Fidelity::Fast, seed::derive(of, 1), 1).unwrap();
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let actions: Vec<[f64; 2]> = serde_json::from_str(&line.unwrap()).unwrap();
        let answer = if actions.is_empty() {
            serde_json::to_string(&env.reset().unwrap()).unwrap()
        } else {
            let rows = env.step(&actions).unwrap().into_iter().map(|t| {
                let end = u8::from(t.terminated) + 2 * u8::from(t.truncated);
                (t.observation, t.reward, end, t.final_observation)
            });
            serde_json::to_string(&rows.collect::<Vec<_>>()).unwrap()
        };
        writeln!(out, "{answer}").unwrap();
        out.flush().unwrap();
    }
}
