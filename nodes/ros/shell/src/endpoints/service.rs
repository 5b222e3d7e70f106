//! Services: servers with a handler on their own thread, and clients with a timeout on every wait.

use crate::dds::graph::Graph;
use crate::dds::interface::{Srv, service_type};
use crate::dds::large_reply::{self, ReplyReader};
use crate::dds::peers::{Requester, list_peers};
use crate::dds::servers::Server;
use crate::dds::service_endpoints::{ClientEndpoints, ServiceSpec};
use crate::dds::service_server::{SERVICE_QOS, ServiceServer};
use crate::error::{CallError, ShellError};
use crate::process::node::Node;
use crate::time::shutdown::Shutdown;
use crate::time::wait::block_until;
use rustdds::GUID;
use std::collections::BTreeSet;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Period at which a waiting client checks that the servers it called are alive.
const LIVELINESS_POLL: Duration = Duration::from_secs(1);

/// Handle of a service. Dropping it ends the service.
#[must_use = "the service ends when its handle is dropped"]
pub struct Service {
    name: String,
    stop: Shutdown,
}

impl Service {
    /// Returns the absolute name.
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

/// Client of a service. Clones share it. Calls run one at a time; further calls wait.
pub struct Client<S: Srv> {
    inner: Arc<ClientInner<S>>,
}

impl<S: Srv> Clone for Client<S> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner) }
    }
}

type Asking<S> =
    ClientEndpoints<<S as catenary_msgs::ServiceInterface>::Request, <S as catenary_msgs::ServiceInterface>::Response>;

/// Endpoints of a client: the service, and the topic for large replies.
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
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
    client: Mutex<Ends<S>>,
    name: String,
    server: Server,
    shutdown: Shutdown,
    graph: Arc<Graph>,
}

impl Node {
    /// Answers requests one after the other, on the service's own thread, until the handle is dropped. The handler may block;
    /// requests queue meanwhile.
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

    /// Serves as [`Node::serve`], with a handler that also gets the sender of the request.
    ///
    /// # Errors
    /// As [`Node::serve`].
    pub fn serve_to<S: Srv>(
        &self,
        name: &str,
        handler: impl FnMut(S::Request, &Requester) -> S::Response + Send + 'static,
    ) -> Result<Service, ShellError> {
        let name = self.resolve(name)?;
        let mut server = ServiceServer::<S::Request, S::Response>::new(self.graph(), name.clone(), S::TYPE_NAME)?
            .refusing(S::refusal);
        if large_reply::is_for(S::TYPE_NAME) {
            server = server.with_large_replies()?;
        }
        let stop = self.shutdown().child();
        let stopped = stop.clone();
        self.spawn(&format!("srv {name}"), move || {
            block_until(smol::future::or(stopped.triggered(), server.answer_to(handler)), None);
            server.graph().linger();
        })?;
        Ok(Service { name, stop })
    }

    /// Creates a client of a service.
    ///
    /// # Errors
    /// [`ShellError`]: the name, the middleware.
    pub fn client<S: Srv>(&self, name: &str) -> Result<Client<S>, ShellError> {
        let name = self.resolve(name)?;
        // Created before the writer of requests, so that servers have discovered it when the first request comes.
        let large = match large_reply::is_for(S::TYPE_NAME) {
            true => Some(ReplyReader::new(self.graph(), &name)?),
            false => None,
        };
        let (dds_type, qos) = (service_type(S::TYPE_NAME)?, SERVICE_QOS.into());
        let of = ServiceSpec { name: &name, dds_type: &dds_type, requests: &qos, answers: &qos };
        let service = self.graph().make(
            S::TYPE_NAME,
            || format!("client of {name}"),
            |session| ClientEndpoints::new(session, &of),
        )?;
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
    /// Returns the absolute name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Waits for a server. Returns false on timeout or shutdown.
    #[must_use]
    pub fn wait_for_service(&self, timeout: Duration) -> bool {
        // Held for the whole call: answers of two calls on one reader would be mixed up.
        let client = self.inner.client.lock().unwrap_or_else(PoisonError::into_inner);
        self.wait_matched(&client.service, timeout, &self.inner.shutdown).is_some()
    }

    /// Checks that at most one node offers the service, for requests that only one node may carry out.
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

    /// Sends a request and waits for the answer, at most `timeout` including the wait for a server.
    ///
    /// # Errors
    /// [`CallError`]: no server, timeout, a server that died, shutdown, the middleware.
    pub fn call(&self, request: S::Request, timeout: Duration) -> Result<S::Response, CallError> {
        self.call_until(request, timeout, &self.inner.shutdown)
    }

    /// Calls as [`Client::call`], and returns [`CallError::Shutdown`] when `stop` is triggered. The server may still carry the
    /// request out; its answer is ignored.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub fn call_until(
        &self,
        request: S::Request,
        timeout: Duration,
        stop: &Shutdown,
    ) -> Result<S::Response, CallError> {
        // Taken before the lock: the wait for other calls of this client counts.
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
            match block_until(either.as_mut(), Some(deadline.min(now + LIVELINESS_POLL))) {
                Some(Some(Ok(response))) => return Ok(response),
                Some(Some(Err(reason))) => return Err(CallError::Middleware { name: name(), reason }),
                Some(None) => return Err(CallError::Shutdown { name: name() }),
                None if Instant::now() >= deadline => {
                    return Err(CallError::Timeout { name: name(), waited: timeout });
                }
                // All servers that were there at the request are gone. A new one under the same name has not got it.
                None if !asked.is_empty() && asked.is_disjoint(&graph.answering(server)) => {
                    return Err(CallError::Left { name: name() });
                }
                None => {}
            }
        }
    }
}
