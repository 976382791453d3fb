

_wrench_of_columns = wrench


class State:
    """The memory of the sensor between calls of `wrench`."""

    def __init__(self):
        self.time = np.nan
        self.held = None
        self.averages = None
        self.rows = 0


def wrench(readings, times=None, state=None):
    """The wrenches of consecutive frames of one recording: a row for each, a column for each of AXES, N and N*m.

    `readings` has a row for each frame and a column for each channel, in counts; `times` has their times in s, unless
    memory is by row. For a recording in pieces, pass the same `State` each time."""
    readings = np.asarray(readings, float)
    state = State() if state is None else state
    if not BY_TIME:
        times = state.rows + np.arange(len(readings))
    elif times is None or len(times) != len(readings):
        raise ValueError("a time is expected for each frame")
    state.rows += len(readings)
    decay = np.atleast_1d(TIME_CONSTANTS)
    terms = np.empty((len(readings), decay.size, readings.shape[-1]))
    for row, (time, reading) in enumerate(zip(times, readings)):
        step = time - state.time
        # Ignore a frame that arrives out of order.
        if not -GAP <= step < 0:
            if 0 <= step <= GAP:
                share = -np.expm1(-step / decay)[:, np.newaxis]
                state.averages = state.averages + share * (state.held - state.averages)
            else:
                state.averages = np.tile(reading, (decay.size, 1))
            state.time, state.held = time, reading
        terms[row] = reading - state.averages
    return _wrench_of_columns(np.concatenate([readings, terms.reshape(len(readings), -1)], axis=-1))
