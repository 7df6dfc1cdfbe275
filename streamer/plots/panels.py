"""One small panel for each joint: legs in the first two columns, arms and head beside them."""

from __future__ import annotations

from itertools import zip_longest

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexmotion.configs.robot import Robot

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


def joint_panels(figure: Figure, robot: Robot, *, above: float, sharex: bool, sharey: bool) -> dict[int, Axes]:
    """Panels by joint index, titled with the joint's name, below the first `above` inches of the figure."""
    columns = joint_columns(robot)
    rows = max(map(len, columns))
    height = figure.get_size_inches()[1]
    cells = figure.add_gridspec(
        rows,
        len(columns),
        left=0.035,
        right=0.99,
        top=1 - above / height,
        bottom=0.3 / height,
        hspace=0.34,
        wspace=0.15,
    )
    grid = cells.subplots(sharex=sharex, sharey=sharey, squeeze=False)
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
