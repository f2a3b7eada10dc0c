"""Progress bars for long operations, with a common interface, so that callers and tests can omit or replace them."""

from collections.abc import Iterable
from typing import Protocol, TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


class ProgressBar(Protocol[Item]):
    """Interface of progress bars: passes items on and shows how many have been consumed."""

    def __call__(self, items: Iterable[Item], total: int, title: str, /) -> Iterable[Item]:
        """Return an iterable over the same items.

        Args:
            items: items to pass on.
            total: number of items, or of the units that the bar counts instead (such as the images of batches).
            title: text next to the bar.
        """


def no_bar(items: Iterable[Item], _total: int, _title: str, /) -> Iterable[Item]:
    """Return the items without showing a bar."""
    return items


def terminal_bar(items: Iterable[Item], total: int, title: str, /) -> Iterable[Item]:
    """Show a bar in the terminal, removed when it is complete."""
    yield from tqdm(items, title, total, leave=False)
