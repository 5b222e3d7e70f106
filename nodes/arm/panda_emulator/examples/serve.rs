//! Serves the Franka Control Interface without ROS, for tests with foreign clients.
//!
//!     serve ADDRESS [--generation panda|fr3] [--pace clock|lock_step|elastic] [--patience SECONDS] [--network none|lab]
//!           [--seed N] [--model_library FILE]
//!
//! `--NAME VALUE`, `--NAME=VALUE` and `NAME=VALUE` are the same. Prints `listening ADDRESS`, then each event in a line: the clock of the
//! control box in ms, and the event. Serves until SIGINT or SIGTERM (exit code 0), or until the server's thread ends (exit code 1).
//! Reads one instruction a line on stdin and answers it with a line that begins with `done`; the end of stdin ends nothing:
//!
//!     push FX FY FZ MX MY MZ | user_stop on|off | brakes on|off | guiding on|off | lose_states N | lose_commands N
//!     repeat_states N | swap_states | pose | joints | responses | crash
//!
//! `responses`: number, median, 99th percentile and greatest of the times from a state to its command since the last time, us.
//! `crash`: the server's thread panics, for tests of what supervises this program.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a program with arguments, a clock and a standard output"
)]

use panda_emulator::Settings;
use panda_emulator::fci::Generation;
use panda_emulator::server::{Fault, Handle, Network, Pace, Server, ServerOptions};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::error::Error;
use std::io::{BufRead, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

type Failure = Box<dyn Error + Send + Sync>;

const USAGE: &str = "serve ADDRESS [--generation panda|fr3] [--pace clock|lock_step|elastic] [--patience SECONDS] \
                     [--network none|lab] [--seed N] [--model_library FILE]";

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let address = arguments.next().ok_or_else(|| format!("expected an address: {USAGE}"))?;
    if matches!(address.as_str(), "-h" | "--help") {
        println!("{USAGE}");
        return Ok(());
    }
    let address = address.parse().map_err(|error| format!("ADDRESS {address}: {error}; such as 127.0.0.2:1337"))?;
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&ended))?;
    }
    let server = Server::bind(address, options(arguments)?)?;
    let handle = server.handle();
    tell(&format!("listening {}", server.address()));
    let instructed = server.handle();
    // A thread of its own, because reading cannot be interrupted: the process ends with the main thread.
    std::thread::spawn(move || read_instructions(&instructed));
    while !ended.load(Ordering::Relaxed) {
        for (ms, event) in handle.take_events() {
            tell(&format!("{ms} {event}"));
        }
        if let Some(panic) = handle.failure() {
            return Err(format!("the server's thread has ended: {panic}").into());
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

/// Prints a line. Nobody may listen, and the arm is served none the less.
fn tell(line: &str) {
    let mut out = std::io::stdout().lock();
    let _nobody_listens = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// Follows the instructions on stdin until its end.
fn read_instructions(handle: &Handle) {
    for line in std::io::stdin().lock().lines() {
        // Bytes that are no text, or a stdin that was closed.
        let Ok(line) = line else { return };
        match instruct(handle, &line) {
            Ok(answer) => tell(&format!("done {answer}")),
            Err(error) => tell(&format!("done error: {line}: {error}")),
        }
    }
}

fn options(mut arguments: impl Iterator<Item = String>) -> Result<ServerOptions, Failure> {
    let mut options = ServerOptions { settings: Settings::default(), ..ServerOptions::default() };
    while let Some(argument) = arguments.next() {
        let (name, value) = match argument.split_once('=') {
            Some((name, value)) => (name.to_owned(), value.to_owned()),
            None if argument.starts_with("--") => {
                let value = arguments.next().ok_or_else(|| format!("{argument}: expected a value: {USAGE}"))?;
                (argument, value)
            }
            None => return Err(format!("{argument}: expected --NAME VALUE: {USAGE}").into()),
        };
        match (name.trim_start_matches('-'), value.as_str()) {
            ("generation", "panda") => options.settings.generation = Generation::Panda,
            ("generation", "fr3") => options.settings = Settings::of(Generation::Fr3),
            ("pace", "clock") => options.pace = Pace::Clock,
            ("pace", "lock_step") => options.pace = Pace::LockStep,
            ("pace", "elastic") => options.pace = Pace::Elastic,
            ("patience", seconds) => {
                let patience = seconds.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
                options.patience =
                    patience.ok_or_else(|| format!("patience {seconds}: expected seconds, 0 or more"))?;
            }
            ("network", "none") => options.network = Network::None,
            ("network", "lab") => options.network = Network::Lab,
            ("seed", seed) => options.seed = seed.parse().map_err(|error| format!("seed {seed}: {error}"))?,
            ("model_library", file) => {
                let read = std::fs::read(file).map_err(|error| format!("model_library {file}: {error}"))?;
                options.model_library = Some(read);
            }
            (name, value) => return Err(format!("unknown argument --{name} {value}: {USAGE}").into()),
        }
    }
    Ok(options)
}

fn instruct(handle: &Handle, line: &str) -> Result<String, Failure> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let switch = |word: &str| match word {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("expected on or off, got {word}")),
    };
    match words[..] {
        ["push", ..] => {
            let numbers = words[1..].iter().map(|word| word.parse::<f64>()).collect::<Result<Vec<_>, _>>()?;
            if !numbers.iter().all(|number| number.is_finite()) {
                return Err("expected finite numbers".into());
            }
            handle.push(numbers.try_into().map_err(|_| "expected six numbers")?);
        }
        ["user_stop", word] => handle.set_user_stop(switch(word)?),
        ["brakes", word] => handle.set_brakes(switch(word)?),
        ["guiding", word] => handle.set_guiding(switch(word)?),
        ["lose_states", count] => handle.inject(Fault::LoseStates(count.parse()?)),
        ["lose_commands", count] => handle.inject(Fault::LoseCommands(count.parse()?)),
        ["repeat_states", count] => handle.inject(Fault::RepeatStates(count.parse()?)),
        ["swap_states"] => handle.inject(Fault::SwapStates),
        ["crash"] => handle.crash(),
        ["pose"] => return Ok(format!("{:?}", handle.snapshot().hand_pose)),
        ["joints"] => return Ok(format!("{:?}", handle.snapshot().q_rad)),
        ["responses"] => {
            let times = handle.take_responses();
            let us = |share| times.quantile_us(share).unwrap_or_default();
            return Ok(format!("{} {} {} {}", times.count(), us(0.5), us(0.99), times.longest().as_micros()));
        }
        _ => return Err("unknown instruction".into()),
    }
    // The next cycle has begun, so that the instruction holds.
    std::thread::sleep(Duration::from_millis(3));
    Ok(String::new())
}
