//! Compliance of a controller, set through its parameters. The names are those of crisp_controllers' `CartesianController`.

use crate::compliance::Compliance;
use anyhow::Result;
use catenary_msgs::ServiceInterface;
use catenary_shell::{Client, Node, Value};
use ros2_client::Parameter;
use ros2_client::rcl_interfaces::{SetParametersAtomicallyResponse, SetParametersRequest};
use std::time::Duration;

/// Timeout of the controller's answer. Chosen, above the worst case of a busy machine.
const ANSWER: Duration = Duration::from_secs(2);
/// Axes in the names of the controller's parameters.
const AXES: [&str; 6] = ["pos_x", "pos_y", "pos_z", "rot_x", "rot_y", "rot_z"];
/// Service type `rcl_interfaces/srv/SetParametersAtomically`, which sets all parameters or none.
pub enum SetParametersAtomically {}

impl ServiceInterface for SetParametersAtomically {
    type Request = SetParametersRequest;
    type Response = SetParametersAtomicallyResponse;
    const TYPE_NAME: &'static str = "rcl_interfaces/srv/SetParametersAtomically";
    const TYPE_HASH: &'static str = "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd";
}

/// Returns the controller's parameters for these settings.
fn parameters(c: &Compliance) -> Vec<(String, Value)> {
    let gains = AXES.iter().zip(c.stiffness.iter().zip(c.damping)).flat_map(|(axis, (stiffness, damping))| {
        [(format!("task.k_{axis}"), Value::Double(*stiffness)), (format!("task.d_{axis}"), Value::Double(damping))]
    });
    let clips = ["x", "y", "z"].map(|axis| (format!("task.error_clip.{axis}"), Value::Double(c.error_clip_m)));
    // Without `limit_error` the controller reads the clips but does not apply them.
    gains.chain(clips).chain([("limit_error".to_owned(), Value::Boolean(true))]).collect()
}

/// Returns a function that sets the compliance of the controller called `controller`. With an empty name it refuses.
///
/// # Errors
/// [`catenary_shell::ShellError`]: an invalid name, the middleware.
pub fn setter(node: &Node, controller: &str) -> Result<impl FnMut(&Compliance) -> Result<String, String> + use<>> {
    let client: Option<Client<SetParametersAtomically>> = match controller {
        "" => None,
        name => Some(node.client(&format!("{name}/set_parameters_atomically"))?),
    };
    Ok(move |wanted: &Compliance| {
        let Some(client) = &client else {
            return Err("parameter controller.node is empty: no controller's compliance can be set".to_owned());
        };
        let parameter = |(name, value)| Parameter { name, value }.into();
        let request = SetParametersRequest { parameter: parameters(wanted).into_iter().map(parameter).collect() };
        let result = client.call(request, ANSWER).map_err(|e| e.to_string())?.result;
        match result.successful {
            true => Ok(String::new()),
            false => Err(format!("the controller refuses: {}", result.reason)),
        }
    })
}
