//! Services of every ROS 2 node: six for its parameters, and one for the types that it uses.

use super::type_description;
use crate::dds::graph::Graph;
use crate::dds::service_server::ServiceServer;
use crate::error::ShellError;
use crate::parameters::kinds::Value;
use crate::parameters::spec::ParamSpec;
use crate::parameters::store::{Description, Params};
use crate::time::shutdown::Shutdown;
use crate::time::wait::block_until;
use catenary_msgs::ServiceInterface;
use catenary_msgs::type_description_interfaces::srv::{
    GetTypeDescription, GetTypeDescriptionRequest, GetTypeDescriptionResponse,
};
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest, GetParameterTypesResponse,
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, ListParametersResult,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
};
use ros2_client::{Message, Parameter};
use std::sync::Arc;

/// Servers of a node.
pub(crate) struct Servers {
    list: ServiceServer<ListParametersRequest, ListParametersResponse>,
    get: ServiceServer<GetParametersRequest, GetParametersResponse>,
    get_types: ServiceServer<GetParameterTypesRequest, GetParameterTypesResponse>,
    describe: ServiceServer<DescribeParametersRequest, DescribeParametersResponse>,
    set: ServiceServer<SetParametersRequest, SetParametersResponse>,
    set_atomically: ServiceServer<SetParametersRequest, SetParametersAtomicallyResponse>,
    describe_type: ServiceServer<GetTypeDescriptionRequest, GetTypeDescriptionResponse>,
}

impl Servers {
    pub(crate) fn new(graph: &Arc<Graph>, node_path: &str) -> Result<Self, ShellError> {
        Ok(Self {
            list: endpoint(graph, node_path, "list_parameters", "ListParameters")?,
            get: endpoint(graph, node_path, "get_parameters", "GetParameters")?,
            get_types: endpoint(graph, node_path, "get_parameter_types", "GetParameterTypes")?,
            describe: endpoint(graph, node_path, "describe_parameters", "DescribeParameters")?,
            set: endpoint(graph, node_path, "set_parameters", "SetParameters")?,
            set_atomically: endpoint(graph, node_path, "set_parameters_atomically", "SetParametersAtomically")?,
            describe_type: ServiceServer::new(
                graph,
                format!("{node_path}/get_type_description"),
                GetTypeDescription::TYPE_NAME,
            )?
            .refusing(GetTypeDescription::refusal),
        })
    }

    /// Answers requests until shutdown.
    pub(crate) fn run(&self, params: &Params, graph: &Graph, shutdown: &Shutdown) {
        let answers = async {
            futures::join!(
                self.list.answer(|request| list(params, &request)),
                self.get.answer(|request| get(params, &request)),
                self.get_types.answer(|request| get_types(params, &request)),
                self.describe.answer(|request| describe(params, &request)),
                self.set.answer(|request| set(params, request)),
                self.set_atomically.answer(|request| set_atomically(params, request)),
                self.describe_type.answer(|request| type_description::answer(graph, &request)),
            );
        };
        block_until(smol::future::or(shutdown.triggered(), answers), None);
    }
}

fn endpoint<Req, Resp>(
    graph: &Arc<Graph>,
    node_path: &str,
    name: &str,
    type_name: &str,
) -> Result<ServiceServer<Req, Resp>, ShellError>
where
    Req: Message + Clone + 'static,
    Resp: Message + 'static,
{
    ServiceServer::new(graph, format!("{node_path}/{name}"), &format!("rcl_interfaces/srv/{type_name}"))
}

/// Lists parameter names with fewer than `depth` dots (0: any number). With prefixes, dots are counted below the prefix.
fn list(params: &Params, request: &ListParametersRequest) -> ListParametersResponse {
    let depth = usize::try_from(request.depth).unwrap_or(usize::MAX);
    let shallow = |rest: &str| depth == 0 || rest.matches('.').count() < depth;
    let wanted = |name: &String| {
        let under = |prefix: &String| name == prefix || name.strip_prefix(&format!("{prefix}.")).is_some_and(shallow);
        if request.prefixes.is_empty() { shallow(name) } else { request.prefixes.iter().any(under) }
    };
    let names: Vec<String> = params.names().into_iter().filter(wanted).collect();
    let mut prefixes: Vec<String> =
        names.iter().filter_map(|name| name.rsplit_once('.')).map(|(prefix, _)| prefix.to_owned()).collect();
    prefixes.dedup();
    ListParametersResponse { result: ListParametersResult { names, prefixes } }
}

/// Returns one value per name, or no values at all if a name is unknown. rclcpp and rclpy answer the same way, and their tools
/// take an empty answer for "not set".
fn each<T>(names: &[String], value: impl Fn(&String) -> Option<T>) -> Vec<T> {
    names.iter().map(value).collect::<Option<_>>().unwrap_or_default()
}

fn get(params: &Params, request: &GetParametersRequest) -> GetParametersResponse {
    GetParametersResponse { values: each(&request.names, |name| params.get(name).map(Into::into)) }
}

fn get_types(params: &Params, request: &GetParameterTypesRequest) -> GetParameterTypesResponse {
    let code = |name: &String| params.get(name).map(|value| Value::to_parameter_type_raw(&value));
    GetParameterTypesResponse { values: each(&request.names, code) }
}

fn describe(params: &Params, request: &DescribeParametersRequest) -> DescribeParametersResponse {
    DescribeParametersResponse { values: each(&request.names, |name| params.describe(name).map(known)) }
}

fn known(description: Description) -> raw::ParameterDescriptor {
    let Description { name, value, spec } = description;
    let constraints = spec.constraints();
    let ParamSpec { description, range, integer_range, read_only, .. } = spec;
    // A range of the wrong kind makes `ros2 param describe` print a limit that does not apply.
    let range = range.filter(|_| matches!(value, Value::Double(_) | Value::DoubleArray(_)));
    let integer_range = integer_range.filter(|_| matches!(value, Value::Integer(_) | Value::IntegerArray(_)));
    raw::ParameterDescriptor {
        name,
        r#type: Value::to_parameter_type_raw(&value),
        description,
        additional_constraints: constraints,
        read_only,
        dynamic_typing: false,
        floating_point_range: range
            .map(|(from_value, to_value)| raw::FloatingPointRange { from_value, to_value, step: 0.0 })
            .into_iter()
            .collect(),
        integer_range: integer_range
            .map(|(from_value, to_value)| raw::IntegerRange { from_value, to_value, step: 0 })
            .into_iter()
            .collect(),
    }
}

fn result(outcome: Result<(), String>) -> raw::SetParametersResult {
    if let Err(reason) = &outcome {
        tracing::warn!("refused to set a parameter: {reason}");
    }
    outcome.into()
}

fn set(params: &Params, request: SetParametersRequest) -> SetParametersResponse {
    let one = |parameter: raw::Parameter| {
        let Parameter { name, value } = parameter.into();
        result(params.set(&name, &value))
    };
    SetParametersResponse { results: request.parameter.into_iter().map(one).collect() }
}

fn set_atomically(params: &Params, request: SetParametersRequest) -> SetParametersAtomicallyResponse {
    let pair = |parameter: raw::Parameter| {
        let Parameter { name, value } = parameter.into();
        (name, value)
    };
    let values: Vec<_> = request.parameter.into_iter().map(pair).collect();
    SetParametersAtomicallyResponse { result: result(params.set_all(&values)) }
}
