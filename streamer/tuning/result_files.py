"""What a campaign leaves in its folder: the robot with the numbers found, and the figures before and after."""

from __future__ import annotations

from pathlib import Path

from flexmotion.streamer.tuning.campaign import Plan
from flexmotion.streamer.tuning.result import TuningResult, result_of
from flexmotion.streamer.tuning.result_text import markdown
from flexmotion.streamer.tuning.state import CampaignState, write_whole
from flexmotion.streamer.tuning.variant import write_variant

ROBOT, JSON, MARKDOWN = "robot", "tuning.json", "tuning.md"
"""Names in the folder of a campaign."""


def write_result(plan: Plan, state: CampaignState, folder: Path) -> TuningResult:
    """Write the robot's folder, `tuning.json` and `tuning.md` into a campaign's folder.

    Raises:
        ConfigError: the folder cannot be written.
    """
    result = result_of(plan, state)
    values = {number.at: state.best.numbers[number.name] for number in plan.numbers}
    write_variant(plan.robot.file, values, folder / ROBOT)
    write_whole(folder / JSON, result.model_dump_json(by_alias=True, indent=2) + "\n")
    write_whole(folder / MARKDOWN, markdown(result))
    return result
