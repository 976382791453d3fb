//! Edges at PA15, with the time of the interrupt that they raise.
//!
//! The time is taken first thing in the handler: late by its entry and, where another handler or a
//! critical section is under way, by that: some µs, and 25 ms while a page of the flash is erased. A test
//! on the model holds it to 20 µs.
#![expect(unsafe_code, reason = "an interrupt handler asks for it")]

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use core::task::Poll;

use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::interrupt::typelevel::{Binding, EXTI15_10, Handler};
use embassy_stm32::{Peri, interrupt, pac, peripherals};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Instant, Timer};
use firmware::{SeenEdge, SyncInput};

/// The pin, and the line of the EXTI that is its.
const LINE: usize = 15;

/// Edges that can wait to be taken.
const WAITING: usize = 8;

/// Edges that are counted where there is no room for them, before the input is deaf for a time: what is at it
/// then is no signal, and the core has other things to do.
const MOST_MISSED: u16 = 256;

/// How long it is deaf.
const REST: Duration = Duration::from_millis(10);

static SEEN: Channel<CriticalSectionRawMutex, SeenEdge, WAITING> = Channel::new();
/// Whether there may be some among them. The firmware is one task, so this is asked whenever it wakes, some
/// seventeen times a frame, and a critical section each time would cost 4 % of what a frame does.
static SOME: AtomicBool = AtomicBool::new(false);
static LISTENER: AtomicWaker = AtomicWaker::new();
static MISSED: AtomicU16 = AtomicU16::new(0);

/// What is done at an edge.
pub(crate) struct Stamp;

impl Handler<EXTI15_10> for Stamp {
    // SAFETY: as the trait asks, it is called from the interrupt alone; it touches atomics, a channel and a waker
    // that are made for it, and registers that nobody else writes while the line is unmasked.
    unsafe fn on_interrupt() {
        let at_us = Instant::now().as_micros();
        forget_pending();
        let missed = MISSED.load(Ordering::Relaxed);
        if SEEN.try_send(SeenEdge { at_us, missed }).is_ok() {
            MISSED.store(0, Ordering::Relaxed);
            SOME.store(true, Ordering::Release);
            LISTENER.wake();
            return;
        }
        MISSED.store(missed + 1, Ordering::Relaxed);
        if missed + 1 >= MOST_MISSED {
            listen(false);
        }
    }
}

fn forget_pending() {
    pac::EXTI.pr(0).write(|pending| pending.set_line(LINE, true)); // cleared by writing a one
}

fn listen(on: bool) {
    pac::EXTI.imr(0).modify(|mask| mask.set_line(LINE, on));
}

fn is_listening() -> bool {
    pac::EXTI.imr(0).read().line(LINE)
}

/// The sync input.
pub(crate) struct Edges {
    /// Keeps the pin an input.
    _pin: Input<'static>,
}

impl Edges {
    /// Pulled up, as the pin is after a reset: an open input is at rest, and an open collector is enough.
    pub(crate) fn new(
        pin: Peri<'static, peripherals::PA15>,
        _handler: impl Binding<EXTI15_10, Stamp>,
    ) -> Self {
        let pin = Input::new(pin, Pull::Up);
        pac::SYSCFG.exticr(LINE / 4).modify(|port| port.set_exti(LINE % 4, 0)); // port A
        pac::EXTI.rtsr(0).modify(|rising| rising.set_line(LINE, true));
        forget_pending();
        listen(true);
        // SAFETY: the handler is in place and may be called from now on.
        unsafe { interrupt::EXTI15_10.enable() };
        Self { _pin: pin }
    }
}

impl SyncInput for Edges {
    async fn next_edge(&mut self) -> SeenEdge {
        if !is_listening() {
            Timer::after(REST).await;
            forget_pending();
            listen(true);
        }
        let mut is_registered = false;
        poll_fn(|context| {
            // All of the firmware is one task: its waker is the same for good.
            if !is_registered {
                LISTENER.register(context.waker());
                is_registered = true;
            }
            if !SOME.load(Ordering::Acquire) {
                return Poll::Pending;
            }
            // An edge between these two lines is received by the second.
            SOME.store(false, Ordering::Relaxed);
            match SEEN.try_receive() {
                Ok(edge) => {
                    SOME.store(true, Ordering::Relaxed);
                    Poll::Ready(edge)
                }
                Err(_) => Poll::Pending,
            }
        })
        .await
    }
}
