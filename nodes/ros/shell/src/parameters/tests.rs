use super::args::RosArgs;
use super::kinds::Value;
use super::spec::ParamSpec;
use super::store::{ParamError, Params};
use std::sync::{Arc, Mutex};

fn params(args: &[&str]) -> Params {
    let all = std::iter::once("--ros-args").chain(args.iter().copied());
    let (args, _) = RosArgs::parse(all).unwrap();
    Params::new("runner", args.params_for("/", "runner").into_iter().cloned())
}

fn step_spec() -> ParamSpec {
    ParamSpec::new("Time between two actions.").unit("s").range(0.05..=5.0)
}

#[test]
fn the_last_value_given_replaces_the_default() {
    let params = params(&["-p", "step_period_s:=1", "-p", "step_period_s:=0.25"]);
    let step = params.declare("step_period_s", 0.5, step_spec()).unwrap();
    let anchor = params
        .declare("delta_anchor", "measured".to_owned(), ParamSpec::new("").choices(&["measured", "last_target"]))
        .unwrap();
    assert_eq!(step.get(), 0.25);
    assert_eq!(anchor.get(), "measured");
    assert_eq!(params.refuse_unknown().unwrap(), Vec::<String>::new());
}

#[test]
fn every_kind_is_read_from_the_command_line() {
    let params = params(&[
        "-p",
        "a:=true",
        "-p",
        "b:=3",
        "-p",
        "c:=3",
        "-p",
        "d:=x",
        "-p",
        "e:=[1.0, 2.5]",
        "-p",
        "f:=[1, 2]",
        "-p",
        "g:=[x, z]",
        "-p",
        "h:=off",
    ]);
    let spec = || ParamSpec::new("");
    assert!(params.declare("a", false, spec()).unwrap().get());
    assert_eq!(params.declare("b", 0_i64, spec()).unwrap().get(), 3);
    assert_eq!(params.declare("c", 0.0, spec()).unwrap().get(), 3.0);
    assert_eq!(params.declare("d", String::new(), spec()).unwrap().get(), "x");
    assert_eq!(params.declare("e", Vec::<f64>::new(), spec()).unwrap().get(), [1.0, 2.5]);
    assert_eq!(params.declare("f", Vec::<i64>::new(), spec()).unwrap().get(), [1, 2]);
    assert_eq!(params.declare("g", Vec::<String>::new(), spec()).unwrap().get(), ["x", "z"]);
    assert!(!params.declare("h", true, spec()).unwrap().get());
}

#[test]
fn bad_values_at_start_are_named_with_their_origin() {
    for (arg, parts) in [
        ("step_period_s:=fast", vec!["-p step_period_s:=fast", "a number", "the string \"fast\""]),
        ("step_period_s:=9.0", vec!["0.05 to 5 s", "got 9"]),
        ("step_period_s:=true", vec!["a number", "the boolean true"]),
    ] {
        let error = params(&["-p", arg]).declare("step_period_s", 0.5, step_spec()).unwrap_err();
        for part in parts {
            assert!(error.to_string().contains(part), "{error} lacks {part:?}");
        }
    }
}

#[test]
fn values_for_undeclared_parameters_are_refused() {
    let params = params(&["-p", "step_periods:=1.0"]);
    params.declare("step_period_s", 0.5, step_spec()).unwrap();
    let message = params.refuse_unknown().unwrap_err().to_string();
    for part in ["-p step_periods:=1.0", "runner", "step_periods", "it has step_period_s"] {
        assert!(message.contains(part), "{message} lacks {part:?}");
    }
}

#[test]
fn a_bad_default_and_a_second_declaration_are_errors() {
    let params = params(&[]);
    assert!(matches!(params.declare("step_period_s", 9.0, step_spec()), Err(ParamError::BadDefault { .. })));
    params.declare("step_period_s", 0.5, step_spec()).unwrap();
    assert_eq!(
        params.declare("step_period_s", 0.5, step_spec()).unwrap_err(),
        ParamError::DeclaredTwice("step_period_s".to_owned())
    );
}

#[test]
fn sets_from_outside_reach_the_handle_or_are_refused_with_the_reason() {
    let params = params(&[]);
    let step = params.declare("step_period_s", 0.5, step_spec()).unwrap();
    let robot = params.declare("robot", "fr3".to_owned(), ParamSpec::new("").read_only()).unwrap();
    let gain = params
        .declare(
            "gain",
            2_i64,
            ParamSpec::new("").integer_range(0..=8).check(|value| match value {
                Value::Integer(odd) if odd % 2 == 1 => Err(format!("expected an even one, got {odd}")),
                _ => Ok(()),
            }),
        )
        .unwrap();
    params.set("step_period_s", &Value::Double(1.0)).unwrap();
    assert_eq!(step.get(), 1.0);
    params.set("step_period_s", &Value::Integer(2)).unwrap();
    assert_eq!((step.get(), params.get("step_period_s")), (2.0, Some(Value::Double(2.0))));
    for (name, value, part) in [
        ("step_period_s", Value::Double(f64::NAN), "finite"),
        ("step_period_s", Value::Double(6.0), "0.05 to 5 s"),
        ("step_period_s", Value::String("1".into()), "expected a number"),
        ("step_period_s", Value::NotSet, "got nothing"),
        ("robot", Value::String("panda".into()), "read-only"),
        ("gain", Value::Integer(9), "0 to 8"),
        ("gain", Value::Integer(3), "an even one"),
        ("gian", Value::Integer(3), "no parameter gian"),
    ] {
        let reason = params.set(name, &value).unwrap_err();
        assert!(reason.contains(part), "{reason} lacks {part:?}");
    }
    assert_eq!((step.get(), robot.get().as_str(), gain.get()), (2.0, "fr3", 2));
}

#[test]
fn a_set_of_several_is_all_or_nothing_and_reported_once() {
    let params = params(&[]);
    let a = params.declare("a", 1_i64, ParamSpec::new("")).unwrap();
    let b = params.declare("b", 1_i64, ParamSpec::new("").integer_range(0..=5)).unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&seen);
    params.on_change(move |changes| sink.lock().unwrap().push(changes.to_vec()));
    let both = |b| [("a".to_owned(), Value::Integer(2)), ("b".to_owned(), Value::Integer(b))];
    assert!(params.set_all(&both(9)).is_err());
    assert_eq!((a.get(), b.get()), (1, 1));
    params.set_all(&both(3)).unwrap();
    assert_eq!((a.get(), b.get()), (2, 3));
    let seen = seen.lock().unwrap();
    assert_eq!((seen.len(), seen[0].len()), (1, 2));
}

#[test]
fn a_wildcard_entry_of_a_file_may_go_unused() {
    let file = "/**: {ros__parameters: {a: 1}}";
    let (args, _) = RosArgs::parse_with(["--ros-args", "--params-file", "f.yaml"], &|_| Ok(file.to_owned())).unwrap();
    let params = Params::new("runner", args.params_for("/", "runner").into_iter().cloned());
    assert_eq!(params.refuse_unknown().unwrap(), ["f.yaml:1: /**.ros__parameters.a"]);
}

#[test]
fn a_value_that_another_replaces_is_not_checked() {
    let file = "/**: {ros__parameters: {workers: many}}\nrunner: {ros__parameters: {workers: 2}}";
    let (args, _) = RosArgs::parse_with(["--ros-args", "--params-file", "f.yaml"], &|_| Ok(file.to_owned())).unwrap();
    let params = Params::new("runner", args.params_for("/", "runner").into_iter().cloned());
    assert_eq!(params.declare("workers", 1_i64, ParamSpec::new("Workers.")).unwrap().get(), 2);
}

/// A double after an integer takes effect, although ROS 2 would refuse the integer for it. Other types behave as in rclpy.
#[test]
fn of_two_types_the_one_of_ros_2_takes_precedence() {
    let both = params(&["-p", "rate:=1", "-p", "rate:=2.5", "-p", "workers:=2", "-p", "workers:=many"]);
    assert_eq!(both.declare("rate", 0.0, ParamSpec::new("Rate.")).unwrap().get(), 2.5);
    assert_eq!(both.passed_over(), Vec::<String>::new());
    assert_eq!(both.declare("workers", 1_i64, ParamSpec::new("Workers.")).unwrap().get(), 2);
    let [warning] = &both.passed_over()[..] else { panic!("{:?}", both.passed_over()) };
    assert!(warning.contains("the integer 2 counts") && warning.contains("\"many\" of -p workers:=many"), "{warning}");
    let lists = params(&["-p", "theta:=[1, 2]", "-p", "theta:=[0.5]"]);
    assert_eq!(lists.declare("theta", vec![0.0], ParamSpec::new("Values.")).unwrap().get(), [0.5]);
    let last = params(&["-p", "rate:=2.5", "-p", "rate:=1"]);
    assert_eq!(last.declare("rate", 0.0, ParamSpec::new("Rate.")).unwrap().get(), 1.0);
}
