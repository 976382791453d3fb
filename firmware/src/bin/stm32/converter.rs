//! The eight emitters and ADC1, which sums conversions of their phototransistors with little work
//! for the core (RM0394, chapter 16; RM0440, chapter 21).
//!
//! The oversampler adds up 2, 4, 8 or 16 conversions before it interrupts the core ("Oversampler");
//! more 12-bit codes do not fit in its 16 bits without rounding. Other numbers are split into such
//! bursts, the largest first. The interrupt at the end of a burst starts the next and switches the
//! emitters, and TIM6 adds the settling time. So the task sleeps meanwhile.
#![expect(
    unsafe_code,
    reason = "an interrupt is handled and enabled here, and two codes are read from the system memory"
)]

use core::cell::RefCell;
use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering, compiler_fence};
use core::task::Poll;

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, AdcChannel};
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt::typelevel::{Binding, Handler, Interrupt};
use embassy_stm32::pac;
use embassy_stm32::pac::adc::regs::{Cfgr2, Sqr1};
use embassy_stm32::pac::timer::vals::{Mms, Urs};
use embassy_stm32::peripherals::{ADC1, TIM6};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::Timer;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::Instant;
use firmware::{Factory, FrontEnd};
use shared_proto::{CHANNELS, Vitals};

/// Longest pause between conversions, µs, with a margin. A conversion that starts more than 1 ms after the previous one
/// may be wrong (STM32L432xx/442xx errata, "Wrong ADC result if conversion done late after calibration or previous
/// conversion"); discarding it costs little on other chips.
const LONGEST_PAUSE_US: u64 = 900;

/// Exponent of the longest burst, 2⁴ conversions: 16 · 4095 is below 2¹⁶.
const LONGEST_BURST: u32 = 4;

/// Register bits whose types in the library differ by family: CR.ADSTP; CFGR.EXTEN and EXTSEL.
const ADSTP: u32 = 1 << 4;
const TRIGGER: u32 = 0b11 << 10 | 0b1_1111 << 5;

/// For reference and thermometer; together they take less than [`firmware::VITALS_US`].
const VITAL_CONVERSIONS: u8 = 4;

static EMITTERS: Mutex<CriticalSectionRawMutex, RefCell<Option<[Output<'static>; CHANNELS]>>> =
    Mutex::new(RefCell::new(None));

fn light(emitter: u8, on: bool) {
    EMITTERS.lock(|emitters| {
        let mut emitters = emitters.borrow_mut();
        let emitter = emitters.as_mut().and_then(|all| all.get_mut(usize::from(emitter)));
        emitter.into_iter().for_each(|emitter| emitter.set_level(on.into()));
    });
}

/// The task writes the state while the converter is idle, the interrupt while the converter runs.
static STATE: ConverterState = ConverterState {
    sums: [AtomicU32::new(0), AtomicU32::new(0), AtomicU32::new(0)],
    at: AtomicU8::new(0),
    last: AtomicU8::new(0),
    conversions: AtomicU8::new(0),
    left: AtomicU8::new(0),
    burst: AtomicU8::new(0),
    stays_fresh: AtomicBool::new(false),
    emitter: AtomicU8::new(0),
    trigger: AtomicU32::new(0),
    done: AtomicWaker::new(),
};

struct ConverterState {
    sums: [AtomicU32; 3],
    /// Index of the current sum; all sums are done when it exceeds `last`.
    at: AtomicU8,
    last: AtomicU8,
    conversions: AtomicU8,
    left: AtomicU8,
    /// Conversions in the current burst; zero to discard its result.
    burst: AtomicU8,
    /// True if the converter pauses less than [`LONGEST_PAUSE_US`] between two sums.
    stays_fresh: AtomicBool,
    emitter: AtomicU8,
    trigger: AtomicU32,
    done: AtomicWaker,
}

impl ConverterState {
    /// Starts a sum, after a conversion to discard if the converter was idle for long.
    fn begin(&self, is_fresh: bool) {
        let conversions = self.conversions.load(Ordering::Relaxed);
        self.left.store(conversions, Ordering::Relaxed);
        let (exponent, burst) = if is_fresh { longest_burst(conversions) } else { (0, 0) };
        self.burst.store(burst, Ordering::Relaxed);
        set_oversampling(exponent);
    }

    fn is_done(&self) -> bool {
        self.at.load(Ordering::Acquire) > self.last.load(Ordering::Relaxed)
    }

    fn end_burst(&self, codes: u16) {
        let at = self.at.load(Ordering::Relaxed);
        let burst = self.burst.load(Ordering::Relaxed);
        let left = self.left.load(Ordering::Relaxed).saturating_sub(burst);
        if let (Some(sum), true) = (self.sums.get(usize::from(at)), burst > 0) {
            sum.store(sum.load(Ordering::Relaxed) + u32::from(codes), Ordering::Relaxed);
        }
        stop();
        if left > 0 {
            self.left.store(left, Ordering::Relaxed);
            let (exponent, burst) = longest_burst(left);
            self.burst.store(burst, Ordering::Relaxed);
            set_oversampling(exponent);
            return start_burst();
        }
        self.at.store(at + 1, Ordering::Release);
        if self.is_done() {
            return self.done.wake();
        }
        light(self.emitter.load(Ordering::Relaxed), at == 0);
        self.begin(self.stays_fresh.load(Ordering::Relaxed));
        self.start_settled();
    }

    fn start_settled(&self) {
        let trigger = self.trigger.load(Ordering::Relaxed);
        pac::ADC1.cfgr().modify(|config| config.0 |= trigger);
        start_burst(); // at the trigger
        start_settling();
    }
}

/// Returns exponent and length of the next burst of a sum with `conversions` left (at least one).
fn longest_burst(conversions: u8) -> (u32, u8) {
    let exponent = conversions.checked_ilog2().unwrap_or(0).min(LONGEST_BURST);
    (exponent, 1 << exponent)
}

/// Sets bursts of 2^`exponent` conversions; the converter has to be stopped.
fn set_oversampling(exponent: u32) {
    // ROVSE and, from bit 2, OVSR, whose type in the library differs by family.
    let oversampling = exponent.checked_sub(1).map_or(0, |code| 1 | code << 2);
    pac::ADC1.cfgr2().write_value(Cfgr2(oversampling));
}

fn start_burst() {
    compiler_fence(Ordering::SeqCst);
    pac::ADC1.cr().modify(|control| control.set_adstart(true));
}

/// Stops the converter, which cannot be configured while it waits for the next trigger ("Stopping
/// an ongoing conversion").
fn stop() {
    if pac::ADC1.cr().read().adstart() {
        pac::ADC1.cr().modify(|control| control.0 |= ADSTP);
        while pac::ADC1.cr().read().adstart() {}
    }
    pac::ADC1.cfgr().modify(|config| config.0 &= !TRIGGER);
}

pub(crate) struct EndOfBurst;

impl<I: Interrupt> Handler<I> for EndOfBurst {
    unsafe fn on_interrupt() {
        if pac::ADC1.isr().read().eoc() {
            // Reading the data, the lower half of the register, clears the interrupt.
            STATE.end_burst(pac::ADC1.dr().read().0 as u16);
        }
    }
}

pub(crate) fn input_number(input: impl AdcChannel<ADC1>) -> u8 {
    input.degrade_adc().get_hw_channel()
}

pub(crate) struct Photointerrupters {
    _adc: Adc<'static, ADC1>,
    /// Inputs of the channels, and of reference and thermometer.
    channels: [u8; CHANNELS],
    vitals: [u8; 2],
    factory: Factory,
    timer: SettlingTimer,
    /// End of the last conversion; `None` before the first.
    last_us: Option<u64>,
}

impl Photointerrupters {
    /// Switches converter and timer on. `I` is the converter's interrupt, and `trigger` the EXTSEL
    /// and EXTEN bits of CFGR for TIM6. Sample times are already set and the emitters off.
    pub(crate) fn new<I: Interrupt>(
        adc: Adc<'static, ADC1>,
        (channels, vitals): ([u8; CHANNELS], [u8; 2]),
        timer: Peri<'static, TIM6>,
        trigger: u32,
        emitters: [Output<'static>; CHANNELS],
        _irqs: impl Binding<I, EndOfBurst>,
    ) -> Self {
        EMITTERS.lock(|position| _ = position.borrow_mut().replace(emitters));
        STATE.trigger.store(trigger, Ordering::Relaxed);
        pac::ADC1.cr().modify(|control| control.set_aden(true));
        while !pac::ADC1.isr().read().adrdy() {}
        pac::ADC1.ier().modify(|enabled| enabled.set_eocie(true));
        // SAFETY: the handler above is bound, and everything that it accesses is initialised.
        unsafe { I::enable() };
        let (factory, timer) = (factory_codes(), SettlingTimer::new(timer));
        Self { _adc: adc, channels, vitals, factory, timer, last_us: None }
    }

    async fn sum_of(&mut self, input: u8, conversions: u8, settling_us: u16) -> u32 {
        self.take(input, conversions, 1, settling_us, settling_us > 0).await;
        STATE.sums[0].load(Ordering::Relaxed)
    }

    /// Completes the sums. If the future is dropped earlier, the converter and an emitter stay on.
    async fn take(
        &mut self,
        input: u8,
        conversions: u8,
        sums: u8,
        settling_us: u16,
        settles_first: bool,
    ) {
        let pause_us = u64::from(settling_us);
        let start_us = Instant::now().as_micros() + if settles_first { pause_us } else { 0 };
        let is_fresh =
            self.last_us.is_some_and(|last_us| start_us.wrapping_sub(last_us) < LONGEST_PAUSE_US);
        STATE.sums.iter().for_each(|sum| sum.store(0, Ordering::Relaxed));
        STATE.at.store(0, Ordering::Relaxed);
        STATE.last.store(sums.saturating_sub(1), Ordering::Relaxed);
        STATE.conversions.store(conversions.max(1), Ordering::Relaxed);
        STATE.stays_fresh.store(pause_us < LONGEST_PAUSE_US, Ordering::Relaxed);
        let mut sequence = Sqr1::default(); // of length one
        sequence.set_sq(0, input);
        pac::ADC1.sqr1().write_value(sequence);
        self.timer.set(settling_us);
        STATE.begin(is_fresh);
        if settles_first {
            STATE.start_settled()
        } else {
            start_burst()
        }
        poll_fn(|context| {
            if STATE.is_done() {
                return Poll::Ready(());
            }
            STATE.done.register(context.waker());
            // The sums may have completed before the waker was registered.
            if STATE.is_done() { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        self.last_us = Some(Instant::now().as_micros());
    }
}

impl FrontEnd for Photointerrupters {
    fn light(&mut self, channel: Option<usize>) {
        (0..CHANNELS).for_each(|emitter| light(emitter as u8, channel == Some(emitter)));
    }

    async fn sum(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        match self.channels.get(channel) {
            Some(&input) => self.sum_of(input, conversions, settling_us).await,
            None => 0,
        }
    }

    async fn expose(&mut self, settling_us: u16, channel: usize, conversions: u8) -> [u32; 3] {
        let Some(&input) = self.channels.get(channel) else { return [0; 3] };
        STATE.emitter.store(channel as u8, Ordering::Relaxed);
        self.take(input, conversions, 3, settling_us, false).await;
        STATE.sums.each_ref().map(|sum| sum.load(Ordering::Relaxed))
    }

    /// The first conversion follows a frame immediately, so none is discarded.
    async fn vitals(&mut self) -> Vitals {
        let [reference, thermometer] = self.vitals;
        let reference = self.sum_of(reference, VITAL_CONVERSIONS, 0).await;
        let thermometer = self.sum_of(thermometer, VITAL_CONVERSIONS, 0).await;
        self.factory.vitals(reference, thermometer, VITAL_CONVERSIONS)
    }
}

/// Thermometer codes at 30 °C and 130 °C (DS11451, "Temperature sensor calibration values").
const COLD: *const u16 = 0x1FFF_75A8 as *const u16;
const HOT: *const u16 = 0x1FFF_75CA as *const u16;

fn factory_codes() -> Factory {
    // SAFETY: both addresses are in the chip's system memory, which is always readable.
    let (cold, hot) = unsafe { (COLD.read_volatile(), HOT.read_volatile()) };
    Factory { reference: pac::VREFINTCAL.data().read(), cold, hot }
}

/// TIM6 times the settling of an emitter (RM0394, chapter 29; RM0440, chapter 30): it counts µs
/// once, and its update event triggers the converter.
struct SettlingTimer(Timer<'static, TIM6>);

impl SettlingTimer {
    fn new(timer: Peri<'static, TIM6>) -> Self {
        let mut timer = Timer::new(timer);
        timer.set_tick_freq(Hertz::mhz(1));
        // One pulse; only the end of the count is an update.
        timer.regs_core().cr1().modify(|control| {
            control.set_opm(true);
            control.set_urs(Urs::COUNTER_ONLY);
        });
        timer.regs_basic().cr2().modify(|control| control.set_mms(Mms::UPDATE));
        Self(timer)
    }

    /// Sets the count, µs, at least two: the timer cannot count to zero.
    fn set(&self, us: u16) {
        let timer = self.0.regs_core();
        timer.arr().write(|reload| reload.set_arr(us.saturating_sub(1).max(1)));
        timer.cnt().write(|count| count.set_cnt(0));
    }
}

/// Starts the timer, from the converter's interrupt while the timer's owner waits for the sums.
fn start_settling() {
    pac::TIM6.cr1().modify(|control| control.set_cen(true));
}
