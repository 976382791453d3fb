//! ADC1: sums of conversions that the core has no part in.
//!
//! The oversampler adds conversions up, 2, 4, 8 or 16 of them, before it interrupts the core (RM0394,
//! chapter 16, "Oversampler"). Sixteen codes of 12 bits are the most that fit in its 16 bits without a shift,
//! and so without rounding. Any other number is made of such bursts, the largest first; the interrupt
//! at the end of one starts the next. The time in which an emitter settles is TIM6's, whose interrupt starts
//! the first: the task sleeps from switching an emitter to the end of its conversions.
#![expect(unsafe_code, reason = "interrupts are handled and enabled here")]

use core::future::poll_fn;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering, compiler_fence};
use core::task::Poll;

use embassy_stm32::Peri;
use embassy_stm32::adc::Adc;
use embassy_stm32::interrupt::typelevel::{self, Binding, Handler, Interrupt};
use embassy_stm32::pac;
use embassy_stm32::pac::adc::regs::{Cfgr2, Sqr1};
use embassy_stm32::pac::timer::regs::SrCore;
use embassy_stm32::pac::timer::vals::Urs;
use embassy_stm32::peripherals::{ADC1, TIM6};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::Timer;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::Instant;

/// A conversion later than 1 ms after the one before may be wrong, and is to be thrown away
/// (STM32L432xx/442xx errata, "Wrong ADC result if conversion done late after calibration or previous
/// conversion"), which costs others little. The margin is for starting it.
const LONGEST_PAUSE_US: u64 = 900;

/// The longest burst, as a power of two: 16 · 4095 is below 2¹⁶.
const LONGEST_BURST: u32 = 4;

/// What is being summed. The task writes it while the converter rests, the interrupts while it does not.
static STATE: State = State {
    left: AtomicU8::new(0),
    burst: AtomicU8::new(0),
    sum: AtomicU32::new(0),
    done: AtomicWaker::new(),
};

struct State {
    /// Conversions that are not in the sum yet.
    left: AtomicU8,
    /// How many of them the burst under way has; none where it is to be thrown away.
    burst: AtomicU8,
    sum: AtomicU32,
    done: AtomicWaker,
}

impl State {
    /// A sum of so many conversions begins, with one that is thrown away before them if the converter has
    /// rested for long.
    fn begin(&self, conversions: u8, is_fresh: bool) {
        self.sum.store(0, Ordering::Relaxed);
        self.left.store(conversions, Ordering::Relaxed);
        let (exponent, burst) = if is_fresh { longest_burst(conversions) } else { (0, 0) };
        self.burst.store(burst, Ordering::Relaxed);
        set_oversampling(exponent);
    }

    fn is_done(&self) -> bool {
        self.left.load(Ordering::Acquire) == 0
    }

    /// The burst has ended with this sum.
    fn end_burst(&self, codes: u16) {
        let burst = self.burst.load(Ordering::Relaxed);
        let left = self.left.load(Ordering::Relaxed).saturating_sub(burst);
        if burst > 0 {
            let sum = self.sum.load(Ordering::Relaxed) + u32::from(codes);
            self.sum.store(sum, Ordering::Relaxed);
        }
        self.left.store(left, Ordering::Release);
        if left == 0 {
            return self.done.wake();
        }
        let (exponent, burst) = longest_burst(left);
        self.burst.store(burst, Ordering::Relaxed);
        set_oversampling(exponent);
        start_burst();
    }
}

/// The next of the bursts that make so many conversions, at least one: the power of two, and its value.
fn longest_burst(conversions: u8) -> (u32, u8) {
    let exponent = conversions.checked_ilog2().unwrap_or(0).min(LONGEST_BURST);
    (exponent, 1 << exponent)
}

/// Conversions of a burst, as a power of two. The converter has to be at rest.
fn set_oversampling(exponent: u32) {
    // ROVSE and, from bit 2, OVSR; the library has another type for the latter in each family.
    let oversampling = exponent.checked_sub(1).map_or(0, |code| 1 | code << 2);
    pac::ADC1.cfgr2().write_value(Cfgr2(oversampling));
}

fn start_burst() {
    compiler_fence(Ordering::SeqCst);
    pac::ADC1.cr().modify(|control| control.set_adstart(true));
}

/// At the end of a burst.
pub(crate) struct EndOfBurst;

impl<I: Interrupt> Handler<I> for EndOfBurst {
    unsafe fn on_interrupt() {
        if pac::ADC1.isr().read().eoc() {
            // Reading the data takes the interrupt's cause away. They are the lower half of the register.
            STATE.end_burst(pac::ADC1.dr().read().0 as u16);
        }
    }
}

/// When an emitter has settled.
pub(crate) struct Settled;

impl Handler<typelevel::TIM6_DAC> for Settled {
    unsafe fn on_interrupt() {
        if pac::TIM6.sr().read().uif() {
            pac::TIM6.sr().write_value(SrCore::default()); // a zero clears
            start_burst();
        }
    }
}

/// The converter and the timer of settling.
pub(crate) struct Converter {
    _adc: Adc<'static, ADC1>,
    settling: Timer<'static, TIM6>,
    /// When the last conversion ended, in µs; `None` before the first.
    last_us: Option<u64>,
}

impl Converter {
    /// Switches both on; `I` is the converter's interrupt. Inputs have their sample times.
    pub(crate) fn new<I: Interrupt>(
        adc: Adc<'static, ADC1>,
        timer: Peri<'static, TIM6>,
        _irqs: impl Binding<I, EndOfBurst> + Binding<typelevel::TIM6_DAC, Settled>,
    ) -> Self {
        pac::ADC1.cr().modify(|control| control.set_aden(true));
        while !pac::ADC1.isr().read().adrdy() {}
        pac::ADC1.ier().modify(|enabled| enabled.set_eocie(true));

        let mut settling = Timer::new(timer);
        settling.set_tick_freq(Hertz::mhz(1));
        // One pulse; restarting the count is no interrupt.
        settling.regs_core().cr1().modify(|control| {
            control.set_opm(true);
            control.set_urs(Urs::COUNTER_ONLY);
        });
        settling.clear_update_interrupt();
        settling.enable_update_interrupt(true);

        // SAFETY: the handlers above are bound, and all that they touch is there.
        unsafe {
            I::enable();
            typelevel::TIM6_DAC::enable();
        }
        Self { _adc: adc, settling, last_us: None }
    }

    /// The sum of at least one conversion of an input, the first after so many µs.
    pub(crate) async fn sum(&mut self, input: u8, conversions: u8, settling_us: u16) -> u32 {
        let start_us = Instant::now().as_micros() + u64::from(settling_us);
        let is_fresh =
            self.last_us.is_some_and(|last_us| start_us.wrapping_sub(last_us) < LONGEST_PAUSE_US);
        STATE.begin(conversions.max(1), is_fresh);
        let mut sequence = Sqr1::default(); // of one
        sequence.set_sq(0, input);
        pac::ADC1.sqr1().write_value(sequence);
        match settling_us {
            0 => start_burst(),
            _ => self.start_in(settling_us),
        }
        poll_fn(|context| {
            if STATE.is_done() {
                return Poll::Ready(());
            }
            STATE.done.register(context.waker());
            // It may have become so before there was somebody to wake.
            if STATE.is_done() { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        self.last_us = Some(Instant::now().as_micros());
        STATE.sum.load(Ordering::Relaxed)
    }

    /// Starts the first burst in so many µs, at least two: the timer does not count to zero.
    fn start_in(&mut self, us: u16) {
        let timer = self.settling.regs_core();
        timer.arr().write(|reload| reload.set_arr(us.saturating_sub(1).max(1)));
        timer.egr().write(|event| event.set_ug(true));
        compiler_fence(Ordering::SeqCst);
        timer.cr1().modify(|control| control.set_cen(true));
    }
}
