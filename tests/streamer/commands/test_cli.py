"""The command line as a shell sees it: exit codes, one-line errors, what goes to stdout."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import typer

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import load_robot
from flexmotion.drivers import registry
from flexmotion.drivers.interface import Capabilities, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.commands.option_groups import CheckOptions, MotionOptions, grouped
from flexmotion.streamer.commands.options import RobotOption
from flexmotion.streamer.commands.signals import operator_signals
from flexmotion.streamer.commands.streaming import emulated_port
from flexmotion.streamer.report.report import TIMING_KEYS
from flexmotion.streamer.run.requests import Request

COMMANDS = [
    *("dry-run", "run", "send", "status", "arm", "disarm", "stop", "estop", "clear", "kill"),
    *("retarget", "check torque", "robots", "robots tune", "drivers"),
]


def run(*arguments: str) -> int:
    return execute(list(arguments))


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_of_every_command(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*command.split(), "--help") == 0
    text = capsys.readouterr().out
    if command != "drivers":
        assert f"flexmotion {command}" in text.split("Examples")[1]


def test_without_a_command_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run() == 0
    text = capsys.readouterr().out
    assert all(command.split()[0] in text for command in COMMANDS)


def test_help_is_quick_because_nothing_heavy_is_imported() -> None:
    code = "import sys, flexmotion.streamer.cli; print(sorted({'mujoco', 'scipy', 'matplotlib'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


PICTURES_AND_PAGES = {"matplotlib", "jinja2", "fastapi", "uvicorn", "trimesh"}


def test_a_run_loads_no_library_for_pictures_pages_or_views() -> None:
    """Regression: loading them took 2.7 s of processor time at every start."""
    arguments = ["run", "--robot", "op3", "--driver", "sim", "--clock", "lockstep", "--seconds", "0.2", "--json"]
    code = f"""
import sys
from flexmotion.streamer.cli import execute
code = execute({arguments})
print(code, sorted({PICTURES_AND_PAGES} & set(sys.modules)), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["ok"] is True
    assert done.stderr.splitlines()[-1] == "0 []"


def test_the_options_of_a_group_are_those_of_the_command() -> None:
    seen: list[object] = []

    @grouped
    def command(*, robot: RobotOption = "op3", motion: MotionOptions, check: CheckOptions) -> None:
        """Do it."""
        seen.extend([robot, motion, check])

    app = typer.Typer()
    app.command()(command)
    app(["--prompt", "wave", "--seed", "3", "--json"], standalone_mode=False)
    assert seen == ["op3", MotionOptions(prompt="wave", seed=3), CheckOptions(as_json=True)]


def test_an_interrupt_before_anything_is_imported_is_quiet() -> None:
    """Regression: it printed a traceback from the module that was being imported."""
    # SIGINT may be ignored here, if the tests run in the background; at a terminal it is not.
    code = """
import importlib.abc, os, signal, sys
from flexmotion.streamer.__main__ import main

class Impatient(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Impatient())
main()
"""
    listening = "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)"
    done = subprocess.run([sys.executable, "-c", listening + code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
    # Under nohup, or with & in a script, the program must go on. Regression: it ended.
    code = (
        "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\nimport sys\nsys.argv[1:] = ['--version']" + code
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("flexmotion")


BAD_USAGE = {
    "unknown command": (["dance"], "No such command 'dance'"),
    "unknown option": (["dry-run", "--speed", "3"], "No such option"),
    "unknown clock": (["dry-run", "--clock", "sundial"], "'sundial' is not one of 'real', 'lockstep'"),
    "negative time": (["dry-run", "--seconds", "-1"], "--seconds"),
    "endless time": (["dry-run", "--seconds", "inf"], "--seconds"),
    "no time": (["check", "torque", "--seconds", "nan"], "--seconds"),
    "a long story": (["dry-run", "--prompt", "x" * 241], "text: expected a line of 240 characters at most"),
    "unknown robot": (["dry-run", "--robot", "hal"], "unknown robot 'hal': neither a folder nor one of: op3"),
    "robot of robots": (["robots", "hal"], "unknown robot 'hal'"),
    "empty prompt": (["dry-run", "--prompt", " "], "--prompt is empty: say in words what to do"),
    "missing clip": (["dry-run", "--clip", "none.bvh"], "none.bvh: cannot be read"),
    "folder as clip": (["dry-run", "--clip", "/"], "/: a folder, expected a motion file"),
    "kind of clip": (["dry-run", "--clip", "dance.mp4"], "dance.mp4: unknown kind of motion file, expected .bvh"),
    "missing script": (["dry-run", "--script", "none.yaml"], "none.yaml: cannot be read"),
    "two sources": (["dry-run", "--clip", "a.bvh", "--script", "b"], "--clip and --script exclude each other"),
    "no bundle": (["dry-run", "--prompt", "wave", "--bundle", "none"], "none: no bundle there"),
    "bundle for a clip": (["dry-run", "--clip", "a.npz", "--bundle", "none"], "a.npz: cannot be read"),
    "beyond the servos": (["check", "torque", "--supply", "60"], "--supply: 60 V, expected at most 14.8, for servo XM"),
    "clips for nobody": (
        ["check", "torque", "--clips", __file__],
        "which `flexmotion run` takes with --web or --stdin",
    ),
    "bundle to switch clips": (["check", "latency", "-c", "a", "--bundle", "b"], "--bundle: clips need no model"),
    "perturbation": (["dry-run", "--perturb", "wind=3"], "field wind: unknown field, expected one of: seed, timestep"),
    "no value": (["dry-run", "--perturb", "friction"], "expected KEY=VALUE, found 'friction'"),
    "wrong value": (["dry-run", "--perturb", "friction=ice"], "field friction: Input should be a valid number"),
    "not YAML": (["dry-run", "--perturb", "slope_deg=[1"], "slope_deg: not a YAML value"),
    "seed twice": (["dry-run", "--perturb", "seed=3"], "the seed is set by --seed"),
    "heading beyond a turn": (["send", "--heading", "450"], "--heading: 450 is beyond a turn, expected -360 to 360"),
    # Angles of these two are typed in degrees, and were refused in radians.
    "joint at no angle": (["send", "--joint", "l_el", "nan"], "--joint: nan is no number, expected -360 to 360"),
    "heading into no direction": (["send", "--heading", "inf"], "--heading: inf is no number, expected -360 to 360"),
    "joint beyond a turn": (["send", "--joint", "l_el", "450"], "--joint: 450 is beyond a turn, expected -360 to 360"),
    "toes beyond half a turn": (
        ["send", "--foot", "left", "0", ".1", "--heading", "200"],
        "--heading: 200 is beyond half a turn, expected -180 to 180",
    ),
    "missing settings": (["dry-run", "--settings", "none.yaml"], "none.yaml: cannot be read"),
    "missing option": (["run", "--driver", "sim"], "Missing option '--robot'"),
    "unknown driver": (["run", "--robot", "op3", "--driver", "magic"], "unknown driver 'magic', expected one of: "),
    "port of a simulation": (["run", "-r", "op3", "-d", "sim", "-p", "/dev/x"], "field port: unknown field"),
    "kind of output": (["retarget", "a.bvh", "-o", "a.xlsx"], "a.xlsx: unknown kind of file, expected .csv or .npz"),
    "report over a file": (["dry-run", "--report", __file__], "test_cli.py is no folder that can be written to"),
    "pictures over a file": (["log", "plot", "a.mcap", "-o", __file__], "is no folder that can be written to"),
    "report in a file": (["check", "torque", "--report", __file__ + "/x"], "'--report': "),
    "folder of output": (["retarget", "a.bvh", "-o", "none/a.csv"], "none: no such folder"),
    # It asked for a joint to be held, and found only then that the folder is not the user's.
    "shipped robot": (
        ["servo", "calibrate", "-p", "x", "-r", "op3"],
        "op3: a shipped robot, whose folder is the program's",
    ),
    "shipped torso": (["servo", "calibrate-imu", "-p", "x", "-r", "op3"], "op3: a shipped robot, whose folder is"),
    "missing argument": (["retarget"], "Missing argument 'FILE'"),
}


@pytest.mark.parametrize("case", BAD_USAGE)
def test_bad_usage_is_one_line_and_exit_code_2(case: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, expected = BAD_USAGE[case]
    assert run(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert expected in err
    assert err.startswith("flexmotion: ")
    assert err.count("\n") == 1


def test_a_group_without_a_command_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check") == 2
    assert "torque" in "".join(capsys.readouterr())


def test_script_with_an_unknown_word(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "script.yaml"
    script.write_text("- {at: 0, sing: loudly}\n")
    assert run("dry-run", "--script", str(script)) == 2
    assert "line 1: unknown word 'sing', expected at and one of: clip" in capsys.readouterr().err


BVH = (
    """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 20 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 30 0
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.033333
"""
    + 3 * "0 90 0 0 0 0 0 0 0\n"
)


def test_clip_without_legs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "snake.bvh"
    clip.write_text(BVH)
    assert run("dry-run", "--clip", str(clip)) == 2
    err = capsys.readouterr().err
    assert "snake.bvh" in err
    assert err.count("\n") == 1


def test_dry_run_prints_only_its_report_and_equal_runs_are_equal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["dry-run", "--seconds", "0.5", "--seed", "7", "--json"]
    assert run(*arguments, "--report", str(tmp_path)) == 0
    first = json.loads(capsys.readouterr().out)
    assert first == json.loads((tmp_path / "report.json").read_text())
    assert (tmp_path / "index.html").stat().st_size > 10_000
    assert run(*arguments) == 0
    second = json.loads(capsys.readouterr().out)
    assert first["seed"] == 7
    for content in (first, second):
        for key in TIMING_KEYS:
            del content[key]
    assert json.dumps(first) == json.dumps(second)


def test_perturbations_are_in_the_report(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--seconds", "0.2", "--perturbed", "--perturb", "total_mass=3.5", "--no-feedback", "--json"]
    assert run("dry-run", *arguments) in (0, 1)
    options = json.loads(capsys.readouterr().out)["options"]
    assert options["total_mass"] == 3.5
    assert options["torso_mass_scale"] == 1.12
    assert options["feedback"] is False


def test_single_perturbations_win_over_the_standard_ones() -> None:
    assert simulation_options(True, ["friction=0.9"])["friction"] == 0.9
    assert simulation_options(False, []) == {}


def test_a_fall_is_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    shove = "pushes=[{at: 0.7, impulse: [0, 4, 0]}]"
    assert run("dry-run", "--seconds", "2", "--perturb", shove) == 1
    out, err = capsys.readouterr()
    assert out.startswith("FAIL")
    assert "fell after" in out
    assert "Traceback" not in err


def test_run_with_the_simulation_in_lockstep(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("run", "-r", "op3", "-d", "sim", "--clock", "lockstep", "--seconds", "0.3") == 0
    assert capsys.readouterr().out.startswith("PASS")


class Unplugged(SimDriver):
    """A bus on which no servo answers."""

    def open(self) -> None:
        raise DriverError("port /dev/ttyUSB0: no servo answers")


class SimulatedSilent(SimDriver):
    """A robot with one servo that stops answering after `SILENT_FROM` reads."""

    SILENT_FROM = 0
    _reads = 0

    def read(self, state: RobotState) -> None:
        super().read(state)
        self._reads += 1
        if self._reads > self.SILENT_FROM:
            state.stale[11] = 6


class Silent(SimulatedSilent):
    """The same, with the capabilities of a real robot."""

    @property
    def capabilities(self) -> Capabilities:
        return replace(super().capabilities, truth=False)


class SilentLater(Silent):
    """The same, while the robot stands up."""

    SILENT_FROM = 40


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[type[SimDriver]], str]:
    """Function (class) -> name of the class as a driver."""

    def plug(driver: type[SimDriver]) -> str:
        name = driver.__name__.lower()
        module = ModuleType(f"{name}_driver")
        setattr(module, driver.__name__, driver)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setitem(registry.BUILT_IN, name, f"{module.__name__}:{driver.__name__}")
        return name

    return plug


@pytest.mark.parametrize(
    ("driver", "fault"), [(Silent, "no start: servo of l_knee"), (SilentLater, "PARK -> FAULT: servo of l_knee")]
)
def test_failing_hardware_is_exit_code_3_before_the_start_and_during_the_run(
    driver: type[SimDriver], fault: str, plug_in: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: it was 1, which means that the robot fell or exceeded a limit."""
    assert run("run", "-r", "op3", "-d", plug_in(driver), "--clock", "lockstep", "--seconds", "0.3", "--json") == 3
    safety = json.loads(capsys.readouterr().out)["safety"]
    assert safety["hardware_failed"] and safety["faults"][-1].startswith(f"{fault} (id 14) does not answer")


def test_a_failing_simulated_robot_is_exit_code_1(
    plug_in: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: a dry run whose simulated servos overheated reported failed hardware."""
    driver = plug_in(SimulatedSilent)
    assert run("run", "-r", "op3", "-d", driver, "--clock", "lockstep", "--seconds", "0.3", "--json") == 1
    assert json.loads(capsys.readouterr().out)["safety"]["hardware_failed"]


def test_an_emulated_port_is_recognised(tmp_path: Path) -> None:
    """Regression: runs against a late emulator were reported as failures of the servos."""
    ends = os.openpty()
    link = tmp_path / "bus"
    link.symlink_to(os.ttyname(ends[1]))
    assert emulated_port({"port": str(link)}) == str(link)
    assert emulated_port({"ports": {"a": "/dev/null", "b": str(link)}}) == str(link)
    assert emulated_port({"port": "/dev/null"}) is None and emulated_port({}) is None
    for end in ends:
        os.close(end)


def test_a_failing_driver_is_exit_code_3(plug_in: Callable[..., str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run("run", "-r", "op3", "-d", plug_in(Unplugged), "--seconds", "0.3") == 3
    assert capsys.readouterr().err.splitlines()[-1] == "flexmotion: port /dev/ttyUSB0: no servo answers"


def test_a_broken_plug_in_is_named_and_the_rest_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(registry.BUILT_IN, "broken", "no_such_module:Driver")
    assert run("drivers", "--json") == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert not rows["broken"]["loads"]
    assert rows["sim"]["loads"]
    assert "friction" in rows["sim"]["options"]


@pytest.mark.usefixtures("hears_hangup")
def test_signals_are_requests_and_the_second_interrupt_ends_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)
    with operator_signals() as signals:
        assert signals.next() is None
        for number in (signal.SIGUSR1, signal.SIGUSR2, signal.SIGHUP, signal.SIGTERM):
            os.kill(os.getpid(), number)
        assert os.read(signals.wake, 16)
        asked = [signals.next() for _ in range(5)]
        assert asked == [Request.STOP, Request.ESTOP, Request.END, Request.QUIT, None] and signals.interrupted
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_an_end_that_is_requested_while_a_run_is_loaded_ends_at_once(
    number: signal.Signals, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """It loaded on for 13 s, said that "the robot comes to a stand and parks", and wrote a report of 0.0 s."""
    before = signal.getsignal(number)
    with pytest.raises(typer.Exit) as ended, operator_signals(loading=True) as signals:
        os.kill(os.getpid(), signal.SIGUSR1)
        assert signals.next() is Request.STOP
        try:
            os.kill(os.getpid(), number)
            pytest.fail("it loads on")
        except Exception:  # of what is loaded
            pytest.fail("it was caught")
    assert ended.value.exit_code == code and signal.getsignal(number) is before
    assert capsys.readouterr().err == "interrupted while the run was loaded: nothing was started\n"
    with operator_signals(loading=True) as signals:
        signals.loading = False
        os.kill(os.getpid(), number)
        assert signals.next() is Request.END


def test_robots(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("robots", "--json") == 0
    (op3,) = json.loads(capsys.readouterr().out)
    assert (op3["name"], op3["joints"], op3["rate_hz"]) == ("op3", 20, 125.0)
    assert run("robots", op3["file"].rsplit("/", 1)[0], "--json") == 0
    detail, pace = json.loads(capsys.readouterr().out), load_robot("op3").gait.pace
    assert len(detail["joint_list"]) == 20 and pace is not None
    assert (detail["pace"]["ahead_m_s"], detail["pace"]["turning_rad_s"]) == (pace.ahead, pace.turning)
    assert run("robots") == 0
    assert "XM430-W350" in capsys.readouterr().out
    assert run("robots", "op3") == 0
    found = capsys.readouterr().out
    assert "l_knee" in found and f"{pace.ahead:g} m/s ahead" in found


def test_robots_warns_of_numbers_with_which_every_run_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A double support of .19 s passed; then every run was refused with a message about horizon_s, no field named."""
    shipped = load_robot("op3")
    shutil.copytree(shipped.folder, tmp_path / "mine")
    file = (tmp_path / "mine" / shipped.file.name).rename(tmp_path / "mine" / "robot.yaml")
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("double_support_min_s: 0.048", "double_support_min_s: 0.19"), encoding="utf-8")
    told = "field gait.double_support_min_s: 0.19 s, expected at most 0.15, or horizon_s of 1.04"
    assert run("robots", str(tmp_path / "mine")) == 0
    assert told in " ".join(capsys.readouterr().out.split())
    assert run("robots", str(tmp_path / "mine"), "--json") == 0
    assert told in json.loads(capsys.readouterr().out)["warnings"][0]
    assert run("dry-run", "--robot", str(tmp_path / "mine"), "--seconds", "1") == 2
    assert told in capsys.readouterr().err


@pytest.fixture(scope="module")
def short_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from flexmotion.human.motion_file import save_motion
    from flexmotion.streamer.commands.choice import choose_motion

    file = tmp_path_factory.mktemp("clip") / "short.npz"
    save_motion(choose_motion()[:20], file)
    return file


def test_retarget(short_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "short.csv"
    assert run("retarget", str(short_clip), "--robot", "op3", "-o", str(out), "--json") == 0
    assert json.loads(capsys.readouterr().out)["source"] == "short.npz"
    assert out.read_text().startswith("time_s,head_pan,")


def test_a_torque_check_of_refused_words_fails(capsys: pytest.CaptureFixture[str]) -> None:
    """It judged the standing robot, and passed; later it said PASS and `"ok": true`, with exit code 1."""
    assert run("check", "torque", "--prompt", "walk sideways", "--seconds", "1") == 1
    out = " ".join(capsys.readouterr().out.split())
    assert out.startswith("FAIL op3") and "'walk sideways' was refused, and so not checked" in out
    assert run("check", "torque", "--prompt", "walk sideways", "--seconds", "1", "--json") == 1
    content = json.loads(capsys.readouterr().out)
    assert content["ok"] is False and content["refused"] == ["walk sideways"] and content["failed"] == []


def test_a_built_in_script_that_a_bundle_cannot_do_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """The run of `--bundle free` alone failed for kinds that the user had not asked for."""
    assert run("dry-run", "--bundle", "free", "--seconds", "1") == 2
    err = " ".join(capsys.readouterr().err.split())
    assert "the built-in script asks for 'wave with the right hand'" in err and "give --prompt or --script" in err


def test_check_torque(short_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = run("check", "torque", "--clip", str(short_clip), "--json", "--report", str(tmp_path))
    content = json.loads(capsys.readouterr().out)
    assert code == (0 if content["ok"] else 1)
    assert content["worst"] in content["joints"]
    assert content["ok"] == (not content["failed"])
    assert (tmp_path / "torque.png").stat().st_size > 10_000


def test_least_likeness_decides_the_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from flexmotion.human.motion_file import save_motion
    from flexmotion.streamer.commands.choice import choose_motion

    file = tmp_path / "walk.npz"
    save_motion(choose_motion()[255:305], file)
    assert run("dry-run", "--clip", str(file), "--min-likeness", "1", "--json") == 1
    content = json.loads(capsys.readouterr().out)
    assert content["options"]["min_likeness"] == 1.0
    assert content["likeness"]["score"] < 1.0 and not content["motion"]["fell"]


def test_script_of_two_clips(short_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "script.yaml"
    script.write_text(
        f"- {{at: 0, clip: {short_clip}}}\n- {{at: 0.5, clip: {short_clip}}}\n- {{at: 0.9, stop: true}}\n"
    )
    assert run("dry-run", "--script", str(script), "--json") == 0
    assert json.loads(capsys.readouterr().out)["source"] == "script:script.yaml"


def test_a_reader_that_leaves_causes_no_traceback() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "flexmotion.streamer", "robots", "op3"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert b"Traceback" not in process.stderr.read()
    process.stderr.close()
    process.wait()


def test_without_a_model_the_message_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("flexmotion.bundles.shipped.FOLDER", tmp_path)
    script = tmp_path / "talk.yaml"
    script.write_text("- {at: 0, text: wave}\n")
    for arguments, asker in ((["--prompt", "wave"], "--prompt"), (["--script", str(script)], "talk.yaml")):
        assert run("dry-run", *arguments) == 2
        error = capsys.readouterr().err
        assert f"{asker} needs a model bundle" in error and "give --bundle DIR" in error and error.count("\n") == 1


def test_help_says_what_to_type_and_shows_no_emoji(capsys: pytest.CaptureFixture[str]) -> None:
    """`false_position:ID:T` was shown with an emoji in the place of `:ID:`."""
    assert run("emulate", "--help") == 0
    out = capsys.readouterr().out
    assert "false_position" in out and all(ord(character) < 0x1F000 for character in out)


@pytest.mark.parametrize("command", ["send", "status", "arm", "disarm", "stop", "estop", "clear", "kill", "drive"])
def test_all_commands_that_speak_to_a_run_take_the_same_address(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """`flexmotion stop --port 8800` was refused as an unknown option, `flexmotion send --stop-port` too."""
    assert run(command, "--help") == 0
    text = capsys.readouterr().out
    over = () if command == "drive" else ("--zenoh", "--name", "--json")
    for option in ("--host", "--port", "--stop-port", "--source", "--token-file", *over):
        assert option in text, option
