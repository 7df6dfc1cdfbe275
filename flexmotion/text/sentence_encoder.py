"""`SentenceEncoder`: sentences to vectors by a small exported network, without torch and offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.onnx_session import open_session, run
from flexmotion.text.word_pieces import WordPieces

NETWORK, VOCABULARY = "text.onnx", "vocabulary.txt"


class SentenceEncoder:
    """Sentence embeddings of unit length.

    Args:
        folder: with the network and its vocabulary.

    Attributes:
        pieces: splits sentences into numbers of word pieces.
        size: of an embedding.

    Raises:
        ConfigError: one of the files is missing or damaged.
    """

    def __init__(self, folder: Path) -> None:
        try:
            words = (folder / VOCABULARY).read_text(encoding="utf-8").split("\n")
        except OSError as error:
            raise ConfigError(f"{folder / VOCABULARY}: cannot be read ({error.strerror})") from error
        self.pieces = WordPieces(words)
        self._path = folder / NETWORK
        self._session: onnxruntime.InferenceSession = open_session(self._path)
        self.size = int(self._session.get_outputs()[0].shape[-1])

    def __call__(self, sentence: str) -> NDArray[np.float32]:
        """Embedding of a sentence, (size,); zeros for a sentence without words."""
        pieces = self.pieces(sentence)
        if not pieces:
            return np.zeros(self.size, np.float32)
        embedding: NDArray[np.float32] = run(self._session, self._path, {"pieces": np.array([pieces], np.int64)})[0]
        return embedding
