"""`meanings_of`: what each figure of `evaluate` is, and its unit, for people who read a table."""

from __future__ import annotations

MEANINGS: dict[str, str] = {
    "fid": "Fréchet distance of embedded windows from other held-out ones; less is nearer to real motion",
    "r_precision_top1": "share of sentences whose window is the nearest of 32; `top2`, `top3`: among 2, 3",
    "mm_distance": "distance of a window's embedding from that of its sentence",
    "diversity": "distance of two windows' embeddings",
    "multimodality": "distance of the embeddings of two samples of one sentence",
    "skate_ratio": "share of frames in which a heel or toe below 5 cm moves faster than .5 m/s",
    "skate_mm": "way of the lowest heel or toe per frame while it is on the floor [mm]",
    "float_mm": "height of the lowest heel or toe above the floor, beyond 5 mm [mm]",
    "penetrate_mm": "its depth below the floor, beyond 5 mm [mm]",
    "jerk": "mean jerk of the body's points [m/s³]; `jerk_peak`: the greatest; `jerk_join`: where it joins the past",
    "contact_force": "distance of ground forces from those recomputed from the motion [% of body weight]",
    "actuation": "distance of joint torques from inverse dynamics [N·m/kg]",
    "euler_force": "force on the root that torques and ground forces leave over [% of body weight]",
    "euler_moment": "likewise the moment [N·m/kg]",
    "muscle_limit": "muscles times frames with an activation outside [0, 1] [%]",
    "joint_tension": "joint contact forces that pull a joint apart [%]",
    "residual_force": "force on the root that the ground's forces leave, motion differentiated anew [% of body weight]",
    "residual_moment": "likewise the moment [% of body weight x m]; `_p95`: 95th percentile of the frames",
    "zmp_outside": "loaded frames whose zero-moment point is outside the soles [%]",
    "ground_impossible": "loaded feet with a force that no ground gives [%]",
    "muscle_torque": "frames with a torque beyond what muscles produce [%]",
    "joint_contact": "distance of joint contact forces from those that dynamics and muscles need [body weights]",
    "moved_by_planting": "way of the body's points that planting the feet moves them [mm]",
    "moved_by_projection": "likewise the projection onto what the ground can give [mm]",
    "trajectory_error": "share of windows with an asked place off by more than .5 m",
}
"""Metric -> what it is. Sources of the formulas stand where they are computed."""

DELIVERED = "delivered_"
"""How the names of figures of delivered windows begin."""
_DELIVERED = "the same of windows as `Sampler.sample` delivers them; without it they are as the decoder gives them"


def meanings_of(metrics: list[str]) -> list[str]:
    """A line for each of these metrics that has a meaning, in Markdown; some lines explain several."""
    bare = dict.fromkeys(metric.removeprefix(DELIVERED) for metric in metrics)
    lines = [f"`{name}`: {MEANINGS[name]}" for name in bare if name in MEANINGS]
    return [*lines, f"`{DELIVERED}…`: {_DELIVERED}"] if any(one.startswith(DELIVERED) for one in metrics) else lines
