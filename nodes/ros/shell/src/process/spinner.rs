//! Threads of every node: discovery, parameter services and events, `/clock` and `/rosout`.

use super::logging::Line;
use super::network_loss;
use super::node::Node;
use super::parameter_services;
use crate::dds::endpoint::Writer;
use crate::dds::graph::Graph;
use crate::dds::peers;
use crate::dds::qos::Qos;
use crate::dds::session::Session;
use crate::error::ShellError;
use crate::parameters::kinds::{Value, in_words};
use crate::parameters::store::{Change, Param, Params};
use crate::time::clock::Clock;
use crate::time::shutdown::Shutdown;
use crate::time::stamp;
use crate::time::wait::block_until;
use catenary_msgs::Interface;
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use futures::StreamExt;
use ros2_client::builtin_topics::rosout as topics;
use ros2_client::parameters::raw;
use ros2_client::{Log, builtin_interfaces};
use std::pin::pin;
use std::sync::Arc;

type Rosout = Writer<Log>;

type Events = Writer<raw::ParameterEvent>;

/// Starts the threads with their tasks.
pub(crate) fn start(
    node: &Node,
    use_sim_time: &Param<bool>,
    lines: smol::channel::Receiver<Line>,
    has_rosout: bool,
) -> Result<(), ShellError> {
    let graph = Arc::clone(node.graph());
    let (clock, shutdown) = (node.clock().clone(), node.shutdown().clone());
    clock.set_simulated(use_sim_time.get());
    let (switched, switches) = smol::channel::bounded(1);
    let clock_topic = (node.resolve("/clock")?, node.profile(Qos::CLOCK));
    let rosout = if has_rosout { Some(rosout(&graph)?) } else { None };
    let servers = parameter_services::Servers::new(&graph, node.path())?;
    let nodes = peers::reader(&graph)?;
    report_changes(node, &graph, switched)?;
    let (params, ended) = (node.params().clone(), node.shutdown().clone());
    let graph_of_types = Arc::clone(&graph);
    node.spawn("params", move || servers.run(&params, &graph_of_types, &ended))?;
    let (watched, ended) = (Arc::clone(&graph), node.shutdown().clone());
    node.spawn("network", move || network_loss::watch(&watched, &ended))?;
    node.spawn("ros", move || {
        let executor = smol::LocalExecutor::new();
        executor.spawn(follow_discovery(Arc::clone(&graph))).detach();
        executor.spawn(follow_clock(Arc::clone(&graph), clock, clock_topic, switches)).detach();
        executor.spawn(peers::follow(Arc::clone(&graph), nodes)).detach();
        executor.spawn(publish_lines(Arc::clone(&graph), rosout.clone(), lines.clone())).detach();
        run(&executor, &shutdown);
        drop(executor);
        // The last lines, of the shutdown itself.
        while let Ok(line) = lines.try_recv() {
            publish_line(&graph, rosout.as_deref(), line);
        }
    })
}

async fn follow_discovery(graph: Arc<Graph>) {
    graph.follow_discovery().await;
}

/// Creates the writer of `/rosout`, a name that ROS 2 does not remap.
fn rosout(graph: &Graph) -> Result<Arc<Rosout>, ShellError> {
    let make = |session: &Session| Writer::new(session, topics::TOPIC_NAME, topics::TYPE_NAME, &topics::QOS);
    graph.make("rcl_interfaces/msg/Log", || "publisher on /rosout".to_owned(), make).map(Arc::new)
}

fn run(executor: &smol::LocalExecutor<'_>, shutdown: &Shutdown) {
    block_until(executor.run(shutdown.triggered()), None);
}

/// Publishes `/parameter_events` and switches the clock with `use_sim_time`.
fn report_changes(node: &Node, graph: &Arc<Graph>, switched: smol::channel::Sender<()>) -> Result<(), ShellError> {
    let name = node.resolve("/parameter_events")?;
    let policies = Qos::PARAMETER_EVENTS.policies();
    let events: Events = graph.writer(&name, "rcl_interfaces/msg/ParameterEvent", &policies)?;
    let (clock, path) = (node.clock().clone(), node.path().to_owned());
    // Declared parameters are announced as new at the start, as rclcpp and rclpy do.
    publish_event(&events, &clock, &path, all_as_changes(node.params()), Vec::new());
    node.params().on_change(move |changes| {
        publish_event(&events, &clock, &path, Vec::new(), changes.to_vec());
        for change in changes {
            tracing::info!("parameter {} is now {}", change.name, in_words(&change.value));
            if change.name == "use_sim_time" {
                clock.set_simulated(change.value == Value::Boolean(true));
                let _already_told = switched.try_send(());
            }
        }
    });
    Ok(())
}

fn all_as_changes(params: &Params) -> Vec<Change> {
    let change = |name: String| params.get(&name).map(|value| Change { name, value });
    params.names().into_iter().filter_map(change).collect()
}

fn publish_event(events: &Events, clock: &Clock, path: &str, declared: Vec<Change>, changed: Vec<Change>) {
    let raw = |changes: Vec<Change>| -> Vec<raw::Parameter> {
        let parameter = |change: Change| ros2_client::Parameter { name: change.name, value: change.value };
        changes.into_iter().map(|change| parameter(change).into()).collect()
    };
    let event = raw::ParameterEvent {
        stamp: builtin_interfaces::Time::from_nanos(clock.now().nanos()),
        node: path.to_owned(),
        new_parameters: raw(declared),
        changed_parameters: raw(changed),
        deleted_parameters: Vec::new(),
    };
    if let Err(error) = events.write(event) {
        tracing::warn!("/parameter_events: {error}");
    }
}

/// Subscribes `/clock` while time is simulated.
async fn follow_clock(
    graph: Arc<Graph>,
    clock: Clock,
    (topic, qos): (String, Qos),
    switches: smol::channel::Receiver<()>,
) {
    loop {
        if clock.is_simulated() {
            let reader = graph.reader::<ClockMsg>(&topic, ClockMsg::TYPE_NAME, &qos.policies());
            let reader = match reader {
                Ok(reader) => reader,
                Err(error) => {
                    tracing::error!("/clock: {error}");
                    return;
                }
            };
            // Subscribed only in simulated time: /clock comes at 200 Hz and faster.
            let mut stream = pin!(reader.stream());
            while clock.is_simulated() {
                let message = async { stream.next().await };
                let switch = async {
                    let _closed = switches.recv().await;
                    None
                };
                if let Some(Ok((message, _))) = smol::future::or(message, switch).await {
                    clock.set_simulated_time(stamp::from_msg(&message.clock));
                }
            }
        } else if switches.recv().await.is_err() {
            return;
        }
    }
}

async fn publish_lines(graph: Arc<Graph>, rosout: Option<Arc<Rosout>>, lines: smol::channel::Receiver<Line>) {
    while let Ok(line) = lines.recv().await {
        publish_line(&graph, rosout.as_deref(), line);
    }
}

fn publish_line(graph: &Graph, rosout: Option<&Rosout>, line: Line) {
    let Some(writer) = rosout else { return };
    let log = Log {
        stamp: builtin_interfaces::Time::from_nanos(line.stamp.nanos()),
        level: line.level,
        name: line.logger,
        msg: line.message,
        file: line.file,
        function: String::new(),
        line: line.line,
    };
    graph.touch();
    // A failure cannot be logged: the log line would come back here.
    let _lost = writer.write(log);
}
