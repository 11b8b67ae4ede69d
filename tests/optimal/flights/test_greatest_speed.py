"""No flight on a line passes a place faster than the bound, and a flight that draws back first reaches it."""

import numpy as np
import pytest

from optimal.flights.projection_bound import greatest_speed


def drawn_back(speed, ahead, back, distance):
    """Return the time of the bang-bang flight from rest to a speed after a distance, by integration of its parts."""
    w = np.sqrt(max(speed**2 / ahead - 2 * distance, 0.0) / (1 / ahead + 1 / back))
    times = [w / back, w / ahead, speed / ahead]
    x = v = 0.0
    for pull, time in zip((-back, ahead, ahead), times, strict=True):
        x, v = x + v * time + pull * time**2 / 2, v + pull * time
    return sum(times), x, v


@pytest.mark.parametrize("pulls", [(20.0, 20.0), (10.2, 29.8), (29.8, 10.2)])
def test_a_flight_that_draws_back_first_reaches_the_bound(pulls, generator):
    for _ in range(50):
        speed = generator.uniform(5, 30)
        before = generator.uniform(-5, speed**2 / 2 / pulls[0])
        after = generator.uniform(-5, speed**2 / 2 / pulls[1])
        first, x, v = drawn_back(speed, *pulls, before)
        assert (x, v) == (pytest.approx(before), pytest.approx(speed))
        last, *_ = drawn_back(speed, *pulls[::-1], after)
        limits = (first + 1.0, last + 1.0, first + last)
        found = greatest_speed(pulls, (before, before), (after, after), limits)
        assert found == pytest.approx(speed, rel=1e-9)
        assert greatest_speed(pulls, (before - 1, before), (after - 1, after), limits) >= found * (1 - 1e-12)


def test_random_flights_on_a_line_are_never_faster(generator):
    for _ in range(200):
        ahead, back, dt = generator.uniform(5, 30), generator.uniform(5, 30), 0.05
        pulls = generator.uniform(-back, ahead, 40)
        speeds = np.append(0.0, np.cumsum(pulls) * dt)
        stop = abs(speeds[-1]) / (back if speeds[-1] > 0 else ahead)
        places = np.append(0.0, np.cumsum((speeds[:-1] + speeds[1:]) / 2 * dt))
        end, total = places[-1] + speeds[-1] * stop / 2, 40 * dt + stop
        k = int(np.argmax(speeds))
        distances = (places[k], places[k]), (end - places[k], end - places[k])
        assert speeds[k] <= greatest_speed((ahead, back), *distances, (k * dt, total - k * dt, total)) + 1e-9
