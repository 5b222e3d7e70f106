//! Service `get_type_description` of every ROS 2 Jazzy node: descriptions of the node's types, by hash.

use crate::dds::graph::Graph;
use catenary_msgs::type_description_interfaces::srv::{GetTypeDescriptionRequest, GetTypeDescriptionResponse};
use catenary_msgs::{described, structures};

/// Number of hexadecimal digits of a RIHS01 hash (SHA-256).
const DIGITS: usize = 64;

/// Answers a request with the texts of rcl, failures included.
pub(crate) fn answer(graph: &Graph, request: &GetTypeDescriptionRequest) -> GetTypeDescriptionResponse {
    let failed = |reason: &str| GetTypeDescriptionResponse { failure_reason: reason.to_owned(), ..Default::default() };
    if !is_hash(&request.type_hash) {
        return failed("Failed to parse type hash");
    }
    // The hash identifies the type: the type's name is part of the hashed description.
    let found = structures().iter().find(|structure| structure.type_hash == request.type_hash);
    let found = found.filter(|structure| graph.uses_type(structure.type_name));
    let Some((type_description, type_sources)) = found.and_then(|structure| described(structure.type_name)) else {
        return failed("Type not currently in use by this node");
    };
    GetTypeDescriptionResponse {
        successful: true,
        type_description,
        type_sources: if request.include_type_sources { type_sources } else { Vec::new() },
        ..Default::default()
    }
}

fn is_hash(text: &str) -> bool {
    let digits = text.strip_prefix("RIHS01_");
    digits.is_some_and(|digits| digits.len() == DIGITS && digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_has_its_prefix_and_its_length() {
        let digits = "0f".repeat(32);
        assert!(is_hash(&format!("RIHS01_{digits}")));
        for wrong in [digits.clone(), format!("RIHS02_{digits}"), format!("RIHS01_{digits}0"), "RIHS01_xyz".to_owned()]
        {
            assert!(!is_hash(&wrong), "{wrong}");
        }
    }
}
