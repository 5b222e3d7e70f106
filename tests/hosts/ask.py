"""Sends one inference goal from the host that it runs on and prints what came of it: the posterior to the bit, and the time.

Arguments: DOMAIN BAG MODEL ITERATIONS SIMULATIONS SEED.
"""

import json
import pathlib
import sys
import time

import rclpy
from catenary_msgs.action import Infer
from rclpy.action import ActionClient


def bits(values):
    return [float(value).hex() for value in values]


def main(domain, bag, model, iterations, simulations, seed):
    rclpy.init(domain_id=int(domain))
    node = rclpy.create_node("asker")
    client = ActionClient(node, Infer, "/bayes_sim/infer")
    assert client.wait_for_server(30), "no /bayes_sim/infer within 30 s"
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[bag], model_yaml=pathlib.Path(model).read_text())
    goal.iterations, goal.simulations, goal.seed = int(iterations), int(simulations), int(seed)
    asked = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, asked, timeout_sec=30)
    begun = time.monotonic()
    print("accepted", file=sys.stderr, flush=True)
    done = asked.result().get_result_async()
    rclpy.spin_until_future_complete(node, done, timeout_sec=300)
    result, posterior = done.result().result, done.result().result.posterior
    answer = {
        "success": result.success,
        "message": result.message,
        "simulations": result.simulations,
        "seconds": time.monotonic() - begun,
        "losses": bits(result.losses),
        "posterior": [bits(posterior.weights), bits(posterior.means), bits(posterior.covariances)],
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main(*sys.argv[1:])
