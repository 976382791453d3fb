//! Start-up, from the reset to the running tasks.
#![expect(unsafe_code, reason = "an interrupt is handled here")]

use super::converter::Photointerrupters;
use super::last_words;
use super::storage::Area;
use super::tasks::{self, EmbassyClock, Stm32Station};
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{IWDG, RNG};
use embassy_stm32::rng::Rng;
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Config, interrupt, pac, rcc, uid};
use embassy_time::{Duration, with_timeout};
use firmware::{BoardSetup, LastWords, RECORD, Slots, Station, VERSION, baud};
use shared_proto::{Board, Identity, ResetCause};
use static_cell::{ConstStaticCell, StaticCell};

/// The watchdog resets the board unless it is fed within this time.
pub(crate) const WATCHDOG_US: u32 = 1_000_000;

/// Returns the cause of the last reset, and the words before it. Call once, before anything else:
/// it clears the records.
pub(crate) fn past() -> (ResetCause, Option<LastWords>) {
    let (end, last_words) = last_words::take().unzip();
    let cause = reset_cause();
    (end.unwrap_or(cause), last_words)
}

/// Logs the previous run to a debug probe, after the clocks are set.
pub(crate) fn log((cause, last_words): &(ResetCause, Option<LastWords>)) {
    defmt::info!("firmware {}, reset cause {}", VERSION, cause.code());
    if let Some(words) = last_words {
        defmt::error!("before the reset: {=str}", words.as_str());
    }
}

/// Reads and clears the cause of the reset (RM0394 and RM0440, RCC_CSR).
fn reset_cause() -> ResetCause {
    let csr = pac::RCC.csr();
    let flags = csr.read();
    csr.modify(|csr| csr.set_rmvf(true));
    // The pin comes last, as every other cause pulls it, too.
    if flags.iwdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.borrstf() {
        ResetCause::Power
    } else if flags.sftrstf() || flags.oblrstf() || flags.lpwrrstf() {
        ResetCause::Unspecified
    } else {
        ResetCause::Pin
    }
}

/// 80 MHz from the internal 16 MHz oscillator, since no board has a crystal.
pub(crate) fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSI,
        prediv: rcc::PllPreDiv::DIV1,
        mul: rcc::PllMul::MUL10,
        divp: None,
        // For random numbers.
        divq: Some(rcc::PllQDiv::DIV4),
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    config.rcc.ls = rcc::LsConfig::off();
    config.rcc.mux.clk48sel = rcc::mux::Clk48sel::PLL1_Q;
    config
}

/// Defines a board's interrupts and `main`, from the register by which a debugger stops the
/// watchdog, the converter's settings, interrupt and inputs, and the emitters' pins. The board's
/// module defines `clocks`, `set_sample_time` and the constants that are used here.
macro_rules! board {
    (
        $board:expr,
        freeze: $freeze:ident,
        converter: $interrupt:ident ($($config:expr)?),
        inputs: $($input:ident)+,
        emitters: $($emitter:ident)+,
    ) => {
        use embassy_stm32::adc::Adc;
        use embassy_stm32::flash::Flash;
        use embassy_stm32::gpio::{Level, Output, Pull, Speed};
        use embassy_stm32::interrupt::typelevel;
        use embassy_stm32::usart::{self, Uart};
        use embassy_stm32::wdg::IndependentWatchdog;
        use embassy_stm32::{dma, exti, peripherals, rng};
        use $crate::stm32::converter::{EndOfBurst, Photointerrupters, input_number};

        embassy_stm32::bind_interrupts!(struct Irqs {
            USART1 => usart::InterruptHandler<peripherals::USART1>;
            DMA1_CHANNEL4 => dma::InterruptHandler<peripherals::DMA1_CH4>;
            DMA1_CHANNEL5 => dma::InterruptHandler<peripherals::DMA1_CH5>;
            EXTI15_10 => exti::InterruptHandler<typelevel::EXTI15_10>;
            RNG => rng::InterruptHandler<peripherals::RNG>;
            $interrupt => EndOfBurst;
        });

        #[embassy_executor::main]
        async fn main(spawner: embassy_executor::Spawner) {
            let past = start::past();
            let p = embassy_stm32::init(clocks());
            start::log(&past);
            // Keep the watchdog from resetting the board while a debugger halts the core.
            pac::DBGMCU.$freeze().modify(|frozen| frozen.set_iwdg(true));
            // From here on, the watchdog limits every step.
            let mut watchdog = IndependentWatchdog::new(p.IWDG, start::WATCHDOG_US);
            watchdog.unleash();
            let run = (past, start::number(rng::Rng::new(p.RNG, Irqs)).await);

            let adc = Adc::new(p.ADC1, $($config)?);
            let channels = [$(input_number(p.$input)),+];
            channels.iter().for_each(|&input| set_sample_time(input, SAMPLE_TIME));
            let (reference, thermometer) = (adc.enable_vrefint(), adc.enable_temperature());
            let vitals = [input_number(reference), input_number(thermometer)];
            vitals.iter().for_each(|&input| set_sample_time(input, SLOW_SAMPLE_TIME));
            let emitters = [$(Output::new(p.$emitter, Level::Low, Speed::Low)),+];
            let front_end = Photointerrupters::new::<typelevel::$interrupt>(
                adc, (channels, vitals), p.TIM6, TRIGGER, emitters, Irqs,
            );

            let uart = Uart::new_with_rtscts(
                p.USART1, p.PA10, p.PA9, p.PA12, p.PA11, p.DMA1_CH4, p.DMA1_CH5, Irqs, start::line(),
            );
            let sync = exti::ExtiInput::new(p.PA15, p.EXTI15, Pull::Up, Irqs);
            let flash = Flash::new_blocking(p.FLASH);
            let front_end = (front_end, CONVERSION_NS);
            start::tasks(spawner, $board, run, watchdog, front_end, (uart, sync), flash);
        }
    };
}

pub(crate) use board;

pub(crate) fn line() -> usart::Config {
    let mut config = usart::Config::default();
    config.baudrate = baud::FIRST.actual;
    // An open CTS of a three-wire adapter must count as clear to send, RX without a sender as idle.
    config.cts_pull = Pull::Down;
    config.rx_pull = Pull::Up;
    config
}

/// Executor of the sync input, on an interrupt that no other task uses.
static URGENT: InterruptExecutor = InterruptExecutor::new();

// SAFETY: the executor is started before the interrupt is enabled, and only the interrupt polls it.
#[interrupt]
unsafe fn TIM7() {
    // SAFETY: as above.
    unsafe { URGENT.on_interrupt() }
}

pub(crate) fn tasks(
    spawner: Spawner,
    board: Board,
    ((reset_cause, last_words), start): ((ResetCause, Option<LastWords>), u16),
    watchdog: IndependentWatchdog<'static, IWDG>,
    (front_end, conversion_ns): (Photointerrupters, u32),
    (uart, sync): (Result<Uart<'static, Async>, usart::ConfigError>, ExtiInput<'static, Async>),
    flash: Flash<'static, Blocking>,
) {
    static STATION: StaticCell<Stm32Station> = StaticCell::new();
    static RECORD_ROOM: ConstStaticCell<[u8; RECORD]> = ConstStaticCell::new([0; RECORD]);
    static IN: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    let (sender, receiver) = uart.expect("80 MHz can be divided to this rate").split();
    let setup = BoardSetup {
        identity: Identity { board, firmware: VERSION, serial: uid::uid(), min_period_us: 1_000 },
        start,
        reset_cause,
        last_words: last_words.unwrap_or_default(),
        conversion_ns,
        rate: Some(baud::FIRST),
        rates: &baud::RATES,
        has_bootloader: true,
    };
    let station = STATION.init_with(|| Station::new(setup, EmbassyClock, RECORD_ROOM.take()));
    let slots = Slots::new(Area::new(flash));
    let receiver = receiver.into_ring_buffered(IN.take());
    let spawn = "each task is spawned once";
    spawner.spawn(tasks::watch(station, watchdog).expect(spawn));
    spawner.spawn(tasks::acquire(station, front_end).expect(spawn));
    spawner.spawn(tasks::send(station, sender).expect(spawn));
    spawner.spawn(tasks::receive(station, receiver, slots).expect(spawn));
    spawner.spawn(tasks::listen(station).expect(spawn));
    interrupt::TIM7.set_priority(Priority::P1);
    let urgent = URGENT.start(interrupt::TIM7);
    urgent.spawn(tasks::stamp(sync).expect(spawn));
}

/// Returns a random number for this start; 0 if the generator fails.
pub(crate) async fn number(mut rng: Rng<'static, RNG>) -> u16 {
    let mut bytes = [0; 2];
    let filled = with_timeout(Duration::from_millis(1), rng.async_fill_bytes(&mut bytes)).await;
    filled.ok().and_then(Result::ok).map_or(0, |()| u16::from_le_bytes(bytes))
}
