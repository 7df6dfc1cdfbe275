"""Personalisation: fine-tunes a trained model on one person's clips.

Half of every step's loss is of the person's clips, whose manner is the person's, and half of the clips that the model
was trained on (prior preservation: Ruiz et al., DreamBooth, CVPR 2023), or of motion that the model sampled
before, where those are not at hand. Autoencoder, statistics and sentence encoder are not changed.

The fine-tuned network is for requests in the person's manner alone (`personal_export.py`). The other half keeps it able
to do, in that manner, kinds of motion that the person's clips do not show.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from shutil import copyfile, copytree
from typing import cast

from torch import Tensor, nn

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig
from flexmotion.dataset.compact_set import open_set
from flexmotion.text.manner_phrases import manner_phrases
from flexmotion.text.manners import NORMAL
from flexmotion.text.sayings import sayings
from flexmotion.text.sentence_encoder import NETWORK, SentenceEncoder
from flexmotion.training.autoencoder_task import load_autoencoder
from flexmotion.training.checkpoints import BEST, LAST, is_trained
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.examples import Examples, Halves, SetExamples
from flexmotion.training.feature_store import FeatureStore, build_store
from flexmotion.training.own_samples import OwnSamples
from flexmotion.training.processes import Processes
from flexmotion.training.release import begin_to_export
from flexmotion.training.run import CONFIG, FEATURES, ORIGIN, PERSON, PERSONAL, RELEASED, Run
from flexmotion.training.set_summary import SUMMARY
from flexmotion.training.stage import Task
from flexmotion.training.store_index import INDEX


class PersonalTask:
    """Fine-tuning of the denoiser; see `stage.Task`.

    Args:
        base: the trained model, on its training set or on its own samples.
        person: its diffusion on the person's clips; gets the network of `base`.
        prior: weight of the training set's loss, 0 to 1; the rest is the person's.
    """

    def __init__(self, base: Task, person: DiffusionTask, prior: float = 0.5) -> None:
        person.network = cast(Denoiser, base.network)
        self._base, self.person, self._prior = base, person, prior

    @property
    def network(self) -> nn.Module:
        """See `stage.Task`."""
        return self._base.network

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        kept, _ = self._base.losses(step)
        learnt, _ = self.person.losses(step)
        return self._prior * kept + (1 - self._prior) * learnt, {"kept": kept, "learnt": learnt}

    def validate(self) -> dict[str, float]:
        """Losses on the training set (`kept`) and on the person's clips (`learnt`)."""
        kept, learnt = self._base.validate()["loss"], self.person.validate()["loss"]
        return {"loss": self._prior * kept + (1 - self._prior) * learnt, "kept": kept, "learnt": learnt}


def always_asked(config: ModelConfig) -> ModelConfig:
    """The configuration with sentence and manner in every sample: without them, motion stays that of the model."""
    diffusion = config.diffusion.model_copy(update={"drop_text": 0.0, "drop_manner": 0.0})
    return config.model_copy(update={"diffusion": diffusion})


def training_of(path: Path, out: Path) -> Run:
    """The training that is personalised: that of a folder, or one that is made of a weights file.

    Args:
        path: folder of a training, or a weights file.
        out: folder of the personalised run. The training of a weights file is made in it (`RELEASED`), with the student
            and the control branch that the file or the files beside it hold: a bundle is made of them.

    Raises:
        ConfigError: see `begin_to_export`.
    """
    return begin_to_export(path, out / RELEASED) if path.is_file() else Run(path)


def personal_run(trained: Run, out: Path, manner: str) -> Run:
    """Make a new run with the stages of a trained one that personalisation keeps.

    Args:
        trained: with autoencoder, text and diffusion; where it is personalised itself, the new run keeps its person
            beside the new one.
        out: folder of the new run; an existing run there is resumed.
        manner: words that ask for it, such as "like Ada".

    Raises:
        ConfigError: a stage of the trained run is missing, the folder holds a personalisation of another training, or
            the words ask for something already.
    """
    require_free(manner, trained)
    for stage, name in (("autoencoder", BEST), ("diffusion", BEST), ("text", NETWORK)):
        if not (trained.stage(stage) / name).is_file():
            raise ConfigError(f"{trained.stage(stage)}: not trained; run 'flexmotion train {stage}' first")
    out.mkdir(parents=True, exist_ok=True)
    if not (out / CONFIG).is_file():
        copyfile(trained.folder / CONFIG, out / CONFIG)
        if trained.origin is not None:
            for name in (ORIGIN, SUMMARY):
                copyfile(trained.folder / name, out / name)
        copytree(trained.stage("text"), out / "text")
        for stage in ("autoencoder", "forces"):
            if is_trained(trained.stage(stage)):
                (out / stage).mkdir()
                copyfile(trained.stage(stage) / BEST, out / stage / BEST)
        if trained.has_features:  # as large as the set, and only read: linked, not copied
            (out / FEATURES).symlink_to((trained.folder / FEATURES).resolve(), target_is_directory=True)
    run = Run(out)
    run.link_before(trained)
    (out / PERSONAL).write_text(json.dumps([manner]), encoding="utf-8")
    return run


def require_free(manner: str, trained: Run) -> None:
    """Raise `ConfigError` where words cannot name a person: the model hears them as something else already."""
    said = manner.strip()
    if not said or said != manner:
        raise ConfigError(f"manner {manner!r}: expected words such as 'like Ada', without spaces around them")
    known = next((phrase.manner for phrase in manner_phrases(said) if phrase.manner is not None), None)
    if said.lower() == NORMAL or known is not None:
        raise ConfigError(f"manner {manner!r}: asks for the manner {known or NORMAL!r} already; choose other words")
    own = re.compile(rf"(?<!\w){re.escape(said)}(?!\w)", re.IGNORECASE)
    sentences = (sentence for _, sentence in sayings())
    if (inside := min(filter(own.search, sentences), key=len, default=None)) is not None:
        raise ConfigError(f"manner {manner!r}: is a part of {inside!r}, which would be done so; choose other words")
    if said.lower() in (name.lower() for name in persons(trained)):
        raise ConfigError(f"manner {manner!r}: {trained.folder} knows that person already; choose other words")


def persons(run: Run) -> tuple[str, ...]:
    """Manners of the persons that a run is personalised to, its own the last one."""
    own = run.personal_wordings()[:1]
    return (*persons(run.before()), *own) if own else ()


def impersonal(run: Run) -> Run:
    """The training of a run before it was personalised to anyone."""
    return impersonal(run.before()) if run.personal_wordings() else run


def personal_task(
    run: Run, trained: Run, data: Path, manner: str, progress: Callable[[float], None] = lambda done: None
) -> PersonalTask:
    """The task of a personalisation; its network has the trained weights.

    Args:
        run: made by `personal_run`.
        trained: run that it began from. Where that is personalised itself, the denoiser before its person is
            fine-tuned.
        data: set of the person's clips, made by `data build`.
        manner: as in `personal_run`.
        progress: called with the share of the features computed, 0 to 1.

    Raises:
        ConfigError: the personalisation that has begun is on other clips.
    """
    begun = (run.stage("diffusion") / LAST).is_file()
    store = build_store(open_set(data), run.layout, run.folder / PERSON, progress, begun=begun)
    person, kept = _person_and_rest(run, store, impersonal(trained).stage("diffusion"), (manner,))
    return PersonalTask(kept, person)


def personal_teacher(run: Run) -> tuple[DiffusionTask, Examples]:
    """The diffusion of a personalised run, and the windows that its student is distilled on.

    Half of them are of the person's clips, in the person's manner; the rest of the clips that the model was trained on,
    or where those are not at hand, of motion that it samples.

    Returns:
        The diffusion, on the person's clips; the windows.

    Raises:
        ConfigError: the run has not been personalised yet.
    """
    if not (run.folder / PERSON / INDEX).is_file() or not is_trained(run.stage("diffusion")):
        raise ConfigError(f"{run.folder}: not personalised yet; run 'flexmotion personalize' first")
    store = FeatureStore(run.folder / PERSON)
    person, rest = _person_and_rest(run, store, run.stage("diffusion"), run.personal_wordings())
    others = rest if isinstance(rest, OwnSamples) else SetExamples(rest)
    return person, Halves(others, SetExamples(person))


def _person_and_rest(
    run: Run, store: FeatureStore, trained: Path, manner: tuple[str, ...]
) -> tuple[DiffusionTask, DiffusionTask | OwnSamples]:
    """The diffusion on the person's clips, and on what the model was trained on, or where that is not at hand, samples.

    Args:
        run: personalised, or about to be.
        store: of the person's clips.
        trained: folder of the denoiser's weights.
        manner: wordings of the person's.
    """
    autoencoder = load_autoencoder(run)
    encode, processes = SentenceEncoder(run.stage("text")), Processes()
    # The networks were trained on features normalised by the statistics of their own set.
    base_store = run.store() if run.has_features else None
    store.statistics = run.summary().statistics if base_store is None else base_store.statistics
    person = DiffusionTask(
        always_asked(run.config), store, autoencoder, encode, run.seed, processes, manner, _held_out(store), trained
    )
    if base_store is None:
        return person, OwnSamples(person, encode, run.summary(), run.seed, run.config.diffusion)
    return person, DiffusionTask(run.config, base_store, autoencoder, encode, run.seed, processes, trained=trained)


def _held_out(store: FeatureStore) -> str:
    """Split of the validation: a few clips may have none of it."""
    return "validation" if any(clip.split == "validation" for clip in store.clips) else "train"
