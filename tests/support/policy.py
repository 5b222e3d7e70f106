"""A constant policy, which needs no training."""

import json
import struct

STEPS = 16
# Action of every step as a share of the largest one: right and down, slowly enough to stay in the workspace for 16 steps.
BIAS = (0.1, -0.05)


def policy_file(action=BIAS, arm=None, start_speed=None):
    """Bytes of a safetensors file whose policy always chooses one action: 12 inputs with weight 0, two biases.

    `arm`: text of the arm's law that it was trained for; None: the file says none. `start_speed`: greatest speed in m/s of the object at
    the starts of its training; None: it was at rest.
    """
    tensors = {
        "actor.0.weight": ([2, 12], [0.0] * 24),
        "actor.0.bias": ([2], action),
        "observation_mean": ([12], [0.0] * 12),
        "observation_scale": ([12], [1.0] * 12),
        "action_scale": ([2], [0.1, 0.1]),
    }
    names = {"format": "catenary policy 1", "name": "constant", "delta_anchor": "last_target"}
    names |= {"step_period_s": "0.5", "steps": str(STEPS)} | ({"arm": arm} if arm else {})
    names |= {"start_speed_m_s": str(start_speed)} if start_speed else {}
    header, data = {"__metadata__": names}, b""
    for name, (shape, values) in tensors.items():
        packed = struct.pack(f"<{len(values)}f", *values)
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [len(data), len(data) + len(packed)]}
        data += packed
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + data
