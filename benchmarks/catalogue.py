"""`CATALOGUE`: every benchmark, with what it needs, how long it takes and where it fails; no benchmark is imported."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from pathlib import Path

from flexmotion.configs.errors import ConfigError

FOLDER = Path(__file__).resolve().parent


class Need(Enum):
    """What a benchmark needs beyond the installed project; the value is the text of the list."""

    CLIPS = "motion data"
    SET = "training set"
    TRAINING = "training run"
    DEV = "extra dev"
    BIOMECH = "extra biomech"
    TRAIN = "extra train"
    OPENSIM = "extra opensim"


MODULES = {
    Need.DEV: "rustypot",
    Need.BIOMECH: "myo_sim",
    Need.TRAIN: "torch",
    Need.OPENSIM: "opensim",
}
"""A module that an extra installs."""


@dataclass(frozen=True)
class Benchmark:
    """A benchmark: `benchmarks/NAME.py`.

    Attributes:
        name: topic and module, such as `model/hearing`.
        takes: about how long on one idle core, with its default options.
        needs: what must be there besides the installed project.
        fails: where it exits with 1; empty where it only measures.
    """

    name: str
    takes: str
    needs: tuple[Need, ...] = ()
    fails: str = ""

    @property
    def module(self) -> str:
        """Its module, for an import."""
        return f"benchmarks.{self.name.replace('/', '.')}"

    @property
    def asks(self) -> str:
        """The question that it answers: the first line of its module."""
        text = ast.get_docstring(ast.parse((FOLDER / f"{self.name}.py").read_text(encoding="utf-8"))) or ""
        return text.splitlines()[0]

    def check_extras(self) -> None:
        """Check that the extras that it needs are installed.

        Raises:
            ConfigError: one is missing.
        """
        for need in self.needs:
            if need in MODULES and find_spec(MODULES[need]) is None:
                extra = need.value.partition(" ")[2]
                raise ConfigError(f"{self.name} needs the extra {extra!r}: in a clone, pip install '.[{extra}]'")


CATALOGUE = (
    Benchmark("robot/clips", "4 min", (Need.CLIPS,), "a standing clip falls; walked below 90 %; pace below 5x"),
    Benchmark(
        "robot/likeness", "3 min", (Need.CLIPS,), "gestures off by 20/22°, a spurious swing, pitch below .85, a fall"
    ),
    Benchmark("robot/prompts", "30 min", (), "upright, or done, below 90 % (gestures), 80 % (locomotion)"),
    Benchmark("robot/kinds", "15 min", (), "a fall"),
    Benchmark("robot/sentences", "5 min", (), "done or plainly refused below 90 %, an impossible one moves, a fall"),
    Benchmark("robot/hand_targets", "4 min", (), "hand off by 1.5 cm in 20 %, by 4 cm in 5 %; a touch, a fall"),
    Benchmark("robot/foot_targets", "4 min", (), "sole off by 1 cm in 20 %, 2 cm later in 5 %; 4° in 5 %; a fall"),
    Benchmark("robot/head_places", "3 min", (), "head off by 1.5 cm in 20 %, by 4 cm in 5 %; a touch, a fall"),
    Benchmark(
        "robot/tension", "4 min", (), "presses .8 of stiff arms or more, impact above 1.1; tracking above 1°; a fall"
    ),
    Benchmark("robot/pace", "5 min", (), "at `gait.pace` below .4 of the way, .7 of its best speed, 90 % upright"),
    Benchmark(
        "robot/fastest_walk",
        "6 min",
        (),
        "below .20 m/s, a fall, knees late by 6°, slip 5 mm/s, knee RMS .3 of stall, a hot servo",
    ),
    Benchmark("robot/replan_noise", "20 min", (Need.CLIPS,), "at 5 cm upright below 90 %, a join above 3 mm a tick"),
    Benchmark("robot/switching", "5 min", (Need.CLIPS,), "1 fall in 200 changes; another early end or bad goal"),
    Benchmark("robot/bows", "4 min", (), "a robot topples, a fall is noticed beyond 80°, a goal outside"),
    Benchmark("robot/emergency_stop", "15 min", (), "the robot file's emergency stop: a nominal robot falls"),
    Benchmark(
        "robot/pushes", "4 min", (), ".3 N·s upright below 98 % (standing), 90 % (walking); recoverable ones below 95 %"
    ),
    Benchmark("robot/get_up", "6 min", (), "a robot on its front or back does not get up; a goal outside the envelope"),
    Benchmark("robot/steering", "15 min", (), "a fall; a stick that does not move the robot, a STOP without a stand"),
    Benchmark("robot/course", "15 min", (), "in a minute 10 % off the asked way, 5° off the asked heading; a fall"),
    Benchmark(
        "robot/learned_walk",
        "13 min",
        (),
        "no faster than plans, feet lifted below 10 mm, a bad goal",
    ),
    Benchmark("robot/faults", "15 min", (Need.CLIPS,), "upright below 90 % (silent planner), 95 % (stops)"),
    Benchmark("model/hearing", "5 s", (), "below 97 %, a kind below 85 %, left taken for right; manners below 90 %"),
    Benchmark("model/manners", "5 min", (Need.TRAIN, Need.SET), "below 60 % of samples in the manner asked for"),
    Benchmark("model/grammar", "5 s", (), "heard as meant or plainly refused below 90 %"),
    Benchmark("model/prompts", "5 min", (), "below 95 % of the kinds that are offered, one of them below 85 %"),
    Benchmark(
        "model/beside", "6 min", (), "gestures or motions done below 95 %, the worst below 85 %; way off by a tenth"
    ),
    Benchmark("model/long_horizon", "10 min", (Need.SET,), "feet 3 cm off in 2 % of frames, jerk at joins 1.5 x"),
    Benchmark("model/straight", "6 min", (), "a walk off by 5°, 5 % sideways; a stand by 3°, 5 cm in 10 minutes"),
    Benchmark("model/velocity", "5 min", (Need.SET,), "mean error above .15 m/s, .2 rad/s"),
    Benchmark("model/guidance", "10 min"),
    Benchmark("model/speeds", "2 min", (Need.SET,), "samples by words off by .15 m/s, .2 rad/s from clips"),
    Benchmark("model/corrections", "3 min", (), "sideways velocities missed by .15 m/s, .2 rad/s"),
    Benchmark("model/memorisation", "10 min", (Need.SET,), "half as far from training windows; .3 of the diversity"),
    Benchmark("model/agreement", "1 min", (), "90th percentile at 1 s above 5 cm, 3°"),
    Benchmark(
        "model/control",
        "15 min",
        (Need.SET,),
        "hand 2 cm off, path 10 cm in 5 s, half of the forces' error, 1.6 x the time",
    ),
    Benchmark("model/sampler_speed", "10 s"),
    Benchmark("model/int8", "2 min", (Need.TRAIN,), "above 12 ms (99 %: 20 ms) of the processor, 400 MB"),
    Benchmark(
        "model/ablations",
        "2 h",
        (Need.TRAIN, Need.TRAINING),
        "own metrics less than 20 % better, Fréchet distance above 1.1 x",
    ),
    Benchmark("model/baselines", "40 min", (Need.TRAIN, Need.TRAINING)),
    Benchmark("model/variants", "40 min", (Need.TRAIN, Need.SET), "held-out forces worse with variants than without"),
    Benchmark(
        "model/personal",
        "45 min",
        (Need.TRAIN, Need.TRAINING),
        "anything else moves; shown kinds less than a fifth nearer to the person's; .9 of them done",
    ),
    Benchmark("model/delivered", "4 min", (), "residual 2 % of weight, ZMP outside 2 %, jerk 1.5 x, skate 1.2 x"),
    Benchmark(
        "model/distributions", "4 min", (Need.SET,), "a figure of a kind further from clips than 1.3 x they differ"
    ),
    Benchmark("model/onsets", "8 min", (Need.SET,), "a kind beyond its clips; 2 % of changes faster than gestures"),
    Benchmark("model/motion_pictures", "1 min", (Need.SET,)),
    Benchmark("biomechanics/gait", "5 s", (Need.CLIPS,), "a force or moment over its target"),
    Benchmark("biomechanics/plates", "10 s", (Need.CLIPS,), "a vertical force over its target"),
    Benchmark("biomechanics/force_error", "30 s", (Need.CLIPS,), "a correlation or a flagged share over its limit"),
    Benchmark(
        "biomechanics/muscles",
        "2 min",
        (Need.CLIPS, Need.BIOMECH),
        "torque within 2 % in below 90 % of frames, 5 % saturated, knee 3.2 body weights, hip 4.5",
    ),
    Benchmark("biomechanics/speed", "6 min", (Need.CLIPS, Need.BIOMECH), "below 350 frames/s on two workers"),
    Benchmark("biomechanics/perturbed", "10 min", (Need.CLIPS,), "walking tracked below 75 %, assistance above 5 %"),
    Benchmark(
        "biomechanics/opensim_reference",
        "5 min",
        (Need.CLIPS, Need.BIOMECH, Need.OPENSIM),
        "torque 1 % off its largest, activation .02, r .8 with a model",
    ),
    Benchmark("realtime/latency", "1 min", (), "a budget of the stream settings is passed"),
    Benchmark("realtime/plan_time", "2 min", (Need.CLIPS,)),
    Benchmark("realtime/gateway", "9 min", (), "a target unanswered; to command above 35, p99 50 ms; a fall"),
    Benchmark("realtime/page", "5 min", (), "the gateway above .25 cores with 3 pages; plans slowed by over 10 %"),
    Benchmark("realtime/flood", "3 min", (), "a target unanswered; periods missed, lateness or work above 1.5 x by it"),
    Benchmark("realtime/transports", "20 min", (Need.DEV,), "a target unanswered, E-STOP after more than two periods"),
    Benchmark("realtime/stop", "4 min", (), "parked after more than 5.5 s, a fall"),
    Benchmark("mirror/clips", "6 min", (Need.CLIPS,), "a fall; feet p95 above .6 s; the model not 20 % better at .3 s"),
    Benchmark("mirror/latency", "1 min", (), "a frame to its command above 80 ms in the median, 150 ms for 95 %"),
    Benchmark("live/soak", "3 h", (), "unanswered, 1 MB in 10 min, a goal outside the envelope, falls of transports"),
    Benchmark("bus/cycle_time", "2 min", (Need.DEV,), "a cycle costs more than 2.3 of rustypot's, or 1.15 of its wire"),
    Benchmark("bus/faults", "5 min", (), "bad packets end a run or cost 10 % of the tracking"),
    Benchmark("bus/identification", "3 min", (), "a figure off by 10 %, an uncertainty that does not hold"),
)
"""By topic; in the order of the list."""


def find(name: str) -> Benchmark:
    """The benchmark of a name.

    Raises:
        ConfigError: there is none.
    """
    for benchmark in CATALOGUE:
        if benchmark.name == name:
            return benchmark
    room = f"{name.partition('/')[0]}/"
    near = [own.name for own in CATALOGUE if name in own.name or own.name.startswith(room)]
    if not near:
        raise ConfigError(f"no benchmark {name!r}: `python -m benchmarks` lists them")
    raise ConfigError(f"no benchmark {name!r}, expected {'one of ' if len(near) != 1 else ''}{', '.join(near)}")
