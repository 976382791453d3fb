//! Rates of the serial line, as commands name them and as a divider makes them.
//!
//! ```text
//! rate = clock / divider        (RM0394, section 38.5.4, oversampling by 16)
//! ```
//!
//! Between two ends that are each off by less than 2 % every byte arrives: a receiver bears some 4 %
//! of both clocks' errors. The internal oscillator is off by up to 1 % besides (DS11451, table "HSI16
//! oscillator characteristics").

/// A rate that a line can be set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Baud {
    /// What it is called: what the other end is set to.
    pub name: u32,
    /// Periods of the clock in a bit.
    pub divider: u16,
    /// What comes of that, in baud.
    pub actual: u32,
}

/// Start bit, eight of data, stop bit.
const BITS_PER_BYTE: u32 = 10;

impl Baud {
    /// The rate of this name that is as near to `meant` as a divider of the clock makes it, all in Hz.
    const fn near(clock_hz: u32, name: u32, meant: u32) -> Self {
        let divider = (clock_hz + meant / 2) / meant;
        Self { name, divider: divider as u16, actual: clock_hz / divider }
    }

    /// What a line with this rate carries, in bytes per second.
    pub const fn bytes_per_s(self) -> u32 {
        self.actual / BITS_PER_BYTE
    }
}

/// Rates of a clock of 80 MHz; [`FIRST`] is that after a reset.
///
/// What is called 57,600 lies between the two that may be at the other end: 57,600, and what an XBee makes of
/// it with its clock of 16 MHz, 58,824.
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

/// The clock that [`RATES`] divide, Hz.
pub const CLOCK_HZ: u32 = 80_000_000;

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    /// The table of docs/nucleo.md.
    #[test]
    fn rates_are_those_of_the_documentation() {
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
    fn what_is_called_57600_is_as_far_from_the_xbee_as_from_57600() {
        let rate = f64::from(CLOCK_HZ) / f64::from(FIRST.divider);
        // Digi's modules divide 16 MHz by 16 times 17.
        let xbee = 16e6 / (16.0 * 17.0);
        assert!((rate / 57_600.0 - 1.0).abs() < 0.012 && (rate / xbee - 1.0).abs() < 0.012);
    }
}
