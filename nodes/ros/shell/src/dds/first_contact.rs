//! First answer to a client. It must wait until the client's reply reader is discovered, or it is lost.

use super::graph::Graph;
use ros2_client::{Gid, RmwRequestId};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Timeout for the discovery of the client's reply reader. rmw_fastrtps waits as long.
const PATIENCE: Duration = Duration::from_millis(100);

/// Polling period of discovery.
const POLL: Duration = Duration::from_millis(2);

/// Maximum number of remembered clients. Chosen, above the clients of a laboratory.
const REMEMBERED: usize = 64;

/// Bytes that the identifiers of all endpoints of a participant share (GUID prefix).
const PROCESS: usize = 12;

/// Known clients of one reply topic.
pub(crate) struct FirstContact {
    graph: Arc<Graph>,
    reply_topic: String,
    patience: Duration,
    /// Known clients, and whether their readers were discovered.
    known: VecDeque<(Gid, bool)>,
}

impl FirstContact {
    /// Creates it for the clients of the service with this absolute name.
    pub(crate) fn of_service(graph: &Arc<Graph>, service: &str) -> Self {
        Self::new(graph, format!("rr{service}Reply"), PATIENCE)
    }

    /// Creates it for the clients with readers of this DDS topic, and a timeout.
    pub(crate) fn new(graph: &Arc<Graph>, reply_topic: String, patience: Duration) -> Self {
        Self { graph: Arc::clone(graph), reply_topic, patience, known: VecDeque::new() }
    }

    /// Waits until the client of a request can receive an answer. Returns false after the timeout. Only the first request of a
    /// client waits.
    pub(crate) fn wait(&mut self, request: &RmwRequestId) -> bool {
        let client = request.writer_gid;
        match self.known.iter().position(|(known, _)| *known == client) {
            Some(index) => {
                if !self.known[index].1 {
                    self.known[index].1 = self.wait_for_reader(client, Duration::ZERO);
                }
                self.known[index].1
            }
            None => {
                if self.known.len() == REMEMBERED {
                    self.known.pop_front();
                }
                self.known.push_back((client, false));
                let newest = self.known.len() - 1;
                self.known[newest].1 = self.wait_for_reader(client, self.patience);
                self.known[newest].1
            }
        }
    }

    /// Waits for the reader of a known client. Returns false after `patience`.
    fn wait_for_reader(&self, client: Gid, patience: Duration) -> bool {
        // Endpoints of one participant are matched without discovery.
        if process(&Gid::from(self.graph.guid())) == process(&client) {
            return true;
        }
        // Requests do not name their reply reader. Readers are counted instead: one for each living client of that participant.
        let writers = self.graph.discovered_writers();
        let lives =
            |other: &Gid| writers.iter().any(|writer| Gid::from(writer.writer_proxy.remote_writer_guid) == *other);
        let siblings = self.known.iter().map(|(known, _)| known).filter(|known| process(known) == process(&client));
        let clients = siblings.filter(|sibling| **sibling == client || lives(sibling)).count();
        let deadline = Instant::now() + patience;
        loop {
            let readers = self.graph.discovered_readers();
            let replies = readers.iter().filter(|reader| {
                *reader.subscription_topic_data.topic_name() == self.reply_topic
                    && process(&Gid::from(reader.reader_proxy.remote_reader_guid)) == process(&client)
            });
            let is_found = replies.count() >= clients;
            // Also after success: the writer learns of the reader slightly later than discovery.
            std::thread::sleep(POLL);
            if is_found || Instant::now() >= deadline {
                return is_found;
            }
        }
    }
}

fn process(gid: &Gid) -> &[u8] {
    &gid.as_bytes()[..PROCESS]
}
