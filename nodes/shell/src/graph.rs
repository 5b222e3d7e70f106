//! The middleware's node and context, which every endpoint keeps alive.

use crate::error::ShellError;
use crate::interface::{dds_type, ros_type};
use crate::logging;
use crate::qos::Qos;
use crate::shutdown::Shutdown;
use crate::wait::block_until;
use rustdds::discovery::PublicationBuiltinTopicData;
use rustdds::{RTPSEntity, Topic as DdsTopic, TopicKind};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The middleware's node and context; every endpoint keeps them alive, and the node goes before the context.
pub(crate) struct Graph {
    ros: Mutex<ros2_client::Node>,
    context: ros2_client::Context,
    since: Instant,
    /// Nanoseconds from `since` to the last write of any endpoint.
    written: AtomicU64,
}

/// Graphs of this process.
static LIVE: AtomicUsize = AtomicUsize::new(0);

impl Drop for Graph {
    fn drop(&mut self) {
        if LIVE.fetch_sub(1, Ordering::AcqRel) == 1 {
            logging::hush_middleware(true);
        }
    }
}

/// How long a writer stays after the last write, which leaves the process on another thread.
const LINGER: Duration = Duration::from_millis(50);

impl Graph {
    pub(crate) fn new(ros: ros2_client::Node, context: ros2_client::Context) -> Self {
        LIVE.fetch_add(1, Ordering::AcqRel);
        logging::hush_middleware(false);
        Self { ros: Mutex::new(ros), context, since: Instant::now(), written: AtomicU64::new(0) }
    }

    fn elapsed(&self) -> u64 {
        u64::try_from(self.since.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// Something was written just now.
    pub(crate) fn touch(&self) {
        self.written.store(self.elapsed(), Ordering::Relaxed);
    }

    /// Waits until what was written last has surely left; for the end of a writer.
    pub(crate) fn linger(&self) {
        let written = self.written.load(Ordering::Relaxed);
        let age = Duration::from_nanos(self.elapsed().saturating_sub(written));
        if written > 0 && age < LINGER {
            std::thread::sleep(LINGER - age);
        }
    }

    pub(crate) fn ros(&self) -> MutexGuard<'_, ros2_client::Node> {
        self.ros.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn participant(&self) -> rustdds::DomainParticipant {
        self.context.domain_participant()
    }

    /// The DDS topic behind an absolute name.
    pub(crate) fn topic(&self, name: &str, type_name: &str, qos: Qos) -> Result<DdsTopic, ShellError> {
        self.context
            .domain_participant()
            .create_topic(format!("rt{name}"), dds_type(type_name)?, &qos.policies(), TopicKind::NoKey)
            .map_err(|error| ShellError::create(format!("topic {name}"), error))
    }

    /// How many publishers of a topic other participants have. A participant may or may not discover its own.
    pub(crate) fn other_publisher_count(&self, name: &str) -> usize {
        let (participant, topic) = (self.participant(), format!("rt{name}"));
        let own = participant.guid().prefix;
        let theirs = participant.discovered_writers().into_iter();
        let theirs = theirs.filter(|w| w.writer_proxy.remote_writer_guid.prefix != own);
        theirs.filter(|w| w.publication_topic_data.topic_name == topic).count()
    }

    /// Topic, message type and profile of every publisher that other participants have.
    pub(crate) fn other_publishers(&self) -> Vec<(String, String, Qos)> {
        let participant = self.participant();
        let own = participant.guid().prefix;
        let theirs = participant.discovered_writers().into_iter();
        let theirs = theirs.filter(|w| w.writer_proxy.remote_writer_guid.prefix != own);
        let publisher = |data: PublicationBuiltinTopicData| {
            let name = data.topic_name.strip_prefix("rt").filter(|name| name.starts_with('/'))?;
            Some((name.to_owned(), ros_type(&data.type_name)?, Qos::offered(data.reliability, data.durability)))
        };
        theirs.filter_map(|w| publisher(w.publication_topic_data)).collect()
    }

    /// The names of all services of a type, each as often as it is served. RustDDS tells them from the readers of their requests.
    pub(crate) fn services(&self, request_type: &str) -> Vec<String> {
        let readers = self.participant().discovered_readers().into_iter().map(|reader| reader.subscription_topic_data);
        let requests = readers.filter(|data| data.type_name() == request_type);
        let name = |data: rustdds::discovery::SubscriptionBuiltinTopicData| {
            Some(data.topic_name().strip_prefix("rq")?.strip_suffix("Request")?.to_owned())
        };
        requests.filter_map(name).collect()
    }

    /// Waits until `matched` holds, looking again at every change of the graph.
    pub(crate) fn wait_matched(
        &self,
        shutdown: &Shutdown,
        timeout: Duration,
        matched: &dyn Fn(&ros2_client::Node) -> bool,
    ) -> bool {
        let deadline = Instant::now() + timeout;
        let events = self.ros().status_receiver();
        loop {
            if matched(&self.ros()) {
                return true;
            }
            let Some(events) = &events else {
                return false;
            };
            let event = smol::future::or(async { events.recv().await.is_ok() }, async {
                shutdown.triggered().await;
                false
            });
            if block_until(event, Some(deadline)) != Some(true) {
                return matched(&self.ros());
            }
        }
    }
}
