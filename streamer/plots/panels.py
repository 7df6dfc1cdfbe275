"""One small panel a joint: legs in the first two columns, arms and head beside them, as on the body."""

from __future__ import annotations

from itertools import zip_longest

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from configs.robot import Robot

_COLUMNS = (("left_leg",), ("right_leg",), ("left_arm",), ("right_arm",))


def joint_columns(robot: Robot) -> list[list[int]]:
    """Joint indices of each column of panels; every joint of the robot is in one."""
    chains = robot.mapping.chains()
    columns = [[i for name in names if name in chains for i in robot.chain(name).values()] for names in _COLUMNS]
    columns = [column for column in columns if column]
    placed = {i for column in columns for i in column}
    for i in (i for i in range(robot.n) if i not in placed):
        min(columns, key=len).append(i)
    return columns


def joint_panels(figure: Figure | SubFigure, robot: Robot, *, sharex: bool, sharey: bool) -> dict[int, Axes]:
    """Panels by joint index, titled with the joint's name; outer panels alone carry tick labels on shared axes."""
    columns = joint_columns(robot)
    rows = max(map(len, columns))
    grid = figure.subplots(rows, len(columns), sharex=sharex, sharey=sharey, squeeze=False)
    panels: dict[int, Axes] = {}
    for row, joints in enumerate(zip_longest(*columns)):
        for column, joint in enumerate(joints):
            axes = grid[row, column]
            if joint is None:
                axes.set_axis_off()
                continue
            panels[joint] = axes
            axes.set_title(robot.joint_names[joint], pad=2)
            axes.tick_params(labelsize=7.5)
            if sharex and row + 1 == len(columns[column]):
                axes.tick_params(labelbottom=True)
    return panels
