//! Baud rates of the serial line: nominal rates, as in commands, and the actual rates of the dividers.
//!
//! ```text
//! rate = clock / divider    (RM0394, section 38.5.4, oversampling by 16)
//! ```
//!
//! A receiver tolerates about 4 % of both clocks' errors together, so 2 % at either end. The
//! internal oscillator adds up to 1 % (DS11451, table "HSI16 oscillator characteristics").

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Baud {
    /// The nominal rate, set at the other end.
    pub name: u32,
    pub divider: u16,
    pub actual: u32,
}

/// Start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u32 = 10;

impl Baud {
    /// Returns the rate closest to `meant` that a divider can produce; all in Hz.
    const fn near(clock_hz: u32, name: u32, meant: u32) -> Self {
        let divider = (clock_hz + meant / 2) / meant;
        Self { name, divider: divider as u16, actual: clock_hz / divider }
    }

    pub const fn bytes_per_s(self) -> u32 {
        self.actual / BITS_PER_BYTE
    }
}

/// Rates with a clock of 80 MHz. The rate for 57,600 lies between the two that the other end may have: 57,600 itself,
/// and 58,824, which an XBee derives for it from its 16 MHz clock.
pub const RATES: [Baud; 9] = [
    Baud::near(CLOCK_HZ, 9_600, 9_600),
    Baud::near(CLOCK_HZ, 19_200, 19_200),
    Baud::near(CLOCK_HZ, 38_400, 38_400),
    FIRST,
    Baud::near(CLOCK_HZ, 115_200, 115_200),
    Baud::near(CLOCK_HZ, 230_400, 230_400),
    Baud::near(CLOCK_HZ, 460_800, 460_800),
    Baud::near(CLOCK_HZ, 921_600, 921_600),
    Baud::near(CLOCK_HZ, 1_000_000, 1_000_000),
];

/// The rate after a reset.
pub const FIRST: Baud = Baud::near(CLOCK_HZ, 57_600, 58_200);

pub const CLOCK_HZ: u32 = 80_000_000;

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    #[test]
    fn rates_equal_those_of_the_documentation() {
        let docs = include_str!("../../docs/nucleo.md");
        for rate in RATES {
            let exact = f64::from(CLOCK_HZ) / f64::from(rate.divider);
            let error = 100.0 * (exact / f64::from(rate.name) - 1.0);
            let row = std::format!("| {} | {exact:.0} | {error:+.2} % |", rate.name);
            assert!(docs.contains(&row), "{row}");
            assert_eq!(f64::from(rate.actual), exact.floor());
        }
    }

    #[test]
    fn the_board_rate_differs_equally_from_the_xbee_rate_and_from_57600() {
        let rate = f64::from(CLOCK_HZ) / f64::from(FIRST.divider);
        // Digi's modules divide 16 MHz by 16 times 17.
        let xbee = 16e6 / (16.0 * 17.0);
        assert!((rate / 57_600.0 - 1.0).abs() < 0.012 && (rate / xbee - 1.0).abs() < 0.012);
    }
}
