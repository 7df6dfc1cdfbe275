"""Recipes of gestures: `gestures.yaml`, typed and validated."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, parse, yaml_content

FILE = "gestures.yaml"


def _ordered(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError(f"[{span[0]:g}, {span[1]:g}]: expected the least value first")
    return span


def _direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError("a direction of length zero")
    return vector


Span = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""Least and greatest value; a value between them is drawn for every motion."""

Vector = tuple[float, float, float]
"""Forward, outward, up, in the axes of the torso; outward is away from the midline, on the side of the arm."""

Direction = Annotated[Vector, AfterValidator(_direction)]
Landmark = Literal["brow", "chin", "breastbone", "waist", "front"]
Ground = Literal["stand", "walk"]


class ArmPose(Strict):
    """Pose of one arm: by the directions of its segments, or by the place of its hand.

    Attributes:
        upper, forearm: directions of upper arm and forearm.
        hand: landmark of the body that the centre of the fist is near.
        offset: from the landmark to the fist [m], of a human 1.75 m tall.
        elbow: direction to which the elbow points from the line between shoulder and hand.
        palm: direction out of the palm, as near as the forearm's rotation reaches; None to keep the base's pronation.
        spread: greatest angle by which the drawn directions differ from these [degrees].
    """

    upper: Direction | None = None
    forearm: Direction | None = None
    hand: Landmark | None = None
    offset: Vector = (0.0, 0.0, 0.0)
    elbow: Direction | None = None
    palm: Direction | None = None
    spread: float = Field(default=0.0, ge=0.0, le=45.0)

    @model_validator(mode="after")
    def _one_way(self) -> ArmPose:
        by_segments = (self.upper is not None, self.forearm is not None)
        by_hand = (self.hand is not None, self.elbow is not None)
        if (all(by_segments) and not any(by_hand)) or (all(by_hand) and not any(by_segments)):
            return self
        raise ValueError("an arm needs either upper and forearm, or hand and elbow")


class HeadPose(Strict):
    """Angles that are added to those of the neck [degrees]: up, towards the gesture's side, tilted to that side."""

    up: Span = (0.0, 0.0)
    turn: Span = (0.0, 0.0)
    tilt: Span = (0.0, 0.0)


class TrunkPose(Strict):
    """Angles that are added to those of the lumbar joint [degrees]: forward, towards the gesture's side, bent to it."""

    lean: Span = (0.0, 0.0)
    turn: Span = (0.0, 0.0)
    bend: Span = (0.0, 0.0)


class Pose(Strict):
    """Pose of the parts that a gesture moves; the others follow the base.

    Attributes:
        arm: of the gesture's side.
        other_arm: of the other side.
        both_arms: of both sides, symmetrical.
        head, trunk: angles beside the base's.
        down: by how much the pelvis is lowered over standing feet [leg lengths].
        tilt: by how much it tilts forward meanwhile [degrees].
    """

    arm: ArmPose | None = None
    other_arm: ArmPose | None = None
    both_arms: ArmPose | None = None
    head: HeadPose | None = None
    trunk: TrunkPose | None = None
    down: Span | None = None
    tilt: Span = (0.0, 0.0)

    @model_validator(mode="after")
    def _arms_once(self) -> Pose:
        if self.both_arms is not None and (self.arm is not None or self.other_arm is not None):
            raise ValueError("both_arms excludes arm and other_arm")
        return self


class Step(Strict):
    """One pose and for how long it is held [s], or poses that are repeated `count` times."""

    pose: str | None = None
    hold: Span = (0.0, 0.0)
    repeat: tuple[str, ...] = ()
    count: tuple[int, int] = (1, 1)

    @model_validator(mode="after")
    def _one_of(self) -> Step:
        if (self.pose is None) == (not self.repeat):
            raise ValueError("a step needs either pose or repeat")
        if not 1 <= self.count[0] <= self.count[1]:
            raise ValueError(f"count is {list(self.count)}, expected the least number, 1 or more, first")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Poses of the step."""
        return self.repeat if self.pose is None else (self.pose,)


class Gesture(Strict):
    """One gesture.

    Attributes:
        kind: label of its motions; `right` in it is the gesture's side.
        over: what the body does meanwhile.
        poses: by name.
        steps: in their order; the gesture begins and ends in the base.
        hand_speed: greatest speed of the hands in a stroke between two poses [m/s].
        head_speed, trunk_speed: likewise of the head against the trunk, and of the trunk [degrees/s].
        sink_speed: likewise of the pelvis, downwards and upwards [leg lengths/s].
        shortest: least duration of a stroke [s].
        touch: whether the hands may touch each other or the body.
        captions: sentences about a motion, beside the wordings of its kind; `{times}` is `once`, `twice` and so on.
    """

    kind: str
    over: tuple[Ground, ...] = ("stand",)
    poses: dict[str, Pose]
    steps: tuple[Step, ...] = Field(min_length=1)
    hand_speed: Span = (0.8, 2.2)
    head_speed: Span = (60.0, 180.0)
    trunk_speed: Span = (30.0, 80.0)
    sink_speed: Span = (0.4, 1.0)
    shortest: float = Field(default=0.3, gt=0.0)
    touch: bool = False
    captions: tuple[str, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _known_poses(self) -> Gesture:
        unknown = {name for step in self.steps for name in step.names} - set(self.poses)
        if unknown:
            raise ValueError(f"steps name unknown poses: {', '.join(sorted(unknown))}; known: {', '.join(self.poses)}")
        return self


class Recipes(Strict):
    """All gestures of a file."""

    gestures: tuple[Gesture, ...] = Field(min_length=1)


def usual(gesture: Gesture) -> Gesture:
    """A gesture with the middle of each span: of the angles of its poses, of holds and speeds."""
    return gesture.model_copy(update={name: _middle(value) for name, value in gesture})


def _middle(value: Any) -> Any:
    match value:
        case BaseModel():
            return value.model_copy(update={name: _middle(own) for name, own in value})
        case dict():
            return {name: _middle(own) for name, own in value.items()}
        case (float(least), float(greatest)):
            return ((least + greatest) / 2.0,) * 2
        case tuple():
            return tuple(_middle(own) for own in value)
    return value


@lru_cache
def recipes() -> tuple[Gesture, ...]:
    """The shipped gestures, in the order of the file."""
    text = resources.files("flexmotion").joinpath("data", FILE).read_text(encoding="utf-8")
    found = parse(Recipes, yaml_content(text), FILE).gestures
    kinds = [gesture.kind for gesture in found]
    if len(set(kinds)) < len(kinds):
        raise ConfigError(f"{FILE}: a kind is there twice")
    return found
