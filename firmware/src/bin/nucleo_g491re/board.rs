//! Pins, clocks and interrupts of the Nucleo-G491RE.

use crate::stm32::start;
use embassy_stm32::adc::{AdcConfig, SampleTime};
use embassy_stm32::{Config, pac, rcc};
use shared_proto::Board;

/// 2.3 µs, so that the flicker formula has the same Δ as on the SkinProc board. 10 kΩ into the
/// converter's 5 pF and 10 pF of wiring need (10 kΩ + 1 kΩ) · 15 pF · ln 2¹⁴ = 1.6 µs (AN2834,
/// "Analog signal source resistance").
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES92_5;

/// 92.5 cycles of sampling and 12.5 of conversion at 40 MHz.
const CONVERSION_NS: u32 = 2_625;

/// 16 µs. The reference needs 4 µs, the thermometer 5 µs (DS13122, tables "Embedded internal
/// voltage reference" and "TS characteristics").
const SLOW_SAMPLE_TIME: SampleTime = SampleTime::CYCLES640_5;

/// Conversions start at a rising edge of TIM6's trigger output: EXTEN in CFGR, and 13 in EXTSEL
/// (RM0440, table "ADC1/2 external triggers for regular channels").
const TRIGGER: u32 = 1 << 10 | 13 << 5;

/// 80 MHz as on the SkinProc board, for the same baud rates; 170 MHz are not needed.
fn clocks() -> Config {
    let mut config = start::clocks();
    config.rcc.hsi48 = None;
    // Divided by two for the converter, whose limit is 60 MHz.
    config.rcc.mux.adc12sel = rcc::mux::Adcsel::SYS;
    config
}

fn set_sample_time(input: u8, time: SampleTime) {
    let position = usize::from(input);
    match position.checked_sub(10) {
        None => pac::ADC1.smpr().modify(|times| times.set_smp(position, time)),
        Some(position) => pac::ADC1.smpr2().modify(|times| times.set_smp(position, time)),
    }
}

start::board! {
    Board::NucleoG491re,
    freeze: apb1lfzr,
    converter: ADC1_2 (AdcConfig::default()),
    inputs: PA0 PA1 PB0 PC1 PC0 PC2 PC3 PB1,
    emitters: PB5 PB10 PA8 PC7 PB6 PA7 PA6 PA5,
}
