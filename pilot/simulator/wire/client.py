"""Lets a server drive a car: the loop of the real simulator's autonomous mode.

Two telemetries are on their way, and each answer to one (`steer`, or `manual`) earns the next. In
real time the car drives on meanwhile; as fast as it goes, time stands still until the answer is there.
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

TOKENS = 2  # telemetries on their way: the real client's "open" event fires twice
FRAME_SECONDS = 1 / 60  # between two frames, and at least between two telemetries, in real time
TICKS_PER_ANSWER = 2  # as fast as it goes: 40 ms, about what the real simulator takes
SILENCE_SECONDS = 5.0  # without an answer: then it is said
NUMBER = re.compile(r"\s*[-+]?[\d,]*\.?\d*(e[-+]?\d+)?\s*", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Summary:
    """What a drive by a server was like.

    Attributes:
        scores: how well it went, since the first answer.
        departures: times that a wheel left the road.
        wall_seconds: s by the clock since the first answer.
        answers: answers of the server; lost: those that the real simulator would not have survived.
        reconnects: connections after the first.
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
            f"{self.departures} departures from the road, {scores.interventions} put-backs; {self.answers} answers, "
            f"{self.lost} lost, {self.reconnects} reconnects"
        )


class Client:
    """The simulator towards a server.

    `run` drives until the end. A window calls `advance` once per frame instead, until `done`, and
    `close` at the end.

    Attributes:
        episode: the car on its track.
        command: steering and throttle, -1..1: the server's last.
        manual: steering and throttle of somebody at the keyboard, who then drives instead; None: the server drives.
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
        """Prepare; the car stands still until the first answer.

        Args:
            episode: the car on its track.
            picture: what the centre camera sees: 160x320x3 uint8 RGB.
            port, host: where the server is.
            realtime: by the clock; else two ticks of 20 ms per answer, as fast as it goes.
            referee: puts the car back and ends the drive; None: back when it is lost, and no end.
            patience: s by the clock without an answer after which `run` gives up; None: never.
            on_tick: called with every state.
        """
        self.episode, self.picture = episode, picture
        self.realtime, self.patience, self.on_tick = realtime, patience, on_tick
        self.referee = referee or Referee(episode, rule=WHEN_LOST)
        self.command = (0.0, 0.0)
        self.manual: tuple[float, float] | None = None
        self.answers = self.lost = 0
        self._link = Link(port, host, prompt=not realtime)
        self._owed = 0  # telemetries that were earned and not sent yet
        self._clock = TickClock()
        self._due = 0.0  # when the next telemetry may be sent
        self._began = self._ended = self._heard = time.monotonic()
        self._silent = False

    # Driving

    def run(self) -> Summary:
        """Drive until the end.

        Raises:
            KeyboardInterrupt: on Ctrl-C, after taking leave of the server.
            TimeoutError: the server's silence lasts longer than the patience.
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
        """One frame in real time, never waiting: hear the server, move the car, send telemetry.

        Args:
            seconds: since the last frame.
        """
        while (packet := self._link.poll()) is not None:
            self._owed += self._hear(packet)
        self._check_silence()
        if self.answers:
            self._move(self._clock.ticks(seconds))
        now = time.monotonic()
        if self._owed and now >= self._due:
            self._due = max(self._due, now - FRAME_SECONDS) + FRAME_SECONDS  # keeps the rate with uneven frames
            self._owed -= 1
            self._send_telemetry()

    def step(self, timeout: float = 0.0) -> bool:
        """As fast as it goes: hear one answer, move the car, send telemetry.

        Args:
            timeout: s to wait for the answer; time stands still meanwhile.

        Returns:
            Whether there was an answer.
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
        """The drive so far."""
        return Summary(
            score("drive", [self.referee.trajectory]),
            self.referee.departures,
            self._ended - self._began,
            self.answers,
            self.lost,
            max(self._link.greetings - 1, 0),
        )

    def close(self) -> None:
        """Take leave of the server."""
        self._link.close()

    def _move(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.done:
                break
            state = self.episode.advance(*(self.manual or self.command))
            self.referee.observe(state)
            if self.on_tick is not None:
                self.on_tick(state)
        self._ended = time.monotonic()

    # The server

    def _hear(self, packet: str) -> bool:
        """Whether a packet earns a telemetry."""
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
                "the server's answer is lost, as the real simulator would lose it without a word: %s. "
                "%d such, and the car gets no command any more",
                error,
                TOKENS,
            )

    def _check_silence(self) -> None:
        if not self._silent and self._link.greeted and time.monotonic() - self._heard > SILENCE_SECONDS:
            self._silent = True
            what = "the car keeps its last command" if self.realtime else "time stands still"
            log.warning("the server is connected and has not answered for %.0f s: %s", SILENCE_SECONDS, what)

    def _check_patience(self) -> None:
        if self.patience is not None and time.monotonic() - self._heard > self.patience:
            raise TimeoutError(f"no answer of a server for {self.patience:g} s")

    def _send_telemetry(self) -> None:
        telemetry = None if self.manual is not None else build_telemetry(self.episode, self.picture(self.episode))
        self._link.send(build_event("telemetry", telemetry))


def build_telemetry(episode: Episode, frame: Frame) -> dict[str, str]:
    """The argument of a telemetry event: all as strings, the steering in degrees, the speed in mph without a sign."""
    state, full_lock = episode.state, math.degrees(FULL_LOCK)
    return {
        "steering_angle": f"{full_lock * state.steering:z.4f}",
        "throttle": f"{max(state.throttle, 0.0):z.4f}",
        "speed": f"{abs(state.speed):.4f}",
        "image": base64.b64encode(encode_frame(frame)).decode(),
    }


def parse_steer(argument: Any) -> tuple[float, float]:
    """Steering and throttle, -1..1, of a steer event, read as the real simulator does on a PC with decimal points.

    Raises:
        ValueError: they are missing, no strings or no numbers: there the real one fails without a word.
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
        # a comma groups thousands: "0,25" reads as 25, which is full lock
        number = float(text.replace(",", "")) if NUMBER.fullmatch(text) else math.nan
    except ValueError:  # nothing but a sign or a point
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"its {name} is {text!r:.40}, not a number")
    return min(max(number, -1.0), 1.0)
