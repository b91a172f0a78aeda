"""Trials against the same episode in MuJoCo, a naive SAPIEN loop, and a reference of fine steps.

    python tests/benchmarks/trials.py [candidates an object and type]

Candidates of all shipped objects, from data/trials' sampler. Ours: pre-check, then the episode, the default one and
episode=fast. Reference: the default one at dt 1/2000. Naive: what one writes first: a scene, the URDF and the object's
parts anew for each candidate, no pre-check. MuJoCo: hand, object, drives, closing, loads and tests of the outcome are
the same, behind our pre-check, and the model of an object is compiled once; what differs is MuJoCo's own: soft
contacts, elliptic friction cones, the Newton solver, implicitfast integration, PD drives as actuators, at our dt. All
take turns, an object a round, in one process, and seconds are the processor's; agreement is about success or not, over
candidates that the pre-check lets through, unless it says all, with its 95 % interval (Wilson). episode=fast was chosen
on other candidates.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from scipy.stats import binomtest
from shared.clouds import objects
from shared.harness import Report
from torch import Tensor

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.preshape import Drive
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.candidates import sample_candidates
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.episode import CHECK_STEPS, DIRECTIONS, Simulator
from spgf_torch.simulation.execute import execute
from spgf_torch.simulation.precheck import PreCheck
from spgf_torch.simulation.worker import Trials

Requests = list[tuple[GraspObject, str, Tensor]]

CANDIDATES = 12
NAIVE = 1  # candidate of each object and type for the naive loop


def episode(name: str) -> EpisodeConfig:
    """As `episode=NAME` sets it."""
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        composed = compose("simulate", [f"episode={name}"])
    return typed(EpisodeConfig, OmegaConf.to_container(composed.episode))


EPISODE, FAST = settings(EpisodeConfig), episode("fast")
FINE = settings(EpisodeConfig, dt=1 / 2000)

# MuJoCo's default contacts throw objects out of closing fingers (33 % of outcomes as ours); of ten settings tried on
# 46 candidates, these, as stiff as the time step lets them be and overdamped, agreed best at our dt (80 %).
FRICTION, SOLREF = (EPISODE.friction, 0.005, 1e-4), (2 * EPISODE.dt, 2.0)


class Mujoco:
    """The episode of `simulation.episode` in MuJoCo, for one object and grasp type of a jaw.

    The hand's base is the world's frame; the object is placed in it and all loads act on the object as forces, turned
    into that frame.
    """

    def __init__(self, mujoco, obj: GraspObject, hand: Hand, kind: str) -> None:
        self.mj, self.obj, self.hand, self.preshape = mujoco, obj, hand, hand.preshapes[kind]
        spec = mujoco.MjSpec.from_string(hand.robot.xml)
        spec.option.timestep, spec.option.gravity = EPISODE.dt, [0, 0, 0]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.compiler.boundmass = spec.compiler.boundinertia = 1e-9
        for geom in spec.geoms:
            geom.contype, geom.conaffinity, geom.friction, geom.solref = 1, 0, FRICTION, SOLREF
        for joint in list(spec.joints):
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        moments, axes = np.linalg.eigh(obj.inertia)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        body = spec.worldbody.add_body(
            name="object", mass=obj.mass, ipos=obj.com, inertia=moments, iquat=_quaternion(mujoco, axes)
        )
        body.explicitinertial = True
        body.add_freejoint()
        for number, part in enumerate(obj.parts):
            name = f"part{number}"
            spec.add_mesh(
                name=name,
                uservert=np.asarray(part, dtype=np.float64).ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
            )
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0)
            geom.contype, geom.conaffinity, geom.friction, geom.solref = 0, 1, FRICTION, SOLREF
        for name, drive in self.preshape.drives.items():
            _drive(mujoco, spec, name, drive)
        for name in self.preshape.held:  # what never moves becomes part of its parent, as in `articulation`
            _weld(mujoco, spec, name, self.preshape.joints[name])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.addresses = {name: self.model.joint(name).qposadr[0] for name in self.preshape.drives}
        self.free = self.model.body("object").jntadr[0]
        self.pads = [self.model.body(link).id for (link,) in self.preshape.groups]

    def run(self, T_object_tcp: np.ndarray) -> str:
        mj, data, config = self.mj, self.data, EPISODE
        mj.mj_resetData(self.model, data)
        T_base_object = self.preshape.T_base_tcp @ np.linalg.inv(T_object_tcp)
        self.R = T_base_object[:3, :3]
        self.place = self.model.jnt_qposadr[self.free]
        data.qpos[self.place : self.place + 3] = T_base_object[:3, 3]
        data.qpos[self.place + 3 : self.place + 7] = _quaternion(mj, self.R)
        for name, address in self.addresses.items():
            data.qpos[address] = data.actuator(name).ctrl[0] = self.preshape.joints[name]
        mj.mj_forward(self.model, data)
        self.close()
        if not self.touching():
            return "missed"
        for _ in range(round(config.settle_time / config.dt)):
            self.follow()
            mj.mj_step(self.model, data)
        if len(self.touching()) < 2:
            return "missed"
        start = data.qpos[self.place : self.place + 7].copy()
        gravity = np.array([0.0, 0.0, -config.gravity])
        loads = [(gravity - [0, 0, config.hold_acceleration], config.hold_time)]
        loads += [(gravity + config.shake_acceleration * way, config.shake_time) for way in DIRECTIONS]
        for acceleration, duration in loads:
            data.xfrc_applied[self.model.body("object").id, :3] = self.obj.mass * (self.R @ acceleration)
            steps = round(duration / config.dt)
            for step in range(1, steps + 1):
                mj.mj_step(self.model, data)
                if (step % CHECK_STEPS == 0 or step == steps) and (failure := self.failure(start)):
                    return failure
        return "success" if len(self.touching()) == 2 else "dropped"

    def close(self) -> None:
        data, closing, drives = self.data, self.preshape.closing, self.preshape.drives
        (phase,), stride = closing.phases, closing.speed * EPISODE.dt
        window, dof = max(1, round(EPISODE.stall_window / EPISODE.dt)), self.model.jnt_dofadr[self.free]
        targets = before = {name: sign * float(data.qpos[self.addresses[name]]) for name, sign in phase.items()}
        still = 0
        self.model.dof_damping[dof : dof + 3] = EPISODE.damping * self.obj.mass
        self.model.dof_damping[dof + 3 : dof + 6] = EPISODE.damping * np.trace(self.obj.inertia) / 3
        for step in range(1, round(closing.time / EPISODE.dt) + 1):
            for name, sign in phase.items():
                ahead = sign * float(data.qpos[self.addresses[name]]) + closing.effort / drives[name].stiffness
                targets = {**targets, name: max(targets[name], min(targets[name] + stride, ahead))}
                data.actuator(name).ctrl[0] = sign * targets[name]
            self.follow()
            self.mj.mj_step(self.model, data)
            if step % window == 0:
                now = {name: sign * float(data.qpos[self.addresses[name]]) for name, sign in phase.items()}
                moved = max(abs(now[name] - before[name]) for name in phase)
                before, still = now, still + 1 if moved < EPISODE.stall_motion else 0
                if still == 2:
                    break
        self.model.dof_damping[dof : dof + 6] = 0

    def follow(self) -> None:
        for name, rule in self.preshape.closing.follow.items():
            driver = float(self.data.qpos[self.addresses[rule.of]])
            self.data.actuator(name).ctrl[0] = rule.ratio * driver + rule.offset

    def failure(self, start: np.ndarray) -> str | None:
        now = self.data.qpos[self.place : self.place + 7]
        R, R0 = _rotation(self.mj, now[3:]), _rotation(self.mj, start[3:])
        tcp = self.preshape.T_base_tcp[:3, 3]
        if math.dist(R @ R0.T @ (tcp - start[:3]) + now[:3], tcp) > EPISODE.max_slip:
            return "slipped" if len(self.touching()) == 2 else "dropped"
        return "rotated" if (np.trace(R @ R0.T) - 1) / 2 < math.cos(math.radians(EPISODE.max_rotation_deg)) else None

    def touching(self) -> set[int]:
        thing, found, force = self.model.body("object").id, set(), np.zeros(6)
        for i, contact in enumerate(self.data.contact[: self.data.ncon]):
            bodies = set(self.model.geom_bodyid[contact.geom])
            self.mj.mj_contactForce(self.model, self.data, i, force)
            if thing in bodies and force[0] > 0:
                found |= {k for k, pad in enumerate(self.pads) if pad in bodies}
        return found


def _drive(mujoco, spec, joint: str, drive: Drive) -> None:
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=drive.stiffness, kv=drive.damping)
    actuator.forcelimited, actuator.forcerange = 1, [-drive.effort, drive.effort]


def _weld(mujoco, spec, name: str, angle: float) -> None:
    """Turn the joint's body to the angle and take the joint away."""
    joint = spec.joint(name)
    body, axis, turn = joint.parent, np.array(joint.axis), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, axis, angle)
    result = np.zeros(4)
    mujoco.mju_mulQuat(result, np.array(body.quat), turn)
    body.quat = result
    spec.delete(joint)


def _quaternion(mujoco, rotation: np.ndarray) -> np.ndarray:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion


def _rotation(mujoco, quaternion: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.ascontiguousarray(quaternion))
    return matrix.reshape(3, 3)


@dataclass
class Tally:
    """What each way of trying found: success or not of all its trials in order, and the seconds of processor.

    One thread each, so that these are what a machine with nothing else to do would take.
    """

    held: dict[str, list[bool]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, attempt: Callable[[np.ndarray], str], candidates: np.ndarray) -> None:
        start = time.process_time()
        self.held.setdefault(name, []).extend(attempt(T) == "success" for T in candidates)
        self.seconds[name] = self.seconds.get(name, 0) + time.process_time() - start

    def per_second(self, name: str) -> float:
        return len(self.held[name]) / self.seconds[name]

    def agreement(self, name: str, reference: str) -> float:
        return float(np.mean(np.array(self.held[name]) == self.held[reference]))

    def agreed(self, name: str, whole: int) -> str:
        """With the reference: of the free candidates, and of the whole, where no collision ends otherwise."""
        free = len(self.held[name])
        same = round(free * self.agreement(name, "dt 1/2000"))
        return f"{_share(same, free)} / {_share(same + whole - free, whole)}"


def _share(hits: int, count: int) -> str:
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    return f"{hits / count:.1%} of {count} ({100 * interval.low:.1f}-{100 * interval.high:.1f})"


def compare(tally: Tally, obj: GraspObject, hand: Hand, kind: str, T: np.ndarray, mujoco: ModuleType | None) -> None:
    """Try the candidates T (M, 4, 4) in every way."""
    start = time.process_time()
    check, simulator = PreCheck(obj, hand.preshapes[kind]), Simulator(obj, hand, EPISODE)
    free = np.array([not check.collides(pose) for pose in T])
    tally.seconds["pre-check"] = tally.seconds.get("pre-check", 0) + time.process_time() - start
    fast, fine = Simulator(obj, hand, FAST), Simulator(obj, hand, FINE)
    tally.add("ours", lambda pose: simulator.run(pose, kind), T[free])
    tally.add("ours, fast", lambda pose: fast.run(pose, kind), T[free])
    tally.add("dt 1/2000", lambda pose: fine.run(pose, kind), T[free])
    tally.add("naive", lambda pose: Simulator(obj, hand, EPISODE).run(pose, kind), T[:NAIVE])
    truth = np.zeros(len(T), dtype=bool)
    truth[free] = tally.held["dt 1/2000"][-free.sum() :] if free.any() else []
    tally.held.setdefault("truth of naive", []).extend(truth[:NAIVE].tolist())
    if mujoco:
        tally.add("mujoco", Mujoco(mujoco, obj, hand, kind).run, T[free])


def main(count: int) -> None:
    report = Report("trials", " ".join(__doc__.split("\n\n")[2].split()))
    report.skip("trials with device=cuda: PhysX on the CPU is what repeats bit for bit")
    mujoco, hand, tally = report.peer("mujoco"), load_hand(settings(HandConfig)), Tally()
    requests: Requests = []
    for number, obj in enumerate(objects()):
        for kind in hand.preshapes:
            T = sample_candidates(obj, count, settings(SamplerConfig), np.random.default_rng(number))
            requests.append((obj, kind, T))
            compare(tally, obj, hand, kind, T.numpy(), mujoco)
    for name in [name for name in tally.held if name != "truth of naive"]:
        agreement = tally.agreement(name, "truth of naive" if name == "naive" else "dt 1/2000")
        rate, success = tally.per_second(name), float(np.mean(tally.held[name]))
        report.row(method=name, trials=len(tally.held[name]), trials_per_s=rate, success=success, agreement=agreement)
    whole, rates = sum(len(T) for _, _, T in requests), {}
    for name, config in (("ours", EPISODE), ("ours, fast", FAST)):
        rates[name] = by_the_clock(requests, Trials(hand, config))
        report.row(method=f"{name}, two processes, once started", trials=whole, trials_per_s=rates[name])
    told(report, tally, whole, rates)
    report.write()


def by_the_clock(requests: Requests, trials: Trials) -> float:
    """Candidates/s of two processes, from when the first chunk has come back."""
    done: list[tuple[float, int]] = []
    for _ in execute(requests, trials, 2, lambda name, count: done.append((time.perf_counter(), count))):
        pass
    return sum(count for _, count in done[1:]) / (done[-1][0] - done[0][0])


def told(report: Report, tally: Tally, whole: int, rates: dict[str, float]) -> None:
    """The figures of so many candidates in the whole; `rates`: candidates/s of two processes, by the clock."""
    for name, label in (("ours", "default episode"), ("ours, fast", "episode=fast")):
        core = whole / (tally.seconds[name] + tally.seconds["pre-check"])
        report.figure(
            f"candidates/s of one core's time x 2 cores (of two busy ones, by the clock), {label}",
            ">= 200 on 2 cores",
            f"{2 * core:.0f} ({rates[name]:.0f})",
        )
        report.figure(
            f"outcomes as at dt 1/2000, of free candidates / of all, {label}", ">= 99 %", tally.agreed(name, whole)
        )
    right = tally.agreement("naive", "truth of naive")
    ours = whole / (tally.seconds["ours"] + tally.seconds["pre-check"])
    report.figure(
        "candidates/s over a naive SAPIEN loop",
        "",
        f"{ours / tally.per_second('naive'):.1f} (whose outcomes are right for {right:.1%} of what it tries)",
    )
    if "mujoco" in tally.held:
        ratio, agreement = tally.per_second("ours") / tally.per_second("mujoco"), tally.agreement("mujoco", "dt 1/2000")
        report.figure(
            "free trials/s over the same episode in MuJoCo", "", f"{ratio:.2f} (which agrees in {agreement:.1%})"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else CANDIDATES)
