"""Parameter files and -p give our nodes and nodes of rclpy equal values."""

import pytest
import rclpy

FILES = {
    "any1": "/**: {ros__parameters: {workers: 1}}",
    "any3": "/**:\n  ros__parameters:\n    workers: 3\n",
    "own2": "simulator_pool: {ros__parameters: {workers: 2}}",
    "own4any5": "simulator_pool: {ros__parameters: {workers: 4}}\n/**: {ros__parameters: {workers: 5}}\n",
    "deep6": "/**/simulator_pool: {ros__parameters: {workers: 6}}",
    "lab7": "lab:\n  simulator_pool:\n    ros__parameters: {workers: 7}\n",
    "below8": "/lab/*: {ros__parameters: {workers: 8}}",
    "one9": "/*: {ros__parameters: {workers: 9}}",
    "other10": "/other/simulator_pool: {ros__parameters: {workers: 10}}",
    "twice11": "simulator_pool:\n  ros__parameters:\n    workers: 12\n    workers: 11\n",
    "again14": "simulator_pool: {ros__parameters: {workers: 13}}\n---\nsimulator_pool: {ros__parameters: {workers: 14}}\n",
    "rooted15": "/simulator_pool: {ros__parameters: {workers: 15}}",
}
# Arguments in order: names of FILES, and values for -p.
CASES = [
    *FILES,
    "any1 own2", "own2 any1", "any1 any3", "any3 own2 any1", "any1 deep6 own2", "lab7 any1", "below8 lab7", "one9 own2",
    "own2 workers:=20", "workers:=20 own2", "any1 own2 workers:=20", "any1 workers:=20", "workers:=20 any1",
    "simulator_pool:workers:=21", "any1 own2 simulator_pool:workers:=21", "workers:=20 workers:=22",
    "rooted15 any1 own2", "own2 any1 rooted15", "rooted15 any1 simulator_pool:workers:=21", "twice11 workers:=12",
    "workers:=3 workers:=x", "workers:=x workers:=3", "workers:=0x10", "workers:=010", "workers:=+5",
]  # fmt: skip
ABSENT = 0


def of_rclpy(arguments, namespace, domain):
    """Value that a node of rclpy gets for the parameter `workers`."""
    context = rclpy.Context()
    context.init(args=["x", "--ros-args", *arguments], domain_id=domain)
    try:
        node = rclpy.create_node(
            "simulator_pool", namespace=namespace, context=context, enable_rosout=False, start_parameter_services=False
        )  # fmt: skip
        value = node.declare_parameter("workers", ABSENT).value
        node.destroy_node()
    finally:
        context.try_shutdown()
    return value


def of_ours(program, arguments, namespace):
    """Value that our node would start with, from the list of parameters in its help."""
    text = program.text("node", "simulator_pool", "--help", "--ros-args", *arguments, "-r", f"__ns:={namespace}")
    (value,) = [line.split(" = ")[1] for line in text.splitlines() if line.strip().startswith("workers = ")]
    return int(value)


@pytest.mark.parametrize("namespace", ["/", "/lab"])
@pytest.mark.parametrize("case", CASES)
def test_our_node_and_one_of_rclpy_get_one_value(program, tmp_path, case, namespace):
    arguments = []
    for word in case.split():
        if ":=" in word:
            arguments += ["-p", word]
        else:
            (tmp_path / word).write_text(FILES[word])
            arguments += ["--params-file", str(tmp_path / word)]
    assert of_ours(program, arguments, namespace) == of_rclpy(arguments, namespace, program.domain)


@pytest.mark.parametrize("key", ["/cam*", "/lab//pool", "/2pool", "/lab/", "*"])
def test_a_name_that_no_node_can_have_is_refused(program, tmp_path, key):
    path = tmp_path / "f.yaml"
    path.write_text(f"{key}:\n  ros__parameters: {{workers: 1}}\n")
    done = program("node", "simulator_pool", "--ros-args", "--params-file", path, seconds=20)
    assert done.returncode == 2 and str(path) in done.stderr, done.stderr
    with pytest.raises(Exception, match="parse params file"):
        of_rclpy(["--params-file", str(path)], "/", program.domain)
