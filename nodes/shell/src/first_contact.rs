//! The first answer to a client: it must not leave before the client's reply reader is known, or it is lost.

use crate::graph::Graph;
use ros2_client::{Gid, RmwRequestId};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long the first answer waits for the client's reply reader. rmw_fastrtps waits as long.
const PATIENCE: Duration = Duration::from_millis(100);

/// Between two looks at what discovery knows.
const LOOK: Duration = Duration::from_millis(2);

/// Clients that are remembered.
const REMEMBERED: usize = 64;

/// The bytes by which all endpoints of a process begin.
const PROCESS: usize = 12;

/// The clients of one reply topic that have been met.
pub(crate) struct FirstContact {
    graph: Arc<Graph>,
    reply_topic: String,
    met: VecDeque<Gid>,
}

impl FirstContact {
    /// For the service with this absolute name.
    pub(crate) fn new(graph: &Arc<Graph>, service: &str) -> Self {
        Self { graph: Arc::clone(graph), reply_topic: format!("rr{service}Reply"), met: VecDeque::new() }
    }

    /// Returns when the client that sent the request can get an answer, or after a short patience; at once from the
    /// client's second request on.
    pub(crate) fn wait(&mut self, request: &RmwRequestId) {
        let client = request.writer_gid;
        if self.met.contains(&client) {
            return;
        }
        if self.met.len() == REMEMBERED {
            self.met.pop_front();
        }
        self.met.push_back(client);
        let participant = self.graph.participant();
        if process(&participant_gid(&participant)) == process(&client) {
            return;
        }
        // Requests do not name their reply reader, so readers are counted: one for each client of that process.
        let clients = self.met.iter().filter(|met| process(met) == process(&client)).count();
        let deadline = Instant::now() + PATIENCE;
        loop {
            let readers = participant.discovered_readers();
            let replies = readers.iter().filter(|reader| {
                *reader.subscription_topic_data.topic_name() == self.reply_topic
                    && process(&Gid::from(reader.reader_proxy.remote_reader_guid)) == process(&client)
            });
            let known = replies.count() >= clients;
            // One more look's time, in which the writer hears what discovery knows.
            std::thread::sleep(LOOK);
            if known || Instant::now() >= deadline {
                return;
            }
        }
    }
}

fn participant_gid(participant: &rustdds::DomainParticipant) -> Gid {
    use rustdds::RTPSEntity;
    Gid::from(participant.guid())
}

fn process(gid: &Gid) -> &[u8] {
    &gid.as_bytes()[..PROCESS]
}
