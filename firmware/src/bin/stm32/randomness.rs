//! Random bytes from the chip's noise (RM0394, chapter 24).

use embassy_stm32::pac;
use embassy_time::{Duration, Instant};

/// A word takes 42 cycles of the generator's clock, which is 40 MHz.
const LONGEST: Duration = Duration::from_millis(1);

/// Eight bytes; `None` if the generator does not give any. Its clock has to run.
pub(crate) fn nonce() -> Option<[u8; 8]> {
    pac::RCC.ahb2enr().modify(|enabled| enabled.set_rngen(true));
    pac::RNG.cr().modify(|control| control.set_rngen(true));
    let words = word().zip(word());
    pac::RNG.cr().modify(|control| control.set_rngen(false));
    pac::RCC.ahb2enr().modify(|enabled| enabled.set_rngen(false));
    let (first, second) = words.filter(|(first, second)| first != second)?;
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&first.to_le_bytes());
    bytes[4..].copy_from_slice(&second.to_le_bytes());
    Some(bytes)
}

/// One word, which is never zero.
fn word() -> Option<u32> {
    let deadline = Instant::now() + LONGEST;
    loop {
        let status = pac::RNG.sr().read();
        if status.seis() || status.ceis() {
            return None;
        }
        if status.drdy() {
            return Some(pac::RNG.dr().read()).filter(|&word| word != 0);
        }
        if Instant::now() > deadline {
            return None;
        }
    }
}
