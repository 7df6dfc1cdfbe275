"""Files for OpenSim: their form, their axes by physics, and OpenSim's own inverse dynamics with them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.analysis import ClipAnalysis, Recording, analyse
from flexmotion.biomechanics.differentiation import EDGE, second_derivative
from flexmotion.biomechanics.dynamics_files import write_files
from flexmotion.biomechanics.opensim_files import opensim_files
from flexmotion.biomechanics.opensim_names import FROM_Y_UP, coordinates, generalised_forces, y_up, y_up_rotation
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.spatial.gravity import GRAVITY

START = 0.4


@pytest.fixture(scope="module")
def analysed(clip: Motion) -> ClipAnalysis:
    return analyse(clip[:60], muscles=False, recording=Recording(START, turn=0.3, origin=(1.0, 0.5)))


@pytest.fixture(scope="module")
def folder(analysed: ClipAnalysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opensim")
    write_files(opensim_files(folder / "walk.sto", analysed))
    return folder


def storage(file: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Header and columns of a storage, read as its format says."""
    lines = file.read_text().splitlines()
    end = lines.index("endheader")
    header = dict(line.split("=") for line in lines[1:end])
    names = lines[end + 1].split("\t")
    values = np.array([[float(value) for value in line.split("\t")] for line in lines[end + 2 :]])
    return header, dict(zip(names, values.T, strict=True))


@pytest.mark.parametrize("part", ["", "_coordinates", "_moments", "_quality"])
def test_storages_have_the_rows_and_columns_of_their_header(part: str, folder: Path, analysed: ClipAnalysis) -> None:
    header, columns = storage(folder / f"walk{part}.sto")
    assert int(header["nRows"]) == len(analysed) and int(header["nColumns"]) == len(columns)
    assert header["inDegrees"] == ("yes" if part == "_coordinates" else "no")
    assert columns["time"][0] == START
    assert np.diff(columns["time"]) == pytest.approx(1 / analysed.dynamics.motion.fps, abs=1e-6)


def test_forces_are_y_up(folder: Path, analysed: ClipAnalysis) -> None:
    """Forces of both feet and the residual sum to mass x (acceleration + g), the acceleration from the coordinates."""
    _, ground = storage(folder / "walk.sto")
    _, moments = storage(folder / "walk_moments.sto")
    motion = analysed.recording.placed(analysed.dynamics).motion
    acceleration = y_up(second_derivative(forward(motion).com, motion.fps))
    needed = motion.body.mass * (acceleration + [0.0, GRAVITY, 0.0])
    for column, axis in enumerate("xyz"):
        total = ground[f"ground_force_l_v{axis}"] + ground[f"ground_force_r_v{axis}"] + moments[f"pelvis_t{axis}_force"]
        assert total[EDGE:-EDGE] == pytest.approx(needed[EDGE:-EDGE, column], abs=0.5)
    assert (ground["ground_force_r_py"] == 0.0).all()


def test_residual_is_that_of_the_pelvis(folder: Path, analysed: ClipAnalysis) -> None:
    _, moments = storage(folder / "walk_moments.sto")
    _, quality = storage(folder / "walk_quality.sto")
    size = np.linalg.norm([moments[f"pelvis_t{axis}_force"] for axis in "xyz"], axis=0)
    assert size / analysed.weight == pytest.approx(quality["residual_force_bw"], abs=1e-6)


def test_coordinates_are_the_pose(folder: Path, analysed: ClipAnalysis) -> None:
    _, found = storage(folder / "walk_coordinates.sto")
    motion = analysed.recording.placed(analysed.dynamics).motion
    angles = np.stack([found[f"pelvis_{name}"] for name in ("tilt", "list", "rotation")], axis=1)
    pelvis = Rotation.from_euler("ZXY", angles, degrees=True).as_matrix()
    assert pelvis == pytest.approx(y_up_rotation(segment_motion(motion).rotation[:, 1]), abs=1e-6)
    assert found["pelvis_ty"] == pytest.approx(motion.root_position[:, 2], abs=1e-8)
    assert found["pelvis_tz"] == pytest.approx(-motion.root_position[:, 1], abs=1e-8)
    assert np.radians(found["knee_angle_r"]) == pytest.approx(
        motion.joints[:, JOINTS.index("knee_flexion_r")], abs=1e-8
    )


angles_of_three = st.tuples(*3 * [st.floats(-1.2, 1.2)])


@given(angles=angles_of_three, rates=angles_of_three, moment=angles_of_three)
def test_generalised_forces_do_the_work_of_the_moment(
    angles: tuple[float, ...], rates: tuple[float, ...], moment: tuple[float, ...]
) -> None:
    """Moments of tilt, list and rotation times their rates are the power of the moment on the pelvis."""
    step = 1e-4
    turns = Rotation.from_euler("ZXY", np.array(angles) + np.outer([-step, 0.0, step], rates))
    ours = FROM_Y_UP @ turns.as_matrix() @ FROM_Y_UP.T
    torques = np.zeros((3, DOF_COUNT))
    torques[:, 3:6] = moment
    motion = Motion(
        fps=1 / step,
        root_position=np.zeros((3, 3)),
        root_quaternion=Rotation.from_matrix(ours).as_quat(scalar_first=True),
        joints=np.zeros((3, len(JOINTS))),
        torques=torques,
    )
    values, forces = coordinates(motion), generalised_forces(motion)
    names = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
    power = sum(forces[f"{name}_moment"][1] * (values[name][2] - values[name][0]) / (2 * step) for name in names)
    spin = (Rotation.from_matrix(ours[0]).inv() * Rotation.from_matrix(ours[2])).as_rotvec() / (2 * step)
    assert power == pytest.approx(float(np.dot(spin, moment)), abs=1e-5)


def test_external_loads_name_columns_and_bodies_that_exist(folder: Path) -> None:
    loads = ET.parse(folder / "walk_external_loads.xml").getroot().find("ExternalLoads")
    assert loads is not None
    data = loads.findtext("datafile")
    assert data == "walk.sto"
    _, columns = storage(folder / data)
    bodies = {body.get("name") for body in ET.parse(folder / "walk_model.osim").iter("Body")}
    forces = list(loads.iter("ExternalForce"))
    assert len(forces) == 2
    for force in forces:
        assert force.findtext("applied_to_body") in bodies
        for kind in ("force", "point", "torque"):
            assert {f"{force.findtext(f'{kind}_identifier')}{axis}" for axis in "xyz"} <= columns.keys()


def test_model_has_the_mass_and_the_coordinates_of_the_clip(folder: Path, analysed: ClipAnalysis) -> None:
    model = ET.parse(folder / "walk_model.osim")
    mass = sum(float(body.findtext("mass") or "nan") for body in model.iter("Body"))
    assert mass == pytest.approx(analysed.dynamics.motion.body.mass, abs=1e-6)
    names = {coordinate.get("name") for coordinate in model.iter("Coordinate")}
    _, values = storage(folder / "walk_coordinates.sto")
    _, forces = storage(folder / "walk_moments.sto")
    assert names == values.keys() - {"time"}
    assert names == {name.rpartition("_")[0] for name in forces.keys() - {"time"}}


def test_muscles_and_joint_contact(clip: Motion, tmp_path: Path) -> None:
    pytest.importorskip("myo_sim", reason="extra biomech")
    found = analyse(clip[:30])
    assert found.muscles is not None
    write_files(opensim_files(tmp_path / "walk.sto", found))
    _, activations = storage(tmp_path / "walk_activations.sto")
    assert activations["soleus_r"] == pytest.approx(
        found.muscles.state.activations[:, found.muscles.names.index("soleus_r")], abs=1e-8
    )
    _, contact = storage(tmp_path / "walk_joint_contact.sto")
    # Compression: on the tibia downward, along -y.
    compression = -contact["knee_l_on_tibia_l_in_tibia_l_fy"]
    assert compression == pytest.approx(-found.muscles.contact[:, found.muscles.state.crossings.index("knee_l"), 2])
    assert np.median(compression) > 0.3 * found.weight


def test_inverse_dynamics_of_opensim_gives_the_same_moments(
    folder: Path, analysed: ClipAnalysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenSim reads model, coordinates and loads, and computes the moments itself; it writes a log where it runs."""
    opensim = pytest.importorskip("opensim", reason="extra opensim")
    monkeypatch.chdir(tmp_path)
    opensim.Logger.setLevelString("Error")
    tool = opensim.InverseDynamicsTool()
    tool.setModelFileName(str(folder / "walk_model.osim"))
    tool.setCoordinatesFileName(str(folder / "walk_coordinates.sto"))
    tool.setExternalLoadsFileName(str(folder / "walk_external_loads.xml"))
    tool.setLowpassCutoffFrequency(-1.0)
    tool.setStartTime(START)
    tool.setEndTime(float(analysed.times[-1]))
    tool.setResultsDir(str(tmp_path))
    tool.setOutputGenForceFileName("opensim.sto")
    assert tool.run()
    theirs = opensim.TimeSeriesTable(str(tmp_path / "opensim.sto"))
    _, ours = storage(folder / "walk_moments.sto")
    assert set(theirs.getColumnLabels()) == ours.keys() - {"time"}
    times = np.array(theirs.getIndependentColumn())
    inner = slice(EDGE, -EDGE)
    for name, values in ours.items():
        if name != "time":
            other = np.interp(ours["time"], times, theirs.getDependentColumn(name).to_numpy())
            error = np.sqrt(np.mean((values - other)[inner] ** 2))
            # Both differentiate in their own way: 2 % of the largest value, and .3 N·m or N.
            assert error < 0.02 * np.abs(values).max() + 0.3, (name, error)


@pytest.mark.parametrize("part", ["", "_coordinates", "_moments", "_quality"])
def test_opensim_opens_the_storages(part: str, folder: Path) -> None:
    opensim = pytest.importorskip("opensim", reason="extra opensim")
    table = opensim.TimeSeriesTable(str(folder / f"walk{part}.sto"))
    _, columns = storage(folder / f"walk{part}.sto")
    assert set(table.getColumnLabels()) == columns.keys() - {"time"}


def test_opensim_opens_the_external_loads(folder: Path) -> None:
    opensim = pytest.importorskip("opensim", reason="extra opensim")
    loads = opensim.ExternalLoads(str(folder / "walk_external_loads.xml"), True)
    assert [loads.get(index).get_applied_to_body() for index in range(loads.getSize())] == ["calcn_l", "calcn_r"]
