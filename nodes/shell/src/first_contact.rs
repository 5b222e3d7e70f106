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
    patience: Duration,
    /// Those met, and whether they could be answered.
    met: VecDeque<(Gid, bool)>,
}

impl FirstContact {
    /// For the clients of the service with this absolute name.
    pub(crate) fn of_service(graph: &Arc<Graph>, service: &str) -> Self {
        Self::new(graph, format!("rr{service}Reply"), PATIENCE)
    }

    /// For the clients that get their answers from this topic of the middleware, which are waited for so long.
    pub(crate) fn new(graph: &Arc<Graph>, reply_topic: String, patience: Duration) -> Self {
        Self { graph: Arc::clone(graph), reply_topic, patience, met: VecDeque::new() }
    }

    /// Returns when the client that sent the request can get an answer, or after the patience; at once from the client's
    /// second request on. False: it cannot.
    pub(crate) fn wait(&mut self, request: &RmwRequestId) -> bool {
        let client = request.writer_gid;
        match self.met.iter().position(|(met, _)| *met == client) {
            Some(known) => {
                if !self.met[known].1 {
                    self.met[known].1 = self.find(client, Duration::ZERO);
                }
                self.met[known].1
            }
            None => {
                if self.met.len() == REMEMBERED {
                    self.met.pop_front();
                }
                self.met.push_back((client, false));
                let newest = self.met.len() - 1;
                self.met[newest].1 = self.find(client, self.patience);
                self.met[newest].1
            }
        }
    }

    /// Waits for the reader of a client that has been met.
    fn find(&self, client: Gid, patience: Duration) -> bool {
        if process(&Gid::from(self.graph.guid())) == process(&client) {
            return true;
        }
        // Requests do not name their reply reader, so readers are counted: one for each client of that process that is still there.
        let writers = self.graph.discovered_writers();
        let lives = |met: &Gid| writers.iter().any(|writer| Gid::from(writer.writer_proxy.remote_writer_guid) == *met);
        let met = self.met.iter().map(|(met, _)| met).filter(|met| process(met) == process(&client));
        let clients = met.filter(|met| **met == client || lives(met)).count();
        let deadline = Instant::now() + patience;
        loop {
            let readers = self.graph.discovered_readers();
            let replies = readers.iter().filter(|reader| {
                *reader.subscription_topic_data.topic_name() == self.reply_topic
                    && process(&Gid::from(reader.reader_proxy.remote_reader_guid)) == process(&client)
            });
            let known = replies.count() >= clients;
            // One more look's time, in which the writer hears what discovery knows.
            std::thread::sleep(LOOK);
            if known || Instant::now() >= deadline {
                return known;
            }
        }
    }
}

fn process(gid: &Gid) -> &[u8] {
    &gid.as_bytes()[..PROCESS]
}
