"""Our trainer beside PPO of Stable-Baselines3: the same environments, the same number of steps, the same episodes for the score.

Stable-Baselines3 has its defaults with twelve environments, which are those of our preset `sb3`. Both learn over the prior of the model.
The score is the mean return of the mean action on --episodes other episodes. Processor time is that of the trainer with its share of
Python, and that of the environments, each from the operating system.
"""

import argparse
import json
import pathlib
import resource
import subprocess
import tempfile
import time

import gymnasium
import numpy
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

ROOT = pathlib.Path(__file__).resolve().parents[3]
ENVIRONMENTS, LIMIT_M = 12, 0.06


class Environments(VecEnv):
    """Environments in a process of their own."""

    def __init__(self, program, model, count, seed):
        command = [program, model, str(count), str(seed)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        box = gymnasium.spaces.Box(-numpy.inf, numpy.inf, (12,), numpy.float32)
        super().__init__(count, box, gymnasium.spaces.Box(-1, 1, (2,), numpy.float32))

    def ask(self, words):
        self.process.stdin.write(json.dumps(words) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def reset(self):
        return numpy.array(self.ask([]), numpy.float32)

    def step_async(self, actions):
        self.actions = (LIMIT_M * numpy.clip(actions, -1, 1)).tolist()

    def step_wait(self):
        observations, rewards, ends, last = zip(*self.ask(self.actions), strict=True)
        infos = [
            {"terminal_observation": numpy.array(o, numpy.float32), "TimeLimit.truncated": e == 2} for o, e in zip(last, ends, strict=True)
        ]
        return numpy.array(observations, numpy.float32), numpy.array(rewards, numpy.float32), numpy.array(ends) > 0, infos

    def close(self):
        self.process.stdin.close()
        self.process.wait()

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs

    def get_attr(self, attr_name, indices=None):
        return [None] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError

    def env_method(self, method_name, *arguments, indices=None, **keywords):
        raise NotImplementedError


def scored(act, environments, episodes):
    """Returns of the first `episodes` episodes, counted by environment, so that long and short ones count alike."""
    observations = environments.reset()
    running, returns = numpy.zeros(environments.num_envs), [[] for _ in range(environments.num_envs)]
    each = -(-episodes // environments.num_envs)
    while min(map(len, returns)) < each:
        environments.step_async(act(observations))
        observations, rewards, done, _ = environments.step_wait()
        running += rewards
        for i in numpy.flatnonzero(done):
            returns[i].append(running[i])
            running[i] = 0.0
    return float(numpy.mean([r[:each] for r in returns]))


def cpu_s():
    return sum(
        getattr(resource.getrusage(who), name)
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        for name in ("ru_utime", "ru_stime")
    )


def actor(file):
    """Mean action of a policy file, in action limits."""
    bytes_ = file.read_bytes()
    length = int.from_bytes(bytes_[:8], "little")
    header, data = json.loads(bytes_[8 : 8 + length]), bytes_[8 + length :]
    tensors = {
        n: numpy.frombuffer(data[slice(*t["data_offsets"])], "<f4").reshape(t["shape"]) for n, t in header.items() if n != "__metadata__"
    }

    def act(observations):
        x = ((observations - tensors["observation_mean"]) / numpy.maximum(tensors["observation_scale"], 1e-6)).clip(-10, 10)
        layers = sum(name.endswith("weight") for name in tensors)
        for k in range(layers):
            x = x @ tensors[f"actor.{k}.weight"].T + tensors[f"actor.{k}.bias"]
            x = numpy.tanh(x) if k + 1 < layers else x
        return x

    return act


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--environments", required=True)
    parser.add_argument("--model", default=ROOT / "launch_configs/models/soft_bar_place.yaml", type=pathlib.Path)
    parser.add_argument("--steps", type=int, default=122_880)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=120)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rows = {name: [] for name in ("Stable-Baselines3", "catenary, preset sb3", "catenary, preset default")}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, arguments.seeds + 1):
            test = Environments(arguments.environments, arguments.model, ENVIRONMENTS, 1000 + seed)
            train = Environments(arguments.environments, arguments.model, ENVIRONMENTS, seed)
            began, at = cpu_s(), time.monotonic()
            learner = PPO("MlpPolicy", train, seed=seed, device="cpu").learn(arguments.steps)
            train.close()
            spent = (cpu_s() - began, time.monotonic() - at)
            value = scored(lambda o, learner=learner: learner.predict(o, deterministic=True)[0], test, arguments.episodes)
            rows["Stable-Baselines3"].append((value, *spent))
            test.close()
            for preset in ("sb3", "default"):
                file = pathlib.Path(folder) / f"{preset}.safetensors"
                # What Stable-Baselines3 sees and begins with, in the default preset, too.
                command = [
                    arguments.program,
                    "train",
                    "--model",
                    arguments.model,
                    "--preset",
                    preset,
                    "--newest-only",
                    "--no-plan",
                    "--out",
                    file,
                ]
                began, at = cpu_s(), time.monotonic()
                subprocess.run([*map(str, command), "--steps", str(arguments.steps), "--seed", str(seed)], check=True, capture_output=True)
                spent = (cpu_s() - began, time.monotonic() - at)
                test = Environments(arguments.environments, arguments.model, ENVIRONMENTS, 1000 + seed)
                rows[f"catenary, preset {preset}"].append((scored(actor(file), test, arguments.episodes), *spent))
                test.close()
    print("| trainer | mean return of each seed | processor s | wall s |\n|---|---|---|---|")
    for name, row in rows.items():
        values, cpu, wall = (numpy.array(column) for column in zip(*row, strict=True))
        print(f"| {name} | {', '.join(f'{v:.3f}' for v in values)} | {cpu.mean():.0f} | {wall.mean():.0f} |")


if __name__ == "__main__":
    main()
