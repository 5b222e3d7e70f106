//! Action servers.

use super::goal::{Concurrency, Decision, GoalHandle, Outcome, ServerWaker, Update, Updates};
use super::goals::{CancelCode, Goals, Id, ResultAnswer, State};
use super::status::{STATUS_QOS, result_service};
use crate::dds::action_endpoints::{ActionServerEndpoints, ActionSpec, CancelGoalRequest};
use crate::dds::first_contact::FirstContact;
use crate::dds::graph::Graph;
use crate::dds::interface::{Act, action_type};
use crate::dds::large_reply::ReplyWriter;
use crate::dds::peers::{Peer, Requester};
use crate::dds::service_server::SERVICE_QOS;
use crate::error::ShellError;
use crate::process::node::Node;
use crate::process::threads::Threads;
use crate::time::clock::Clock;
use crate::time::shutdown::{Shutdown, Wake};
use ros2_client::RmwRequestId;
use ros2_client::action::{
    CancelGoalResponse, FeedbackMessage, GetResultResponse, GoalId, GoalInfo, GoalStatusEnum, SendGoalResponse,
};
use ros2_client::action_msgs::{CancelGoalResponseEnum, GoalStatus, GoalStatusArray};
use ros2_client::builtin_interfaces::Time as RosTime;
use rustdds::mio1::event::Source;
use rustdds::mio1::{Events, Interest, Poll, Token, Waker};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Time for running goals to end after shutdown, so that their clients still get a result. Shorter than the 3 s in which threads
/// must end.
const LAST_RESULTS: Duration = Duration::from_secs(2);

/// Time after the end of a goal in which a client may still request its result, if none has.
const LATE_REQUESTS: Duration = Duration::from_secs(1);

/// Handle of an action server. Dropping it ends the server and cancels running goals.
#[must_use = "the action ends when its handle is dropped"]
pub struct ActionServer {
    name: String,
    stop: Shutdown,
}

impl ActionServer {
    /// Returns the absolute name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for ActionServer {
    fn drop(&mut self) {
        self.stop.trigger();
    }
}

type Ends<A> = ActionServerEndpoints<
    <A as catenary_msgs::ActionInterface>::Goal,
    <A as catenary_msgs::ActionInterface>::Result,
    <A as catenary_msgs::ActionInterface>::Feedback,
>;

type Handler<A> = dyn Fn(GoalHandle<A>) -> Outcome<<A as catenary_msgs::ActionInterface>::Result> + Send + Sync;

type Decide<A> = dyn FnMut(&<A as catenary_msgs::ActionInterface>::Goal) -> Decision + Send;

impl Node {
    /// Serves an action until the handle is dropped. `decide` accepts or rejects each new goal and must not block. `handler`
    /// runs each accepted goal on its own thread.
    ///
    /// # Errors
    /// [`ShellError`]: the name, the middleware.
    pub fn serve_action<A: Act>(
        &self,
        name: &str,
        concurrency: Concurrency,
        decide: impl FnMut(&A::Goal) -> Decision + Send + 'static,
        handler: impl Fn(GoalHandle<A>) -> Outcome<A::Result> + Send + Sync + 'static,
    ) -> Result<ActionServer, ShellError> {
        let name = self.resolve(name)?;
        let fail = |error: &dyn std::fmt::Display| ShellError::create(format!("action {name}"), error);
        let (dds_type, qos, status) = (action_type(A::TYPE_NAME)?, SERVICE_QOS.into(), STATUS_QOS.into());
        let of = ActionSpec { name: &name, dds_type: &dds_type, qos: &qos, status: &status };
        let mut server: Ends<A> = self.graph().make_action(
            A::TYPE_NAME,
            || format!("action {name}"),
            |session| ActionServerEndpoints::new(session, &of),
        )?;
        let large = ReplyWriter::new(self.graph(), &result_service(&name))?;
        let poll = Poll::new().map_err(|error| fail(&error))?;
        register(&poll, server.goals.source(), Token(0)).map_err(|error| fail(&error))?;
        register(&poll, server.cancels.source(), Token(1)).map_err(|error| fail(&error))?;
        register(&poll, server.results.source(), Token(2)).map_err(|error| fail(&error))?;
        let waker = Waker::new(poll.registry(), Token(3)).map_err(|error| fail(&error))?;
        // Handlers and shutdown wake the poll through the same waker.
        let waker = Arc::new(ServerWaker(waker));
        let stop = self.shutdown().child();
        let wake: Arc<dyn Wake> = Arc::<ServerWaker>::clone(&waker);
        stop.register(Arc::downgrade(&wake));
        let (sender, received) = channel();
        let driver = Driver::<A> {
            server,
            name: name.clone(),
            contacts: Contacts::new(self.graph(), &name, &large),
            large,
            goals: Goals::new(),
            ended: None,
            ids: BTreeMap::new(),
            limit: match concurrency {
                Concurrency::One => 1,
                Concurrency::Many(limit) => limit,
            },
            decide: Box::new(decide),
            handler: Arc::new(handler),
            updates: Updates { sender, waker },
            received,
            clock: self.clock().clone(),
            stop: stop.clone(),
            threads: Arc::clone(self.threads()),
            graph: Arc::clone(self.graph()),
        };
        self.spawn(&format!("act {name}"), move || driver.run(poll))?;
        Ok(ActionServer { name, stop })
    }
}

fn register(poll: &Poll, source: &mut dyn Source, token: Token) -> std::io::Result<()> {
    source.register(poll.registry(), token, Interest::READABLE)
}

/// Known clients of the three services of an action, and of its topic for large results.
struct Contacts {
    send_goal: FirstContact,
    cancel_goal: FirstContact,
    get_result: FirstContact,
    large_result: FirstContact,
}

impl Contacts {
    fn new(graph: &Arc<Graph>, action: &str, large: &ReplyWriter) -> Self {
        let contact = |service: &str| FirstContact::of_service(graph, service);
        Self {
            send_goal: contact(&format!("{action}/_action/send_goal")),
            cancel_goal: contact(&format!("{action}/_action/cancel_goal")),
            get_result: contact(&result_service(action)),
            large_result: large.contact(graph),
        }
    }
}

struct Driver<A: Act> {
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
    server: Ends<A>,
    large: ReplyWriter,
    name: String,
    contacts: Contacts,
    goals: Goals<A::Result, RmwRequestId>,
    /// Time of the last end of a goal.
    ended: Option<Instant>,
    ids: BTreeMap<Id, (GoalId, Shutdown)>,
    limit: usize,
    decide: Box<Decide<A>>,
    handler: Arc<Handler<A>>,
    updates: Updates<A>,
    received: Receiver<Update<A>>,
    clock: Clock,
    stop: Shutdown,
    threads: Arc<Threads>,
    graph: Arc<Graph>,
}

impl<A: Act> Driver<A> {
    fn run(mut self, mut poll: Poll) {
        let mut events = Events::with_capacity(8);
        let mut stopped = None;
        loop {
            // Before the wait: requests may have come before the poll was registered, and edges are signalled once.
            self.handle_pending();
            let now = Instant::now();
            let deadline = self.stop.is_triggered().then(|| self.end(*stopped.get_or_insert(now)));
            if deadline.is_some_and(|end| now >= end) {
                // RustDDS sends the last answers on another thread.
                self.graph.linger();
                return;
            }
            let timeout = deadline.map(|end| end.saturating_duration_since(now));
            match poll.poll(&mut events, timeout) {
                Ok(()) => {}
                // A signal: the deadline is computed again.
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => {
                    tracing::error!("{}: cannot wait for requests: {error}", self.name);
                    return;
                }
            }
        }
    }

    /// Returns the time at which a stopped server ends: running goals get time to end, and clients time to request results.
    fn end(&self, stopped: Instant) -> Instant {
        match self.ended {
            _ if self.goals.running() > 0 => stopped + LAST_RESULTS,
            Some(ended) if self.goals.unanswered() => ended + LATE_REQUESTS,
            _ => stopped,
        }
    }

    /// Handles all pending requests and messages. The readers signal edges, so each is read until it is empty.
    fn handle_pending(&mut self) {
        for (request, goal) in self.take_all(|server| server.goals.try_take()) {
            self.new_goal(request, goal.goal_id, goal.goal);
        }
        for (request, cancel) in self.take_all(|server| server.cancels.try_take()) {
            self.cancel(request, &cancel);
        }
        for (request, asked) in self.take_all(|server| server.results.try_take()) {
            self.result_request(request, asked.goal_id);
        }
        while let Ok(update) = self.received.try_recv() {
            match update {
                Update::Feedback(id, feedback) => self.feedback(&id, feedback),
                Update::Done(id, outcome) => self.done(&id, outcome),
            }
        }
    }

    fn take_all<T>(&self, take: impl Fn(&Ends<A>) -> Result<Option<T>, String>) -> Vec<T> {
        let mut all = Vec::new();
        loop {
            match take(&self.server) {
                Ok(Some(one)) => all.push(one),
                Ok(None) => return all,
                Err(error) => tracing::warn!("{}: unreadable request: {error}", self.name),
            }
        }
    }

    fn report(&self, sent: Result<(), String>) {
        self.graph.touch();
        if let Err(error) = sent {
            tracing::warn!("{}: answer not sent: {error}", self.name);
        }
    }

    fn new_goal(&mut self, request: RmwRequestId, goal_id: GoalId, goal: A::Goal) {
        // First: an answer to a client whose reader is not discovered is lost.
        self.contacts.send_goal.wait(&request);
        let id = *goal_id.uuid.as_bytes();
        let requester = Requester::new(&self.graph, &request);
        let stamp = RosTime::from_nanos(self.clock.now().nanos());
        let decision = if self.stop.is_triggered() {
            Decision::Reject("the node shuts down".to_owned())
        } else if self.goals.contains(&id) {
            Decision::Reject("a goal with this id is known already".to_owned())
        } else if self.goals.running() >= self.limit {
            Decision::Reject(format!("{} running already", self.goals.running()))
        } else {
            (self.decide)(&goal)
        };
        let accepted = match decision {
            Decision::Accept => true,
            Decision::Reject(reason) => {
                let name = self.name.clone();
                let tell = move |peer: &Peer| tracing::warn!("{name}: goal of {peer} rejected: {reason}");
                self.graph.identify(requester.endpoint(), &self.threads, tell);
                false
            }
        };
        self.report(self.server.goals.answer(&self.graph, request, SendGoalResponse { accepted, stamp }, |_| None));
        if accepted {
            self.start(id, goal_id, goal, stamp, requester);
        }
    }

    fn start(&mut self, id: Id, goal_id: GoalId, goal: A::Goal, stamp: RosTime, requester: Requester) {
        let cancelled = self.stop.child();
        self.goals.start(id, stamp.to_nanos());
        self.ids.insert(id, (goal_id, cancelled.clone()));
        // Before the handler starts, so that the status precedes its feedback.
        self.publish_status();
        let handle = GoalHandle { goal: Arc::new(goal), id, requester, cancelled, updates: self.updates.clone() };
        let (handler, updates) = (Arc::clone(&self.handler), self.updates.clone());
        let started = self.threads.spawn(&format!("goal {}", self.name), move || {
            updates.send(Update::Done(id, handler(handle)));
        });
        // Without a thread the goal would stay executing for ever.
        if let Err(error) = started {
            tracing::error!("{}: {error}", self.name);
            self.done(&id, Outcome::Aborted(A::Result::default()));
        }
    }

    fn cancel(&mut self, request: RmwRequestId, cancel: &CancelGoalRequest) {
        let (id, stamp) = (*cancel.goal_info.goal_id.uuid.as_bytes(), cancel.goal_info.stamp.to_nanos());
        self.contacts.cancel_goal.wait(&request);
        let (code, cancelled) = self.goals.cancel(&id, stamp);
        let response = CancelGoalResponse {
            return_code: match code {
                CancelCode::Accepted => CancelGoalResponseEnum::None,
                CancelCode::Rejected => CancelGoalResponseEnum::Rejected,
                CancelCode::UnknownGoal => CancelGoalResponseEnum::UnknownGoal,
                CancelCode::GoalTerminated => CancelGoalResponseEnum::GoalTerminated,
            },
            goals_canceling: cancelled.iter().filter_map(|id| self.info(id)).collect(),
        };
        self.publish_status();
        // Before the handlers are woken: a client must learn of the cancellation before it gets the result.
        self.report(self.server.cancels.answer(&self.graph, request, response, |_| None));
        for id in cancelled {
            if let Some((_, cancelled)) = self.ids.get(&id) {
                cancelled.trigger();
            }
        }
    }

    fn result_request(&mut self, request: RmwRequestId, goal_id: GoalId) {
        self.contacts.get_result.wait(&request);
        match self.goals.ask(goal_id.uuid.as_bytes(), request) {
            ResultAnswer::Wait => {}
            ResultAnswer::Now(state, result) => self.send_result(request, code(state), result),
            ResultAnswer::Unknown => {
                self.send_result(request, GoalStatusEnum::Unknown, A::Result::default());
            }
        }
    }

    fn feedback(&self, id: &Id, feedback: A::Feedback) {
        if let Some((goal_id, _)) = self.ids.get(id)
            && let Err(error) = self.server.feedback.write(FeedbackMessage { goal_id: *goal_id, feedback })
        {
            tracing::warn!("{}: feedback not sent: {error}", self.name);
        }
    }

    fn done(&mut self, id: &Id, outcome: Outcome<A::Result>) {
        let (state, result) = match outcome {
            Outcome::Succeeded(result) => (State::Succeeded, result),
            Outcome::Canceled(result) => (State::Canceled, result),
            Outcome::Aborted(result) => (State::Aborted, result),
        };
        let Some((state, waiting)) = self.goals.finish(id, state, result.clone()) else {
            return;
        };
        self.ended = Some(Instant::now());
        for request in waiting {
            self.send_result(request, code(state), result.clone());
        }
        self.publish_status();
        // The store drops old results; their ids go with them.
        let goals = &self.goals;
        self.ids.retain(|id, _| goals.contains(id));
    }

    fn send_result(&mut self, request: RmwRequestId, status: GoalStatusEnum, result: A::Result) {
        let response = GetResultResponse { status, result };
        if self.large.send(&request, &response, &mut self.contacts.large_result) {
            self.graph.touch();
        } else {
            // The goal keeps its status: it was carried out, and only its result cannot be sent.
            let refusal = |reason| Some(GetResultResponse { status, result: A::refusal(reason)? });
            self.report(self.server.results.answer(&self.graph, request, response, refusal));
        }
    }

    fn info(&self, id: &Id) -> Option<GoalInfo> {
        let (goal_id, _) = self.ids.get(id)?;
        let (_, goal) = self.goals.iter().find(|(known, _)| *known == id)?;
        Some(GoalInfo { goal_id: *goal_id, stamp: RosTime::from_nanos(goal.accepted) })
    }

    fn publish_status(&self) {
        let status = |(id, goal): (&Id, &super::goals::Goal<_, _>)| {
            let goal_info = self.info(id)?;
            Some(GoalStatus { goal_info, status: code(goal.state) })
        };
        let status_list = self.goals.iter().filter_map(status).collect();
        if let Err(error) = self.server.status.write(GoalStatusArray { status_list }) {
            tracing::warn!("{}: status not sent: {error}", self.name);
        }
    }
}

fn code(state: State) -> GoalStatusEnum {
    match state {
        State::Executing => GoalStatusEnum::Executing,
        State::Canceling => GoalStatusEnum::Canceling,
        State::Succeeded => GoalStatusEnum::Succeeded,
        State::Canceled => GoalStatusEnum::Canceled,
        State::Aborted => GoalStatusEnum::Aborted,
    }
}
