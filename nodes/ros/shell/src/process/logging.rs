//! Logs: every `tracing` event goes to stderr in the format of ROS 2, and to `/rosout` under the node's name.

use crate::dds::log_noise;
use crate::parameters::args::{Level, RosArgs};
use crate::time::clock::wall_now;
use crate::time::point::Time;
use std::cell::RefCell;
use std::fmt::{self, Write as _};
use std::io::{IsTerminal, Write as _};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_log::NormalizeEvent;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

/// Maximum number of log lines that wait for `/rosout`. More are dropped there, and still go to stderr.
const ROSOUT_BACKLOG: usize = 256;

/// Log line.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) stamp: Time,
    pub(crate) level: u8,
    pub(crate) logger: String,
    pub(crate) message: String,
    pub(crate) file: String,
    pub(crate) line: u32,
}

/// Sink of a node's log lines for `/rosout`.
pub(crate) struct Rosout {
    logger: String,
    sender: smol::channel::Sender<Line>,
}

thread_local! {
    static OF_THREAD: RefCell<Option<Arc<Rosout>>> = const { RefCell::new(None) };
}

/// Sink of threads that were not started by a node.
static OF_PROCESS: Mutex<Weak<Rosout>> = Mutex::new(Weak::new());

impl Rosout {
    /// Creates the sink of a node, and the receiver from which the node publishes.
    pub(crate) fn new(logger: &str) -> (Arc<Self>, smol::channel::Receiver<Line>) {
        let (sender, receiver) = smol::channel::bounded(ROSOUT_BACKLOG);
        (Arc::new(Self { logger: logger.to_owned(), sender }), receiver)
    }

    /// Makes this the sink of the current thread.
    pub(crate) fn enter(self: &Arc<Self>) {
        OF_THREAD.with_borrow_mut(|current| *current = Some(Arc::clone(self)));
    }

    /// Makes this the sink of all threads without their own sink.
    pub(crate) fn adopt_process(self: &Arc<Self>) {
        *OF_PROCESS.lock().unwrap_or_else(PoisonError::into_inner) = Arc::downgrade(self);
    }

    fn current() -> Option<Arc<Self>> {
        OF_THREAD
            // The thread-local value may be gone already at the end of a thread.
            .try_with(|current| current.borrow().clone())
            .ok()
            .flatten()
            .or_else(|| OF_PROCESS.lock().unwrap_or_else(PoisonError::into_inner).upgrade())
    }
}

/// Starts logging for the process. `RUST_LOG`, if set, replaces `--log-level`. The DDS crates log only warnings, and none that
/// come with every datagram. A second call changes nothing.
pub fn init(name: &str, args: &RosArgs) {
    let directives = std::env::var("RUST_LOG").ok();
    let filter = EnvFilter::new(filter(name, args, directives.as_deref()));
    let layer = RosLayer { name: name.to_owned(), console: args.console_logs, colour: std::io::stderr().is_terminal() };
    let subscriber = tracing_subscriber::registry().with(filter).with(layer);
    if tracing::subscriber::set_global_default(subscriber).is_ok() {
        // Crates that use `log` format their lines before the filter. A maximum level keeps their hot paths free of formatting.
        let level = if directives.is_some() {
            tracing_log::log::LevelFilter::Trace
        } else {
            tracing_log::log::LevelFilter::Warn
        };
        let tracer = tracing_log::LogTracer::builder().with_max_level(level);
        if tracer.init().is_err() {
            tracing::debug!("another logger was installed before");
        }
    }
}

fn filter(name: &str, args: &RosArgs, directives: Option<&str>) -> String {
    let word = |level| match level {
        Level::Debug => "debug",
        Level::Info => "info",
        Level::Warn => "warn",
        Level::Error | Level::Fatal => "error",
    };
    let mut base = word(args.log_level.unwrap_or(Level::Info));
    let mut loggers = String::new();
    for (logger, level) in &args.logger_levels {
        if logger == name {
            base = word(*level);
        } else {
            let _ = write!(loggers, ",{}={}", logger.replace('.', "::"), word(*level));
        }
    }
    format!("{},{}{loggers}", log_noise::FILTER, directives.unwrap_or(base))
}

struct RosLayer {
    name: String,
    console: bool,
    colour: bool,
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for RosLayer {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        // Events of crates that use `log` carry target and place in their fields.
        let normalised = event.normalized_metadata();
        let metadata = normalised.as_ref().unwrap_or_else(|| event.metadata());
        let mut message = Message::default();
        event.record(&mut message);
        let target = metadata.target();
        let is_foreign = log_noise::is_of_middleware(target);
        if log_noise::is_noise(*metadata.level(), target, &message.message) || is_foreign && log_noise::is_hushed() {
            return;
        }
        let rosout = Rosout::current();
        let node = rosout.as_ref().map_or(self.name.as_str(), |rosout| rosout.logger.as_str());
        let logger = match is_foreign {
            true => format!("{node}.{}", target.replace("::", ".")),
            false => node.to_owned(),
        };
        let line = Line {
            stamp: wall_now(),
            level: severity(*metadata.level()),
            logger,
            message: message.text(),
            file: metadata.file().unwrap_or_default().to_owned(),
            line: metadata.line().unwrap_or_default(),
        };
        if self.console {
            self.print(&line);
        }
        // A warning of DDS about sending a log line would cause another log line to be sent.
        if let (Some(rosout), false) = (rosout, is_foreign) {
            let _full = rosout.sender.try_send(line);
        }
    }
}

fn severity(level: tracing::Level) -> u8 {
    match level {
        // Constants of rcl_interfaces/msg/Log.
        tracing::Level::ERROR => 40,
        tracing::Level::WARN => 30,
        tracing::Level::INFO => 20,
        _ => 10,
    }
}

impl RosLayer {
    fn print(&self, line: &Line) {
        let (word, colour) = match line.level {
            40 => ("ERROR", "\x1b[31m"),
            30 => ("WARN", "\x1b[33m"),
            20 => ("INFO", ""),
            _ => ("DEBUG", "\x1b[32m"),
        };
        let (colour, reset) = if self.colour && !colour.is_empty() { (colour, "\x1b[0m") } else { ("", "") };
        let Line { stamp, logger, message, .. } = line;
        let text = format!("{colour}[{word}] [{stamp}] [{logger}]: {message}{reset}\n");
        let _closed = std::io::stderr().lock().write_all(text.as_bytes());
    }
}

#[derive(Default)]
struct Message {
    message: String,
    fields: String,
}

impl Message {
    fn text(self) -> String {
        if self.fields.is_empty() {
            self.message
        } else if self.message.is_empty() {
            self.fields.trim_start().to_owned()
        } else {
            format!("{}{}", self.message, self.fields)
        }
    }
}

impl Visit for Message {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.message.push_str(value),
            name if name.starts_with("log.") => {}
            name => {
                let _ = write!(self.fields, " {name}={value:?}");
            }
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => {
                let _ = write!(self.message, "{value:?}");
            }
            name if name.starts_with("log.") => {}
            name => {
                let _ = write!(self.fields, " {name}={value:?}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(list: &[&str]) -> RosArgs {
        let all = std::iter::once("--ros-args").chain(list.iter().copied());
        RosArgs::parse(all).unwrap().0
    }

    #[test]
    fn the_filter_follows_the_log_level_and_keeps_dds_quiet() {
        let all = filter("camera", &args(&[]), None);
        let quiet = all.strip_suffix(",info").unwrap();
        assert!(quiet.starts_with("rustdds=warn,ros2_client=warn,"));
        let given = args(&["--log-level", "warn", "--log-level", "camera:=debug"]);
        assert_eq!(filter("camera", &given, None), format!("{quiet},debug"));
        assert_eq!(filter("bag", &given, None), format!("{quiet},warn,camera=debug"));
        assert_eq!(filter("camera", &given, Some("rustdds=debug")), format!("{quiet},rustdds=debug"));
    }

    #[test]
    fn a_line_carries_message_and_fields_to_the_sink_of_its_thread() {
        let (rosout, lines) = Rosout::new("camera");
        let layer = RosLayer { name: "process".to_owned(), console: false, colour: false };
        let subscriber = tracing_subscriber::registry().with(layer);
        let thread = std::thread::spawn(move || {
            rosout.enter();
            tracing::subscriber::with_default(subscriber, || {
                tracing::warn!(dropped = 3, "behind by {} ms", 40);
                tracing::error!(target: "rustdds::rtps", "lost");
                tracing::warn!(target: "rustdds::rtps::writer", "lost");
            });
        });
        thread.join().unwrap();
        let line = lines.try_recv().unwrap();
        assert_eq!((line.level, line.logger.as_str()), (30, "camera"));
        assert_eq!(line.message, "behind by 40 ms dropped=3");
        assert!(lines.try_recv().is_err(), "a line of DDS went to /rosout");
    }
}
