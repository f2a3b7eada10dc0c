"""What an ONNX file of this program says about itself, as JSON in the file's metadata."""

import json
from dataclasses import dataclass, field
from typing import Any

from pilot.model.checkpoint import to_jsonable
from pilot.portable.preprocessing import Preprocessing, preprocessing_from
from pilot.signature import STEERING_ONLY, Signature, signature_from

METADATA_KEY = "behavioral-cloning steering model"
VERSION = 2  # 1 had no signature
LARGEST_CARD = 1 << 20  # bytes


@dataclass(frozen=True)
class ModelCard:
    """What is known about a model.

    Attributes:
        name: of the network.
        config: the training options, as plain values.
        data: summary of the training data.
        metrics: validation metrics.
        preprocessing: of a network of another project; None: the network takes frames as they are.
        signature: what the network takes and returns.
    """

    name: str
    config: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    preprocessing: Preprocessing | None = None
    signature: Signature = STEERING_ONLY

    def to_json(self) -> str:
        """Return the card as text."""
        prepared = self.preprocessing.to_json() if self.preprocessing else None
        content = {"version": VERSION, "network": self.name, "config": self.config, "data": self.data}
        content |= {"metrics": self.metrics, "preprocessing": prepared, "signature": self.signature}
        return json.dumps(to_jsonable(content))


def read_card(text: str) -> ModelCard:
    """Read a card.

    Raises:
        ValueError: the text is no card of this program, or of a newer version.
    """
    content = json.loads(text) if len(text) <= LARGEST_CARD else None
    parts = ("config", "data", "metrics")
    if not isinstance(content, dict) or not all(isinstance(content.get(part), dict) for part in parts):
        raise ValueError("its metadata are damaged")
    if content.get("version") not in range(1, VERSION + 1):
        raise ValueError(f"made by a newer version of this program (version {content.get('version')!r})")
    prepared = content.get("preprocessing")
    return ModelCard(
        str(content.get("network")),
        content["config"],
        content["data"],
        content["metrics"],
        None if prepared is None else preprocessing_from(prepared),
        signature_from(content.get("signature", {})),
    )
