"""Head-up display (HUD) of the window: speed, steering, laps, recording, help."""

from dataclasses import dataclass

from panda3d.core import (
    Camera,
    CardMaker,
    GraphicsOutput,
    NodePath,
    OrthographicLens,
    TextNode,
    TransparencyAttrib,
)

from pilot.simulator.episode import CarState

UNITS = 540.0  # height of the window in the units of this file, independent of its size in pixels
MARGIN = 18.0
STANDING_MPH, STANDING_SECONDS = 0.5, 3.0  # a car slower than this, for so long, has stopped
BAR, THICK, MARK = 260.0, 8.0, 10.0  # width and height of the steering bar, width of its mark
Rgba = tuple[float, float, float, float]
WHITE, RED, ORANGE, SHADE = (1, 1, 1, 1), (0.8, 0.1, 0.08, 0.9), (1, 0.72, 0.2, 1), (0, 0, 0, 0.45)


@dataclass
class LapClock:
    """Counts and times laps; it stops while the car stands.

    Attributes:
        laps: number of completed laps.
        seconds: time of the current lap.
        last: time of the last completed lap in s; None before.
    """

    laps: int = 0
    seconds: float = 0.0
    last: float | None = None
    _time: float = 0.0
    _stood_since: float | None = 0.0

    def update(self, time: float, laps: float, mph: float) -> None:
        """Update the clock; to be called once per frame.

        Args:
            time: s since the start.
            laps: since the start, with fraction.
            mph: speed of the car.
        """
        if abs(mph) > STANDING_MPH:
            self._stood_since = None
        elif self._stood_since is None:
            self._stood_since = time
        if not self.stopped:
            self.seconds += time - self._time
        self._time = time
        if laps >= self.laps + 1:
            self.laps, self.last, self.seconds = int(laps), self.seconds, 0.0

    @property
    def stopped(self) -> bool:
        """Whether the car has not moved yet, or has stood for some time."""
        since = self._stood_since
        return since is not None and (since == 0 or self._time - since > STANDING_SECONDS)

    def text(self) -> str:
        """Return a text with the number and time of the current lap and the time of the last one."""
        now = f"Lap {self.laps + 1}    {_clock(self.seconds)}"
        return now if self.last is None else f"{now}    last {_clock(self.last)}"


def _clock(seconds: float) -> str:
    return f"{int(seconds // 60)}:{seconds % 60:04.1f}"


class Hud:
    """Texts and a steering bar in a display region in front of the scene.

    Attributes:
        keys: text of the help: the keys and their functions.
        help: whether `keys` is shown.
        clock: counts the laps.
    """

    def __init__(self, output: GraphicsOutput) -> None:
        self.keys, self.help, self.clock = "", True, LapClock()
        self._root = NodePath("hud")
        self._root.set_depth_test(False)
        self._root.set_depth_write(False)
        self._root.set_transparency(TransparencyAttrib.M_alpha)
        self._lens = OrthographicLens()
        self._lens.set_near_far(-1, 1)
        region = output.make_display_region()
        region.set_sort(10)
        region.set_camera(self._root.attach_new_node(Camera("hud", self._lens)))
        self._speed = self._text(40, TextNode.A_left)
        self._laps = self._text(20, TextNode.A_left)
        self._recording = self._text(20, TextNode.A_right, card=RED)
        self._note = self._text(18, TextNode.A_center)
        self._warning = self._text(26, TextNode.A_center, ORANGE)
        self._keys = self._text(14, TextNode.A_center)
        self._bar = self._root.attach_new_node("bar")
        self._card(-BAR / 2, BAR / 2, THICK, SHADE)
        self._card(-1, 1, THICK, WHITE)
        self._mark = self._card(-MARK / 2, MARK / 2, THICK + 8, ORANGE)

    def resize(self, aspect: float) -> None:
        """Lay out the elements for an aspect ratio (width / height) of the window."""
        wide = UNITS * aspect
        self._lens.set_film_size(wide, UNITS)
        self._lens.set_film_offset(wide / 2, UNITS / 2)
        top, bottom = UNITS - MARGIN - 16, MARGIN + 30
        for node, x, y in (
            (self._speed, MARGIN, bottom),
            (self._laps, MARGIN, top),
            (self._bar, wide / 2, bottom + 8),
            (self._recording, wide - MARGIN, top),
            (self._note, wide / 2, top - 30),
            (self._warning, wide / 2, 0.72 * UNITS),
            (self._keys, wide / 2, MARGIN),
        ):
            node.set_pos(x, 0, y)
        self._keys.set_scale(min(14.0, wide / 54))  # so that it fits into a narrow window

    def show(self, state: CarState, laps: float, rows: int | None, note: str) -> None:
        """Update the contents.

        Args:
            state: of the car.
            laps: since the start, with fraction.
            rows: number of recorded rows; None while not recording.
            note: message to be displayed.
        """
        self.clock.update(state.time, laps, state.speed)
        _write(self._speed, f"{abs(state.speed):.0f} mph{' R' if state.speed < -0.5 else ''}")
        _write(self._laps, self.clock.text())
        _write(self._recording, "" if rows is None else f"RECORDING  {rows}")
        _write(self._note, note)
        _write(self._warning, "" if state.on_road else "OFF THE ROAD    Backspace: back to the road")
        _write(self._keys, self.keys if self.help else "")
        self._mark.set_x(state.steering * BAR / 2)

    def _text(self, size: float, align: int, colour: Rgba = WHITE, card: Rgba = SHADE) -> NodePath:
        text = TextNode("text")
        text.set_align(align)
        text.set_text_color(*colour)
        text.set_card_color(*card)
        text.set_card_as_margin(0.4, 0.4, 0.15, 0.15)
        text.set_bin("fixed")  # otherwise the card may be drawn over its text
        node = self._root.attach_new_node(text)
        node.set_scale(size)
        return node

    def _card(self, left: float, right: float, height: float, colour: Rgba) -> NodePath:
        maker = CardMaker("card")
        maker.set_frame(left, right, -height / 2, height / 2)
        maker.set_color(*colour)
        return self._bar.attach_new_node(maker.generate())


def _write(node: NodePath, text: str) -> None:
    if node.node().get_text() != text:  # because the layout of text is slow
        node.node().set_text(text)
