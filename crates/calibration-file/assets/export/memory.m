    % Frames of one recording in order, times in s unless memory is by row. For a recording in pieces, pass the
    % state that the previous piece returned.
    if nargin < 3 || isempty(state)
        state = struct('time', NaN, 'held', [], 'averages', [], 'rows', 0);
    end
    count = size(readings, 1);
    if ~BY_TIME
        times = state.rows + (0:count - 1);
    elseif nargin < 2 || numel(times) ~= count
        error('a time is expected for each frame');
    end
    state.rows = state.rows + count;
    terms = zeros(count, numel(TIME_CONSTANTS) * size(readings, 2));
    for row = 1:count
        step = times(row) - state.time;
        % Ignore a frame that arrives out of order.
        if ~(step < 0 && step >= -GAP)
            if step >= 0 && step <= GAP
                share = -expm1(-step ./ TIME_CONSTANTS(:));
                state.averages = state.averages + share .* (state.held - state.averages);
            else
                state.averages = repmat(readings(row, :), numel(TIME_CONSTANTS), 1);
            end
            state.time = times(row);
            state.held = readings(row, :);
        end
        term = (readings(row, :) - state.averages).';
        terms(row, :) = term(:).';
    end
    readings = [readings, terms];
