//! Pins, clocks and interrupts of the Nucleo-G491RE.

use crate::stm32::converter::{Converter, EndOfBurst};
use crate::stm32::front_end::{Inputs, Photointerrupters, emitters};
use crate::stm32::start::{self, Common, Past};
use crate::stm32::time::Independent;
use embassy_executor::Spawner;
use embassy_stm32::adc::{Adc, AdcChannel, AdcConfig, SampleTime};
use embassy_stm32::interrupt::typelevel;
use embassy_stm32::{Config, bind_interrupts, dma, exti, pac, peripherals, rcc, rng, usart};
use shared_proto::Board;

bind_interrupts!(struct Irqs {
    USART1 => usart::InterruptHandler<peripherals::USART1>;
    DMA1_CHANNEL4 => dma::InterruptHandler<peripherals::DMA1_CH4>;
    DMA1_CHANNEL5 => dma::InterruptHandler<peripherals::DMA1_CH5>;
    EXTI15_10 => exti::InterruptHandler<typelevel::EXTI15_10>;
    RNG => rng::InterruptHandler<peripherals::RNG>;
    ADC1_2 => EndOfBurst;
});

/// 2.3 µs, for Δ of the flicker to be that of the SkinProc board. A source of 10 kΩ into the converter's 5 pF and
/// 10 pF of wires needs (10 kΩ + 1 kΩ) · 15 pF · ln 2¹⁴ = 1.6 µs (AN2834, "Analog signal source resistance").
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES92_5;

/// 92.5 cycles of sampling and 12.5 of conversion at 40 MHz.
const CONVERSION_NS: u32 = 2_625;

/// The reference takes 4 µs to sample, the thermometer 5 (DS13122, tables "Embedded internal voltage
/// reference" and "TS characteristics"); this is 16 µs.
const SLOW_SAMPLE_TIME: SampleTime = SampleTime::CYCLES640_5;

/// A rising edge of TIM6's trigger output starts conversions: CFGR's EXTEN, and 13 in EXTSEL (RM0440, table "ADC1/2 external triggers for regular channels").
const TRIGGER: u32 = 1 << 10 | 13 << 5;

/// 80 MHz from the internal 16 MHz oscillator, as on the SkinProc board, so that the rates of the line are the
/// same. The chip could do 170 MHz, of which a frame has no need.
fn clocks() -> Config {
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
    config.rcc.hsi48 = None;
    config.rcc.ls = rcc::LsConfig::off();
    // Divided by two for the converter, which bears 60 MHz.
    config.rcc.mux.adc12sel = rcc::mux::Adcsel::SYS;
    config.rcc.mux.clk48sel = rcc::mux::Clk48sel::PLL1_Q;
    config
}

fn set_sample_time(input: u8, time: SampleTime) {
    let position = usize::from(input);
    match position.checked_sub(10) {
        None => pac::ADC1.smpr().modify(|times| times.set_smp(position, time)),
        Some(position) => pac::ADC1.smpr2().modify(|times| times.set_smp(position, time)),
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let past = Past::take();
    let p = embassy_stm32::init(clocks());
    past.log();
    // A debugger that halts the core is no reason for a reset.
    pac::DBGMCU.apb1lfzr().modify(|frozen| frozen.set_iwdg(true));
    let watchdog = Independent::start(p.IWDG);

    let adc = Adc::new(p.ADC1, AdcConfig::default());
    let inputs = Inputs::new(
        [
            p.PA0.degrade_adc(),
            p.PA1.degrade_adc(),
            p.PB0.degrade_adc(),
            p.PC1.degrade_adc(),
            p.PC0.degrade_adc(),
            p.PC2.degrade_adc(),
            p.PC3.degrade_adc(),
            p.PB1.degrade_adc(),
        ],
        adc.enable_vrefint().degrade_adc(),
        adc.enable_temperature().degrade_adc(),
    );
    inputs.channels.iter().for_each(|&input| set_sample_time(input, SAMPLE_TIME));
    set_sample_time(inputs.reference, SLOW_SAMPLE_TIME);
    set_sample_time(inputs.thermometer, SLOW_SAMPLE_TIME);
    let emitters = emitters([
        p.PB5.into(),
        p.PB10.into(),
        p.PA8.into(),
        p.PC7.into(),
        p.PB6.into(),
        p.PA7.into(),
        p.PA6.into(),
        p.PA5.into(),
    ]);
    let converter = Converter::new::<typelevel::ADC1_2>(adc, p.TIM6, TRIGGER, emitters, Irqs);
    let front_end = Photointerrupters::new(converter, inputs);
    let common = Common {
        usart: p.USART1,
        tx: p.PA9,
        rx: p.PA10,
        cts: p.PA11,
        rts: p.PA12,
        tx_dma: p.DMA1_CH4,
        rx_dma: p.DMA1_CH5,
        sync: p.PA15,
        sync_line: p.EXTI15,
        rng: p.RNG,
        flash: p.FLASH,
    };
    let front_end = (front_end, CONVERSION_NS);
    start::tasks(spawner, (Board::NucleoG491re, past), watchdog, front_end, common, Irqs).await;
}
