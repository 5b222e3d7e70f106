"""The soft bar in MuJoCo, as a 3D flex of three kinds and as a rod (a 1D flex).

All settings are documented by MuJoCo: Young's modulus, Poisson's ratio and Rayleigh damping time of flex elements, elliptic friction
cones, and the integrator "discrete", the only one that treats elasticity implicitly. Masses are lumped by share of volume, because a
flexcomp gives each node an equal mass.
"""

import dataclasses
import time

import mujoco
import numpy as np

# Number of MuJoCo's warnings by their first 60 characters, since the last clear. Without a handler MuJoCo writes a log file.
warnings = {}
mujoco.set_mju_user_warning(lambda text: warnings.__setitem__(text[:60], warnings.get(text[:60], 0) + 1))

GRAVITY_M_S2 = 9.81
# Height in m of the grip in the tests at rest, far above the table.
REST_HEIGHT_M = 1.0
# Relaxation to rest: steps of the first length (the second for bars stiffer than STIFF_PA), each begun without velocity, until no
# coordinate moves by STILL_M in a step.
REST_STEPS_S = (0.01, 0.002)
STIFF_PA = 1e6
MAX_REST_STEPS = 4000
STILL_M = 1e-7
# Inertia in kg of the hand along its slides, so large that the bar of 50 g does not move it within a step.
HAND_ARMATURE_KG = 1e3
# Thickness in m that contacts add to the surface of a flex.
SKIN_M = 2.5e-4


@dataclasses.dataclass(frozen=True)
class Setting:
    """Discretisation of the bar and of time."""

    name: str
    # Nodes of a 3D flex ("full", "trilinear" or "quadratic"), or "rod" for a 1D flex.
    kind: str
    # Number of elements along the bar; there is one over height and width.
    cells: int
    step_s: float
    # Solver that MuJoCo's guide advises for the flex: Newton for rods, CG for soft volumes.
    solver: str

    def describe(self):
        what = {
            "full": f"3D flex, 1x1x{self.cells} cubes of linear tetrahedra",
            "trilinear": f"3D flex, trilinear, 1x1x{self.cells} cells",
            "quadratic": f"3D flex, quadratic, 1x1x{self.cells} cells",
            "rod": f"1D flex, {self.cells} edges of fixed length, bending and torsion",
        }[self.kind]
        return f"{what}, {1e3 * self.step_s:g} ms, discrete, {self.solver}"


class Bar:
    """A bar at rest that a hand at `hand_m` (x, z) in m holds at one end, level (`level`) or hanging."""

    def __init__(self, setting, episode, youngs_modulus_pa, level, table, hand_m):
        self.setting, self.episode = setting, episode
        self.hand_m = np.array(hand_m)
        xml = self._xml(youngs_modulus_pa, level, table)
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        along = self.data.flexvert_xpos[:, 0] - hand_m[0] if level else hand_m[1] - self.data.flexvert_xpos[:, 2]
        self._lump_masses(level)
        # Vertices of each section from the first one after the grip to the tip.
        places = np.round(along / episode["length_m"], 6)
        self.sections = [np.flatnonzero(places == p) for p in np.unique(places) if p > 0.0]
        # Slides of the hand along x, y and z, the first joints of the model.
        self.slides = slice(0, 3)
        self._come_to_rest(REST_STEPS_S[youngs_modulus_pa > STIFF_PA])

    def _xml(self, youngs_modulus_pa, level, table):
        e, s = self.episode, self.setting
        length_m, side_m, n = e["length_m"], e["side_m"], s.cells
        mass_kg = e["density_kg_m3"] * length_m * side_m**2
        # Contacts as stiff as the step resolves (MuJoCo asks for at least twice the step), and no stiffer than 4 ms.
        contact = f'friction="{e["table_friction"]} 0.005 0.0001" solref="{max(0.004, 2 * s.step_s)} 1"'
        elasticity = f'young="{youngs_modulus_pa}" poisson="{e["poisson_ratio"]}" damping="{e["kelvin_voigt_time_s"]}"'
        if s.kind == "rod":
            # Half of the clamped edge lies before the grip, so that the first bend stands for the length of the first edge.
            spacing_m = length_m / (n + 0.5)
            points = " ".join(f"{(k - 0.5) * spacing_m} 0 0" for k in range(n + 2))
            edges = " ".join(f"{k} {k + 1}" for k in range(n + 1))
            flex = f"""
              <flexcomp name="bar" type="direct" dim="1" point="{points}" element="{edges}" mass="{mass_kg}"
                        radius="{side_m / 2}" inertiabox="{side_m}">
                <contact selfcollide="none" {contact}/>
                <edge equality="true" solref="{2 * s.step_s} 1" solimp="0.999 0.9999 0.001"/>
                <elasticity {elasticity} section="box" sectionsize="{side_m / 2} {side_m / 2}"/>
                <pin id="0 1"/>
              </flexcomp>"""
        else:
            order = {"full": 1, "trilinear": 1, "quadratic": 2}[s.kind]
            grid = "" if s.kind == "full" else f'dof="{s.kind}" cellcount="{n} 1 1"'
            sections = max(n, 12) if s.kind == "quadratic" else n
            flex = f"""
              <flexcomp name="bar" type="grid" dim="3" {grid} count="{sections + 1} 2 2" pos="{length_m / 2} 0 0"
                        spacing="{length_m / sections} {side_m} {side_m}" mass="{mass_kg}" radius="{SKIN_M}"
                        inertiabox="{side_m}">
                <contact selfcollide="none" {contact}/>
                <elasticity {elasticity}/>
                <pin gridrange="0 0 0 0 {order} {order}"/>
              </flexcomp>"""
        turn = "1 0 0 0" if level else "0.7071067811865476 0 0.7071067811865476 0"
        slides = "".join(
            f'<joint name="hand_{a}" type="slide" axis="{v}" armature="{HAND_ARMATURE_KG}"/>'
            for a, v in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
        )
        floor = f'<geom type="plane" size="3 3 0.1" {contact}/>' if table else ""
        return f"""
          <mujoco>
            <option timestep="{s.step_s}" integrator="discrete" solver="{s.solver}" tolerance="1e-8" cone="elliptic"
                    gravity="0 0 -{GRAVITY_M_S2}"/>
            <worldbody>
              {floor}
              <body name="hand" pos="{self.hand_m[0]} 0 {self.hand_m[1]}">
                <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-6 1e-6 1e-6"/>
                {slides}
                <body name="turn" quat="{turn}">{flex}</body>
              </body>
            </worldbody>
          </mujoco>"""

    def _lump_masses(self, level):
        """Gives every node the mass of its share of the bar's volume.

        Along each axis the share is half of each neighbouring cell, or a sixth or two thirds of a quadratic cell (Simpson's rule).
        """
        m, e, s = self.model, self.episode, self.setting
        mass_kg = e["density_kg_m3"] * e["length_m"] * e["side_m"] ** 2
        order = 2 if s.kind == "quadratic" else 1

        def share(place, cells):
            """Share of the length that a node at `place` (0 to 1) stands for."""
            k = round(place * cells * order)
            ends = 0.5 if k in (0, cells * order) else 1.0
            if order == 1:
                return ends / cells
            return (2.0 / 3.0 if k % 2 else ends / 3.0) / cells

        for body in range(m.nbody):
            name = m.body(body).name
            if not name.startswith("bar_") or "twist" in name:
                continue
            offset = self.data.xpos[body] - [self.hand_m[0], 0.0, self.hand_m[1]]
            along, up = (offset[0], offset[2]) if level else (-offset[2], offset[0])
            if s.kind == "rod":
                at_tip = along > (1.0 - 1e-6) * e["length_m"]
                portion = (0.5 if at_tip else 1.0) / (s.cells + 0.5)
            else:
                portion = share(along / e["length_m"], s.cells)
                portion *= share(up / e["side_m"] + 0.5, 1) * share(offset[1] / e["side_m"] + 0.5, 1)
            m.body_mass[body] = mass_kg * portion
        mujoco.mj_setConst(m, self.data)

    def _come_to_rest(self, step_s):
        m, d = self.model, self.data
        damping_s, still = m.flex_damping.copy(), np.zeros(2)
        m.flex_damping[:], m.opt.timestep, self.still = 0.0, step_s, False
        for _ in range(MAX_REST_STEPS):
            before = d.qpos.copy()
            self._hold(self.hand_m, still, still)
            mujoco.mj_step(m, d)
            d.qvel[:] = 0.0
            self.still = bool(np.abs(d.qpos - before).max() < STILL_M)
            if self.still:
                break
        m.flex_damping[:], m.opt.timestep, d.time = damping_s, self.setting.step_s, 0.0
        self._hold(self.hand_m, still, still)
        mujoco.mj_forward(m, d)

    def _hold(self, place_m, velocity_m_s, next_velocity_m_s):
        """Sets the hand's position and velocity, and applies the force that gives it the next velocity in the coming step.

        The bar's nodes are relative to the hand, so this is how the acceleration acts on the bar.
        """
        d = self.data
        away, v, w = place_m - self.hand_m, velocity_m_s, next_velocity_m_s
        d.qpos[self.slides] = away[0], 0.0, away[1]
        d.qvel[self.slides] = v[0], 0.0, v[1]
        push = HAND_ARMATURE_KG * (w - v) / self.model.opt.timestep
        d.qfrc_applied[self.slides] = push[0], 0.0, push[1]

    def centre_line_m(self):
        """Centres of the sections (x, z) in m, from the grip to the tip."""
        grip = self.hand_m + self.data.qpos[self.slides][[0, 2]]
        middles = [self.data.flexvert_xpos[section].mean(axis=0)[[0, 2]] for section in self.sections]
        return np.array([grip, *middles])

    def keypoints_m(self):
        """Points (x, z) in m at the keypoints' fractions of the deformed length."""
        line = self.centre_line_m()
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        wanted = np.array(self.episode["keypoint_fractions"]) * arc[-1]
        return np.stack([np.interp(wanted, arc, line[:, i]) for i in (0, 1)], axis=1)

    def run(self):
        """Runs the episode; returns the track (frames, 4, 2) in m and its core-seconds."""
        e, m, d, step_s = self.episode, self.model, self.data, self.setting.step_s
        path = np.array(e["grip_m"])
        times_s = np.arange(len(path)) * e["grip_period_s"]
        steps = round(e["frame_times_s"][-1] / step_s)
        at = np.stack([np.interp(np.arange(steps + 1) * step_s, times_s, path[:, i]) for i in (0, 1)], axis=1)
        velocity_m_s = np.vstack([np.zeros(2), np.diff(at, axis=0) / step_s])
        frames = {round(t / step_s) for t in e["frame_times_s"]}
        track = [self.keypoints_m()]
        started_s = time.thread_time()
        for k in range(steps):
            self._hold(at[k], velocity_m_s[k], velocity_m_s[k + 1])
            mujoco.mj_step(m, d)
            if k + 1 in frames:
                mujoco.mj_kinematics(m, d)
                mujoco.mj_flex(m, d)
                track.append(self.keypoints_m())
        return np.array(track), time.thread_time() - started_s


# Steps are the longest that MuJoCo's guide calls typical; README.md has figures for other steps.
SETTINGS = (
    Setting("MuJoCo 4 flex, full", "full", 14, 4e-3, "CG"),
    Setting("MuJoCo 4 flex, trilinear", "trilinear", 14, 4e-3, "CG"),
    Setting("MuJoCo 4 flex, trilinear, fine", "trilinear", 28, 4e-3, "CG"),
    Setting("MuJoCo 4 flex, quadratic", "quadratic", 8, 4e-3, "CG"),
    Setting("MuJoCo 4 rod", "rod", 14, 4e-3, "Newton"),
)


def theory(episode, youngs_modulus_pa):
    """Elongation of the hanging bar, and sag of the level bar by Euler-Bernoulli theory, in m."""
    weight_pa_m = episode["density_kg_m3"] * GRAVITY_M_S2
    length_m, side_m = episode["length_m"], episode["side_m"]
    elongation_m = weight_pa_m * length_m**2 / (2.0 * youngs_modulus_pa)
    sag_m = 12.0 * weight_pa_m * length_m**4 / (8.0 * youngs_modulus_pa * side_m**2)
    return elongation_m, sag_m


def measure(setting, episode):
    """Row of the table for a setting."""

    def at_rest(youngs_modulus_pa, level):
        bar = Bar(setting, episode, youngs_modulus_pa, level, False, (0.4, REST_HEIGHT_M))
        drop_m = REST_HEIGHT_M - bar.centre_line_m()[-1, 1]
        return drop_m if bar.still else float("nan")

    def hanging(youngs_modulus_pa):
        return (at_rest(youngs_modulus_pa, False) - episode["length_m"]) / theory(episode, youngs_modulus_pa)[0]

    cantilever_pa = episode["cantilever_pa"]
    row = {
        "simulator": setting.name,
        "settings": setting.describe(),
        "hanging_ratio_1e3_pa": hanging(1e3),
        "hanging_ratio_5e4_pa": hanging(5e4),
        "cantilever_ratio_1e7_pa": at_rest(cantilever_pa, True) / theory(episode, cantilever_pa)[1],
    }
    bar = Bar(setting, episode, episode["youngs_modulus_pa"], True, True, episode["grip_m"][0])
    track, core_seconds = bar.run()
    apart_m = np.linalg.norm(track - np.array(episode["reference_m"]), axis=2)
    finite = bool(np.isfinite(track).all())
    row["episodes_per_core_second"] = 1.0 / core_seconds
    row["track_rms_mm"] = float(1e3 * np.sqrt(np.mean(apart_m**2))) if finite else float("nan")
    return row
