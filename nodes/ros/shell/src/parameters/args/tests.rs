use super::*;

const FILE: &str = "
/**:
  ros__parameters:
    use_sim_time: true
policy_runner:
  ros__parameters:
    step_period_s: 0.5
    gate: {low: 1, high: [1.0, 2.0]}
lab:
  left:
    ros__parameters: {a: 1}
/other/*:
  ros__parameters: {b: text}
";

fn parse(args: &[&str]) -> Result<(RosArgs, Vec<String>), ArgError> {
    RosArgs::parse_with(args.iter().copied(), &|path| {
        if path == Path::new("p.yaml") { Ok(FILE.to_owned()) } else { Err(std::io::Error::other("no such file")) }
    })
}

fn of_file(text: &str) -> Result<Vec<ParamOverride>, ArgError> {
    let mut overrides = Overrides::default();
    file::read(Path::new("f.yaml"), text, &mut overrides)?;
    Ok(overrides.finish())
}

fn error(args: &[&str]) -> String {
    parse(args).unwrap_err().to_string()
}

#[test]
fn arguments_outside_the_ros_section_are_left_over() {
    let (args, rest) = parse(&["run", "--ros-args", "-r", "a:=b", "--", "--fast", "--ros-args", "-p", "x:=1"]).unwrap();
    assert_eq!(rest, ["run", "--fast"]);
    assert_eq!(args.remaps.len(), 1);
    assert_eq!(args.params[0].value, Yaml::Integer(1));
}

#[test]
fn node_and_namespace_are_remapped() {
    let (args, _) = parse(&["--ros-args", "-r", "__ns:=/lab", "--remap", "camera:__node:=eye"]).unwrap();
    assert_eq!(args.node_identity("camera", "/").unwrap(), ("eye".into(), "/lab".into()));
    assert_eq!(args.node_identity("bag", "/").unwrap(), ("bag".into(), "/lab".into()));
    let (args, _) = parse(&["--ros-args", "-r", "__name:=eye", "-r", "__ns:=lab"]).unwrap();
    assert_eq!(args.node_identity("camera", "/").unwrap(), ("eye".into(), "/lab".into()));
}

#[test]
fn topics_are_remapped_by_their_expanded_names() {
    let (args, _) = parse(&[
        "--ros-args",
        "-r",
        "image:=/camera/color",
        "-r",
        "camera:mask:=~/mask",
        "-r",
        "/panda/enable:=arm/enable",
    ])
    .unwrap();
    let resolve = |name, node| args.resolve(name, "/lab", node).unwrap();
    assert_eq!(resolve("image", "camera"), "/camera/color");
    assert_eq!(resolve("/lab/image", "camera"), "/camera/color");
    assert_eq!(resolve("/image", "camera"), "/image");
    assert_eq!(resolve("mask", "camera"), "/lab/camera/mask");
    assert_eq!(resolve("mask", "other"), "/lab/mask");
    assert_eq!(resolve("/panda/enable", "other"), "/lab/arm/enable");
}

#[test]
fn parameter_files_reach_the_nodes_they_name() {
    let (args, _) = parse(&["--ros-args", "--params-file", "p.yaml"]).unwrap();
    let names = |namespace: &str, node: &str| -> Vec<String> {
        args.params_for(namespace, node).iter().map(|param| param.name.clone()).collect()
    };
    assert_eq!(names("/", "policy_runner"), ["use_sim_time", "step_period_s", "gate.low", "gate.high"]);
    assert_eq!(names("/lab", "policy_runner"), ["use_sim_time"]);
    assert_eq!(names("/lab", "left"), ["use_sim_time", "a"]);
    assert_eq!(names("/other", "any"), ["use_sim_time", "b"]);
    let step = args.params.iter().find(|param| param.name == "step_period_s").unwrap();
    assert_eq!(step.value, Yaml::Float(0.5));
    assert_eq!(step.origin, "p.yaml:7: policy_runner.ros__parameters.step_period_s");
}

#[test]
fn values_for_a_node_of_the_same_name_are_named() {
    let missed = |text: &str, namespace: &str, node: &str| {
        let read = |_: &std::path::Path| Ok(text.to_owned());
        let (args, _) = RosArgs::parse_with(["--ros-args", "--params-file", "f.yaml", "-p", "rate:=1"], &read).unwrap();
        args.missed_values(namespace, node, &[node, "camera"])
    };
    let of = |section: &str| format!("{section}: {{ros__parameters: {{a: 1, b: 2}}}}\n");
    // Sections that a node in /left does not read, although they have its name.
    for section in ["camera", "/camera", "/right/camera", "/left/left/camera"] {
        let [told] = &missed(&of(section), "/left", "camera")[..] else { panic!("one warning for {section}") };
        assert!(
            told.starts_with(&format!("f.yaml:1: {section}.ros__parameters.a: the values there are for `{section}`"))
        );
        assert!(told.ends_with("this node is /left/camera: write `/left/camera` or `/**/camera`"), "{told}");
    }
    assert_eq!(missed(&of("camera"), "/", "late_camera").len(), 1, "the section of the name before the remapping");
    let both = of("/right/camera") + &of("/left/camera");
    for text in [&of("/left/camera"), &of("/*/camera"), &of("/**/camera"), &of("tracker"), &of("/**"), &both, ""] {
        assert_eq!(missed(text, "/left", "camera"), [] as [String; 0], "{text}");
    }
}

#[test]
fn parameters_can_be_for_one_node() {
    let (args, _) = parse(&["--ros-args", "-p", "camera:gain:=2", "-p", "rate:=fast"]).unwrap();
    let names = |namespace: &str, node: &str| -> Vec<String> {
        args.params_for(namespace, node).iter().map(|param| param.name.clone()).collect()
    };
    assert_eq!(names("/", "camera"), ["gain", "rate"]);
    assert_eq!(names("/lab", "camera"), ["rate"], "the name of a node has no wildcard in it");
    assert_eq!(names("/", "bag"), ["rate"]);
    assert!(error(&["--ros-args", "-p", "lab/camera:gain:=2"]).contains("without a namespace"));
}

#[test]
fn log_levels_and_switches_are_read() {
    let (args, _) = parse(&[
        "--ros-args",
        "--log-level",
        "WARN",
        "--log-level",
        "camera:=debug",
        "--disable-rosout-logs",
        "--enable-stdout-logs",
        "--disable-external-lib-logs",
        "-e",
        "/enclave",
    ])
    .unwrap();
    assert_eq!(args.log_level, Some(Level::Warn));
    assert_eq!(args.logger_levels, [("camera".to_owned(), Level::Debug)]);
    assert!(!args.rosout_logs && args.console_logs);
    assert_eq!(args.without_effect.len(), 2);
}

#[test]
fn errors_name_the_option_the_value_and_what_was_expected() {
    for (args, parts) in [
        (vec!["-r"], vec!["-r", "FROM:=TO"]),
        (vec!["-r", "a=b"], vec!["-r", "\"a=b\"", "FROM:=TO"]),
        (vec!["-r", "a:=b c"], vec!["b c"]),
        (vec!["-r", "__foo:=b"], vec!["__foo", "__ns"]),
        (vec!["-p", "a:=[1"], vec!["-p", "a:=[1", "YAML"]),
        (vec!["-p", "a:="], vec!["nothing"]),
        (vec!["-p", "a"], vec!["NAME:=VALUE"]),
        (vec!["--log-level", "loud"], vec!["--log-level", "loud", "debug"]),
        (vec!["--params-file", "missing.yaml"], vec!["missing.yaml", "no such file"]),
        (vec!["--fast"], vec!["--fast"]),
    ] {
        let mut all = vec!["--ros-args"];
        all.extend(&args);
        let message = error(&all);
        for part in parts {
            assert!(message.contains(part), "{args:?}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn broken_parameter_files_are_named_with_the_field() {
    for (text, parts) in [
        ("camera: [1]", vec!["f.yaml:1", "camera", "ros__parameters", "a list"]),
        ("camera:\n  ros__parameters: 3\n", vec!["camera.ros__parameters", "the integer 3"]),
        ("camera:\n  ros__parameters: {a: {b: }}\n", vec!["camera.ros__parameters.a.b", "nothing"]),
        ("- 1", vec!["f.yaml:1: ", "top level", "a list"]),
        ("no map", vec!["f.yaml:1: ", "top level", "the string \"no map\""]),
        (
            "a:\n  ros__parameters:\n    b: [1, x]\n",
            vec!["f.yaml:3: a.ros__parameters.b: ", "one type", "\"x\" after the integer 1"],
        ),
        ("a: {ros__parameters: {b: {}}}", vec!["a.ros__parameters.b", "an empty map"]),
        ("a: {ros__parameters: {b: *c}}", vec!["a.ros__parameters.b", "an alias"]),
        ("a: {ros__parameters: {b: [[1], 2]}}", vec!["a.ros__parameters", "a list"]),
        ("a: {ros__parameters: {b: [{c: 1}]}}", vec!["a.ros__parameters.b", "a map in it"]),
        ("a: {ros__parameters: {b: 1}, ros__parameters: {c: 2}}", vec!["one ros__parameters in each"]),
        ("a: {ros__parameters: {b: 1}, c: {ros__parameters: {d: 2}}}", vec!["no namespace behind it"]),
        ("a: {ros__parameters: }", vec!["a map of parameters", "nothing"]),
        ("---\n", vec!["f.yaml:2: top level: expected a key, got nothing"]),
        ("camera: {", vec!["f.yaml", "not YAML"]),
    ] {
        let message = of_file(text).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part), "{text:?}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn an_invalid_new_node_name_is_refused() {
    let (args, _) = parse(&["--ros-args", "-r", "__node:=1camera"]).unwrap();
    let message = args.node_identity("camera", "/").unwrap_err().to_string();
    assert!(message.contains("1camera"), "{message}");
}

/// The table holds rclpy's values of the parameter `x` of `/camera` for the same arguments.
#[test]
fn of_several_values_the_one_of_ros_2_takes_precedence() {
    let read = |path: &Path| match path.to_str() {
        Some("any1") => Ok("/**: {ros__parameters: {x: 1}}".to_owned()),
        Some("own2") => Ok("camera: {ros__parameters: {x: 2}}".to_owned()),
        Some("any3") => Ok("/**: {ros__parameters: {x: 3}}".to_owned()),
        Some("own4any5") => Ok("camera: {ros__parameters: {x: 4}}\n/**: {ros__parameters: {x: 5}}".to_owned()),
        _ => Err(std::io::Error::other("no such file")),
    };
    for (arguments, expected) in [
        ("any1 own2", 2),
        ("own2 any1", 1),
        ("any1 any3", 3),
        ("own4any5", 5),
        ("own2 x:=9", 9),
        ("x:=9 own2", 2),
        ("any1 own2 x:=9", 2),
        ("any1 x:=9", 9),
        ("x:=9 any1", 1),
        ("any1 own2 camera:x:=8", 8),
    ] {
        let mut all = vec!["--ros-args"];
        for word in arguments.split(' ') {
            all.extend([if word.contains(":=") { "-p" } else { "--params-file" }, word]);
        }
        let (args, _) = RosArgs::parse_with(all, &read).unwrap();
        let last = args.params_for("/", "camera").last().map(|param| param.value.clone());
        assert_eq!(last, Some(Yaml::Integer(expected)), "{arguments}");
    }
}

/// The table holds patterns that rclpy accepts, and whether they apply to `/lab/camera` and `/camera`.
#[test]
fn names_in_parameter_files_are_those_of_ros_2() {
    for (key, in_lab, in_root) in [
        ("/lab/camera", true, false),
        ("lab/camera", true, false),
        ("/*/camera", true, false),
        ("/**/camera", true, true),
        ("/lab/*", true, false),
        ("/lab/**", true, false),
        ("/*", false, true),
        ("/**", true, true),
        ("/*/*", true, false),
        ("lab: {camera", true, false),
        ("camera", false, true),
    ] {
        let close = if key.contains('{') { "}" } else { "" };
        let text = format!("{key}: {{ros__parameters: {{x: 1}}}}{close}");
        let args = RosArgs { params: of_file(&text).unwrap(), ..RosArgs::default() };
        let reaches = |namespace| !args.params_for(namespace, "camera").is_empty();
        assert_eq!((reaches("/lab"), reaches("/")), (in_lab, in_root), "{key}");
    }
    for key in ["/cam*", "/lab//camera", "/2camera", "/lab/"] {
        let error = of_file(&format!("{key}: {{ros__parameters: {{x: 1}}}}")).unwrap_err();
        assert!(error.to_string().contains("* stands for one name"), "{key}: {error}");
    }
}
