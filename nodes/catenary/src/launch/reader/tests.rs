//! Tests of the reader on whole launch files.

use super::read;
use crate::launch::description::{Argument, Grace, LaunchDescription, Restart};
use anyhow::Result;
use std::time::Duration;

fn launch(text: &str, given: &[(&str, &str)]) -> Result<LaunchDescription> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("x.launch.xml");
    std::fs::write(&path, text)?;
    std::fs::write(
        folder.path().join("inner.xml"),
        r#"<launch><arg name="who"/><arg name="n" default="1"/><let name="leak" value="$(var n)"/><executable cmd="echo $(var who)"/></launch>"#,
    )?;
    std::fs::write(folder.path().join("p.yaml"), "/**: {ros__parameters: {x: 1}}")?;
    let given: Vec<(String, String)> = given.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
    read(&path, &given, &|name| (name == "HOME").then(|| "/home/lab".to_owned()))
}

fn refusal(text: &str, given: &[(&str, &str)]) -> String {
    format!("{:#}", launch(text, given).unwrap_err())
}

#[test]
fn arguments_conditions_includes_and_environment_are_applied() {
    let text = r#"<launch>
        <arg name="n" default="2" description="a number"/>
        <arg name="with" default="False"/>
        <let name="twice" value="$(var n)$(var n)"/>
        <executable cmd="run '--a b' $(var twice)" respawn="true" respawn_delay="0.5" respawn_max_retries="3"><env name="K" value="$(var n)"/></executable>
        <executable cmd="never" if="$(var with)"/>
        <include file="$(dirname)/inner.xml"><arg name="who" value="you$(var n)"/></include>
    </launch>"#;
    let d = launch(text, &[("n", "7")]).unwrap();
    let n =
        Argument { name: "n".into(), default: Some("2".into()), description: "a number".into(), choices: Vec::new() };
    assert_eq!(d.arguments[0], n);
    let names: Vec<&str> = d.arguments.iter().map(|a| a.name.as_str()).collect();
    assert_eq!(names, ["n", "with"], "those that the <include> gives are not the user's");
    assert_eq!(d.processes.len(), 2);
    assert_eq!(d.processes[0].command, ["run", "--a b", "77"]);
    assert_eq!(d.processes[0].environment["K"].as_deref(), Some("7"));
    let restart = Restart { respawn: true, delay: Duration::from_millis(500), limit: Some(3) };
    assert_eq!(d.processes[0].restart, restart);
    assert_eq!(d.processes[1].command, ["echo", "you7"]);
}

#[test]
fn an_include_shares_its_variables_and_a_group_keeps_its_own() {
    let text = r#"<launch>
        <let name="n" value="5"/>
        <let name="here" value="$(dirname)"/>
        <include file="$(dirname)/inner.xml"><arg name="who" value="a"/></include>
        <executable cmd="run $(var leak) $(var who)"/>
        <group><let name="n" value="6"/><set_env name="E" value="in"/><executable cmd="run $(var n) $(env E)"/></group>
        <executable cmd="run $(var n) $(env E none)"/>
        <group scoped="false"><set_env name="E" value="out"/></group>
        <append_env name="E" value="more"/><append_env name="HOME" value="/x" prepend="true" separator=";"/>
        <executable cmd="run $(env E) $(env HOME)"><env name="F" value="$(env E)!"/></executable>
        <unset_env name="HOME"/><executable cmd="run $(env HOME gone)"/>
    </launch>"#;
    let d = launch(text, &[]).unwrap();
    let commands: Vec<String> = d.processes.iter().map(|p| p.command.join(" ")).collect();
    let expected = ["echo a", "run 5 a", "run 6 in", "run 5 none", "run out:more /x;/home/lab", "run gone"];
    assert_eq!(commands, expected);
    assert_eq!(d.processes[4].environment["F"].as_deref(), Some("out:more!"));
    assert_eq!(d.processes[5].environment["HOME"], None, "it is removed");
    let names: Vec<&str> = d.processes.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["echo", "run", "run-2", "run-3", "run-4", "run-5"], "each has a log of its own");
}

#[test]
fn a_node_gets_the_arguments_that_ros_2_gives_it() {
    let text = r#"<launch>
        <push_ros_namespace namespace="lab"/>
        <node exec="/bin/tracker" name="eyes" namespace="left" args="--fast 'a b'" ros_args="--log-level debug" exec_name="tracker_left"
              launch-prefix="nice -n 5" cwd="/tmp" output="screen" sigterm_timeout="1.5">
            <param name="width_px" value="640"/><param from="$(dirname)/p.yaml"/>
            <param name="dlo"><param name="hue_deg" value="[190.0, 250.0]"/><param name="word" value="7" type="str"/></param>
            <remap from="image" to="/camera/image"/><env name="K" value="v"/>
        </node>
        <node pkg="catenary" exec="camera"/>
        <group><push-ros-namespace namespace="/other"/><node exec="a"/></group>
    </launch>"#;
    let d = launch(text, &[]).unwrap();
    let [tracker, camera, other] = &d.processes[..] else { panic!("{d:?}") };
    let words: Vec<&str> = tracker.command.iter().map(String::as_str).filter(|w| !w.ends_with("p.yaml")).collect();
    let expected = "nice|-n|5|/bin/tracker|--fast|a b|--ros-args|--log-level|debug|--ros-args|-r|__node:=eyes|-r|\
                    __ns:=/lab/left|--params-file|(parameters)|--params-file|--params-file|(parameters)|-r|image:=/camera/image";
    assert_eq!(words.join("|"), expected);
    let files: Vec<&str> = tracker.parameters.iter().map(|p| p.yaml.as_str()).collect();
    let begin = "\"/lab/left/eyes\":\n  ros__parameters:\n";
    assert_eq!(files[0], format!("{begin}    \"width_px\": 640\n"));
    assert_eq!(files[1], format!("{begin}    \"dlo.hue_deg\": [190.0, 250.0]\n    \"dlo.word\": \"7\"\n"));
    assert!(tracker.parameters.iter().all(|p| tracker.command[p.word] == "(parameters)"));
    assert_eq!((tracker.name.as_str(), tracker.shown.stdout), ("tracker_left", true));
    let grace = Grace { interrupted: Duration::from_millis(1500), ..Grace::default() };
    assert_eq!(tracker.grace, grace);
    assert_eq!(camera.command, ["camera", "--ros-args", "-r", "__ns:=/lab"], "found without an installation");
    assert_eq!(other.command, ["a", "--ros-args", "-r", "__ns:=/other"]);
}

#[test]
fn a_value_stays_one_word_of_the_command_whatever_is_in_it() {
    let text = r#"<launch><arg name="theta"/><executable cmd="cell -p theta:=$(var theta) -p seed:=1"/></launch>"#;
    let d = launch(text, &[("theta", "[9.0, 1000.0]")]).unwrap();
    assert_eq!(d.processes[0].command, ["cell", "-p", "theta:=[9.0, 1000.0]", "-p", "seed:=1"]);
}

#[test]
fn mistakes_name_file_line_and_attribute() {
    let e = refusal("<launch>\n<executable cmd=\"x\" respan=\"true\"/></launch>", &[]);
    assert!(e.contains("x.launch.xml") && e.contains("line 2, <executable>") && e.contains("respan"), "{e}");
    let e = refusal("<launch>\n\n<timer period=\"1\"/></launch>", &[]);
    assert!(e.contains("line 3, <timer>") && e.contains("expected arg, let, group"), "{e}");
    for (inside, named) in [
        (r#"<arg name="a"/>"#, "a:=VALUE"),
        (r#"<arg name="a" default="x"><choice value="b"/><choice value="c"/></arg>"#, "expected b or c, got `x`"),
        (r#"<executable cmd="x" if="maybe"/>"#, "if: expected true or false, got `maybe`"),
        (r#"<executable cmd="x" if="yes"/>"#, "got `yes`"),
        (r#"<executable cmd="x" if="1" unless="0"/>"#, "got both"),
        (r#"<executable cmd="x" respawn_delay="$(env HOME)"/>"#, "respawn_delay: expected seconds"),
        (r#"<executable cmd="x" respawn_max_retries="many"/>"#, "respawn_max_retries"),
        (r#"<executable cmd="x" on_exit="restart"/>"#, "on_exit: expected shutdown"),
        (r#"<executable cmd="x" output="file"/>"#, "output: expected log, screen"),
        (r#"<executable cmd="x"><param name="a" value="1"/></executable>"#, "expected env inside it, got <param>"),
        (r#"<node pkg="no_such" exec="x"/>"#, "no package `no_such`"),
        (r#"<node exec="x" name="a b"/>"#, "name:"),
        (r#"<node exec="x"><param name="a"/></node>"#, "a: expected a value"),
        (r#"<node exec="x"><param name="a" value="[1, b]"/></node>"#, "all of one type"),
        (r#"<node exec="x"><param name="a" value="1.5" type="int"/></node>"#, "expected int, got `1.5`"),
        (r#"<node exec="x"><param from="/no/such.yaml"/></node>"#, "/no/such.yaml"),
        (r#"<include file="/no/such.xml"/>"#, "launch file /no/such.xml"),
        (r#"<include file="$(dirname)/inner.xml"/>"#, "who:=VALUE"),
        (
            r#"<include file="$(dirname)/inner.xml"><let name="who" value="1"/></include>"#,
            "expected arg inside it, got <let>",
        ),
        (r#"<group scoped="perhaps"/>"#, "scoped"),
    ] {
        let e = refusal(&format!("<launch>{inside}</launch>"), &[]);
        assert!(e.contains(named), "{inside}: {e}");
    }
    assert!(refusal("<launch/>", &[("b", "1")]).contains("`b`"));
    let inner = r#"<launch><include file="$(dirname)/inner.xml"><arg name="who" value="a"/></include></launch>"#;
    assert!(
        refusal(inner, &[("who", "b")]).contains("no argument `who`; it takes n"),
        "the <include> would override it"
    );
    assert_eq!(launch(inner, &[("n", "3")]).unwrap().arguments[0].name, "n");
    assert!(refusal("<robot/>", &[]).contains("expected <launch>, got <robot>"));
}
