//! From the reset to the running firmware.

use crate::chip::Stm32;
use crate::converter::Converter;
use crate::factory;
use crate::front_end::{Inputs, Photointerrupters};
use crate::interrupts::Irqs;
use crate::last_words::{self, End};
use crate::randomness;
use crate::storage::Area;
use crate::sync_input::Edges;
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::adc::{Adc, AdcChannel, AnyAdcChannel};
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{AnyPin, Level, Output, Pull, Speed};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, peripherals, rcc, uid};
use embassy_time::{Instant, Timer};
use firmware::{Clock, Link, Parts, Slots, VERSION, Watchdog, baud};
use shared_proto::{Board, Identity, ResetCause};
use static_cell::ConstStaticCell;

const WATCHDOG_US: u32 = 1_000_000;

/// 80 MHz from the internal 16 MHz oscillator: the board has no crystal.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hsi = true;
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
    // Off by default, and then the converter never gets ready.
    config.rcc.mux.adcsel = rcc::mux::Adcsel::SYS;
    config.rcc.mux.clk48sel = rcc::mux::Clk48sel::PLL1_Q;
    config
}

/// Why the board has started (RM0394, RCC_CSR). Read once: the flags are cleared.
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

struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn wait_until_us(&self, at_us: u64) {
        Timer::at(Instant::from_micros(at_us)).await;
    }
}

struct Independent(IndependentWatchdog<'static, peripherals::IWDG>);

impl Watchdog for Independent {
    fn feed(&mut self) {
        self.0.pet();
    }
}

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let (end, last_words) = last_words::take().unzip();
    let last_words = last_words.unwrap_or_default();
    let reset_cause = reset_cause(end);
    let p = embassy_stm32::init(clocks());
    defmt::info!("skinproc {}, reset cause {}", VERSION, reset_cause.code());
    if end.is_some() {
        defmt::error!("before the reset: {=str}", last_words.as_str());
    }

    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_US);
    watchdog.unleash();

    let input = |channel: AnyAdcChannel<'static, peripherals::ADC1>| channel.get_hw_channel();
    let emitter = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low);
    let adc = Adc::new(p.ADC1);
    let inputs = Inputs {
        channels: [
            p.PA0.degrade_adc(),
            p.PA1.degrade_adc(),
            p.PA2.degrade_adc(),
            p.PA3.degrade_adc(),
            p.PA4.degrade_adc(),
            p.PA5.degrade_adc(),
            p.PA6.degrade_adc(),
            p.PA7.degrade_adc(),
        ]
        .map(input),
        reference: input(adc.enable_vrefint().degrade_adc()),
        thermometer: input(adc.enable_temperature().degrade_adc()),
    };
    let emitters = [
        emitter(p.PB0.into()),
        emitter(p.PB1.into()),
        emitter(p.PB3.into()),
        emitter(p.PB4.into()),
        emitter(p.PB5.into()),
        emitter(p.PB6.into()),
        emitter(p.PB7.into()),
        emitter(p.PA8.into()),
    ];
    let converter = Converter::new(adc, p.TIM6, Irqs);
    let front_end = Photointerrupters::new(converter, inputs, emitters, factory::codes());

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
    let uart = BufferedUart::new_with_rtscts(
        p.USART1,
        p.PA10,
        p.PA9,
        p.PA12,
        p.PA11,
        Irqs,
        OUT.take(),
        IN.take(),
        config,
    );
    let (sender, receiver) = uart.expect("80 MHz can be divided to this rate").split();

    firmware::run(Parts {
        front_end,
        clock: EmbassyClock,
        receiver,
        sender,
        storage: Slots::new(Area::new(Flash::new_blocking(p.FLASH))),
        watchdog: Independent(watchdog),
        sync_input: Edges::new(p.PA15, Irqs),
        chip: Stm32,
        link: Link::Transparent,
        identity: Identity {
            board: Board::SkinProc,
            firmware: VERSION,
            serial: uid::uid(),
            min_period_us: 1_000,
        },
        reset_cause,
        last_words,
        nonce: randomness::nonce(),
        rate: Some(baud::FIRST),
    })
    .await;
}
