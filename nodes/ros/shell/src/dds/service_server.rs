//! Server of a service on DDS, and the profiles of services.

use super::first_contact::FirstContact;
use super::graph::Graph;
use super::interface::service_type;
use super::large_reply::ReplyWriter;
use super::peers::Requester;
use super::service_endpoints::{ServerEndpoints, ServiceSpec};
use crate::error::ShellError;
use futures::StreamExt;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};
use ros2_client::{Message, QosProfile};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// Profile of requests and replies, equal to the profile of rclcpp and rclpy.
pub(crate) const SERVICE_QOS: QosProfile = QosProfile {
    reliability: Reliability::Reliable { when_full: WhenFull::DEFAULT },
    durability: Durability::Volatile,
    history: History::KeepLast { depth: 10 },
    deadline: None,
    lifespan: None,
    liveliness: Liveliness::Automatic,
    liveliness_lease: None,
};

/// Liveliness lease of servers. Without it a killed server would be called during the 50 s of its participant's lease. For it
/// RustDDS sends a sign of life every 6 s.
const SERVER_LEASE: Duration = Duration::from_secs(10);

/// Profile of a server's replies, with the liveliness lease.
const REPLY_QOS: QosProfile = QosProfile { liveliness_lease: Some(SERVER_LEASE), ..SERVICE_QOS };

/// Server of one service, which answers its requests.
pub(crate) struct ServiceServer<Req: Message + 'static, Resp: Message> {
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
    server: ServerEndpoints<Req, Resp>,
    large: Option<ReplyWriter>,
    /// Makes an answer of the reason why the real one cannot be sent.
    refusal: fn(String) -> Option<Resp>,
    path: String,
    graph: Arc<Graph>,
}

impl<Req, Resp> ServiceServer<Req, Resp>
where
    Req: Message + Clone + 'static,
    Resp: Message + 'static,
{
    /// Creates the endpoint of a service with this absolute name and the type called `type_name` (`package/srv/Type`).
    pub(crate) fn new(graph: &Arc<Graph>, path: String, type_name: &str) -> Result<Self, ShellError> {
        let (dds_type, requests, answers) = (service_type(type_name)?, SERVICE_QOS.into(), REPLY_QOS.into());
        let of = ServiceSpec { name: &path, dds_type: &dds_type, requests: &requests, answers: &answers };
        let server =
            graph.make(type_name, || format!("service {path}"), |session| ServerEndpoints::new(session, &of))?;
        Ok(Self { server, large: None, refusal: |_| None, path, graph: Arc::clone(graph) })
    }

    /// Answers with a refusal where the answer is too large for the client.
    pub(crate) fn refusing(self, refusal: fn(String) -> Option<Resp>) -> Self {
        Self { refusal, ..self }
    }

    /// Adds the topic for large replies.
    pub(crate) fn with_large_replies(mut self) -> Result<Self, ShellError> {
        self.large = Some(ReplyWriter::new(&self.graph, &self.path)?);
        Ok(self)
    }

    /// Answers requests, one after the other. Never ends.
    pub(crate) async fn answer(&self, mut handler: impl FnMut(Req) -> Resp) {
        self.answer_to(|request, _| handler(request)).await;
    }

    /// Answers requests with a handler that also gets the sender.
    pub(crate) async fn answer_to(&self, mut handler: impl FnMut(Req, &Requester) -> Resp) {
        let mut contact = FirstContact::of_service(&self.graph, &self.path);
        let mut large = self.large.as_ref().map(|large| (large, large.contact(&self.graph)));
        let mut requests = pin!(self.server.requests());
        while let Some(request) = requests.next().await {
            let sent = match request {
                Ok((id, request)) => {
                    let response = handler(request, &Requester::new(&self.graph, &id));
                    let is_sent = large.as_mut().is_some_and(|(large, clients)| large.send(&id, &response, clients));
                    if is_sent {
                        Ok(())
                    } else {
                        contact.wait(&id);
                        self.server.answer(&self.graph, id, response, self.refusal)
                    }
                }
                Err(error) => {
                    tracing::warn!("{}: unreadable request: {error}", self.path);
                    continue;
                }
            };
            // So that the end of the server waits until RustDDS has sent the answer.
            self.graph.touch();
            if let Err(error) = sent {
                tracing::warn!("{}: answer not sent: {error}", self.path);
            }
        }
    }

    /// Returns the graph in which the service is.
    pub(crate) fn graph(&self) -> &Graph {
        &self.graph
    }
}
