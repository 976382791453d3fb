//! Flash that cannot be read.
//!
//! Each double word has a check code that corrects one wrong bit. Two are reported by the
//! non-maskable interrupt and go on being so at every reading (RM0394, section 3.3.2). A loss of
//! power while the calibration is written leaves such a double word in its pages, which is no reason
//! not to start.
#![expect(unsafe_code, reason = "an exception handler asks for it")]

use core::sync::atomic::{AtomicBool, Ordering};

use super::pages;
use embassy_stm32::pac;
use embassy_stm32::pac::flash::regs::Eccr;

static FAILED: AtomicBool = AtomicBool::new(false);

/// What follows is about readings from here on.
pub(crate) fn forget() {
    FAILED.store(false, Ordering::SeqCst);
}

/// Whether a double word of the calibration's pages could not be read since.
pub(crate) fn has_failed() -> bool {
    // The interrupt is taken before what comes after the barriers (Arm DDI0403, B1.5.14).
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    FAILED.load(Ordering::SeqCst)
}

// SAFETY: only an atomic and a register that nobody else writes are touched.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let eccr = pac::FLASH.eccr().read();
    let is_ours = pages::range().contains(&eccr.addr_ecc()) && !eccr.sysf_ecc();
    if eccr.eccd() && is_ours {
        let mut clear = Eccr::default();
        clear.set_eccd(true); // cleared by writing a one
        pac::FLASH.eccr().write_value(clear);
        FAILED.store(true, Ordering::SeqCst);
        return;
    }
    // The code itself is damaged, or the clock has failed.
    panic!("NMI, flash ECC register {:#010x}", eccr.0);
}
