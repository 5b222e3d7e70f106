//! Serves the Franka Control Interface without ROS, for tests with foreign clients.
//!
//!     serve ADDRESS [generation=panda|fr3] [pace=clock|lock_step] [network=none|lab] [seed=N] [model_library=FILE]
//!
//! Prints `listening ADDRESS`, then each event in a line: the clock of the control box in ms, and the event. Reads one instruction
//! a line on stdin and answers it with a line that begins with `done`:
//!
//!     push FX FY FZ MX MY MZ | user_stop on|off | brakes on|off | guiding on|off | lose_states N | lose_commands N
//!     repeat_states N | swap_states | pose | joints | responses
//!
//! `responses`: number, median, 99th percentile and greatest of the times from a state to its command since the last time, us.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a program with arguments, a clock and a standard output"
)]

use panda_emulator::Settings;
use panda_emulator::fci::Generation;
use panda_emulator::server::{Fault, Handle, Network, Pace, Server, ServerOptions};
use std::error::Error;
use std::io::{BufRead, Write};
use std::time::Duration;

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let address = arguments.next().ok_or("expected an address")?.parse()?;
    let server = Server::bind(address, options(arguments)?)?;
    println!("listening {}", server.address());
    let handle = server.handle();
    let events = server.handle();
    std::thread::spawn(move || {
        loop {
            for (ms, event) in events.take_events() {
                println!("{ms} {event}");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        match instruct(&handle, &line) {
            Ok(answer) => println!("done {answer}"),
            Err(error) => println!("done error: {line}: {error}"),
        }
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn options(arguments: impl Iterator<Item = String>) -> Result<ServerOptions, Failure> {
    let mut options = ServerOptions { settings: Settings::default(), ..ServerOptions::default() };
    for argument in arguments {
        match argument.split_once('=').ok_or("expected NAME=VALUE")? {
            ("generation", "panda") => options.settings.generation = Generation::Panda,
            ("generation", "fr3") => options.settings.generation = Generation::Fr3,
            ("pace", "clock") => options.pace = Pace::Clock,
            ("pace", "lock_step") => options.pace = Pace::LockStep,
            ("network", "none") => options.network = Network::None,
            ("network", "lab") => options.network = Network::Lab,
            ("seed", seed) => options.seed = seed.parse()?,
            ("model_library", file) => options.model_library = Some(std::fs::read(file)?),
            _ => return Err(format!("unknown argument {argument}").into()),
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
            handle.push(numbers.try_into().map_err(|_| "expected six numbers")?);
        }
        ["user_stop", word] => handle.set_user_stop(switch(word)?),
        ["brakes", word] => handle.set_brakes(switch(word)?),
        ["guiding", word] => handle.set_guiding(switch(word)?),
        ["lose_states", count] => handle.inject(Fault::LoseStates(count.parse()?)),
        ["lose_commands", count] => handle.inject(Fault::LoseCommands(count.parse()?)),
        ["repeat_states", count] => handle.inject(Fault::RepeatStates(count.parse()?)),
        ["swap_states"] => handle.inject(Fault::SwapStates),
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
