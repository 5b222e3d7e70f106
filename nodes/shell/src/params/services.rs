//! The six parameter services of every ROS 2 node.

use super::spec::ParamSpec;
use super::store::{Description, Params};
use super::kinds::Value;
use crate::error::ShellError;
use crate::node::Graph;
use crate::service::{self, SERVICE_QOS};
use futures::StreamExt;
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, ListParametersResult, SetParametersAtomicallyResponse,
    SetParametersRequest, SetParametersResponse,
};
use ros2_client::{Message, Parameter, Server, ServiceMapping, ServiceTypeName};
use std::pin::pin;

/// The servers, before they run.
pub(crate) struct Servers {
    list: Server<ListParametersRequest, ListParametersResponse>,
    get: Server<GetParametersRequest, GetParametersResponse>,
    get_types: Server<GetParameterTypesRequest, GetParameterTypesResponse>,
    describe: Server<DescribeParametersRequest, DescribeParametersResponse>,
    set: Server<SetParametersRequest, SetParametersResponse>,
    set_atomically: Server<SetParametersRequest, SetParametersAtomicallyResponse>,
}

impl Servers {
    pub(crate) fn new(graph: &Graph, node_path: &str) -> Result<Self, ShellError> {
        Ok(Self {
            list: server(graph, node_path, "list_parameters", "ListParameters")?,
            get: server(graph, node_path, "get_parameters", "GetParameters")?,
            get_types: server(graph, node_path, "get_parameter_types", "GetParameterTypes")?,
            describe: server(graph, node_path, "describe_parameters", "DescribeParameters")?,
            set: server(graph, node_path, "set_parameters", "SetParameters")?,
            set_atomically: server(
                graph,
                node_path,
                "set_parameters_atomically",
                "SetParametersAtomically",
            )?,
        })
    }

    /// Answers requests for as long as the executor runs.
    pub(crate) fn spawn(self, executor: &smol::LocalExecutor<'_>, params: &Params) {
        let own = params.clone();
        executor.spawn(answer(self.list, move |request| list(&own, &request))).detach();
        let own = params.clone();
        executor.spawn(answer(self.get, move |request| get(&own, &request))).detach();
        let own = params.clone();
        executor.spawn(answer(self.get_types, move |request| get_types(&own, &request))).detach();
        let own = params.clone();
        executor.spawn(answer(self.describe, move |request| describe(&own, &request))).detach();
        let own = params.clone();
        executor.spawn(answer(self.set, move |request| set(&own, request))).detach();
        let own = params.clone();
        executor
            .spawn(answer(self.set_atomically, move |request| set_atomically(&own, request)))
            .detach();
    }
}

fn server<Req, Resp>(
    graph: &Graph,
    node_path: &str,
    name: &str,
    type_name: &str,
) -> Result<Server<Req, Resp>, ShellError>
where
    Req: Message + Clone + 'static,
    Resp: Message + 'static,
{
    let path = format!("{node_path}/{name}");
    let ros_name = service::ros_name(&path)?;
    graph
        .ros()
        .create_server(
            ServiceMapping::Enhanced,
            &ros_name,
            &ServiceTypeName::new("rcl_interfaces", type_name),
            SERVICE_QOS,
            SERVICE_QOS,
        )
        .map_err(|error| ShellError::create(format!("service {path}"), error))
}

async fn answer<Req, Resp>(server: Server<Req, Resp>, handler: impl Fn(Req) -> Resp)
where
    Req: Message + 'static,
    Resp: Message + 'static,
{
    let mut requests = pin!(server.receive_request_stream());
    while let Some(request) = requests.next().await {
        let sent = match request {
            Ok((id, request)) => server.send_response(id, handler(request)),
            Err(error) => {
                tracing::warn!("parameter service: unreadable request: {error}");
                continue;
            }
        };
        if let Err(error) = sent {
            tracing::warn!("parameter service: answer not sent: {error}");
        }
    }
}

/// Names with fewer than `depth` dots (0: any), or under one of the prefixes to that depth below it.
fn list(params: &Params, request: &ListParametersRequest) -> ListParametersResponse {
    let depth = usize::try_from(request.depth).unwrap_or(usize::MAX);
    let shallow = |rest: &str| depth == 0 || rest.matches('.').count() < depth;
    let wanted = |name: &String| {
        let under = |prefix: &String| {
            name == prefix
                || name.strip_prefix(&format!("{prefix}.")).is_some_and(shallow)
        };
        if request.prefixes.is_empty() { shallow(name) } else { request.prefixes.iter().any(under) }
    };
    let names: Vec<String> = params.names().into_iter().filter(wanted).collect();
    let mut prefixes: Vec<String> =
        names.iter().filter_map(|name| name.rsplit_once('.')).map(|(prefix, _)| prefix.to_owned()).collect();
    prefixes.dedup();
    ListParametersResponse { result: ListParametersResult { names, prefixes } }
}

fn get(params: &Params, request: &GetParametersRequest) -> GetParametersResponse {
    let value = |name: &String| params.get(name).unwrap_or(Value::NotSet).into();
    GetParametersResponse { values: request.names.iter().map(value).collect() }
}

fn get_types(params: &Params, request: &GetParameterTypesRequest) -> GetParameterTypesResponse {
    let code = |name: &String| {
        Value::to_parameter_type_raw(&params.get(name).unwrap_or(Value::NotSet))
    };
    GetParameterTypesResponse { values: request.names.iter().map(code).collect() }
}

fn describe(params: &Params, request: &DescribeParametersRequest) -> DescribeParametersResponse {
    let descriptor = |name: &String| match params.describe(name) {
        Some(description) => known(description),
        None => unknown(name),
    };
    DescribeParametersResponse { values: request.names.iter().map(descriptor).collect() }
}

fn known(description: Description) -> raw::ParameterDescriptor {
    let Description { name, value, spec } = description;
    let constraints = spec.constraints();
    let ParamSpec { description, range, integer_range, read_only, .. } = spec;
    let range = range.filter(|_| matches!(value, Value::Double(_) | Value::DoubleArray(_)));
    let integer_range =
        integer_range.filter(|_| matches!(value, Value::Integer(_) | Value::IntegerArray(_)));
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

fn unknown(name: &str) -> raw::ParameterDescriptor {
    raw::ParameterDescriptor {
        name: name.to_owned(),
        r#type: raw::ParameterType::NOT_SET,
        description: String::new(),
        additional_constraints: String::new(),
        read_only: false,
        dynamic_typing: false,
        floating_point_range: Vec::new(),
        integer_range: Vec::new(),
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

fn set_atomically(
    params: &Params,
    request: SetParametersRequest,
) -> SetParametersAtomicallyResponse {
    let pair = |parameter: raw::Parameter| {
        let Parameter { name, value } = parameter.into();
        (name, value)
    };
    let values: Vec<_> = request.parameter.into_iter().map(pair).collect();
    SetParametersAtomicallyResponse { result: result(params.set_all(&values)) }
}
