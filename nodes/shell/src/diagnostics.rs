//! `/diagnostics`: once a second, what a node has to say about itself, and its resident memory.

use crate::contract;
use crate::error::ShellError;
use crate::node::Node;
use catenary_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use std::fmt::Display;
use std::time::{Duration, Instant};

/// Time between two reports.
const PERIOD: Duration = Duration::from_secs(1);

/// What is wrong with a node, if anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Health {
    /// Nothing.
    Ok = 0,
    /// It works with losses.
    Warn = 1,
    /// It does not work.
    Error = 2,
    /// What it needs has stopped coming.
    Stale = 3,
}

/// One report of a node.
#[derive(Debug)]
pub struct Report {
    health: Health,
    message: String,
    values: Vec<(String, String)>,
}

impl Report {
    fn new() -> Self {
        Self { health: Health::Ok, message: String::new(), values: Vec::new() }
    }

    /// Adds a figure; its name carries the unit: `image_rate_hz`.
    pub fn value(&mut self, key: &str, value: impl Display) -> &mut Self {
        self.values.push((key.to_owned(), value.to_string()));
        self
    }

    /// Says what is wrong; the worst of several counts, and every message is kept.
    pub fn problem(&mut self, health: Health, message: &str) -> &mut Self {
        self.health = self.health.max(health);
        if !self.message.is_empty() {
            self.message.push_str("; ");
        }
        self.message.push_str(message);
        self
    }
}

impl Node {
    /// Publishes `/diagnostics` once a wall-clock second, on a thread of its own, with what `fill` adds to the
    /// resident memory.
    ///
    /// # Errors
    /// [`ShellError`]: the middleware.
    pub fn report_diagnostics(&self, mut fill: impl FnMut(&mut Report) + Send + 'static) -> Result<(), ShellError> {
        let topic = contract::DIAGNOSTICS;
        let publisher = self.publisher::<DiagnosticArray>(topic.name, topic.qos)?;
        let (clock, shutdown) = (self.clock().clone(), self.shutdown().clone());
        let name = self.path().to_owned();
        self.spawn("diagnostics", move || {
            let mut next = Instant::now() + PERIOD;
            while !shutdown.wait_timeout(next.saturating_duration_since(Instant::now())) {
                next += PERIOD;
                let mut report = Report::new();
                if let Some(bytes) = resident_bytes() {
                    report.value("resident_memory_mb", format!("{:.1}", bytes as f64 / 1e6));
                }
                fill(&mut report);
                let header = crate::stamp::header(clock.now(), "");
                publisher.send(DiagnosticArray { header, status: vec![status(&name, report)] });
            }
        })
    }
}

fn status(name: &str, report: Report) -> DiagnosticStatus {
    DiagnosticStatus {
        level: report.health as u8,
        name: name.to_owned(),
        message: if report.message.is_empty() { "ok".to_owned() } else { report.message },
        hardware_id: String::new(),
        values: report.values.into_iter().map(|(key, value)| KeyValue { key, value }).collect(),
    }
}

/// Resident memory of this process in bytes, where the system tells.
#[must_use]
pub fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_problem_counts_and_all_are_said() {
        let mut report = Report::new();
        report.value("image_rate_hz", 59.9);
        report.problem(Health::Error, "no images").problem(Health::Warn, "drops");
        let status = status("/camera", report);
        assert_eq!((status.level, status.message.as_str()), (2, "no images; drops"));
        assert_eq!(status.values[0].key, "image_rate_hz");
        assert_eq!(status.values[0].value, "59.9");
    }

    #[test]
    fn resident_memory_is_plausible_on_linux() {
        if cfg!(target_os = "linux") {
            let bytes = resident_bytes().unwrap();
            assert!((1_000_000..100_000_000_000).contains(&bytes), "{bytes}");
        }
    }
}
