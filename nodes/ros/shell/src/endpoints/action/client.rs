//! Action clients.

use super::status::{STATUS_QOS, Status, result_service};
use crate::dds::action_endpoints::{ActionClientEndpoints, ActionSpec, CancelGoalRequest};
use crate::dds::graph::Graph;
use crate::dds::interface::{Act, action_type};
use crate::dds::large_reply::ReplyReader;
use crate::dds::matches::Matches;
use crate::dds::peers::list_peers;
use crate::dds::servers::Server;
use crate::dds::service_server::SERVICE_QOS;
use crate::error::{CallError, ShellError};
use crate::process::node::Node;
use crate::process::threads::Threads;
use crate::time::shutdown::Shutdown;
use crate::time::wait::block_until;
use futures::StreamExt;
use ros2_client::RmwRequestId;
use ros2_client::action::{GetResultRequest, GoalId, GoalInfo, GoalStatusEnum, SendGoalRequest};
use ros2_client::builtin_interfaces::Time as RosTime;
use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

type Ends<A> = ActionClientEndpoints<
    <A as catenary_msgs::ActionInterface>::Goal,
    <A as catenary_msgs::ActionInterface>::Result,
    <A as catenary_msgs::ActionInterface>::Feedback,
>;

struct Inner<A: Act> {
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
    client: Ends<A>,
    large: ReplyReader,
    name: String,
    server: Server,
    busy: AtomicBool,
    shutdown: Shutdown,
    threads: Arc<Threads>,
    graph: Arc<Graph>,
}

/// Sends goals to an action server, one at a time. Clones share it.
pub struct ActionClient<A: Act> {
    inner: Arc<Inner<A>>,
}

impl<A: Act> Clone for ActionClient<A> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner) }
    }
}

impl Node {
    /// Creates a client of an action.
    ///
    /// # Errors
    /// [`ShellError`]: the name, the middleware.
    pub fn action_client<A: Act>(&self, name: &str) -> Result<ActionClient<A>, ShellError> {
        let name = self.resolve(name)?;
        let (dds_type, qos, status) = (action_type(A::TYPE_NAME)?, SERVICE_QOS.into(), STATUS_QOS.into());
        let of = ActionSpec { name: &name, dds_type: &dds_type, qos: &qos, status: &status };
        let client = self.graph().make_action(
            A::TYPE_NAME,
            || format!("client of {name}"),
            |session| ActionClientEndpoints::new(session, &of),
        )?;
        // Results are service replies, so a large one takes the topic for large replies.
        let large = ReplyReader::new(self.graph(), &result_service(&name))?;
        let inner = Inner {
            client,
            large,
            server: Server::new(&format!("{name}/_action/send_goal")),
            name,
            busy: AtomicBool::new(false),
            shutdown: self.shutdown().clone(),
            threads: Arc::clone(self.threads()),
            graph: Arc::clone(self.graph()),
        };
        Ok(ActionClient { inner: Arc::new(inner) })
    }
}

impl<A: Act> Inner<A> {
    /// Waits for an answer of the middleware, until the timeout or shutdown.
    fn answer<T, E: std::fmt::Display>(
        &self,
        answer: impl Future<Output = Result<T, E>>,
        timeout: Duration,
    ) -> Result<T, CallError> {
        let name = || self.name.clone();
        let end = async {
            self.shutdown.triggered().await;
            None
        };
        let either = smol::future::or(async { Some(answer.await) }, end);
        match block_until(either, Some(Instant::now() + timeout)) {
            Some(Some(Ok(answer))) => Ok(answer),
            Some(Some(Err(error))) => Err(CallError::Middleware { name: name(), reason: error.to_string() }),
            Some(None) => Err(CallError::Shutdown { name: name() }),
            None => Err(CallError::Timeout { name: name(), waited: timeout }),
        }
    }

    fn request_result(&self, goal_id: GoalId) -> Result<RmwRequestId, CallError> {
        let failed = |reason| CallError::Middleware { name: self.name.clone(), reason };
        self.client.results.ask_now(GetResultRequest { goal_id }).map_err(failed)
    }

    fn wait_for_server(&self, timeout: Duration) -> bool {
        let matched = |matches: &Matches| self.client.is_matched(matches);
        let server = self.graph.wait_server(&self.server, &self.shutdown, timeout, &matched);
        server.is_some()
    }
}

impl<A: Act> ActionClient<A> {
    /// Returns the absolute name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Waits for a server. Returns false on timeout or shutdown.
    #[must_use]
    pub fn wait_for_server(&self, timeout: Duration) -> bool {
        self.inner.wait_for_server(timeout)
    }

    /// Sends a goal and waits until it is accepted, at most `timeout` including the wait for a server. Calls `on_feedback` on its
    /// own thread until the returned goal is dropped.
    ///
    /// # Errors
    /// [`CallError`]: no server, rejected, no answer in time, another goal of this client not yet dropped.
    pub fn send(
        &self,
        goal: A::Goal,
        timeout: Duration,
        on_feedback: impl FnMut(A::Feedback) + Send + 'static,
    ) -> Result<RunningGoal<A>, CallError> {
        let inner = &self.inner;
        let name = || inner.name.clone();
        // All goals of a client share one reader of feedback. Two followers of its stream would take each other's messages.
        if inner.busy.swap(true, Ordering::AcqRel) {
            let reason = "another goal of this client is not yet dropped".to_owned();
            return Err(CallError::Middleware { name: name(), reason });
        }
        let release = Release(Arc::clone(inner));
        let deadline = Instant::now() + timeout;
        if !inner.wait_for_server(timeout) {
            return Err(if inner.shutdown.is_triggered() {
                CallError::Shutdown { name: name() }
            } else {
                CallError::NoServer { name: name(), waited: timeout }
            });
        }
        let servers = inner.graph.servers(std::slice::from_ref(&inner.name));
        // Each of them would carry the goal out.
        if servers.len() > 1 {
            return Err(CallError::Ambiguous { name: name(), servers: list_peers(&servers) });
        }
        // The wait for the server has used up a part of the timeout.
        let left = deadline.saturating_duration_since(Instant::now());
        let goal_id = GoalId::new_random();
        let response = inner.answer(inner.client.goals.call(SendGoalRequest { goal_id, goal }), left)?;
        if !response.accepted {
            let server = inner.graph.servers(std::slice::from_ref(&inner.name));
            return Err(CallError::Rejected { name: name(), server: list_peers(&server) });
        }
        // Servers may drop a result soon after the end of its goal, so it is requested at once.
        let request = inner.request_result(goal_id)?;
        let stop = inner.shutdown.child();
        let (reader, stopped) = (Arc::clone(inner), stop.clone());
        inner
            .threads
            .spawn(&format!("feedback {}", inner.name), move || {
                follow(&reader, goal_id, &stopped, on_feedback);
            })
            .map_err(|error| CallError::Middleware { name: name(), reason: error.to_string() })?;
        Ok(RunningGoal { release, goal_id, request, stop })
    }
}

fn follow<A: Act>(inner: &Inner<A>, goal_id: GoalId, stop: &Shutdown, mut on_feedback: impl FnMut(A::Feedback)) {
    let mut stream = pin!(inner.client.feedback.stream());
    loop {
        let stopped = async {
            stop.triggered().await;
            None
        };
        match block_until(smol::future::or(stopped, stream.next()), None).flatten() {
            Some(Ok((message, _))) if message.goal_id == goal_id => on_feedback(message.feedback),
            // Feedback of another client's goal.
            Some(Ok(_)) => {}
            Some(Err(error)) => tracing::warn!("{}: unreadable feedback: {error}", inner.name),
            None => return,
        }
    }
}

/// Guard that frees the client for its next goal when it is dropped.
struct Release<A: Act>(Arc<Inner<A>>);

impl<A: Act> Drop for Release<A> {
    fn drop(&mut self) {
        self.0.busy.store(false, Ordering::Release);
    }
}

/// Accepted goal. Dropping it stops the feedback; the goal itself continues.
pub struct RunningGoal<A: Act> {
    release: Release<A>,
    goal_id: GoalId,
    request: RmwRequestId,
    stop: Shutdown,
}

impl<A: Act> Drop for RunningGoal<A> {
    fn drop(&mut self) {
        self.stop.trigger();
    }
}

impl<A: Act> RunningGoal<A> {
    /// Waits for the result. It may be called again after a [`CallError::Timeout`].
    ///
    /// # Errors
    /// [`CallError`]: timeout, shutdown, [`CallError::Forgotten`].
    pub fn wait(&self, timeout: Duration) -> Result<(Status, A::Result), CallError> {
        let inner = &self.release.0;
        let failed = |reason: String| CallError::Middleware { name: inner.name.clone(), reason };
        let small = inner.client.results.answer(self.request);
        let response = inner.answer(smol::future::or(small, inner.large.receive(self.request)), timeout)?;
        let status = match response.status {
            GoalStatusEnum::Succeeded => Status::Succeeded,
            GoalStatusEnum::Canceled => Status::Canceled,
            GoalStatusEnum::Aborted => Status::Aborted,
            GoalStatusEnum::Unknown => return Err(CallError::Forgotten { name: inner.name.clone() }),
            other => return Err(failed(format!("expected an end of the goal, got {other:?}"))),
        };
        Ok((status, response.result))
    }

    /// Requests the result again. The server that took the goal answers every request; a server that replaced it does not know
    /// the goal, and the next [`RunningGoal::wait`] returns [`CallError::Forgotten`].
    ///
    /// # Errors
    /// [`CallError`]: the middleware.
    pub fn ask_again(&mut self) -> Result<(), CallError> {
        self.request = self.release.0.request_result(self.goal_id)?;
        Ok(())
    }

    /// Requests the cancellation. Returns true if the server cancels the goal, and its result follows; false if it refuses or
    /// the goal is over.
    ///
    /// # Errors
    /// [`CallError`]: timeout, shutdown.
    pub fn cancel(&self, timeout: Duration) -> Result<bool, CallError> {
        let inner = &self.release.0;
        let goal_info = GoalInfo { goal_id: self.goal_id, stamp: RosTime::ZERO };
        let cancel = inner.client.cancels.call(CancelGoalRequest { goal_info });
        Ok(!inner.answer(cancel, timeout)?.goals_canceling.is_empty())
    }
}
