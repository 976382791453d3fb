//! Colours that everyone can distinguish, also in grey print.

/// Lines and points, in the order of use: the palette of Okabe and Ito ("Color Universal Design",
/// 2008), without its yellow, which is too pale on white.
pub(super) const SERIES: [&str; 7] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];

/// The colour of a series by its number; colours begin anew where they end.
pub(super) fn series(number: usize) -> &'static str {
    SERIES[number % SERIES.len()]
}

/// Text and frames.
pub(super) const INK: &str = "#222222";
/// Grid lines.
pub(super) const GRID: &str = "#e4e4e4";
/// The zero line under a trace.
pub(super) const ZERO: &str = "#999999";
/// Behind the time that the robot is partly in a channel, and that it is wholly in it.
pub(super) const PARTLY_INSIDE: &str = "#e6e6e6";
/// Behind the time that the robot is wholly in a channel: in grey between the other and white.
pub(super) const INSIDE: &str = "#fbe9ea";
/// Spread about a mean.
pub(super) const SPREAD: &str = "#c9dcea";
/// Reference lines over densities: identity, no residual.
pub(super) const REFERENCE: &str = "#d55e00";

/// Ten equal steps through viridis (van der Walt and Smith, 2015), dark to light.
const VIRIDIS: [[u8; 3]; 10] = [
    [0x44, 0x01, 0x54],
    [0x48, 0x28, 0x78],
    [0x3e, 0x49, 0x89],
    [0x31, 0x68, 0x8e],
    [0x26, 0x82, 0x8e],
    [0x1f, 0x9e, 0x89],
    [0x35, 0xb7, 0x79],
    [0x6e, 0xce, 0x58],
    [0xb5, 0xde, 0x2b],
    [0xfd, 0xe7, 0x25],
];

/// The colour at `t` in 0..=1 of a sequential scale, dark (single points must be seen on white) to
/// light, as `#rrggbb`.
pub(super) fn sequential(t: f64) -> String {
    let position = t.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let index = (position as usize).min(VIRIDIS.len() - 2);
    let fraction = position - index as f64;
    let mut colour = String::from("#");
    for (&a, &b) in VIRIDIS[index].iter().zip(&VIRIDIS[index + 1]) {
        let mixed = f64::from(a) + fraction * (f64::from(b) - f64::from(a));
        colour.push_str(&format!("{:02x}", mixed.round() as u8));
    }
    colour
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_dark_to_light() {
        assert_eq!([sequential(0.0), sequential(1.0)], ["#440154", "#fde725"]);
        let luminance = |t: f64| {
            let colour = sequential(t);
            let channel = |i: usize| f64::from(u8::from_str_radix(&colour[i..i + 2], 16).unwrap());
            0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
        };
        let steps: Vec<f64> = (0..=20).map(|i| luminance(f64::from(i) / 20.0)).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
    }
}
