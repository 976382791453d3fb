# Each sensor responds with y = lo + h*sigma(q)**nu to a displacement q = b + a.x, where y and x are in the scales
# of the training data. A frame is inverted by Gauss-Newton steps that minimise
#     sum((y - f(x))**2 / v) + x.P.x,    v = sigma**2 + tau**2*(df/dq)**2 + g.C.g
# where x is the wrench, followed by the factors that all sensors share.
# The steps are the same as in `shellcal convert`, except that dead sensors are not detected: pass nan for them.

_B, _A, _LO = PARAMETERS[:, 0], GAINS, PARAMETERS[:, 7]
_H, _NU = np.exp(PARAMETERS[:, 8]), np.exp(PARAMETERS[:, 9])
_C = COVARIANCE.reshape(-1, 10, 10)


def wrench(readings):
    """The wrenches of some frames: an array whose last axis has a column for each of AXES, N and N*m.

    The last axis of `readings` has a column for each channel, in counts; nan is left out."""
    readings = np.asarray(readings, float)
    if readings.shape[-1] != CHANNELS:
        raise ValueError(f"{CHANNELS:g} channels are expected, found {readings.shape[-1]}")
    frames = readings.reshape(-1, readings.shape[-1])[:, CHANNEL.astype(int)]
    y = (frames - LEAST) / RANGE
    used = np.isfinite(y)
    x = _descend(np.where(used, y, 0.0), used)
    return (x[:, :6] * WRENCH_SCALE).reshape(readings.shape[:-1] + (6,))


def _descend(y, used):
    state = _state(_start(y, used), y, used)
    before = _sum(state, state)
    step = _step(state)[0]
    rest = np.zeros_like(step)
    active, halvings = np.ones(len(y), bool), np.zeros(len(y))
    for _ in range(16):
        following = _state(state[0] + step, y, used)
        taken = active & (_sum(following, state) <= before)
        before = np.where(taken, _sum(following, following), before)
        state = [np.where(taken[:, None], new, old) for new, old in zip(following, state)]
        next_step, length = _step(following)
        rests = taken & (length < 1e-6)
        rest = np.where(rests[:, None], next_step, rest)
        step = np.where(taken[:, None], next_step, 0.5 * step)
        halvings = np.where(taken, 0, halvings + 1)
        active &= ~rests & (halvings < 4)
        if not active.any():
            break
    return state[0] + rest


def _start(y, used):
    """Inverts each curve, which leaves a linear problem."""
    share = np.clip((y - _LO) / _H, 0.01, 0.99)
    ln_sigma = np.log(share) / _NU
    rest = -np.expm1(ln_sigma)
    slope = _H * _NU * share * rest
    variance = NOISE[0] + NOISE[1] * slope**2 + (0.02 * _H) ** 2
    weight = np.where(used, slope**2 / variance, 0.0)
    pull = weight * (ln_sigma - np.log(rest) - _B)
    return _solve(weight, pull @ _A)


def _state(x, y, used):
    """x, and for every sensor its residual, slope and weight."""
    q = x @ _A.T + _B
    e = np.exp(-np.abs(q))
    ln_sigma = np.minimum(q, 0.0) - np.log1p(e)
    height = _H * np.exp(_NU * ln_sigma)
    slope = _NU * height * np.where(q >= 0, e, 1.0) / (1.0 + e)
    gradient = np.stack(
        [slope, *(slope * x[:, axis, None] for axis in range(6)), np.ones_like(q), height, _NU * height * ln_sigma], -1
    )
    unsure = np.einsum("nki,kij,nkj->nk", gradient, _C, gradient)
    weight = np.where(used, 1.0 / (NOISE[0] + NOISE[1] * slope**2 + unsure), 0.0)
    return [x, y - _LO - height, slope, weight]


def _sum(of, by):
    """The objective, with the weights of another state."""
    return np.einsum("ni,ij,nj->n", of[0], PRIOR, of[0]) + (by[3] * of[1] ** 2).sum(axis=1)


def _step(state):
    x, residual, slope, weight = state
    descent = (weight * slope * residual) @ _A - x @ PRIOR
    step = _solve(weight * slope**2, descent)
    return step, (step * descent).sum(axis=1)


def _solve(weight, right):
    curvature = PRIOR + np.einsum("nk,ki,kj->nij", weight, _A, _A)
    return np.linalg.solve(curvature, right[:, :, None])[:, :, 0]
