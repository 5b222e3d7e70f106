//! Services: servers with a handler on a thread of their own, and clients with a timeout on every wait.

use crate::error::{CallError, ShellError};
use crate::first_contact::FirstContact;
use crate::graph::{Graph, Server};
use crate::interface::{Srv, service_type};
use crate::large_reply::{self, ReplyReader, ReplyWriter};
use crate::middleware::{ClientEnds, Served, ServerEnds};
use crate::node::Node;
use crate::peers::{Requester, list_peers};
use crate::shutdown::Shutdown;
use crate::wait::block_until;
use futures::StreamExt;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};
use ros2_client::{Message, QosProfile};
use rustdds::GUID;
use std::collections::BTreeSet;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The profile of requests and replies, which is that of rclcpp and rclpy.
pub(crate) const SERVICE_QOS: QosProfile = QosProfile {
    reliability: Reliability::Reliable { when_full: WhenFull::DEFAULT },
    durability: Durability::Volatile,
    history: History::KeepLast { depth: 10 },
    deadline: None,
    lifespan: None,
    liveliness: Liveliness::Automatic,
    liveliness_lease: None,
};

/// Silence after which a server is taken for dead. The lease of its participant is 50 s, in which one that was killed would
/// be asked as if it were there. RustDDS gives a sign of life every 6 s for it.
const SERVER_LEASE: Duration = Duration::from_secs(10);

/// How often a client that waits looks whether those whom it asked live.
const LOOK: Duration = Duration::from_secs(1);

/// The profile of a server's replies: it promises signs of life.
const REPLY_QOS: QosProfile = QosProfile { liveliness_lease: Some(SERVER_LEASE), ..SERVICE_QOS };

/// The server's end of one service.
pub(crate) struct Endpoint<Req: Message + 'static, Resp: Message> {
    // Before the graph, so that reader and writer go first.
    server: ServerEnds<Req, Resp>,
    large: Option<ReplyWriter>,
    path: String,
    graph: Arc<Graph>,
}

impl<Req, Resp> Endpoint<Req, Resp>
where
    Req: Message + Clone + 'static,
    Resp: Message + 'static,
{
    /// The service with this absolute name, of the type called `type_name` (`package/srv/Type`).
    pub(crate) fn new(graph: &Arc<Graph>, path: String, type_name: &str) -> Result<Self, ShellError> {
        let (dds_type, requests, answers) = (service_type(type_name)?, SERVICE_QOS.into(), REPLY_QOS.into());
        let of = Served { name: &path, dds_type: &dds_type, requests: &requests, answers: &answers };
        let server = graph.make(type_name, || format!("service {path}"), |session| ServerEnds::new(session, &of))?;
        Ok(Self { server, large: None, path, graph: Arc::clone(graph) })
    }

    /// With a way for large answers.
    fn with_large_replies(mut self) -> Result<Self, ShellError> {
        self.large = Some(ReplyWriter::new(&self.graph, &self.path)?);
        Ok(self)
    }

    /// Answers requests, one after the other, for ever.
    pub(crate) async fn answer(&self, mut handler: impl FnMut(Req) -> Resp) {
        self.answer_to(|request, _| handler(request)).await;
    }

    /// The same for a handler that is told who asks.
    async fn answer_to(&self, mut handler: impl FnMut(Req, &Requester) -> Resp) {
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
                        self.server.answer(&self.graph, id, response)
                    }
                }
                Err(error) => {
                    tracing::warn!("{}: unreadable request: {error}", self.path);
                    continue;
                }
            };
            self.graph.touch();
            if let Err(error) = sent {
                tracing::warn!("{}: answer not sent: {error}", self.path);
            }
        }
    }
}

/// Ends its service when it is dropped.
#[must_use = "the service ends when its handle is dropped"]
pub struct Service {
    name: String,
    stop: Shutdown,
}

impl Service {
    /// The absolute name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.stop.trigger();
    }
}

/// Asks a service. Clones share it; one call is in flight at a time, others wait their turn.
pub struct Client<S: Srv> {
    inner: Arc<ClientInner<S>>,
}

impl<S: Srv> Clone for Client<S> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner) }
    }
}

type Asking<S> =
    ClientEnds<<S as catenary_msgs::ServiceInterface>::Request, <S as catenary_msgs::ServiceInterface>::Response>;

/// The service's own end, and that of large answers.
struct Ends<S: Srv> {
    service: Asking<S>,
    large: Option<ReplyReader>,
}

impl<S: Srv> Ends<S> {
    async fn ask(&self, request: S::Request) -> Result<S::Response, String> {
        let id = self.service.ask(request).await?;
        let small = self.service.answer(id);
        match &self.large {
            Some(large) => smol::future::or(small, large.receive(id)).await,
            None => small.await,
        }
    }
}

struct ClientInner<S: Srv> {
    // Before the graph, so that reader and writer go first.
    client: Mutex<Ends<S>>,
    name: String,
    server: Server,
    shutdown: Shutdown,
    graph: Arc<Graph>,
}

impl Node {
    /// Answers requests one after the other, on a thread of the service's own, until the handle is dropped. The
    /// handler may block; requests queue meanwhile.
    ///
    /// # Errors
    /// [`ShellError`]: the name, the middleware.
    pub fn serve<S: Srv>(
        &self,
        name: &str,
        mut handler: impl FnMut(S::Request) -> S::Response + Send + 'static,
    ) -> Result<Service, ShellError> {
        self.serve_to::<S>(name, move |request, _| handler(request))
    }

    /// As [`Node::serve`], with a handler that is told who asks.
    ///
    /// # Errors
    /// As [`Node::serve`].
    pub fn serve_to<S: Srv>(
        &self,
        name: &str,
        handler: impl FnMut(S::Request, &Requester) -> S::Response + Send + 'static,
    ) -> Result<Service, ShellError> {
        let name = self.resolve(name)?;
        let mut endpoint = Endpoint::<S::Request, S::Response>::new(self.graph(), name.clone(), S::TYPE_NAME)?;
        if large_reply::is_for(S::TYPE_NAME) {
            endpoint = endpoint.with_large_replies()?;
        }
        let stop = self.shutdown().child();
        let stopped = stop.clone();
        self.spawn(&format!("srv {name}"), move || {
            block_until(smol::future::or(stopped.triggered(), endpoint.answer_to(handler)), None);
            endpoint.graph.linger();
        })?;
        Ok(Service { name, stop })
    }

    /// A client of a service.
    ///
    /// # Errors
    /// [`ShellError`]: the name, the middleware.
    pub fn client<S: Srv>(&self, name: &str) -> Result<Client<S>, ShellError> {
        let name = self.resolve(name)?;
        // Before the requests, so that servers know it by the first of them.
        let large = match large_reply::is_for(S::TYPE_NAME) {
            true => Some(ReplyReader::new(self.graph(), &name)?),
            false => None,
        };
        let (dds_type, qos) = (service_type(S::TYPE_NAME)?, SERVICE_QOS.into());
        let of = Served { name: &name, dds_type: &dds_type, requests: &qos, answers: &qos };
        let service =
            self.graph().make(S::TYPE_NAME, || format!("client of {name}"), |session| ClientEnds::new(session, &of))?;
        let inner = ClientInner {
            client: Mutex::new(Ends { service, large }),
            server: Server::new(&name),
            name,
            shutdown: self.shutdown().clone(),
            graph: Arc::clone(self.graph()),
        };
        Ok(Client { inner: Arc::new(inner) })
    }
}

impl<S: Srv> Client<S> {
    /// The absolute name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Waits until the service is there; false: not in time, or shutdown.
    #[must_use]
    pub fn wait_for_service(&self, timeout: Duration) -> bool {
        let client = self.inner.client.lock().unwrap_or_else(PoisonError::into_inner);
        self.wait_matched(&client.service, timeout, &self.inner.shutdown).is_some()
    }

    /// Fails where several nodes offer the service: for requests that only one of them may carry out.
    ///
    /// # Errors
    /// [`CallError::Ambiguous`].
    pub fn ensure_one_server(&self) -> Result<(), CallError> {
        let servers = self.inner.graph.servers(std::slice::from_ref(&self.inner.name));
        match servers.len() {
            0 | 1 => Ok(()),
            _ => Err(CallError::Ambiguous { name: self.inner.name.clone(), servers: list_peers(&servers) }),
        }
    }

    fn wait_matched(&self, client: &Asking<S>, timeout: Duration, stop: &Shutdown) -> Option<BTreeSet<GUID>> {
        let ClientInner { graph, server, .. } = &*self.inner;
        graph.wait_server(server, stop, timeout, &|matches| client.is_matched(matches))
    }

    /// Asks and waits for the answer, at most `timeout` from the start of the call, including the wait for the
    /// service to appear.
    ///
    /// # Errors
    /// [`CallError`]: nobody offers the service, no answer in time, the server died, shutdown, the middleware.
    pub fn call(&self, request: S::Request, timeout: Duration) -> Result<S::Response, CallError> {
        self.call_until(request, timeout, &self.inner.shutdown)
    }

    /// As [`Client::call`], and gives up when `stop` is triggered, which is [`CallError::Shutdown`]. A server may answer all
    /// the same, and nobody hears it.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub fn call_until(
        &self,
        request: S::Request,
        timeout: Duration,
        stop: &Shutdown,
    ) -> Result<S::Response, CallError> {
        let deadline = Instant::now() + timeout;
        let name = || self.inner.name.clone();
        let client = self.inner.client.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(asked) = self.wait_matched(&client.service, deadline.saturating_duration_since(Instant::now()), stop)
        else {
            return Err(if stop.is_triggered() {
                CallError::Shutdown { name: name() }
            } else {
                CallError::NoServer { name: name(), waited: timeout }
            });
        };
        let ClientInner { graph, server, .. } = &*self.inner;
        let answer = async { Some(client.ask(request).await) };
        let end = async {
            stop.triggered().await;
            None
        };
        let mut either = pin!(smol::future::or(answer, end));
        loop {
            let now = Instant::now();
            match block_until(either.as_mut(), Some(deadline.min(now + LOOK))) {
                Some(Some(Ok(response))) => return Ok(response),
                Some(Some(Err(reason))) => return Err(CallError::Middleware { name: name(), reason }),
                Some(None) => return Err(CallError::Shutdown { name: name() }),
                None if Instant::now() >= deadline => {
                    return Err(CallError::Timeout { name: name(), waited: timeout });
                }
                None if !asked.is_empty() && asked.is_disjoint(&graph.answering(server)) => {
                    return Err(CallError::Left { name: name() });
                }
                None => {}
            }
        }
    }
}
