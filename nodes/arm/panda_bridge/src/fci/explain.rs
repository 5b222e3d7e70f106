//! Errors of the client library, in words that say what to do.

use franka::FrankaError;

/// Texts of a connection that the robot's side closed: which of them comes depends on what was under way.
const CLOSED: [&str; 4] = ["server closed connection", "got interrupted", "Connection reset", "Broken pipe"];

/// Returns one line: what happened, and what to do.
#[must_use]
pub fn explain(error: &FrankaError) -> String {
    let text = error.to_string().replace('\n', " ");
    let plain = text.strip_prefix("libfranka: ").unwrap_or(&text);
    match error {
        FrankaError::IncompatibleVersion { server_version, library_version } => format!(
            "the robot speaks FCI version {server_version}, and version {library_version} was asked for: expected 5 for fci.generation panda, 10 for fr3; a Panda with version 3 or 4 needs system 4.2.1"
        ),
        FrankaError::Network(_) if plain.contains("refused") => {
            "the robot refuses the connection: activate FCI in Desk, and check fci.host".to_owned()
        }
        FrankaError::Network(_) if plain.contains("UDP receive: Timeout") => {
            "no state came for 1 s: check the cable, and that no firewall drops UDP".to_owned()
        }
        FrankaError::Network(_) if plain.to_lowercase().contains("timeout") => {
            "no answer at fci.host: check the address, the cable and that the robot has started".to_owned()
        }
        FrankaError::Network(_) if CLOSED.iter().any(|text| plain.contains(text)) => {
            "the robot closed the connection: another client may be connected, or FCI was deactivated in Desk"
                .to_owned()
        }
        FrankaError::Network(_) if ["route", "unreachable", "lookup"].iter().any(|text| plain.contains(text)) => {
            format!("fci.host cannot be reached ({plain}): check the address and the network settings")
        }
        FrankaError::Protocol(_) => {
            format!("unexpected data ({plain}), of the robot or of another program: check fci.generation")
        }
        FrankaError::Command(_) if plain.contains("current mode (") => {
            format!("{plain}: open the brakes in Desk, release the user stop, or recover from the reflex")
        }
        _ => plain.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_failure_says_what_to_do() {
        let network = |text: &str| explain(&FrankaError::Network(format!("libfranka: {text}")));
        let refused = network("Connection to FCI refused. Please install FCI feature or enable FCI mode in Desk.");
        assert!(refused.contains("activate FCI in Desk"), "{refused}");
        assert!(network("UDP receive: Timeout").contains("no state came"));
        assert!(network("Connection timeout. Please check your network.").contains("check the address"));
        assert!(network("server closed connection").contains("another client"));
        let version = explain(&FrankaError::IncompatibleVersion { server_version: 4, library_version: 5 });
        assert!(version.contains("version 4") && version.contains("4.2.1"), "{version}");
    }
}
