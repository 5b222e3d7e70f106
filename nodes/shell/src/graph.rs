//! The middleware's node and context, which every endpoint keeps alive.

use crate::error::ShellError;
use crate::interface::{dds_type, ros_type};
use crate::logging;
use crate::peers::{self, Directory};
use crate::qos::Qos;
use crate::shutdown::Shutdown;
use crate::wait::block_until;
use rustdds::discovery::{DiscoveredWriterData, PublicationBuiltinTopicData};
use rustdds::policy::Liveliness;
use rustdds::{Duration as DdsDuration, GUID, QosPolicies, RTPSEntity, Topic as DdsTopic, TopicKind};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The middleware's node and context; every endpoint keeps them alive, and the node goes before the context.
pub(crate) struct Graph {
    ros: Mutex<ros2_client::Node>,
    context: ros2_client::Context,
    directory: Directory,
    since: Instant,
    /// Nanoseconds from `since` to the last write of any endpoint.
    written: AtomicU64,
}

/// How long what a client knows of its server is taken for true.
const KNOWN: Duration = Duration::from_secs(1);

/// A server as its client knows it.
///
/// Every look by which ros2-client tells whether a server is matched leaves a channel of some kB behind, until the graph
/// changes. A client that asks a thousand times a minute must not look each time.
pub(crate) struct Server {
    replies: String,
    met: Mutex<Option<Met>>,
}

/// Who answers, and when that was looked up.
struct Met {
    looked: Instant,
    answering: BTreeSet<GUID>,
}

impl Server {
    /// That of the service with this absolute name.
    pub(crate) fn new(service: &str) -> Self {
        Self { replies: format!("rr{service}Reply"), met: Mutex::new(None) }
    }

    fn met(&self) -> MutexGuard<'_, Option<Met>> {
        self.met.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
        let (directory, written) = (Directory::default(), AtomicU64::new(0));
        Self { ros: Mutex::new(ros), context, directory, since: Instant::now(), written }
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

    /// The names of the nodes of other participants.
    pub(crate) fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Endpoints of all participants that live, as far as they promised signs of life.
    pub(crate) fn living_endpoints(&self) -> Vec<peers::Endpoint> {
        let (participant, now) = (self.participant(), Instant::now());
        let writers = participant.discovered_writers().into_iter().filter(|w| lives(w, now)).map(|w| peers::Endpoint {
            gid: w.writer_proxy.remote_writer_guid.to_bytes(),
            topic: w.publication_topic_data.topic_name,
            is_writer: true,
            addresses: peers::addresses(&w.writer_proxy.unicast_locator_list),
        });
        let readers = participant.discovered_readers().into_iter().map(|r| peers::Endpoint {
            gid: r.reader_proxy.remote_reader_guid.to_bytes(),
            topic: r.subscription_topic_data.topic_name().clone(),
            is_writer: false,
            addresses: peers::addresses(&r.reader_proxy.unicast_locator_list),
        });
        writers.chain(readers).collect()
    }

    pub(crate) fn participant(&self) -> rustdds::DomainParticipant {
        self.context.domain_participant()
    }

    /// The DDS topic behind an absolute name.
    pub(crate) fn topic(&self, name: &str, type_name: &str, qos: Qos) -> Result<DdsTopic, ShellError> {
        self.topic_with(name, type_name, &qos.policies())
    }

    /// The same with the policies of its endpoints.
    pub(crate) fn topic_with(&self, name: &str, type_name: &str, of: &QosPolicies) -> Result<DdsTopic, ShellError> {
        self.context
            .domain_participant()
            .create_topic(format!("rt{name}"), dds_type(type_name)?, of, TopicKind::NoKey)
            .map_err(|error| ShellError::create(format!("topic {name}"), error))
    }

    /// How many publishers of a topic are known that live, as far as they promised signs of life.
    pub(crate) fn publisher_count(&self, name: &str) -> usize {
        self.writers_of(&format!("rt{name}")).iter().filter(|writer| lives(writer, Instant::now())).count()
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

    /// As [`Graph::wait_matched`] for a server, which is looked for anew only where it was not there before, has left, or was
    /// started anew: of a new one, discovery may have told a part only.
    /// Returns who answers, as far as known; none: nobody.
    pub(crate) fn wait_server(
        &self,
        server: &Server,
        shutdown: &Shutdown,
        timeout: Duration,
        matched: &dyn Fn(&ros2_client::Node) -> bool,
    ) -> Option<BTreeSet<GUID>> {
        if let Some(met) = &mut *server.met() {
            let mut is_same = true;
            if met.looked.elapsed() > KNOWN {
                let now = self.meet(server);
                is_same = now.answering.is_subset(&met.answering);
                *met = now;
            }
            if is_same && !met.answering.is_empty() {
                return Some(met.answering.clone());
            }
        }
        let there = |ros: &ros2_client::Node| matched(ros) && !self.is_dead(server);
        let met = self.wait_matched(shutdown, timeout, &there).then(|| self.meet(server));
        let answering = met.as_ref().map(|met| met.answering.clone());
        *server.met() = met;
        answering
    }

    fn meet(&self, server: &Server) -> Met {
        Met { looked: Instant::now(), answering: self.answering(server) }
    }

    /// The writers of answers that live, of other participants.
    pub(crate) fn answering(&self, server: &Server) -> BTreeSet<GUID> {
        let now = Instant::now();
        let living = self.writers_of(&server.replies).into_iter().filter(|writer| lives(writer, now));
        living.map(|writer| writer.writer_proxy.remote_writer_guid).collect()
    }

    /// Whether all are dead that were there.
    fn is_dead(&self, server: &Server) -> bool {
        let (known, now) = (self.writers_of(&server.replies), Instant::now());
        !known.is_empty() && !known.iter().any(|writer| lives(writer, now))
    }

    fn writers_of(&self, dds_topic: &str) -> Vec<DiscoveredWriterData> {
        let found = self.participant().discovered_writers().into_iter();
        found.filter(|writer| writer.publication_topic_data.topic_name == dds_topic).collect()
    }

    /// The names of all services of a type, each as often as it is served. RustDDS tells them from the readers of their
    /// requests; whether a server lives, its writer of answers tells.
    pub(crate) fn services(&self, request_type: &str) -> Vec<String> {
        let readers = self.participant().discovered_readers().into_iter().map(|reader| reader.subscription_topic_data);
        let requests = readers.filter(|data| data.type_name() == request_type);
        let name = |data: rustdds::discovery::SubscriptionBuiltinTopicData| {
            Some(data.topic_name().strip_prefix("rq")?.strip_suffix("Request")?.to_owned())
        };
        let names: BTreeSet<String> = requests.filter_map(name).collect();
        names.into_iter().flat_map(|name| vec![name.clone(); self.answering(&Server::new(&name)).len()]).collect()
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

/// Whether a writer has not been silent for longer than it promised. Signs of life of its participant count.
fn lives(writer: &DiscoveredWriterData, now: Instant) -> bool {
    match writer.publication_topic_data.liveliness {
        Some(Liveliness::Automatic { lease_duration }) if lease_duration < DdsDuration::INFINITE => {
            now.saturating_duration_since(writer.last_updated) <= Duration::from(lease_duration)
        }
        _ => true,
    }
}
