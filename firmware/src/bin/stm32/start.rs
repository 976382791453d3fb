//! From the reset to the running firmware.

use super::chip::Stm32;
use super::front_end::Photointerrupters;
use super::last_words::{self, End};
use super::randomness;
use super::storage::Area;
use super::sync_input::{Edges, Stamp};
use defmt_rtt as _;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::typelevel::{self, Binding};
use embassy_stm32::peripherals::{self, FLASH, IWDG, PA9, PA10, PA11, PA12, PA15, USART1};
use embassy_stm32::usart::{self, BufferedInterruptHandler, BufferedUart};
use embassy_stm32::usart::{BufferedUartRx, BufferedUartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, uid};
use embassy_time::{Instant, Timer};
use firmware::{Clock, LastWords, Link, Parts, Slots, VERSION, Watchdog, baud};
use shared_proto::{Board, Identity, ResetCause};
use static_cell::ConstStaticCell;

const WATCHDOG_US: u32 = 1_000_000;

/// How the run before has ended.
pub(crate) struct Past {
    cause: ResetCause,
    last_words: Option<LastWords>,
}

impl Past {
    /// To be called once, first of all: what is left of the past is forgotten.
    pub(crate) fn take() -> Self {
        let (end, last_words) = last_words::take().unzip();
        Self { cause: reset_cause(end), last_words }
    }

    /// Says so to a debug probe. The clocks have to be set.
    pub(crate) fn log(&self) {
        defmt::info!("firmware {}, reset cause {}", VERSION, self.cause.code());
        if let Some(words) = &self.last_words {
            defmt::error!("before the reset: {=str}", words.as_str());
        }
    }
}

/// Why the board has started (RM0394 and RM0440, RCC_CSR). Read once: the flags are cleared.
fn reset_cause(end: Option<End>) -> ResetCause {
    let csr = embassy_stm32::pac::RCC.csr();
    let flags = csr.read();
    csr.modify(|csr| csr.set_rmvf(true));
    // The pin is pulled by every other cause too, so it comes last.
    if let Some(end) = end {
        end.cause()
    } else if flags.iwdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.borrstf() {
        ResetCause::Power
    } else if flags.sftrstf() || flags.oblrstf() || flags.lpwrrstf() {
        ResetCause::Unspecified
    } else {
        ResetCause::Pin
    }
}

pub(crate) struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

pub(crate) struct Independent(IndependentWatchdog<'static, IWDG>);

impl Independent {
    /// From now on the firmware has to be quick.
    pub(crate) fn start(watchdog: Peri<'static, IWDG>) -> Self {
        let mut watchdog = IndependentWatchdog::new(watchdog, WATCHDOG_US);
        watchdog.unleash();
        Self(watchdog)
    }
}

impl Watchdog for Independent {
    fn feed(&mut self) {
        self.0.pet();
    }
}

/// What is on the same pins of every board: the serial line and the sync input.
pub(crate) struct Lines {
    pub(crate) usart: Peri<'static, USART1>,
    pub(crate) tx: Peri<'static, PA9>,
    pub(crate) rx: Peri<'static, PA10>,
    pub(crate) cts: Peri<'static, PA11>,
    pub(crate) rts: Peri<'static, PA12>,
    pub(crate) sync: Peri<'static, PA15>,
}

/// What the firmware needs of a board whose conversions take so many ns.
pub(crate) type Stm32Parts<const CONVERSION_NS: u32> = Parts<
    Photointerrupters<CONVERSION_NS>,
    EmbassyClock,
    BufferedUartRx<'static>,
    BufferedUartTx<'static>,
    Slots<Area>,
    Independent,
    Edges,
    Stm32,
>;

/// Puts together what the firmware needs.
pub(crate) fn parts<const CONVERSION_NS: u32>(
    board: Board,
    past: Past,
    watchdog: Independent,
    front_end: Photointerrupters<CONVERSION_NS>,
    lines: Lines,
    flash: Peri<'static, FLASH>,
    irqs: impl Binding<typelevel::USART1, BufferedInterruptHandler<peripherals::USART1>>
    + Binding<typelevel::EXTI15_10, Stamp>
    + Copy
    + 'static,
) -> Stm32Parts<CONVERSION_NS> {
    let mut config = usart::Config::default();
    config.baudrate = baud::FIRST.actual;
    // Wakes the receiver for every byte: commands are shorter than half its buffer.
    config.eager_reads = Some(1);
    // An adapter of three wires leaves CTS open: then the line is clear to send. RX without a sender
    // is idle.
    config.cts_pull = Pull::Down;
    config.rx_pull = Pull::Up;
    static OUT: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    static IN: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    let Lines { usart, tx, rx, cts, rts, sync } = lines;
    let uart =
        BufferedUart::new_with_rtscts(usart, rx, tx, rts, cts, irqs, OUT.take(), IN.take(), config);
    let (sender, receiver) = uart.expect("80 MHz can be divided to this rate").split();
    Parts {
        front_end,
        clock: EmbassyClock,
        receiver,
        sender,
        storage: Slots::new(Area::new(Flash::new_blocking(flash))),
        watchdog,
        sync_input: Edges::new(sync, irqs),
        chip: Stm32,
        link: Link::Transparent,
        identity: Identity { board, firmware: VERSION, serial: uid::uid(), min_period_us: 1_000 },
        reset_cause: past.cause,
        last_words: past.last_words.unwrap_or_default(),
        nonce: randomness::nonce(),
        rate: Some(baud::FIRST),
    }
}
