//! Graph as seen by one node: its session, and the endpoints of others that discovery found.

use super::directory::{Directory, Endpoint, addresses};
use super::endpoint::{Reader, Writer};
use super::interface::{dds_type, ros_type};
use super::log_noise;
use super::matches::Matches;
use super::qos::Qos;
use super::session::{Created, Session};
use crate::error::ShellError;
use crate::time::shutdown::Shutdown;
use crate::time::wait::block_until;
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

/// Graph as seen by one node.
///
/// The session is owned only here. [`Graph::leave`] ends it, even if endpoints, clones of the node or this still exist.
pub(crate) struct Graph {
    /// Session; `None` after the node has left.
    session: Mutex<Option<Session>>,
    /// Set before the session ends. Readable without the session's lock.
    has_left: AtomicBool,
    own: GUID,
    matches: Matches,
    /// Names of all types that endpoints of the node have had.
    types: Mutex<BTreeSet<String>>,
    directory: Directory,
    since: Instant,
    /// Time of the last write of any endpoint, nanoseconds after `since`.
    written: AtomicU64,
    /// Number of answers that were too large for their clients.
    too_large: AtomicU64,
}

/// Number of sessions in this process.
static LIVE: AtomicUsize = AtomicUsize::new(0);

impl Drop for Graph {
    fn drop(&mut self) {
        self.leave();
    }
}

/// Time that a writer stays after its last write. RustDDS sends on another thread.
const LINGER: Duration = Duration::from_millis(50);

impl Graph {
    pub(crate) fn new(session: Session) -> Self {
        LIVE.fetch_add(1, Ordering::AcqRel);
        // A process may start a node after its last one has left.
        log_noise::hush(false);
        Self {
            own: session.participant().guid(),
            session: Mutex::new(Some(session)),
            has_left: AtomicBool::new(false),
            matches: Matches::default(),
            directory: Directory::default(),
            types: Mutex::default(),
            since: Instant::now(),
            written: AtomicU64::new(0),
            too_large: AtomicU64::new(0),
        }
    }

    /// Counts an answer that was too large for its client.
    pub(crate) fn count_too_large(&self) {
        self.too_large.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the number of answers that were too large for their clients.
    pub(crate) fn too_large(&self) -> u64 {
        self.too_large.load(Ordering::Relaxed)
    }

    /// Ends the session: other nodes see the node and its endpoints leave. Later creations and writes fail.
    ///
    /// Returns when the session has ended, even if another thread ends it.
    pub(crate) fn leave(&self) {
        self.linger();
        self.has_left.store(true, Ordering::Release);
        // The lock is held to the end, so that another thread in `leave` waits too.
        let mut session = self.session();
        if session.is_none() {
            return;
        }
        // RustDDS warns of endpoints that outlive their participant. After the last session these warnings are noise.
        if LIVE.fetch_sub(1, Ordering::AcqRel) == 1 {
            log_noise::hush(true);
        }
        *session = None;
    }

    /// Returns true if the node has left the graph.
    pub(crate) fn has_left(&self) -> bool {
        self.has_left.load(Ordering::Acquire)
    }

    fn session(&self) -> MutexGuard<'_, Option<Session>> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if the node no longer hears the graph: see [`Session::has_lost_network`].
    pub(crate) fn has_lost_network(&self) -> bool {
        self.session().as_ref().is_some_and(Session::has_lost_network)
    }

    /// Returns true if an endpoint of the node has had the type called `package/kind/Name`.
    pub(crate) fn uses_type(&self, name: &str) -> bool {
        self.types.lock().unwrap_or_else(PoisonError::into_inner).contains(name)
    }

    /// Creates an endpoint of a type. `what` names it in the error.
    pub(crate) fn make<T>(
        &self,
        type_name: &str,
        what: impl FnOnce() -> String,
        make: impl FnOnce(&Session) -> Created<T>,
    ) -> Result<T, ShellError> {
        self.types.lock().unwrap_or_else(PoisonError::into_inner).insert(type_name.to_owned());
        match &*self.session() {
            Some(session) => make(session).map_err(|error| ShellError::create(what(), error)),
            None => Err(ShellError::create(what(), "the node has left the graph")),
        }
    }

    /// Creates the endpoints of an action, as [`Graph::make`], and records their derived types.
    pub(crate) fn make_action<T>(
        &self,
        type_name: &str,
        what: impl FnOnce() -> String,
        make: impl FnOnce(&Session) -> Created<T>,
    ) -> Result<T, ShellError> {
        let parts = ["SendGoal", "GetResult", "FeedbackMessage"].map(|part| format!("{type_name}_{part}"));
        let common = ["action_msgs/srv/CancelGoal", "action_msgs/msg/GoalStatusArray"].map(str::to_owned);
        self.types.lock().unwrap_or_else(PoisonError::into_inner).extend(parts.into_iter().chain(common));
        self.make(type_name, what, make)
    }

    /// Creates a writer of a message type on the topic with this absolute name.
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

    /// Creates a reader of a message type on the topic with this absolute name.
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

    /// Returns the matches between the node's endpoints and others.
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
        // The session is locked for one poll only, so that `leave` can end it in between.
        let next = |context: &mut std::task::Context<'_>| match &*self.session() {
            Some(session) => session.poll_event(context),
            None => Poll::Ready(None),
        };
        std::future::poll_fn(next).await
    }

    fn elapsed(&self) -> u64 {
        u64::try_from(self.since.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// Records a write.
    pub(crate) fn touch(&self) {
        self.written.store(self.elapsed(), Ordering::Relaxed);
    }

    /// Waits until the last write has left the process, before the end of a writer.
    pub(crate) fn linger(&self) {
        let written = self.written.load(Ordering::Relaxed);
        let age = Duration::from_nanos(self.elapsed().saturating_sub(written));
        if written > 0 && age < LINGER {
            std::thread::sleep(LINGER - age);
        }
    }

    /// Returns the identifier of the participant.
    pub(crate) fn guid(&self) -> GUID {
        self.own
    }

    /// Returns the names of the nodes of other participants.
    pub(crate) fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Returns the living writers of all participants.
    pub(crate) fn living_writers(&self) -> Vec<Endpoint> {
        let now = Instant::now();
        let living = self.discovered_writers().into_iter().filter(|w| lives(w, now));
        let endpoint = |w: DiscoveredWriterData| Endpoint {
            gid: w.writer_proxy.remote_writer_guid.to_bytes(),
            topic: w.publication_topic_data.topic_name,
            addresses: addresses(&w.writer_proxy.unicast_locator_list),
        };
        living.map(endpoint).collect()
    }

    /// Returns the readers of all participants. Readers have no liveliness: one of a killed participant counts until its lease ends.
    pub(crate) fn living_readers(&self) -> Vec<Endpoint> {
        let endpoint = |r: DiscoveredReaderData| Endpoint {
            gid: r.reader_proxy.remote_reader_guid.to_bytes(),
            topic: r.subscription_topic_data.topic_name().clone(),
            addresses: addresses(&r.reader_proxy.unicast_locator_list),
        };
        self.discovered_readers().into_iter().map(endpoint).collect()
    }

    /// Returns domain and number of the participant, which determine its ports; `None` after the node has left.
    pub(crate) fn domain_and_number(&self) -> Option<(u16, u16)> {
        let session = self.session();
        session.as_ref().map(|session| (session.participant().domain_id(), session.participant().participant_id()))
    }

    /// Returns the discovered writers, of other participants and partly of this one; empty after the node has left.
    pub(crate) fn discovered_writers(&self) -> Vec<DiscoveredWriterData> {
        self.session().as_ref().map(|session| session.participant().discovered_writers()).unwrap_or_default()
    }

    /// Returns the discovered readers, as [`Graph::discovered_writers`].
    pub(crate) fn discovered_readers(&self) -> Vec<DiscoveredReaderData> {
        self.session().as_ref().map(|session| session.participant().discovered_readers()).unwrap_or_default()
    }

    /// Returns the UDP addresses of the readers of a topic in a client's participant.
    pub(crate) fn addresses_of(&self, dds_topic: &str, client: Gid) -> Vec<SocketAddr> {
        let process = GUID::from(client).prefix;
        let readers = self.discovered_readers().into_iter();
        let readers = readers.filter(|reader| {
            reader.reader_proxy.remote_reader_guid.prefix == process
                && reader.subscription_topic_data.topic_name() == dds_topic
        });
        let locators = readers.flat_map(|reader| reader.reader_proxy.unicast_locator_list);
        // Several readers of one participant announce the same addresses: each gets one datagram.
        let addresses: BTreeSet<SocketAddr> = locators.filter(|l| l.is_udp()).map(SocketAddr::from).collect();
        addresses.into_iter().collect()
    }

    /// Returns the number of living publishers of a topic.
    pub(crate) fn publisher_count(&self, name: &str) -> usize {
        self.writers_of(&format!("rt{name}")).iter().filter(|writer| lives(writer, Instant::now())).count()
    }

    /// Returns the number of publishers of a topic in other participants. A participant may or may not discover its own.
    pub(crate) fn other_publisher_count(&self, name: &str) -> usize {
        let (own, topic) = (self.own.prefix, format!("rt{name}"));
        let theirs = self.discovered_writers().into_iter();
        let theirs = theirs.filter(|w| w.writer_proxy.remote_writer_guid.prefix != own);
        theirs.filter(|w| w.publication_topic_data.topic_name == topic).count()
    }

    /// Returns the publishers of other participants.
    pub(crate) fn other_publishers(&self) -> Vec<(String, String, Qos)> {
        // Discovery may or may not list the participant's own writers.
        let own = self.own.prefix;
        let theirs = self.discovered_writers().into_iter();
        let theirs = theirs.filter(|w| w.writer_proxy.remote_writer_guid.prefix != own);
        let publisher = |data: PublicationBuiltinTopicData| {
            let name = data.topic_name.strip_prefix("rt").filter(|name| name.starts_with('/'))?;
            Some((name.to_owned(), ros_type(&data.type_name)?, Qos::offered(data.reliability, data.durability)))
        };
        theirs.filter_map(|w| publisher(w.publication_topic_data)).collect()
    }

    /// Returns the discovered writers on a DDS topic.
    pub(super) fn writers_of(&self, dds_topic: &str) -> Vec<DiscoveredWriterData> {
        let found = self.discovered_writers().into_iter();
        found.filter(|writer| writer.publication_topic_data.topic_name == dds_topic).collect()
    }

    /// Waits until `matched` holds, and tests it again at every change of the graph. Returns false on timeout or shutdown.
    pub(crate) fn wait_matched(
        &self,
        shutdown: &Shutdown,
        timeout: Duration,
        matched: &dyn Fn(&Matches) -> bool,
    ) -> bool {
        let deadline = Instant::now() + timeout;
        loop {
            // Before the test, so that no change is missed.
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

/// Returns false for a writer that has been silent for longer than its liveliness lease. RustDDS counts its participant's signs of
/// life.
pub(super) fn lives(writer: &DiscoveredWriterData, now: Instant) -> bool {
    match writer.publication_topic_data.liveliness {
        Some(Liveliness::Automatic { lease_duration }) if lease_duration < DdsDuration::INFINITE => {
            now.saturating_duration_since(writer.last_updated) <= Duration::from(lease_duration)
        }
        _ => true,
    }
}
