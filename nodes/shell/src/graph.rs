//! A node's part in the graph: its session, and what it sees of the others.

use crate::error::ShellError;
use crate::interface::{dds_type, ros_type};
use crate::logging;
use crate::middleware::{Made, Matches, Reader, Session, Writer};
use crate::peers::{self, Directory};
use crate::qos::Qos;
use crate::shutdown::Shutdown;
use crate::wait::block_until;
use ros2_client::Gid;
use rustdds::discovery::{DiscoveredReaderData, DiscoveredWriterData, PublicationBuiltinTopicData};
use rustdds::policy::Liveliness;
use rustdds::{DomainParticipantStatusEvent, Duration as DdsDuration, GUID, QosPolicies, RTPSEntity};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::time::{Duration, Instant};

/// A node's part in the graph.
///
/// The session is owned here alone, and nothing else keeps it: [`Graph::leave`] ends it whoever still holds an endpoint, a
/// clone of the node or this.
pub(crate) struct Graph {
    /// None: the node has left.
    session: Mutex<Option<Session>>,
    /// Set before the session ends, and read without waiting for its lock.
    has_left: AtomicBool,
    own: GUID,
    matches: Matches,
    /// Names of the types that the node's endpoints have had.
    types: Mutex<BTreeSet<String>>,
    directory: Directory,
    since: Instant,
    /// Nanoseconds from `since` to the last write of any endpoint.
    written: AtomicU64,
}

/// How long what a client knows of its server is taken for true.
const KNOWN: Duration = Duration::from_secs(1);

/// A server as its client knows it.
///
/// A look copies all that discovery knows of writers. A client that asks a thousand times a minute must not look each time.
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
        self.leave();
    }
}

/// How long a writer stays after the last write, which leaves the process on another thread.
const LINGER: Duration = Duration::from_millis(50);

impl Graph {
    pub(crate) fn new(session: Session) -> Self {
        LIVE.fetch_add(1, Ordering::AcqRel);
        logging::hush_middleware(false);
        Self {
            own: session.participant().guid(),
            session: Mutex::new(Some(session)),
            has_left: AtomicBool::new(false),
            matches: Matches::default(),
            directory: Directory::default(),
            types: Mutex::default(),
            since: Instant::now(),
            written: AtomicU64::new(0),
        }
    }

    /// Ends the session: the others see the node and its endpoints gone. What is made or written later fails.
    ///
    /// Returns when the session has ended, whoever ends it.
    pub(crate) fn leave(&self) {
        self.linger();
        self.has_left.store(true, Ordering::Release);
        // The lock is held to the end, so that another thread that calls this waits, too.
        let mut session = self.session();
        if session.is_none() {
            return;
        }
        // What the middleware says of endpoints that outlive their participant is noise.
        if LIVE.fetch_sub(1, Ordering::AcqRel) == 1 {
            logging::hush_middleware(true);
        }
        *session = None;
    }

    /// Whether the node has left the graph.
    pub(crate) fn has_left(&self) -> bool {
        self.has_left.load(Ordering::Acquire)
    }

    fn session(&self) -> MutexGuard<'_, Option<Session>> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether an endpoint of the node has had this type, called `package/kind/Name`.
    pub(crate) fn uses_type(&self, name: &str) -> bool {
        self.types.lock().unwrap_or_else(PoisonError::into_inner).contains(name)
    }

    /// Makes an endpoint of a type; `what` names it in the error.
    pub(crate) fn make<T>(
        &self,
        type_name: &str,
        what: impl FnOnce() -> String,
        make: impl FnOnce(&Session) -> Made<T>,
    ) -> Result<T, ShellError> {
        self.types.lock().unwrap_or_else(PoisonError::into_inner).insert(type_name.to_owned());
        match &*self.session() {
            Some(session) => make(session).map_err(|error| ShellError::create(what(), error)),
            None => Err(ShellError::create(what(), "the node has left the graph")),
        }
    }

    /// As [`Graph::make`], for the ends of an action, which have types of their own.
    pub(crate) fn make_action<T>(
        &self,
        type_name: &str,
        what: impl FnOnce() -> String,
        make: impl FnOnce(&Session) -> Made<T>,
    ) -> Result<T, ShellError> {
        let parts = ["SendGoal", "GetResult", "FeedbackMessage"].map(|part| format!("{type_name}_{part}"));
        let common = ["action_msgs/srv/CancelGoal", "action_msgs/msg/GoalStatusArray"].map(str::to_owned);
        self.types.lock().unwrap_or_else(PoisonError::into_inner).extend(parts.into_iter().chain(common));
        self.make(type_name, what, make)
    }

    /// A writer of messages of a type on the topic with this absolute name.
    pub(crate) fn writer<M: Serialize>(
        &self,
        name: &str,
        type_name: &str,
        qos: &QosPolicies,
    ) -> Result<Writer<M>, ShellError> {
        let kind = dds_type(type_name)?;
        self.make(
            type_name,
            || format!("publisher on {name}"),
            |session| Writer::new(session, &format!("rt{name}"), &kind, qos),
        )
    }

    /// A reader of messages of a type on the topic with this absolute name.
    pub(crate) fn reader<M: 'static + DeserializeOwned>(
        &self,
        name: &str,
        type_name: &str,
        qos: &QosPolicies,
    ) -> Result<Reader<M>, ShellError> {
        let kind = dds_type(type_name)?;
        self.make(
            type_name,
            || format!("subscription of {name}"),
            |session| Reader::new(session, &format!("rt{name}"), &kind, qos),
        )
    }

    /// Which endpoints of others the node's endpoints are matched with.
    pub(crate) fn matches(&self) -> &Matches {
        &self.matches
    }

    /// Follows discovery until the node leaves.
    pub(crate) async fn follow_discovery(&self) {
        while let Some(event) = self.next_event().await {
            self.matches.apply(&event);
        }
    }

    async fn next_event(&self) -> Option<DomainParticipantStatusEvent> {
        // The session is not borrowed while nothing happens.
        let next = |context: &mut std::task::Context<'_>| match &*self.session() {
            Some(session) => session.poll_event(context),
            None => Poll::Ready(None),
        };
        std::future::poll_fn(next).await
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

    /// Identifier of the participant.
    pub(crate) fn guid(&self) -> GUID {
        self.own
    }

    /// The names of the nodes of other participants.
    pub(crate) fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Endpoints of all participants that live, as far as they promised signs of life.
    pub(crate) fn living_endpoints(&self) -> Vec<peers::Endpoint> {
        let now = Instant::now();
        let writers = self.discovered_writers().into_iter().filter(|w| lives(w, now)).map(|w| peers::Endpoint {
            gid: w.writer_proxy.remote_writer_guid.to_bytes(),
            topic: w.publication_topic_data.topic_name,
            is_writer: true,
            addresses: peers::addresses(&w.writer_proxy.unicast_locator_list),
        });
        let readers = self.discovered_readers().into_iter().map(|r| peers::Endpoint {
            gid: r.reader_proxy.remote_reader_guid.to_bytes(),
            topic: r.subscription_topic_data.topic_name().clone(),
            is_writer: false,
            addresses: peers::addresses(&r.reader_proxy.unicast_locator_list),
        });
        writers.chain(readers).collect()
    }

    /// Domain and number of the participant, which fix its ports; none once the node has left.
    pub(crate) fn domain_and_number(&self) -> Option<(u16, u16)> {
        let session = self.session();
        session.as_ref().map(|session| (session.participant().domain_id(), session.participant().participant_id()))
    }

    /// The writers that other participants have, and those of this one that it has discovered; none once the node has left.
    pub(crate) fn discovered_writers(&self) -> Vec<DiscoveredWriterData> {
        self.session().as_ref().map(|session| session.participant().discovered_writers()).unwrap_or_default()
    }

    /// The readers, as [`Graph::discovered_writers`].
    pub(crate) fn discovered_readers(&self) -> Vec<DiscoveredReaderData> {
        self.session().as_ref().map(|session| session.participant().discovered_readers()).unwrap_or_default()
    }

    /// UDP addresses of the readers of a topic that a client's process has.
    pub(crate) fn addresses_of(&self, dds_topic: &str, client: Gid) -> Vec<SocketAddr> {
        let process = GUID::from(client).prefix;
        let readers = self.discovered_readers().into_iter();
        let readers = readers.filter(|reader| {
            reader.reader_proxy.remote_reader_guid.prefix == process
                && reader.subscription_topic_data.topic_name() == dds_topic
        });
        let locators = readers.flat_map(|reader| reader.reader_proxy.unicast_locator_list);
        let addresses: BTreeSet<SocketAddr> = locators.filter(|l| l.is_udp()).map(SocketAddr::from).collect();
        addresses.into_iter().collect()
    }

    /// How many publishers of a topic are known that live, as far as they promised signs of life.
    pub(crate) fn publisher_count(&self, name: &str) -> usize {
        self.writers_of(&format!("rt{name}")).iter().filter(|writer| lives(writer, Instant::now())).count()
    }

    /// How many publishers of a topic other participants have. A participant may or may not discover its own.
    pub(crate) fn other_publisher_count(&self, name: &str) -> usize {
        let (own, topic) = (self.own.prefix, format!("rt{name}"));
        let theirs = self.discovered_writers().into_iter();
        let theirs = theirs.filter(|w| w.writer_proxy.remote_writer_guid.prefix != own);
        theirs.filter(|w| w.publication_topic_data.topic_name == topic).count()
    }

    /// Topic, message type and profile of every publisher that other participants have.
    pub(crate) fn other_publishers(&self) -> Vec<(String, String, Qos)> {
        let own = self.own.prefix;
        let theirs = self.discovered_writers().into_iter();
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
        matched: &dyn Fn(&Matches) -> bool,
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
        let there = |matches: &Matches| matched(matches) && !self.answering(server).is_empty();
        let met = self.wait_matched(shutdown, timeout, &there).then(|| self.meet(server));
        // Between the two looks it may have left.
        let met = met.filter(|met| !met.answering.is_empty());
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

    fn writers_of(&self, dds_topic: &str) -> Vec<DiscoveredWriterData> {
        let found = self.discovered_writers().into_iter();
        found.filter(|writer| writer.publication_topic_data.topic_name == dds_topic).collect()
    }

    /// The names of all services of a type, each as often as it is served. RustDDS tells them from the readers of their
    /// requests; whether a server lives, its writer of answers tells.
    pub(crate) fn services(&self, request_type: &str) -> Vec<String> {
        let readers = self.discovered_readers().into_iter().map(|reader| reader.subscription_topic_data);
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
        matched: &dyn Fn(&Matches) -> bool,
    ) -> bool {
        let deadline = Instant::now() + timeout;
        loop {
            // Before the look, so that no change is missed.
            let change = self.matches.change();
            if matched(&self.matches) {
                return true;
            }
            let event = smol::future::or(async { change.recv().await.is_ok() }, async {
                shutdown.triggered().await;
                false
            });
            if block_until(event, Some(deadline)) != Some(true) {
                return matched(&self.matches);
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
