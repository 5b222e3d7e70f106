//! `/diagnostics`: health of a node, once a second, from the losses of its subscriptions, its clock, its own findings and its
//! memory.

use crate::contract;
use crate::dds::sample_claims;
use crate::error::ShellError;
use crate::process::health::{Health, Report};
use crate::process::node::Node;
use crate::time::clock::wall_now;
use crate::time::point::Time;
use crate::time::stamp;
use crate::time::watchdog::Throttle;
use catenary_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time between two reports.
const PERIOD: Duration = Duration::from_secs(1);
/// Tolerated silence of `/clock` in wall time. A simulation at 1/100 of real time publishes `/clock` at 2 Hz.
const CLOCK_PATIENCE: Duration = Duration::from_secs(2);
/// Minimum time between two log lines about an unchanged health.
const REMIND: Duration = Duration::from_secs(30);

impl Node {
    /// Publishes `/diagnostics` once per second of wall time, on its own thread. A report holds the losses of the node's
    /// subscriptions, the state of `/clock`, the resident memory, and the additions of `fill`. The log names problems when they
    /// begin and says when they are over.
    ///
    /// # Errors
    /// [`ShellError`]: the middleware.
    pub fn report_diagnostics(&self, mut fill: impl FnMut(&mut Report) + Send + 'static) -> Result<(), ShellError> {
        let topic = contract::DIAGNOSTICS;
        let publisher = self.publisher::<DiagnosticArray>(topic.name, topic.qos)?;
        let (clock, shutdown) = (self.clock().clone(), self.shutdown().clone());
        let (sources, graph) = (Arc::clone(self.health_sources()), Arc::clone(self.graph()));
        let clock_topic = self.resolve(contract::CLOCK.name)?;
        let name = self.path().to_owned();
        self.spawn("diagnostics", move || {
            // Wall time: a node whose simulated time stands still must report that.
            let mut next = Instant::now() + PERIOD;
            let mut log = HealthLog::default();
            let (mut refused, mut too_large) = (Recent::default(), Recent::default());
            while !shutdown.wait_timeout(next.saturating_duration_since(Instant::now())) {
                // From the planned time, so that the period does not drift.
                next += PERIOD;
                let mut report = Report::new();
                if let Some(bytes) = resident_bytes() {
                    report.value("resident_memory_mb", format!("{:.1}", bytes as f64 / 1e6));
                }
                let publishers = graph.other_publishers();
                let clocks = publishers.iter().filter(|(topic, _, _)| *topic == clock_topic).count();
                if let Some(problem) = clock_problem(clock.silence(), &clock_topic, clocks) {
                    report.problem(Health::Error, &problem);
                }
                let now = Instant::now();
                let refused = refused.count(sample_claims::refused(), now);
                report_recent(
                    &mut report,
                    "messages_over_memory_limit",
                    "messages that claimed too much memory were dropped",
                    refused,
                );
                let too_large = too_large.count(graph.too_large(), now);
                report_recent(&mut report, "answers_too_large", "answers were too large for their clients", too_large);
                sources.report(&publishers, &mut report);
                fill(&mut report);
                log.tell(&report, wall_now());
                let header = stamp::header(clock.now(), "");
                publisher.send(DiagnosticArray { header, status: vec![status(&name, report)] });
            }
        })
    }
}

/// Count of an event that is a problem for a while after it: a reader of single reports would miss one of a second.
#[derive(Default)]
struct Recent {
    seen: u64,
    last: Option<Instant>,
}

impl Recent {
    /// Returns the count, and true if it grew less than [`REMIND`] ago.
    fn count(&mut self, count: u64, now: Instant) -> (u64, bool) {
        if count > self.seen {
            (self.seen, self.last) = (count, Some(now));
        }
        (count, self.last.is_some_and(|last| now.duration_since(last) < REMIND))
    }
}

/// Adds the count of an event to a report once it has happened, and a warning while it is recent.
fn report_recent(report: &mut Report, key: &str, what: &str, (count, is_recent): (u64, bool)) {
    if count > 0 {
        report.value(key, count);
    }
    if is_recent {
        report.problem(Health::Warn, &format!("{count} {what}: see the log"));
    }
}

/// Returns the problem of simulated time, if there is one. `silence` comes from [`Clock::silence`](crate::Clock).
fn clock_problem(silence: Option<(Duration, bool)>, topic: &str, publishers: usize) -> Option<String> {
    let (silence, heard) = silence.filter(|(silence, _)| *silence > CLOCK_PATIENCE)?;
    let who = match publishers {
        0 => "nobody publishes it".to_owned(),
        n => format!("publishers of it: {n}"),
    };
    let fix = "set use_sim_time to false, or start what publishes it";
    Some(match heard {
        true => format!("{topic} has been silent for {:.1} s, so that time stands still: {who}", silence.as_secs_f64()),
        false => format!("use_sim_time is set and no {topic} was heard, so that time stands still: {who}; {fix}"),
    })
}

/// Log of a node's health: a line when it gets worse, reminders while it is bad, and a line when it is good again.
struct HealthLog {
    last: Health,
    reminder: Throttle,
}

impl Default for HealthLog {
    fn default() -> Self {
        Self { last: Health::Ok, reminder: Throttle::new(REMIND) }
    }
}

impl HealthLog {
    fn tell(&mut self, report: &Report, now: Time) {
        let (health, text) = (report.health, &report.message);
        let was = std::mem::replace(&mut self.last, health);
        if health == Health::Ok && was != Health::Ok {
            tracing::info!("health: ok again");
            self.reminder = Throttle::new(REMIND);
        }
        // A worse health is logged at once, without waiting for the reminder.
        if health > was {
            self.reminder = Throttle::new(REMIND);
        }
        if health != Health::Ok && self.reminder.pass(now).is_some() {
            match health {
                Health::Error => tracing::error!("health: {text}"),
                _ => tracing::warn!("health: {text}"),
            }
        }
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

/// Returns the resident memory of this process in bytes; `None` without `/proc`.
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
    fn a_report_has_the_worst_health_and_all_messages() {
        let mut report = Report::new();
        report.value("image_rate_hz", 59.9);
        report.problem(Health::Error, "no images").problem(Health::Warn, "drops");
        let status = status("/camera", report);
        assert_eq!((status.level, status.message.as_str()), (2, "no images; drops"));
        assert_eq!(status.values[0].key, "image_rate_hz");
        assert_eq!(status.values[0].value, "59.9");
    }

    #[test]
    fn an_event_is_a_problem_for_a_while_and_its_count_stays() {
        let (mut recent, start) = (Recent::default(), Instant::now());
        assert_eq!(recent.count(0, start), (0, false));
        assert_eq!(recent.count(2, start), (2, true));
        assert_eq!(recent.count(2, start + REMIND / 2), (2, true));
        assert_eq!(recent.count(2, start + REMIND), (2, false));
        let mut report = Report::new();
        report_recent(&mut report, "answers_too_large", "answers were too large for their clients", (2, false));
        assert_eq!((report.health, report.values[0].1.as_str()), (Health::Ok, "2"));
        report_recent(&mut report, "answers_too_large", "answers were too large for their clients", (3, true));
        assert_eq!(report.health, Health::Warn);
        report_recent(&mut report, "none", "none", (0, false));
        assert_eq!(report.values.len(), 2);
    }

    #[test]
    fn simulated_time_without_a_clock_is_named() {
        let silent = |seconds| Duration::from_secs(seconds);
        assert_eq!(clock_problem(None, "/clock", 0), None);
        assert_eq!(clock_problem(Some((silent(1), false)), "/clock", 0), None);
        assert_eq!(clock_problem(Some((silent(1), true)), "/clock", 1), None);
        let never = clock_problem(Some((silent(9), false)), "/clock", 0).unwrap();
        assert!(never.contains("use_sim_time") && never.contains("nobody publishes it"), "{never}");
        let stopped = clock_problem(Some((silent(9), true)), "/clock", 1).unwrap();
        assert!(stopped.contains("/clock has been silent for 9.0 s"), "{stopped}");
    }

    #[test]
    fn resident_memory_is_plausible_on_linux() {
        if cfg!(target_os = "linux") {
            let bytes = resident_bytes().unwrap();
            assert!((1_000_000..100_000_000_000).contains(&bytes), "{bytes}");
        }
    }
}
