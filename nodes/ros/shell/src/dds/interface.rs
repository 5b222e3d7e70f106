//! Traits of the generated message, service and action types, and their names in DDS.

use crate::error::ShellError;
use catenary_msgs::{ActionInterface, Interface, ServiceInterface};
use ros2_client::MessageTypeName;

/// Sendable data.
pub trait Payload: ros2_client::Message + Clone + Send + Sync + 'static {}

impl<T: ros2_client::Message + Clone + Send + Sync + 'static> Payload for T {}

/// Message type.
pub trait Msg: Interface + Payload {}

impl<T: Interface + Payload> Msg for T {}

/// Service type.
pub trait Srv: ServiceInterface<Request: Payload, Response: Payload> + Send + Sync + 'static {}

impl<T> Srv for T where T: ServiceInterface<Request: Payload, Response: Payload> + Send + Sync + 'static {}

/// Action type.
pub trait Act:
    ActionInterface<Goal: Payload, Result: Payload + Default, Feedback: Payload> + Send + Sync + 'static
{
}

impl<T> Act for T where
    T: ActionInterface<Goal: Payload, Result: Payload + Default, Feedback: Payload> + Send + Sync + 'static
{
}

/// Splits `package/kind/Type`.
fn split<'a>(name: &'a str, kind: &'static str) -> Result<(&'a str, &'a str), ShellError> {
    let mut parts = name.split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(package), Some(middle), Some(type_name), None) if middle == kind => Ok((package, type_name)),
        _ => Err(ShellError::TypeName { expected: kind, got: name.to_owned() }),
    }
}

pub(crate) fn message_type(name: &str) -> Result<MessageTypeName, ShellError> {
    split(name, "msg").map(|(package, name)| MessageTypeName::new(package, name))
}

/// Returns the DDS name of a message type.
pub(crate) fn dds_type(name: &str) -> Result<String, ShellError> {
    message_type(name).map(|name| name.dds_msg_type())
}

/// Returns the message type with the DDS name `dds`; `None` if it is not a message of ROS 2.
pub(crate) fn ros_type(dds: &str) -> Option<String> {
    // rosidl's form of the DDS name: `package::msg::dds_::Name_`.
    let (package, name) = dds.strip_suffix('_')?.split_once("::msg::dds_::")?;
    Some(format!("{package}/msg/{name}"))
}

/// Returns the DDS name of a service type, without `_Request_` and `_Response_`.
pub(crate) fn service_type(name: &str) -> Result<String, ShellError> {
    split(name, "srv").map(|(package, name)| format!("{package}::srv::dds_::{name}"))
}

/// Returns the DDS name of the request of a service type.
pub(crate) fn request_type(name: &str) -> Result<String, ShellError> {
    service_type(name).map(|name| format!("{name}_Request_"))
}

/// Returns the DDS name of an action type, without `_SendGoal_Request_` and other suffixes.
pub(crate) fn action_type(name: &str) -> Result<String, ShellError> {
    split(name, "action").map(|(package, name)| format!("{package}::action::dds_::{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_are_split_by_kind() {
        let pose = message_type("geometry_msgs/msg/PoseStamped").unwrap();
        assert_eq!(pose.dds_msg_type(), "geometry_msgs::msg::dds_::PoseStamped_");
        assert!(message_type("std_srvs/srv/SetBool").is_err());
        assert!(service_type("std_srvs/srv/SetBool").is_ok());
        assert_eq!(request_type("std_srvs/srv/SetBool").unwrap(), "std_srvs::srv::dds_::SetBool_Request_");
        assert!(action_type("catenary_msgs/action/Train").is_ok());
        assert!(message_type("PoseStamped").is_err());
        assert_eq!(dds_type("a_b/msg/C").ok().and_then(|dds| ros_type(&dds)).as_deref(), Some("a_b/msg/C"));
        assert_eq!(ros_type("std_srvs::srv::dds_::SetBool_Request_"), None);
    }
}
