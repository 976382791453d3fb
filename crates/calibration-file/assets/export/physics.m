    % Each sensor responds with y = lo + h*sigma(q)^nu to a displacement q = b + a*x, where y and x are in the scales
    % of the training data. A frame is inverted by Gauss-Newton steps that minimise
    %     sum((y - f(x)).^2 ./ v) + x'*P*x,    v = sigma^2 + tau^2*(df/dq)^2 + g'*C*g
    % where x is the wrench, followed by the factors that all sensors share.
    % The steps are the same as in `shellcal convert`, except that dead sensors are not detected: pass NaN for
    % them.
    if size(readings, 2) ~= CHANNELS
        error('%d channels are expected, found %d', CHANNELS, size(readings, 2));
    end
    m.a = GAINS;
    m.b = PARAMETERS(:, 1);
    m.lo = PARAMETERS(:, 8);
    m.h = exp(PARAMETERS(:, 9));
    m.nu = exp(PARAMETERS(:, 10));
    m.c = COVARIANCE;
    m.noise = NOISE;
    m.prior = PRIOR;
    w = zeros(size(readings, 1), 6);
    for frame = 1:size(readings, 1)
        y = ((readings(frame, CHANNEL + 1) - LEAST) ./ RANGE)';
        used = isfinite(y);
        y(~used) = 0;
        x = descend(m, y, used);
        w(frame, :) = x(1:6)' .* WRENCH_SCALE;
    end
end

function x = descend(m, y, used)
    state = at(m, start(m, y, used), y, used);
    before = cost(m, state, state);
    step = newton(m, state);
    halvings = 0;
    for k = 1:16
        following = at(m, state.x + step, y, used);
        if cost(m, following, state) <= before
            before = cost(m, following, following);
            state = following;
            halvings = 0;
            [step, len] = newton(m, state);
            if len < 1e-6
                state.x = state.x + step;
                break
            end
        else
            step = step / 2;
            halvings = halvings + 1;
            if halvings >= 4
                break
            end
        end
    end
    x = state.x;
end

% Inverts each curve, which leaves a linear problem.
function x = start(m, y, used)
    share = min(max((y - m.lo) ./ m.h, 0.01), 0.99);
    ln_sigma = log(share) ./ m.nu;
    rest = -expm1(ln_sigma);
    slope = m.h .* m.nu .* share .* rest;
    variance = m.noise(1) + m.noise(2) * slope.^2 + (0.02 * m.h).^2;
    weight = used .* slope.^2 ./ variance;
    pull = weight .* (ln_sigma - log(rest) - m.b);
    x = (m.prior + m.a' * (m.a .* weight)) \ (m.a' * pull);
end

% The residual, slope and weight of every sensor.
function state = at(m, x, y, used)
    q = m.a * x + m.b;
    e = exp(-abs(q));
    ln_sigma = min(q, 0) - log1p(e);
    height = m.h .* exp(m.nu .* ln_sigma);
    above = ones(size(q));
    above(q >= 0) = e(q >= 0);
    slope = m.nu .* height .* above ./ (1 + e);
    gradient = [slope, slope * x(1:6)', ones(size(q)), height, m.nu .* height .* ln_sigma];
    unsure = zeros(size(q));
    for k = 1:numel(q)
        g = gradient(k, :);
        unsure(k) = g * m.c(10 * k - 9:10 * k, :) * g';
    end
    state.x = x;
    state.residual = y - m.lo - height;
    state.slope = slope;
    state.weight = used ./ (m.noise(1) + m.noise(2) * slope.^2 + unsure);
end

% The objective, with the weights of another state.
function sum_of = cost(m, of, by)
    sum_of = of.x' * m.prior * of.x + sum(by.weight .* of.residual.^2);
end

function [step, len] = newton(m, state)
    descent = m.a' * (state.weight .* state.slope .* state.residual) - m.prior * state.x;
    step = (m.prior + m.a' * (m.a .* (state.weight .* state.slope.^2))) \ descent;
    len = step' * descent;
end
