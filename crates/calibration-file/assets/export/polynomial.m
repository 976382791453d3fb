    if size(readings, 2) ~= numel(CENTRE)
        error('%d channels are expected, found %d', numel(CENTRE), size(readings, 2));
    end
    % The index after the channels means no factor.
    scaled = [(readings - CENTRE) ./ SCALE, ones(size(readings, 1), 1)];
    features = ones(size(readings, 1), size(FACTORS, 1));
    for factor = 1:size(FACTORS, 2)
        features = features .* scaled(:, FACTORS(:, factor) + 1);
    end
    w = features * COEFFICIENTS;
end
