//! Action servers.

use super::STATUS_QOS;
use super::goal::{Bell, Concurrency, Decision, GoalHandle, Mail, Mailbox, Outcome};
use super::goals::{CancelCode, Goals, Id, ResultAnswer, State};
use crate::clock::Clock;
use crate::error::ShellError;
use crate::first_contact::FirstContact;
use crate::graph::Graph;
use crate::interface::{Act, action_type};
use crate::large_reply::ReplyWriter;
use crate::middleware::{Acted, ActionServerEnds, CancelGoalRequest};
use crate::node::Node;
use crate::peers::Requester;
use crate::service::SERVICE_QOS;
use crate::shutdown::{Shutdown, Wake};
use crate::threads::Threads;
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

/// How long running goals may take to end after shutdown, so that their clients still get a result.
const LAST_RESULTS: Duration = Duration::from_secs(2);

/// How long after the end of a goal a client may still ask for its result, where none has.
const LATE_REQUESTS: Duration = Duration::from_secs(1);

/// Ends its action when it is dropped; running goals are cancelled.
#[must_use = "the action ends when its handle is dropped"]
pub struct ActionServer {
    name: String,
    stop: Shutdown,
}

impl ActionServer {
    /// The absolute name.
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

type Ends<A> = ActionServerEnds<
    <A as catenary_msgs::ActionInterface>::Goal,
    <A as catenary_msgs::ActionInterface>::Result,
    <A as catenary_msgs::ActionInterface>::Feedback,
>;

type Handler<A> = dyn Fn(GoalHandle<A>) -> Outcome<<A as catenary_msgs::ActionInterface>::Result> + Send + Sync;

type Decide<A> = dyn FnMut(&<A as catenary_msgs::ActionInterface>::Goal) -> Decision + Send;

impl Node {
    /// Serves an action until the handle is dropped. `decide` accepts or rejects each new goal and must return at
    /// once; `handler` runs each accepted goal on a thread of its own.
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
        let of = Acted { name: &name, dds_type: &dds_type, qos: &qos, status: &status };
        let mut server: Ends<A> = self.graph().make_action(
            A::TYPE_NAME,
            || format!("action {name}"),
            |session| ActionServerEnds::new(session, &of),
        )?;
        let large = ReplyWriter::new(self.graph(), &result_service(&name))?;
        let poll = Poll::new().map_err(|error| fail(&error))?;
        register(&poll, server.goals.source(), Token(0)).map_err(|error| fail(&error))?;
        register(&poll, server.cancels.source(), Token(1)).map_err(|error| fail(&error))?;
        register(&poll, server.results.source(), Token(2)).map_err(|error| fail(&error))?;
        let bell = Waker::new(poll.registry(), Token(3)).map_err(|error| fail(&error))?;
        let bell = Arc::new(Bell(bell));
        let stop = self.shutdown().child();
        let wake: Arc<dyn Wake> = Arc::<Bell>::clone(&bell);
        stop.register(Arc::downgrade(&wake));
        let (sender, mail) = channel();
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
            mailbox: Mailbox { sender, bell },
            mail,
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

/// The service by which an action tells its results.
pub(super) fn result_service(action: &str) -> String {
    format!("{action}/_action/get_result")
}

/// The clients of the three services of an action, and of its topic for large results.
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
    // Before the graph, so that readers and writers go first.
    server: Ends<A>,
    large: ReplyWriter,
    name: String,
    contacts: Contacts,
    goals: Goals<A::Result, RmwRequestId>,
    /// When a goal ended last.
    ended: Option<Instant>,
    ids: BTreeMap<Id, (GoalId, Shutdown)>,
    limit: usize,
    decide: Box<Decide<A>>,
    handler: Arc<Handler<A>>,
    mailbox: Mailbox<A>,
    mail: Receiver<Mail<A>>,
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
            self.turn();
            let now = Instant::now();
            let deadline = self.stop.is_triggered().then(|| self.end(*stopped.get_or_insert(now)));
            if deadline.is_some_and(|end| now >= end) {
                self.graph.linger();
                return;
            }
            let timeout = deadline.map(|end| end.saturating_duration_since(now));
            match poll.poll(&mut events, timeout) {
                Ok(()) => {}
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => {
                    tracing::error!("{}: cannot wait for requests: {error}", self.name);
                    return;
                }
            }
        }
    }

    /// When to end after a stop: goals get time to end, and clients to ask for their results.
    fn end(&self, stopped: Instant) -> Instant {
        match self.ended {
            _ if self.goals.running() > 0 => stopped + LAST_RESULTS,
            Some(ended) if self.goals.unanswered() => ended + LATE_REQUESTS,
            _ => stopped,
        }
    }

    /// Handles everything that has come. The readers signal edges, so each is read until it is empty.
    fn turn(&mut self) {
        for (request, goal) in self.all(|server| server.goals.try_take()) {
            self.new_goal(request, goal.goal_id, goal.goal);
        }
        for (request, cancel) in self.all(|server| server.cancels.try_take()) {
            self.cancel(request, &cancel);
        }
        for (request, asked) in self.all(|server| server.results.try_take()) {
            self.result_request(request, asked.goal_id);
        }
        while let Ok(mail) = self.mail.try_recv() {
            match mail {
                Mail::Feedback(id, feedback) => self.feedback(&id, feedback),
                Mail::Done(id, outcome) => self.done(&id, outcome),
            }
        }
    }

    fn all<T>(&self, take: impl Fn(&Ends<A>) -> Result<Option<T>, String>) -> Vec<T> {
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
                tracing::warn!("{}: goal of {requester} rejected: {reason}", self.name);
                false
            }
        };
        self.report(self.server.goals.answer(&self.graph, request, SendGoalResponse { accepted, stamp }));
        if accepted {
            self.start(id, goal_id, goal, stamp, requester);
        }
    }

    fn start(&mut self, id: Id, goal_id: GoalId, goal: A::Goal, stamp: RosTime, requester: Requester) {
        let cancelled = self.stop.child();
        self.goals.start(id, stamp.to_nanos());
        self.ids.insert(id, (goal_id, cancelled.clone()));
        self.publish_status();
        let handle = GoalHandle { goal: Arc::new(goal), id, requester, cancelled, mailbox: self.mailbox.clone() };
        let (handler, mailbox) = (Arc::clone(&self.handler), self.mailbox.clone());
        let started = self.threads.spawn(&format!("goal {}", self.name), move || {
            mailbox.send(Mail::Done(id, handler(handle)));
        });
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
        self.report(self.server.cancels.answer(&self.graph, request, response));
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
        let goals = &self.goals;
        self.ids.retain(|id, _| goals.contains(id));
    }

    fn send_result(&mut self, request: RmwRequestId, status: GoalStatusEnum, result: A::Result) {
        let response = GetResultResponse { status, result };
        if self.large.send(&request, &response, &mut self.contacts.large_result) {
            self.graph.touch();
        } else {
            self.report(self.server.results.answer(&self.graph, request, response));
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
