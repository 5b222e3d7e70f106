//! Logs: every `tracing` event goes to stderr in the form of ROS 2, and to `/rosout` under the node's name.

use crate::args::{Level, RosArgs};
use crate::clock::wall_now;
use crate::network_loss;
use crate::time::Time;
use std::cell::RefCell;
use std::fmt::{self, Write as _};
use std::io::{IsTerminal, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_log::NormalizeEvent;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

/// Log lines that wait for `/rosout` at most; more are dropped there, and still go to stderr.
const ROSOUT_BACKLOG: usize = 256;

/// One log line.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) stamp: Time,
    pub(crate) level: u8,
    pub(crate) logger: String,
    pub(crate) message: String,
    pub(crate) file: String,
    pub(crate) line: u32,
}

/// Set when the last node of the process leaves the graph: what the middleware says about its own end is noise.
static MIDDLEWARE_HUSHED: AtomicBool = AtomicBool::new(false);

/// Silences the middleware, or lets it speak again.
pub(crate) fn hush_middleware(hushed: bool) {
    MIDDLEWARE_HUSHED.store(hushed, Ordering::Release);
}

/// Where a node's log lines go for `/rosout`.
pub(crate) struct Rosout {
    logger: String,
    sender: smol::channel::Sender<Line>,
}

thread_local! {
    static OF_THREAD: RefCell<Option<Arc<Rosout>>> = const { RefCell::new(None) };
}

/// The node of threads that no node has started.
static OF_PROCESS: Mutex<Weak<Rosout>> = Mutex::new(Weak::new());

impl Rosout {
    /// A sink for a node, with the end that the node publishes from.
    pub(crate) fn new(logger: &str) -> (Arc<Self>, smol::channel::Receiver<Line>) {
        let (sender, receiver) = smol::channel::bounded(ROSOUT_BACKLOG);
        (Arc::new(Self { logger: logger.to_owned(), sender }), receiver)
    }

    /// Makes it the sink of this thread.
    pub(crate) fn enter(self: &Arc<Self>) {
        OF_THREAD.with_borrow_mut(|current| *current = Some(Arc::clone(self)));
    }

    /// Makes it the sink of the process's other threads.
    pub(crate) fn adopt_process(self: &Arc<Self>) {
        *OF_PROCESS.lock().unwrap_or_else(PoisonError::into_inner) = Arc::downgrade(self);
    }

    fn current() -> Option<Arc<Self>> {
        OF_THREAD
            .try_with(|current| current.borrow().clone())
            .ok()
            .flatten()
            .or_else(|| OF_PROCESS.lock().unwrap_or_else(PoisonError::into_inner).upgrade())
    }
}

/// Starts logging for the process. `RUST_LOG`, where set, replaces the level of `--log-level`; the DDS crates log
/// warnings only, and not those that come with every datagram. A second call changes nothing.
pub fn init(name: &str, args: &RosArgs) {
    let directives = std::env::var("RUST_LOG").ok();
    let filter = EnvFilter::new(filter(name, args, directives.as_deref()));
    let layer = RosLayer { name: name.to_owned(), console: args.console_logs, colour: std::io::stderr().is_terminal() };
    let subscriber = tracing_subscriber::registry().with(filter).with(layer);
    if tracing::subscriber::set_global_default(subscriber).is_ok() {
        // The crates behind `log` are asked for warnings only, which keeps their hot paths free of formatting.
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
    // Writers' warnings are sorted out in `is_noise`. The network side warns of every large datagram, and on the loopback interface of missing multicast; a full
    // window is reported by the publisher itself.
    const QUIET: &str = "rustdds=warn,ros2_client=warn,\
        rustdds::network=error,rustdds::dds::with_key::datawriter=error,ros2_client::distributions=error";
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
    format!("{QUIET},{}{loggers}", directives.unwrap_or(base))
}

struct RosLayer {
    name: String,
    console: bool,
    colour: bool,
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for RosLayer {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let normalised = event.normalized_metadata();
        let metadata = normalised.as_ref().unwrap_or_else(|| event.metadata());
        let mut message = Message::default();
        event.record(&mut message);
        let foreign =
            ["rustdds", "ros2_client", "mio", "polling"].into_iter().find(|name| metadata.target().starts_with(name));
        if is_noise(*metadata.level(), metadata.target(), &message.message) {
            return;
        }
        if foreign.is_some() && MIDDLEWARE_HUSHED.load(Ordering::Acquire) {
            return;
        }
        network_loss::hear(metadata.target(), &message.message);
        let rosout = Rosout::current();
        let node = rosout.as_ref().map_or(self.name.as_str(), |rosout| rosout.logger.as_str());
        let logger = match foreign {
            Some(_) => format!("{node}.{}", metadata.target().replace("::", ".")),
            None => node.to_owned(),
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
        // What DDS says about sending a log line must not be sent as a log line.
        if let (Some(rosout), None) = (rosout, foreign) {
            let _full = rosout.sender.try_send(line);
        }
    }
}

/// What a writer says of every datagram on a lossy link, where it is not that a reader asks for more than it offers; and
/// what joining a domain says of a failure that it returns as well, or of an end that was asked for.
fn is_noise(level: tracing::Level, target: &str, message: &str) -> bool {
    match target {
        "rustdds::rtps::writer" => level == tracing::Level::WARN && !message.contains("QoS mismatch"),
        // The event loop is busy with images when an endpoint goes. The participant's end takes the endpoint along.
        "rustdds::dds::pubsub" => message.starts_with("Cannot remove"),
        "rustdds::dds::participant" => message.contains("ParticipantId"),
        // A node that ends as soon as it has begun hears of its own readers and writers when they are gone.
        "rustdds::discovery" | "rustdds::discovery::discovery" => message.contains("Did not find a local"),
        "rustdds::network::udp_listener" => message.contains("leave_multicast_group"),
        _ => false,
    }
}

fn severity(level: tracing::Level) -> u8 {
    match level {
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
    fn what_a_short_life_makes_discovery_say_is_noise_and_the_rest_is_not() {
        let noise = |message| is_noise(tracing::Level::WARN, "rustdds::discovery", message);
        assert!(noise("Did not find a local reader GUID {1}"));
        let twin = "Did not find a local writer GUID {1}";
        assert!(noise(twin) && is_noise(tracing::Level::WARN, "rustdds::discovery::discovery", twin));
        assert!(!noise("Cannot get multicast discovery listener"));
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
