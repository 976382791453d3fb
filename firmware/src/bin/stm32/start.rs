//! From the reset to the running tasks.
#![expect(unsafe_code, reason = "an interrupt is handled here")]

use super::front_end::Photointerrupters;
use super::last_words::{self, End};
use super::storage::Area;
use super::sync_input;
use super::tasks::{self, Stm32Station};
use super::time::{EmbassyClock, Independent};
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::typelevel::{self, Binding};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::peripherals::{
    self, DMA1_CH4, DMA1_CH5, EXTI15, FLASH, PA9, PA10, PA11, PA12, PA15, RNG, USART1,
};
use embassy_stm32::rng::{self, Rng};
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::{Peri, dma, interrupt, pac, uid};
use embassy_time::{Duration, with_timeout};
use firmware::{BoardSetup, LastWords, RECORD, Slots, Station, VERSION, baud};
use shared_proto::{Board, Identity, ResetCause};
use static_cell::{ConstStaticCell, StaticCell};

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
    let csr = pac::RCC.csr();
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

/// What is on the same pins of every board: the serial line and the sync input; and what no board has otherwise.
pub(crate) struct Common {
    pub(crate) usart: Peri<'static, USART1>,
    pub(crate) tx: Peri<'static, PA9>,
    pub(crate) rx: Peri<'static, PA10>,
    pub(crate) cts: Peri<'static, PA11>,
    pub(crate) rts: Peri<'static, PA12>,
    pub(crate) tx_dma: Peri<'static, DMA1_CH4>,
    pub(crate) rx_dma: Peri<'static, DMA1_CH5>,
    pub(crate) sync: Peri<'static, PA15>,
    pub(crate) sync_line: Peri<'static, EXTI15>,
    pub(crate) rng: Peri<'static, RNG>,
    pub(crate) flash: Peri<'static, FLASH>,
}

/// The executor of the sync input, at whose interrupt nothing else is.
static URGENT: InterruptExecutor = InterruptExecutor::new();

// SAFETY: the executor is started before the interrupt is enabled, and polled by it alone.
#[interrupt]
unsafe fn TIM7() {
    // SAFETY: as above.
    unsafe { URGENT.on_interrupt() }
}

/// Starts the tasks of a board whose conversions take so many ns.
pub(crate) async fn tasks(
    spawner: Spawner,
    (board, past): (Board, Past),
    watchdog: Independent,
    (front_end, conversion_ns): (Photointerrupters, u32),
    common: Common,
    irqs: impl Binding<typelevel::USART1, usart::InterruptHandler<peripherals::USART1>>
    + Binding<typelevel::DMA1_CHANNEL4, dma::InterruptHandler<DMA1_CH4>>
    + Binding<typelevel::DMA1_CHANNEL5, dma::InterruptHandler<DMA1_CH5>>
    + Binding<typelevel::EXTI15_10, exti::InterruptHandler<typelevel::EXTI15_10>>
    + Binding<typelevel::RNG, rng::InterruptHandler<RNG>>
    + 'static,
) {
    static STATION: StaticCell<Stm32Station> = StaticCell::new();
    static RECORD_ROOM: ConstStaticCell<[u8; RECORD]> = ConstStaticCell::new([0; RECORD]);
    static IN: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    let Common { usart, tx, rx, cts, rts, tx_dma, rx_dma, .. } = common;
    let mut config = usart::Config::default();
    config.baudrate = baud::FIRST.actual;
    // An adapter of three wires leaves CTS open: then the line is clear to send. RX without a sender
    // is idle.
    config.cts_pull = Pull::Down;
    config.rx_pull = Pull::Up;
    let uart = Uart::new_with_rtscts(usart, rx, tx, rts, cts, tx_dma, rx_dma, irqs, config);
    let (sender, receiver) = uart.expect("80 MHz can be divided to this rate").split();
    let setup = BoardSetup {
        identity: Identity { board, firmware: VERSION, serial: uid::uid(), min_period_us: 1_000 },
        start: start_number(common.rng, irqs).await,
        reset_cause: past.cause,
        last_words: past.last_words.unwrap_or_default(),
        conversion_ns,
        rate: Some(baud::FIRST),
        rates: &baud::RATES,
        has_bootloader: true,
    };
    let station = STATION.init_with(|| Station::new(setup, EmbassyClock, RECORD_ROOM.take()));
    let slots = Slots::new(Area::new(Flash::new_blocking(common.flash)));
    let receiver = receiver.into_ring_buffered(IN.take());
    let spawn = "each task is spawned once";
    spawner.spawn(tasks::watch(station, watchdog).expect(spawn));
    spawner.spawn(tasks::acquire(station, front_end).expect(spawn));
    spawner.spawn(tasks::send(station, sender).expect(spawn));
    spawner.spawn(tasks::receive(station, receiver, slots).expect(spawn));
    spawner.spawn(tasks::listen(station).expect(spawn));
    let input = ExtiInput::new(common.sync, common.sync_line, Pull::Up, irqs);
    interrupt::TIM7.set_priority(Priority::P1);
    let urgent = URGENT.start(interrupt::TIM7);
    urgent.spawn(sync_input::stamp(input).expect(spawn));
}

/// New at every start, but for one in 65,536; 0 if the chip gives no random numbers.
async fn start_number(
    rng: Peri<'static, RNG>,
    irqs: impl Binding<typelevel::RNG, rng::InterruptHandler<RNG>> + 'static,
) -> u16 {
    let mut bytes = [0; 2];
    let mut rng = Rng::new(rng, irqs);
    let filled = with_timeout(Duration::from_millis(1), rng.async_fill_bytes(&mut bytes)).await;
    filled.ok().and_then(Result::ok).map_or(0, |()| u16::from_le_bytes(bytes))
}
