//! Temperature and supply, from the factory calibration of an STM32L4.

use shared_proto::{COUNTS_PER_LSB, Vitals};

/// Supply during factory calibration, mV (DS11451, tables "Embedded internal voltage reference" and
/// "TS characteristics"; tolerances 10 mV and 5 °C).
const SUPPLY_MV: u32 = 3_000;

/// Temperatures of the thermometer's two codes.
const COLD_CDEG: i32 = 3_000;
const HOT_CDEG: i32 = 13_000;

/// Calibration codes that the factory writes into the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Factory {
    pub reference: u16,
    pub cold: u16,
    pub hot: u16,
}

impl Factory {
    pub fn vitals(&self, reference: u32, thermometer: u32, conversions: u8) -> Vitals {
        let conversions = u32::from(conversions.max(1));
        let counts = |sum: u32| (sum * u32::from(COUNTS_PER_LSB) + conversions / 2) / conversions;
        let (reference, thermometer) = (counts(reference), counts(thermometer));
        let factory = u32::from(self.reference) * u32::from(COUNTS_PER_LSB);
        let supply_mv = (SUPPLY_MV * factory + reference / 2).checked_div(reference);
        Vitals {
            temperature_cdeg: supply_mv.and_then(|supply| self.temperature(thermometer, supply)),
            supply_mv: supply_mv.and_then(|supply| u16::try_from(supply).ok()).filter(|&mv| mv > 0),
            reference: u16::try_from(reference).ok().filter(|&counts| counts > 0),
        }
    }

    /// Returns hundredths of a degree Celsius; `None` if out of range.
    fn temperature(&self, counts: u32, supply_mv: u32) -> Option<i16> {
        let per_step = i64::from(COUNTS_PER_LSB);
        let (cold, hot) = (i64::from(self.cold) * per_step, i64::from(self.hot) * per_step);
        // Scaled to the factory's supply.
        let counts = i64::from(counts) * i64::from(supply_mv) / i64::from(SUPPLY_MV);
        let span = i64::from(HOT_CDEG - COLD_CDEG);
        let above = (span * (counts - cold)).checked_div(hot - cold)?;
        i16::try_from(i64::from(COLD_CDEG) + above).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACTORY: Factory = Factory { reference: 1_655, cold: 1_035, hot: 1_380 };

    #[test]
    fn the_factorys_codes_give_the_factorys_conditions() {
        let vitals = FACTORY.vitals(4 * 1_655, 4 * 1_035, 4);
        let expected = Vitals {
            temperature_cdeg: Some(3_000),
            supply_mv: Some(3_000),
            reference: Some(16 * 1_655),
        };
        assert_eq!(vitals, expected);
        assert_eq!(FACTORY.vitals(1_655, 1_380, 1).temperature_cdeg, Some(13_000));
    }

    #[test]
    fn a_higher_supply_makes_both_codes_smaller() {
        // 3.3 V and 55 °C: 1655/1.1 and (1035 + 345/4)/1.1.
        let vitals = FACTORY.vitals(3_009, 2_038, 2);
        assert_eq!(vitals.supply_mv, Some(3_300));
        let off = vitals.temperature_cdeg.unwrap().abs_diff(5_500);
        // A step of the thermometer is 100 °C/345 · 1.1.
        assert!(off <= 32, "{off}");
    }

    #[test]
    fn invalid_codes_give_unknown_conditions() {
        assert_eq!(FACTORY.vitals(0, 0, 4), Vitals::default());
        let blank = Factory { reference: 0xFFFF, cold: 0xFFFF, hot: 0xFFFF };
        assert_eq!(blank.vitals(1_500, 1_000, 1).temperature_cdeg, None);
    }
}
