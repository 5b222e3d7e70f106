//! Directory of the nodes of other participants, and endpoints that discovery found.
//!
//! RTPS endpoints carry only identifiers. The names of their nodes come from the topic `ros_discovery_info`, on which every ROS 2
//! participant lists its nodes and their endpoints.

use crate::parameters::names;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Size of the directory at which an update removes the participants that have left the graph. Chosen, above the size of
/// any laboratory.
const REMEMBERED: usize = 256;
/// Bytes that the identifiers of all endpoints of a participant share (GUID prefix).
const PREFIX: usize = 12;

/// Identifier of an endpoint or a participant.
pub(crate) type Gid = [u8; 16];
/// Identifier of a participant, the first bytes of the identifiers of its endpoints.
pub(crate) type Prefix = [u8; PREFIX];

/// `rmw_dds_common/msg/NodeEntitiesInfo`.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct NodeEntities {
    namespace: String,
    name: String,
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ParticipantEntities {
    participant: Gid,
    nodes: Vec<NodeEntities>,
}

/// Listed nodes of each participant.
type Nodes = BTreeMap<Prefix, Vec<NodeEntities>>;

/// Directory of the nodes of other participants.
#[derive(Debug, Default)]
pub(crate) struct Directory {
    nodes: Mutex<Nodes>,
    /// Signal to threads that wait for a list.
    updated: Condvar,
}

pub(crate) fn prefix(gid: &Gid) -> Prefix {
    let mut prefix = [0; PREFIX];
    prefix.copy_from_slice(&gid[..PREFIX]);
    prefix
}

fn path(node: &NodeEntities) -> String {
    names::node_path(&node.namespace, &node.name)
}

impl Directory {
    fn nodes(&self) -> MutexGuard<'_, Nodes> {
        self.nodes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces the list of a participant. `present` returns the participants that are still in the graph.
    pub(super) fn update(&self, told: ParticipantEntities, present: impl Fn() -> BTreeSet<Prefix>) {
        let mut nodes = self.nodes();
        let prefix = prefix(&told.participant);
        // A participant announces an empty list when its node leaves.
        if told.nodes.is_empty() {
            nodes.remove(&prefix);
            return;
        }
        // Killed participants announce nothing, so their entries must be dropped at some time.
        if nodes.len() >= REMEMBERED {
            let present = present();
            nodes.retain(|prefix, _| present.contains(prefix));
        }
        nodes.insert(prefix, told.nodes);
        self.updated.notify_all();
    }

    /// Returns the names of the nodes of a participant; `None` if it has not listed them.
    pub(super) fn names(&self, participant: &Prefix) -> Option<Vec<String>> {
        self.nodes().get(participant).map(|nodes| nodes.iter().map(path).collect())
    }

    /// Returns the name of the node of an endpoint. For an unlisted endpoint, returns the names of all nodes of its participant.
    pub(super) fn name(&self, gid: &Gid) -> Option<String> {
        let nodes = self.nodes();
        let of_participant = nodes.get(&prefix(gid))?;
        let owner = of_participant.iter().find(|n| n.readers.contains(gid) || n.writers.contains(gid));
        // An endpoint that is not listed yet belongs to one of the nodes, so all of them are named.
        match (owner, &of_participant[..]) {
            (Some(node), _) => Some(path(node)),
            (None, []) => None,
            (None, all) => Some(all.iter().map(path).collect::<Vec<_>>().join(" or ")),
        }
    }

    /// Waits up to `patience` until the participant of an endpoint has listed its nodes.
    pub(super) fn wait_listed(&self, gid: &Gid, patience: Duration) {
        let is_unlisted = |nodes: &mut Nodes| !nodes.contains_key(&prefix(gid));
        drop(self.updated.wait_timeout_while(self.nodes(), patience, is_unlisted));
    }
}

/// Endpoint of a participant.
#[derive(Clone)]
pub(crate) struct Endpoint {
    pub(crate) gid: Gid,
    /// DDS name of the topic.
    pub(crate) topic: String,
    pub(crate) addresses: Vec<SocketAddr>,
}

/// Returns the addresses at which an endpoint receives.
pub(crate) fn addresses<L: Copy>(locators: &[L]) -> Vec<SocketAddr>
where
    SocketAddr: From<L>,
{
    locators.iter().map(|locator| SocketAddr::from(*locator)).filter(|a| !a.ip().is_unspecified()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid_of(participant: u8, entity: u8) -> Gid {
        let mut gid = [participant; 16];
        gid[PREFIX..].fill(entity);
        gid
    }

    fn node(namespace: &str, name: &str, readers: &[Gid], writers: &[Gid]) -> NodeEntities {
        let (namespace, name) = (namespace.to_owned(), name.to_owned());
        NodeEntities { namespace, name, readers: readers.to_vec(), writers: writers.to_vec() }
    }

    #[test]
    fn an_endpoint_has_the_name_of_its_node_and_an_unlisted_one_the_names_of_its_participant() {
        let directory = Directory::default();
        let nodes = vec![node("/", "a", &[gid_of(1, 7)], &[]), node("/lab", "b", &[], &[gid_of(1, 9)])];
        directory.update(ParticipantEntities { participant: gid_of(1, 1), nodes }, BTreeSet::new);
        assert_eq!(directory.name(&gid_of(1, 7)).as_deref(), Some("/a"));
        assert_eq!(directory.name(&gid_of(1, 9)).as_deref(), Some("/lab/b"));
        assert_eq!(directory.name(&gid_of(1, 5)).as_deref(), Some("/a or /lab/b"));
        assert_eq!(directory.name(&gid_of(2, 7)), None);
        directory.update(ParticipantEntities { participant: gid_of(1, 1), nodes: Vec::new() }, BTreeSet::new);
        assert_eq!(directory.name(&gid_of(1, 7)), None);
    }

    #[test]
    fn the_name_of_an_endpoint_is_awaited_until_its_participant_lists_it() {
        let (directory, late) = (Directory::default(), gid_of(1, 7));
        let named_within = |patience: Duration| {
            directory.wait_listed(&late, patience);
            directory.name(&late)
        };
        assert_eq!(named_within(Duration::from_millis(1)), None);
        std::thread::scope(|threads| {
            let waiting = threads.spawn(|| named_within(Duration::from_secs(20)));
            // The list of another participant comes first.
            for participant in [2, 1] {
                let nodes = vec![node("/", &format!("of_{participant}"), &[gid_of(participant, 7)], &[])];
                directory.update(ParticipantEntities { participant: gid_of(participant, 1), nodes }, BTreeSet::new);
            }
            assert_eq!(waiting.join().unwrap().as_deref(), Some("/of_1"));
        });
    }

    #[test]
    fn only_participants_that_left_are_forgotten() {
        let directory = Directory::default();
        for number in 0..=REMEMBERED {
            let mut participant = [0; 16];
            participant[..2].copy_from_slice(&u16::try_from(number).unwrap().to_be_bytes());
            let nodes = vec![node("/", "a", &[], &[])];
            let present = || BTreeSet::from([[0; PREFIX]]);
            directory.update(ParticipantEntities { participant, nodes }, present);
        }
        assert_eq!(directory.nodes().len(), 2);
        assert!(directory.nodes().contains_key(&[0; PREFIX]));
    }
}
