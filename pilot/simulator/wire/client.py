"""Client that lets a server drive the simulated car, like the Unity simulator's autonomous mode.

Two telemetry messages are in flight; each answer to one (`steer` or `manual`) triggers the next. In real time, the car
moves on meanwhile; in fast mode, simulated time stops until the answer has arrived.
"""

import base64
import logging
import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pilot.arrays import Frame
from pilot.data.frames import encode_frame
from pilot.interrupt import catch_interrupt
from pilot.simulator.clock import TickClock
from pilot.simulator.episode import CarState, Episode
from pilot.simulator.referee import WHEN_LOST, Referee
from pilot.simulator.scores import Scores, score
from pilot.simulator.wire.connection import HOST, PORT, Link, build_event, parse_event
from pilot.vehicle import FULL_LOCK

log = logging.getLogger("pilot")

TOKENS = 2  # telemetry messages in flight; two, because the Unity simulator's "open" event fires twice
FRAME_SECONDS = 1 / 60  # real time: interval of frames, and minimum interval of telemetry
TICKS_PER_ANSWER = 2  # fast mode; 40 ms, about the interval of the Unity simulator's telemetry
SILENCE_SECONDS = 5.0  # without an answer until a warning
Command = tuple[float, float]  # steering and throttle, -1..1 each
NUMBER = re.compile(r"\s*[-+]?[\d,]*\.?\d*(e[-+]?\d+)?\s*", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Summary:
    """Result of an episode driven by a server.

    Attributes:
        scores: of the trajectory since the first answer.
        departures: number of times that a wheel left the road.
        wall_seconds: wall-clock time in s since the first answer.
        answers: number of valid answers by the server.
        lost: number of invalid answers; no telemetry follows them, as in the Unity simulator.
        reconnects: number of connections after the first.
    """

    scores: Scores
    departures: int
    wall_seconds: float
    answers: int
    lost: int
    reconnects: int

    def __str__(self) -> str:
        scores = self.scores
        return (
            f"{scores.laps or 0:.2f} laps in {scores.seconds:.1f} s ({self.wall_seconds:.1f} s by the clock), "
            f"mean speed {scores.speed:.1f} mph; cross-track error {scores.cross_track_mean:.2f} m on average, "
            f"{scores.cross_track_max:.2f} m at most\n"
            f"{self.departures} departures from the road, {scores.interventions} interventions; "
            f"{self.answers} answers, {self.lost} lost, {self.reconnects} reconnects"
        )


class Client:
    """Connects an episode to a server that drives its car.

    `run` drives until the end. Alternatively, a window calls `advance` once per frame until `done`, then `close`.

    Attributes:
        episode: the car on its track.
        command: the server's last steering and throttle, -1..1.
        manual: returns steering and throttle of manual driving for each tick, used instead of `command`; None: the
            server drives. As in the Unity simulator, telemetry is empty then.
        answers, lost: as in Summary.
    """

    def __init__(
        self,
        episode: Episode,
        picture: Callable[[Episode], Frame],
        *,
        port: int = PORT,
        host: str = HOST,
        realtime: bool = True,
        referee: Referee | None = None,
        patience: float | None = None,
        on_tick: Callable[[CarState], None] | None = None,
    ) -> None:
        """Create a client; the car does not move before the first answer.

        Args:
            episode: the car on its track.
            picture: returns the centre camera's frame: 160x320x3 uint8 RGB.
            port, host: address of the server.
            realtime: run in real time; False: fast mode, two ticks of 20 ms per answer without waiting.
            referee: puts the car back and ends the drive; None: puts the car back by the rule `WHEN_LOST`, no end.
            patience: wall-clock time in s without an answer after which `run` raises TimeoutError; None: no limit.
            on_tick: called with the state after each tick.
        """
        self.episode, self.picture = episode, picture
        self.realtime, self.patience, self.on_tick = realtime, patience, on_tick
        self.referee = referee or Referee(episode, rule=WHEN_LOST)
        self.command = (0.0, 0.0)
        self.manual: Callable[[], Command] | None = None
        self.answers = self.lost = 0
        self._link = Link(port, host, prompt=not realtime)
        self._owed = 0  # answers to which no telemetry was sent yet
        self._clock = TickClock()
        self._due = 0.0  # earliest time of the next telemetry
        self._began = self._ended = self._heard = time.monotonic()
        self._silent = False

    # Driving

    def run(self) -> Summary:
        """Drive until the end.

        Raises:
            KeyboardInterrupt: on Ctrl-C or SIGTERM, after disconnecting from the server.
            TimeoutError: the server did not answer for `patience` seconds.
        """
        self._heard = then = time.monotonic()
        try:
            with catch_interrupt() as interrupt:
                while not (self.done or interrupt.asked):
                    self._check_patience()
                    if self.realtime:
                        time.sleep(max(then + FRAME_SECONDS - time.monotonic(), 0.0))
                        then, before = time.monotonic(), then
                        self.advance(then - before)
                    else:
                        self.step(0.1)
                interrupt.raise_if_asked()
        finally:
            self.close()
        return self.summary

    def advance(self, seconds: float) -> None:
        """Process one frame in real time without waiting: receive answers, move the car, send telemetry.

        Args:
            seconds: since the last call.
        """
        while (packet := self._link.poll()) is not None:
            self._owed += self._hear(packet)
        self._check_silence()
        if self.answers:
            self._move(self._clock.ticks(seconds))
        now = time.monotonic()
        if self._owed and now >= self._due:
            self._due = max(self._due, now - FRAME_SECONDS) + FRAME_SECONDS  # keeps the mean rate despite jitter
            self._owed -= 1
            self._send_telemetry()

    def step(self, timeout: float = 0.0) -> bool:
        """Perform one step in fast mode: receive one answer, move the car, send telemetry.

        Args:
            timeout: s to wait for the answer; simulated time stops meanwhile.

        Returns:
            Whether an answer was received.
        """
        packet = self._link.poll(timeout)
        self._check_silence()
        if packet is None or not self._hear(packet):
            return False
        self._move(TICKS_PER_ANSWER)
        self._send_telemetry()
        return True

    @property
    def done(self) -> bool:
        """Whether the drive is over."""
        return self.referee.over

    @property
    def summary(self) -> Summary:
        """Result of the drive so far."""
        return Summary(
            score("drive", [self.referee.trajectory]),
            self.referee.departures,
            self._ended - self._began,
            self.answers,
            self.lost,
            max(self._link.greetings - 1, 0),
        )

    def close(self) -> None:
        """Disconnect from the server."""
        self._link.close()

    def _move(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.done:
                break
            state = self.episode.advance(*(self.manual() if self.manual else self.command))
            self.referee.observe(state)
            if self.on_tick is not None:
                self.on_tick(state)
        self._ended = time.monotonic()

    # The server

    def _hear(self, packet: str) -> bool:
        """Process a packet; return whether it is an answer, which triggers the next telemetry."""
        if packet.startswith("0"):
            self._greet()
        if not packet.startswith("42"):
            return False
        try:
            name, argument = parse_event(packet)
            if name == "steer":
                self.command = parse_steer(argument)
        except ValueError as error:
            self._lose_token(error)
            return False
        if name in ("steer", "manual"):
            self._count_answer()
        return name in ("steer", "manual")

    def _greet(self) -> None:
        self._owed, self._heard = 0, time.monotonic()
        for _ in range(TOKENS):
            self._send_telemetry()

    def _count_answer(self) -> None:
        self._heard, self._silent = time.monotonic(), False
        if self.answers == 0:
            self._began = self._ended = self._heard
        self.answers += 1

    def _lose_token(self, error: ValueError) -> None:
        self.lost += 1
        if self.lost == 1:
            log.warning(
                "the server's answer is invalid; the real simulator would silently ignore it: %s. "
                "After %d of these, the car receives no more commands",
                error,
                TOKENS,
            )

    def _check_silence(self) -> None:
        if not self._silent and self._link.greeted and time.monotonic() - self._heard > SILENCE_SECONDS:
            self._silent = True
            what = "the car keeps its last command" if self.realtime else "simulated time stops"
            log.warning("the server is connected and has not answered for %.0f s: %s", SILENCE_SECONDS, what)

    def _check_patience(self) -> None:
        if self.patience is not None and time.monotonic() - self._heard > self.patience:
            raise TimeoutError(f"no answer of a server for {self.patience:g} s")

    def _send_telemetry(self) -> None:
        telemetry = None if self.manual is not None else build_telemetry(self.episode, self.picture(self.episode))
        self._link.send(build_event("telemetry", telemetry))


def build_telemetry(episode: Episode, frame: Frame) -> dict[str, str]:
    """Return the argument of a telemetry event, with all values as strings.

    The steering is in degrees, the throttle is 0..1, and the speed is in mph, positive also in reverse.
    """
    state, full_lock = episode.state, math.degrees(FULL_LOCK)
    return {
        "steering_angle": f"{full_lock * state.steering:z.4f}",
        "throttle": f"{max(state.throttle, 0.0):z.4f}",
        "speed": f"{abs(state.speed):.4f}",
        "image": base64.b64encode(encode_frame(frame)).decode(),
    }


def parse_steer(argument: Any) -> tuple[float, float]:
    """Parse the argument of a steer event as the Unity simulator does in a locale with decimal points.

    Returns:
        Steering and throttle, clipped to -1..1.

    Raises:
        ValueError: a value is missing, or not a string with a number; the Unity simulator fails silently then.
    """
    if not isinstance(argument, dict):
        raise ValueError(f"its argument is {argument!r:.40}, not an object")
    steering, throttle = (_number(argument, name) for name in ("steering_angle", "throttle"))
    return steering, throttle


def _number(argument: dict[str, Any], name: str) -> float:
    text = argument.get(name)
    if not isinstance(text, str):
        raise ValueError(f"its {name} is {text!r:.40}, not a string")
    try:
        # commas separate thousands: "0,25" is read as 25, which is full lock
        number = float(text.replace(",", "")) if NUMBER.fullmatch(text) else math.nan
    except ValueError:  # only a sign or a point
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"its {name} is {text!r:.40}, not a number")
    return min(max(number, -1.0), 1.0)
