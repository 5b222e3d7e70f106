//! Servers of a service, as a client knows them.

use super::graph::{Graph, lives};
use super::matches::Matches;
use crate::time::shutdown::Shutdown;
use rustdds::GUID;
use rustdds::discovery::SubscriptionBuiltinTopicData;
use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Validity of a client's knowledge of its server. Chosen: a tenth of the lease of a server that dies.
const SERVER_VALIDITY: Duration = Duration::from_secs(1);

/// Server as known by a client.
///
/// Looking a server up copies all discovered writers, so a client that calls a thousand times a minute must not look it up for
/// each call.
pub(crate) struct Server {
    replies: String,
    answering: Mutex<Option<Answering>>,
}

/// Writers of answers, and the time at which they were looked up.
struct Answering {
    at: Instant,
    writers: BTreeSet<GUID>,
}

impl Server {
    /// Creates the unknown server of the service with this absolute name.
    pub(crate) fn new(service: &str) -> Self {
        Self { replies: format!("rr{service}Reply"), answering: Mutex::new(None) }
    }

    fn known(&self) -> MutexGuard<'_, Option<Answering>> {
        self.answering.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Graph {
    /// Waits for a server until `matched` holds, and returns its writers of answers; `None` on timeout or shutdown.
    ///
    /// A server that was found before is looked up again after [`SERVER_VALIDITY`]. The full wait is repeated only if it has left
    /// or was restarted: discovery may have found only some endpoints of a new server.
    pub(crate) fn wait_server(
        &self,
        server: &Server,
        shutdown: &Shutdown,
        timeout: Duration,
        matched: &dyn Fn(&Matches) -> bool,
    ) -> Option<BTreeSet<GUID>> {
        if let Some(known) = &mut *server.known() {
            let mut is_same = true;
            if known.at.elapsed() > SERVER_VALIDITY {
                let now = self.look_up(server);
                // Fewer servers than before are no new server.
                is_same = now.writers.is_subset(&known.writers);
                *known = now;
            }
            if is_same && !known.writers.is_empty() {
                return Some(known.writers.clone());
            }
        }
        let there = |matches: &Matches| matched(matches) && !self.answering(server).is_empty();
        let found = self.wait_matched(shutdown, timeout, &there).then(|| self.look_up(server));
        // The server may have left since `there` held.
        let found = found.filter(|found| !found.writers.is_empty());
        let writers = found.as_ref().map(|found| found.writers.clone());
        *server.known() = found;
        writers
    }

    fn look_up(&self, server: &Server) -> Answering {
        Answering { at: Instant::now(), writers: self.answering(server) }
    }

    /// Returns the living writers of answers of a server.
    pub(crate) fn answering(&self, server: &Server) -> BTreeSet<GUID> {
        let now = Instant::now();
        let living = self.writers_of(&server.replies).into_iter().filter(|writer| lives(writer, now));
        living.map(|writer| writer.writer_proxy.remote_writer_guid).collect()
    }

    /// Returns the names of all services of a type, each as often as it is served. A service is found by its reader of requests,
    /// its living servers by their writers of answers: readers have no liveliness.
    pub(crate) fn services(&self, request_type: &str) -> Vec<String> {
        let readers = self.discovered_readers().into_iter().map(|reader| reader.subscription_topic_data);
        let requests = readers.filter(|data| data.type_name() == request_type);
        let name = |data: SubscriptionBuiltinTopicData| {
            Some(data.topic_name().strip_prefix("rq")?.strip_suffix("Request")?.to_owned())
        };
        let names: BTreeSet<String> = requests.filter_map(name).collect();
        names.into_iter().flat_map(|name| vec![name.clone(); self.answering(&Server::new(&name)).len()]).collect()
    }
}
