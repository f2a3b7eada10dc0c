"""Progress bars for long work, in one form, so that programs and tests can leave them out or put their own in place."""

from collections.abc import Iterable
from typing import Protocol, TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


class ProgressBar(Protocol[Item]):
    """Passes items on one by one, and shows how many have been taken."""

    def __call__(self, items: Iterable[Item], total: int, title: str, /) -> Iterable[Item]:
        """The same items; `total` of them, or of what they count as (images, for batches)."""


def no_bar(items: Iterable[Item], _total: int, _title: str, /) -> Iterable[Item]:
    """Show nothing."""
    return items


def terminal_bar(items: Iterable[Item], total: int, title: str, /) -> Iterable[Item]:
    """A bar in the terminal that vanishes when it is complete."""
    yield from tqdm(items, title, total, leave=False)
