//! Edges in a column of samples.

/// Shares of the range below which a signal is low and above which it is high.
const LOW: f64 = 0.4;
const HIGH: f64 = 0.6;

/// The rising edges of a signal, s, and the time between the samples around one, s (RMS; 0 without an edge).
///
/// A signal is low below 40 % of its range and high above 60 %; an edge lies in the middle between the last
/// low sample and the first high one. Samples that are not finite say nothing.
pub fn rising_edges(time_s: &[f64], values: &[f64]) -> (Vec<f64>, f64) {
    let finite = values.iter().filter(|value| value.is_finite());
    let (least, most) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), &value| {
        (least.min(value), most.max(value))
    });
    let range = most - least;
    let (mut edges, mut squares) = (Vec::new(), 0.0);
    if range.is_nan() || range <= 0.0 {
        return (edges, 0.0);
    }
    let (low, high) = (least + LOW * range, least + HIGH * range);
    let mut last_low = None;
    for (&time, &value) in time_s.iter().zip(values) {
        if value <= low {
            last_low = Some(time);
        } else if value >= high
            && let Some(before) = last_low.take()
        {
            edges.push(0.5 * (before + time));
            squares += (time - before) * (time - before);
        }
    }
    let resolution_s = (squares / edges.len().max(1) as f64).sqrt();
    (edges, resolution_s)
}
