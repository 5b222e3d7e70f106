//! The six parameter services of every ROS 2 node.

use super::kinds::Value;
use super::spec::ParamSpec;
use super::store::{Description, Params};
use crate::error::ShellError;
use crate::graph::Graph;
use crate::service::Endpoint;
use crate::shutdown::Shutdown;
use crate::wait::block_until;
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest, GetParameterTypesResponse,
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, ListParametersResult,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
};
use ros2_client::{Message, Parameter, ServiceTypeName};
use std::sync::Arc;

/// The servers, before they run.
pub(crate) struct Servers {
    list: Endpoint<ListParametersRequest, ListParametersResponse>,
    get: Endpoint<GetParametersRequest, GetParametersResponse>,
    get_types: Endpoint<GetParameterTypesRequest, GetParameterTypesResponse>,
    describe: Endpoint<DescribeParametersRequest, DescribeParametersResponse>,
    set: Endpoint<SetParametersRequest, SetParametersResponse>,
    set_atomically: Endpoint<SetParametersRequest, SetParametersAtomicallyResponse>,
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
        })
    }

    /// Answers requests until shutdown.
    pub(crate) fn run(&self, params: &Params, shutdown: &Shutdown) {
        let answers = async {
            futures::join!(
                self.list.answer(|request| list(params, &request)),
                self.get.answer(|request| get(params, &request)),
                self.get_types.answer(|request| get_types(params, &request)),
                self.describe.answer(|request| describe(params, &request)),
                self.set.answer(|request| set(params, request)),
                self.set_atomically.answer(|request| set_atomically(params, request)),
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
) -> Result<Endpoint<Req, Resp>, ShellError>
where
    Req: Message + Clone + 'static,
    Resp: Message + 'static,
{
    Endpoint::new(graph, format!("{node_path}/{name}"), &ServiceTypeName::new("rcl_interfaces", type_name))
}

/// Names with fewer than `depth` dots (0: any), or under one of the prefixes to that depth below it.
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

fn get(params: &Params, request: &GetParametersRequest) -> GetParametersResponse {
    let value = |name: &String| params.get(name).unwrap_or(Value::NotSet).into();
    GetParametersResponse { values: request.names.iter().map(value).collect() }
}

fn get_types(params: &Params, request: &GetParameterTypesRequest) -> GetParameterTypesResponse {
    let code = |name: &String| Value::to_parameter_type_raw(&params.get(name).unwrap_or(Value::NotSet));
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

fn set_atomically(params: &Params, request: SetParametersRequest) -> SetParametersAtomicallyResponse {
    let pair = |parameter: raw::Parameter| {
        let Parameter { name, value } = parameter.into();
        (name, value)
    };
    let values: Vec<_> = request.parameter.into_iter().map(pair).collect();
    SetParametersAtomicallyResponse { result: result(params.set_all(&values)) }
}
