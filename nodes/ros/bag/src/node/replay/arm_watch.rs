//! Watch for arms in the graph, and for real arms among them.

use crate::error::BagError;
use catenary_msgs::msg::ArmState;
use catenary_shell::{Node, Peer, Received, Subscription, contract, list_peers, stamp};
use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time within which a state of a present arm is heard: discovery takes less than half a second.
const LISTEN: Duration = Duration::from_millis(1500);
/// Additional time for a publisher from which no state has come.
const PATIENCE: Duration = Duration::from_secs(3);
/// Age at which a state of a simulated arm becomes invalid. States come at 50 Hz.
const FRESH: Duration = Duration::from_secs(2);
/// Time between two checks.
const LOOK: Duration = Duration::from_millis(20);

#[derive(Default)]
struct Heard {
    /// Topic on which a real arm's state was heard.
    real: Option<String>,
    /// Time at which each publisher last stated that its arm is simulated.
    simulated: HashMap<[u8; 16], Instant>,
    /// Stamps of the newest replayed states. A received state with such a stamp comes from the bag, and not from an arm.
    replayed: HashSet<i64>,
    /// These stamps in order of their replay.
    in_order: VecDeque<i64>,
}

/// Number of stamps of replayed states that are kept: 20 s at the greatest rate of a replay, and a state comes back in
/// milliseconds.
const REPLAYED: usize = 100_000;

/// Subscription to states of arms, apart from replayed ones.
pub(super) struct ArmWatch {
    heard: Arc<Mutex<Heard>>,
    _subscriptions: Vec<Subscription>,
}

fn lock(heard: &Mutex<Heard>) -> MutexGuard<'_, Heard> {
    heard.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ArmWatch {
    /// Subscribes to the contract's topic and to the `topics` that will be replayed.
    pub(super) fn start(node: &Node, topics: Vec<String>) -> Result<Self, BagError> {
        let heard = Arc::<Mutex<Heard>>::default();
        let mut names = BTreeSet::from([node.resolve(contract::ARM_STATE.name)?]);
        for topic in topics {
            names.insert(node.resolve(&topic)?);
        }
        let mut subscriptions = Vec::new();
        for name in names {
            let (heard, topic) = (Arc::clone(&heard), name.clone());
            let listen = move |state: &ArmState, publisher| {
                let mut heard = lock(&heard);
                let is_replayed = heard.replayed.contains(&stamp::from_msg(&state.header.stamp).nanos());
                match (is_replayed, state.is_sim) {
                    (true, _) => {}
                    (false, true) => _ = heard.simulated.insert(publisher, Instant::now()),
                    (false, false) => heard.real = Some(topic.clone()),
                }
            };
            let qos = contract::ARM_STATE.qos;
            let take = move |got: Received<ArmState>| listen(&got.message, got.publisher);
            subscriptions.push(node.subscription::<ArmState>(&name, qos, take)?);
        }
        Ok(Self { heard, _subscriptions: subscriptions })
    }

    /// Waits until no real arm can be in the graph.
    ///
    /// # Errors
    /// [`BagError::Refused`] if an arm is real, or does not tell whether it is.
    pub(super) fn wait_until_safe(&self, node: &Node) -> Result<(), BagError> {
        let start = Instant::now();
        // Waits until the participants of this machine, and with them their names, are known.
        let _everybody = node.look_around(Duration::ZERO);
        // Nodes of an arm that has not told whether it is real.
        let silent = || -> Result<Vec<Peer>, BagError> {
            if self.has_simulated_arm(node)? {
                return Ok(Vec::new());
            }
            let mut silent = node.publishers(contract::ARM_STATE.name)?;
            silent.extend(node.servers(&contract::ARM)?);
            Ok(silent)
        };
        while start.elapsed() < LISTEN || (!silent()?.is_empty() && start.elapsed() < LISTEN + PATIENCE) {
            self.check()?;
            if node.shutdown().wait_timeout(LOOK) {
                return Ok(());
            }
        }
        self.check()?;
        let silent = silent()?;
        if !silent.is_empty() {
            return Err(BagError::Refused(format!(
                "an arm is in the graph, {}, but no state came on {} that says whether it is real; end it, or replay in \
                 another ROS_DOMAIN_ID",
                list_peers(&silent),
                node.resolve(contract::ARM_STATE.name)?
            )));
        }
        Ok(())
    }

    /// Fails if a real arm was heard.
    pub(super) fn check(&self) -> Result<(), BagError> {
        match &lock(&self.heard).real {
            Some(topic) => Err(BagError::Refused(format!(
                "a real arm is in the graph ({topic} says is_sim: false); end its bridge first, or replay in another \
                 ROS_DOMAIN_ID"
            ))),
            None => Ok(()),
        }
    }

    /// True if a node that serves an arm states that it is simulated. A state from any other node proves nothing about
    /// the arm.
    fn has_simulated_arm(&self, node: &Node) -> Result<bool, BagError> {
        let heard = lock(&self.heard);
        let fresh = heard.simulated.iter().filter(|(_, at)| at.elapsed() < FRESH);
        let fresh: Vec<[u8; 16]> = fresh.map(|(publisher, _)| *publisher).collect();
        drop(heard);
        let servers = node.servers(&contract::ARM)?;
        let is_server = |peer: Peer| servers.iter().any(|server| server.shares_participant(&peer));
        Ok(fresh.into_iter().any(|publisher| is_server(node.peer(publisher))))
    }

    /// Fails unless one simulated arm is the only possible follower of the commands on `topic`, a name before
    /// remapping.
    pub(super) fn check_followers(&self, node: &Node, topic: &str) -> Result<(), BagError> {
        refuse_two_arms(node)?;
        if self.has_simulated_arm(node)? {
            return Ok(());
        }
        Err(BagError::Refused(format!(
            "{} listens on {}, and no state on {} says that it is a simulated arm; end it, or replay in another \
             ROS_DOMAIN_ID",
            list_peers(&node.subscribers(topic)?),
            node.resolve(topic)?,
            node.resolve(contract::ARM_STATE.name)?
        )))
    }

    /// Notes a state that is about to be replayed.
    pub(super) fn expect(&self, state: &ArmState) {
        let stamp_ns = stamp::from_msg(&state.header.stamp).nanos();
        let heard = &mut *lock(&self.heard);
        if heard.replayed.insert(stamp_ns) {
            heard.in_order.push_back(stamp_ns);
        }
        if heard.in_order.len() > REPLAYED
            && let Some(oldest) = heard.in_order.pop_front()
        {
            heard.replayed.remove(&oldest);
        }
    }
}

/// Fails if several nodes serve an arm or publish its pose or state: each would follow commands, and the state of one
/// proves nothing about the others.
pub(super) fn refuse_two_arms(node: &Node) -> Result<(), BagError> {
    let mut arms = node.servers(&contract::ARM)?;
    for teller in node.publishing(&contract::ARM_TOPICS)? {
        if !arms.iter().any(|arm| arm.shares_participant(&teller)) {
            arms.push(teller);
        }
    }
    match arms.len() {
        0 | 1 => Ok(()),
        _ => Err(BagError::Refused(format!(
            "{} all serve an arm, or publish its pose or state, and each would follow the commands of the bag; end all but \
             one, or replay in another ROS_DOMAIN_ID",
            list_peers(&arms)
        ))),
    }
}
