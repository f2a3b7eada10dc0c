"""What the expert demonstrates: lines along the road, and recoveries to them."""

import numpy as np

from pilot.simulator.catalogue import load_track
from pilot.simulator.demonstration import DemonstrationConfig, demonstrate, lines
from pilot.simulator.episode import Episode
from pilot.vehicle import HALF_TRACK


def test_lines_lie_between_the_edges_and_on_two_lanes_reach_across_the_middle() -> None:
    for name in ("lake", "jungle"):
        track = load_track(name)
        left, right = lines(track, 0.3)
        assert lines(track, 0.0) == (track.lane, track.lane)
        edge = track.half_widths.min() - HALF_TRACK
        assert -edge < left < 0 <= track.lane < right < edge


def test_each_lap_follows_a_line_of_its_own() -> None:
    episode = Episode(load_track("mountain"))
    config = DemonstrationConfig(laps=2, rate=1.0, line_spread=0.8)
    driven = [(episode.laps, episode.where.lateral_offset) for _ in demonstrate(episode, config)]
    first, second = (np.median([offset for laps, offset in driven if lap + 0.1 < laps < lap + 1]) for lap in (0, 1))
    assert abs(first - second) > 0.3
    again = Episode(load_track("mountain"))
    assert [(again.laps, again.where.lateral_offset) for _ in demonstrate(again, config)] == driven


def test_a_recovery_leads_to_the_nearest_line() -> None:
    episode = Episode(load_track("jungle"))
    left, right = lines(episode.track, 0.3)
    recoveries: dict[float, list[float]] = {}
    for step in demonstrate(episode, DemonstrationConfig(laps=0, recoveries=40, rate=5.0, line_spread=0.3)):
        recoveries.setdefault(step.done, []).append(episode.where.lateral_offset)
    starts, ends = np.array([(offsets[0], offsets[-1]) for offsets in recoveries.values() if len(offsets) > 5]).T
    wanted = np.clip(starts, left, right)
    assert (np.abs(starts - wanted) > 0.5).sum() > 5
    assert np.abs(ends - wanted).mean() < 0.5


def test_half_of_the_recoveries_start_where_the_road_bends() -> None:
    episode = Episode(load_track("lake"))
    bends = np.quantile(np.abs(episode.track.curvatures), 0.8)
    config = DemonstrationConfig(laps=0, recoveries=100, rate=0.4)
    ahead = [
        np.abs(episode.track.curvature_ahead(episode.where.progress, 10.0)).max() for _ in demonstrate(episode, config)
    ]
    assert 95 < len(ahead) <= 100  # at this rate, the row at each recovery's start only
    assert np.mean(np.array(ahead) > bends) > 0.4
