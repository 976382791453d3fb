//! What the factory has written into the chip about its thermometer and its reference.
#![expect(unsafe_code, reason = "two codes are read from the system memory")]

use embassy_stm32::pac;
use firmware::Factory;

/// Codes of the thermometer at 30 °C and at 130 °C (DS11451, table "Temperature sensor calibration
/// values").
const COLD: *const u16 = 0x1FFF_75A8 as *const u16;
const HOT: *const u16 = 0x1FFF_75CA as *const u16;

/// Reads the codes.
pub(crate) fn codes() -> Factory {
    // SAFETY: both addresses are in the system memory of this chip, which can always be read.
    let (cold, hot) = unsafe { (COLD.read_volatile(), HOT.read_volatile()) };
    Factory { reference: pac::VREFINTCAL.data().read(), cold, hot }
}
