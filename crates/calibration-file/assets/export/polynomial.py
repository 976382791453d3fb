def wrench(readings):
    """The wrenches of some frames: an array whose last axis has a column for each of AXES, N and N*m.

    The last axis of `readings` has a column for each channel, in counts."""
    readings = np.asarray(readings, float)
    if readings.shape[-1:] != CENTRE.shape:
        raise ValueError(f"{CENTRE.size} channels are expected, found {readings.shape[-1:]}")
    scaled = (readings - CENTRE) / SCALE
    one = np.ones(scaled.shape[:-1] + (1,))
    # The index after the channels means no factor.
    factors = np.concatenate([scaled, one], axis=-1)[..., FACTORS.astype(int)]
    return factors.prod(axis=-1) @ COEFFICIENTS
