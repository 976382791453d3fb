//! Colours that everyone can distinguish, also in grey print.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colour(pub(super) u32);

impl Colour {
    pub(super) fn rgb(self) -> [u8; 3] {
        let [_, rgb @ ..] = self.0.to_be_bytes();
        rgb
    }

    pub(super) fn hex(self) -> String {
        format!("#{:06x}", self.0)
    }
}

/// Palette of Okabe and Ito ("Color Universal Design", 2008) without yellow, too pale on white.
const SERIES: [u32; 7] = [0x0072b2, 0xd55e00, 0x009e73, 0xcc79a7, 0xe69f00, 0x56b4e9, 0x000000];

/// The colour of a series by its number; colours repeat after the last.
pub(super) const fn series(number: usize) -> Colour {
    Colour(SERIES[number % SERIES.len()])
}

pub(super) const INK: Colour = Colour(0x222222);
pub(super) const GRID: Colour = Colour(0xe4e4e4);
pub(super) const ZERO: Colour = Colour(0x999999);
/// Background of the time that the robot is partly in a channel.
pub(super) const PARTLY_INSIDE: Colour = Colour(0xe6e6e6);
/// Background of the time wholly in a channel: in grey between the other one and white.
pub(super) const INSIDE: Colour = Colour(0xfbe9ea);
pub(super) const SPREAD: Colour = Colour(0xc9dcea);
/// Reference lines over densities: identity, zero residual.
pub(super) const REFERENCE: Colour = Colour(0xd55e00);

/// Ten equal steps through viridis (van der Walt and Smith, 2015), dark to light.
const VIRIDIS: [u32; 10] = [
    0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b,
    0xfde725,
];

/// Colour at 0..=1 of a scale, from dark (single points must be visible on white) to light.
pub(super) fn sequential(t: f64) -> Colour {
    let position = t.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let index = (position as usize).min(VIRIDIS.len() - 2);
    let fraction = position - index as f64;
    let [from, to] = [index, index + 1].map(|index| Colour(VIRIDIS[index]).rgb().map(f64::from));
    let mixed = std::array::from_fn(|i| (from[i] + fraction * (to[i] - from[i])).round() as u8);
    let [red, green, blue] = mixed;
    Colour(u32::from_be_bytes([0, red, green, blue]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_dark_to_light() {
        assert_eq!([0.0, 1.0].map(|t| sequential(t).hex()), ["#440154", "#fde725"]);
        let luminance = |t: f64| {
            let [red, green, blue] = sequential(t).rgb().map(f64::from);
            0.2126 * red + 0.7152 * green + 0.0722 * blue
        };
        let steps: Vec<f64> = (0..=20).map(|i| luminance(f64::from(i) / 20.0)).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
    }
}
