//! From the reset to the running firmware.
#![expect(unsafe_code, reason = "exception handlers and the interrupt controller ask for it")]

use crate::{executor, front_end, time, uart};
use cortex_m::peripheral::NVIC;
use embassy_time::{Instant, Timer};
use firmware::{Clock, LastWords, Link, NoChip, NoSyncInput, Parts, VERSION, Watchdog};
use semihosting::process::exit;
use shared_proto::{Board, Identity, ResetCause};

const BAUD: u32 = 57_600;

/// Numbers of the interrupts in use (Arm DAI0386).
const RECEIVED: u16 = 0;
const SENT: u16 = 1;
const TIMER: u16 = 10;

#[derive(Clone, Copy)]
struct Interrupt(u16);

// SAFETY: the numbers above are those of the device and do not change.
unsafe impl cortex_m::interrupt::InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self.0
    }
}

// SAFETY: every interrupt that is unmasked is served here; none is nested in another's borrow.
#[cortex_m_rt::exception]
unsafe fn DefaultHandler(interrupt: i16) {
    match interrupt.cast_unsigned() {
        RECEIVED => uart::on_received(),
        SENT => uart::on_sent(),
        TIMER => time::on_interrupt(),
        _ => {}
    }
}

// SAFETY: does not return.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    semihosting::eprintln!("hard fault at {:#010x}", frame.pc());
    exit(3)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    semihosting::eprintln!("{info}");
    exit(101)
}

struct EmbassyClock;

impl Clock for EmbassyClock {
    /// Where time is counted in instructions nothing is late. In real time the core wakes when the
    /// host lets it; what is late by less than this is taken all the same, and its time tells.
    const TOLERANCE_US: u32 = 4_000;

    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

/// QEMU can stop at any time for as long as the host likes: nothing to reset for.
struct NoWatchdog;

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}

#[embassy_executor::task]
async fn firmware(sender: uart::Sender, receiver: uart::Receiver) {
    firmware::run(Parts {
        front_end: front_end::Script::default(),
        clock: EmbassyClock,
        receiver,
        sender,
        storage: front_end::Memory,
        watchdog: NoWatchdog,
        sync_input: NoSyncInput,
        chip: NoChip,
        link: Link::Transparent,
        identity: Identity {
            board: Board::Emulated,
            firmware: VERSION,
            serial: *b"mps2-an386  ",
            min_period_us: 1_000,
        },
        reset_cause: ResetCause::Power,
        last_words: LastWords::new(),
        // Every run is the same here.
        nonce: Some(*b"emulated"),
        rate: None,
    })
    .await;
}

#[cortex_m_rt::entry]
fn main() -> ! {
    time::start();
    let (sender, receiver) = uart::start(time::CORE_HZ, BAUD);
    for interrupt in [RECEIVED, SENT, TIMER] {
        // SAFETY: the handlers above are in place, and no critical section is under way.
        unsafe { NVIC::unmask(Interrupt(interrupt)) };
    }
    executor::run(|spawner| {
        let task = firmware(sender, receiver).expect("the task is spawned once");
        spawner.spawn(task);
    })
}
