"""The control branch: it changes nothing at first, learns, resumes, is exported, and the sampler follows it."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree
from typing import TYPE_CHECKING

import numpy as np
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import CONTROL, Bundle  # noqa: E402
from flexmotion.features.constraint_layout import (  # noqa: E402
    ACTIVATIONS,
    FORCES,
    PATH,
    PLACES,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.constraints import Constraints  # noqa: E402
from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.training.constraint_draws import DRAWS, draw_constraints  # noqa: E402
from flexmotion.training.control_branch import ConstrainedDenoiser, ControlBranch  # noqa: E402
from flexmotion.training.control_task import ControlTask  # noqa: E402
from flexmotion.training.export import export, load_control, load_networks  # noqa: E402
from flexmotion.training.release import begin_run, write_release  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402

if TYPE_CHECKING:
    from tests.flexmotion.training.conftest import Stages

LAYOUT = ConstraintLayout(Layout(30.0, muscles=6))


def drawn(count: int = 400, known: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(count, 32, LAYOUT.size)).astype(np.float32)
    values[..., LAYOUT.blocks[TORQUE_LIMITS]] = values[..., LAYOUT.blocks[TORQUES]]
    asked, mask, kinds = draw_constraints(rng, LAYOUT, values, np.full((count, 32), known))
    return values, asked, mask, kinds


def of_kind(mask: np.ndarray, kinds: np.ndarray, name: str) -> np.ndarray:
    return mask[kinds == list(DRAWS).index(name)]


def test_every_kind_of_constraint_is_drawn() -> None:
    values, asked, mask, kinds = drawn()
    assert set(kinds) == set(range(len(DRAWS)))
    assert not of_kind(mask, kinds, "nothing").any()
    for name, block in (("hand", PLACES), ("path", PATH), ("forces", FORCES), ("muscles", ACTIVATIONS)):
        own = of_kind(mask, kinds, name)
        inside = own[..., LAYOUT.blocks[block]]
        assert inside.any(axis=(1, 2)).all()
    hands = of_kind(mask, kinds, "hand")
    assert set(hands.sum(axis=2).max(axis=1)) == {3}
    lengths = hands.any(axis=2).sum(axis=1)
    assert lengths.max() == 32 and lengths.min() <= 4  # whole windows, and keyframes
    # What is asked is what the window does; limits are no values of single frames.
    limits = np.zeros(LAYOUT.size, np.bool_)
    limits[LAYOUT.blocks[TORQUE_LIMITS]] = True
    np.testing.assert_array_equal(asked[..., ~limits], values[..., ~limits])
    peak = np.abs(values[..., limits]).max(axis=1)
    assert (asked[:, 0, limits] >= 0.8 * peak).all() and (asked[:, 0, limits] <= 1.2 * peak).all()


def test_forces_that_are_not_known_are_not_asked() -> None:
    _, _, mask, kinds = drawn(known=False)
    for name in ("torques", "limits", "forces", "muscles"):
        assert not of_kind(mask, kinds, name).any()
    assert of_kind(mask, kinds, "place").any()


def inputs_of(run: Run, latent: int, size: int = 3) -> list[torch.Tensor]:
    rng = np.random.default_rng(0)
    window, text = run.config.window, run.config.diffusion.text
    shapes = [(size, window.history, run.layout.size), (size, text), (size, 3), (size, text)]
    parts = [torch.from_numpy(rng.standard_normal(shape, np.float32)) for shape in [(size, latent), *shapes]]
    return [parts[0], torch.tensor([900] * size), *parts[1:], torch.ones(size, 3), torch.full((size, 2), 1.5)]


def test_a_new_branch_leaves_the_model_as_it_is(trained: Run) -> None:
    autoencoder, denoiser = load_networks(trained, distilled=True)
    branch = ControlBranch(denoiser, trained.config.control, trained.config.window, trained.layout)
    inputs = inputs_of(trained, autoencoder.latent)
    shape = (3, trained.config.window.future, ConstraintLayout(trained.layout).size)
    with torch.no_grad():
        found = ConstrainedDenoiser(denoiser, branch)(*inputs, torch.randn(shape), torch.ones(shape))
        np.testing.assert_allclose(found.numpy(), denoiser(*inputs).numpy(), atol=1e-6)


def test_training_changes_the_branch_alone_and_lowers_the_loss(trained: Run, stages: Stages, tmp_path: Path) -> None:
    copytree(trained.folder, tmp_path / "run")
    run = Run(tmp_path / "run")
    task = stages.control(run)
    before = load_networks(run, distilled=True)[1].state_dict()
    with torch.no_grad():
        first = task.validate()["loss"]
    done = stages.train(run, "control", task, steps=30)
    assert done.figures["loss"] < first
    after = task._denoiser.denoiser.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_a_branch_resumes_bit_for_bit(
    controlled: tuple[Run, ControlTask], trained: Run, stages: Stages, tmp_path: Path
) -> None:
    copytree(trained.folder, tmp_path / "run")
    run = Run(tmp_path / "run")
    stages.train(run, "control", stages.control(run), steps=3)
    stages.train(run, "control", stages.control(run))
    once = torch.load(controlled[0].stage("control") / "last.pt", weights_only=True)["network"]
    twice = torch.load(run.stage("control") / "last.pt", weights_only=True)["network"]
    assert all(torch.equal(once[name], twice[name]) for name in once)


def test_a_bundle_has_the_branch_and_the_sampler_follows_it(
    controlled: tuple[Run, ControlTask], tmp_path: Path
) -> None:
    run, _ = controlled
    bundle = export(run, tmp_path / "bundle", distilled=True)
    assert bundle.has_control and bundle.jacobian is not None
    autoencoder, denoiser = load_networks(run, distilled=True)
    session = onnxruntime.InferenceSession(str(bundle.folder / CONTROL))
    inputs = inputs_of(run, autoencoder.latent, 1)
    shape = (1, run.config.window.future, ConstraintLayout(run.layout).size)
    rng = np.random.default_rng(1)
    inputs += [torch.from_numpy(rng.standard_normal(shape, np.float32)), torch.ones(shape)]
    names = [one.name for one in session.get_inputs()]
    (found,) = session.run(None, {name: value.numpy() for name, value in zip(names, inputs, strict=True)})
    with torch.no_grad():
        np.testing.assert_allclose(found, load_control(run, denoiser)(*inputs).numpy(), atol=2e-3)

    sampler = Sampler(bundle)
    nothing = Constraints.none(sampler.layout, sampler.body, sampler.future)
    asked = nothing.torque("knee_flexion_r", slice(None), 20.0)
    standing = sampler.standing()
    plain, told = (sampler.sample(standing, Condition("walk forward", constraints=one), 1) for one in (nothing, asked))
    assert np.abs(plain.joints - told.joints).max() > 0


def test_a_bundle_without_a_branch_says_what_it_cannot_follow(bundle: Bundle) -> None:
    sampler = Sampler(bundle, balanced=False)
    nothing = Constraints.none(sampler.layout, sampler.body, sampler.future)
    limited = nothing.torque_limit("knee_flexion_r", slice(None), 20.0)
    with pytest.raises(ValueError, match="torque_limits: model stream has no control branch and its windows are not"):
        sampler.sample(sampler.standing(), Condition("walk forward", constraints=limited), 1)


def test_the_jacobian_of_a_bundle_is_that_of_its_decoder(bundle: Bundle) -> None:
    stored = Sampler(bundle)._solver._tangent
    arrays = dict(bundle.arrays)
    del arrays["jacobian"]
    without = Bundle(bundle.folder)
    without.__dict__["arrays"] = arrays
    measured = Sampler(without)._solver._tangent
    np.testing.assert_allclose(stored.rotations, measured.rotations, atol=2e-3)


def test_a_weights_file_carries_the_branch(controlled: tuple[Run, ControlTask], tmp_path: Path) -> None:
    run, _ = controlled
    release = write_release(run, tmp_path / "released.safetensors")
    assert "control" in release.header.stages
    begun = begin_run(release.path, tmp_path / "further", ["control"])
    assert (begun.stage("control") / "best.pt").is_file() and (begun.stage("distill") / "best.pt").is_file()
