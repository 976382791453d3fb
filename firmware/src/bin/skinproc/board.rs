//! Pins, clocks and interrupts of the SkinProc board.

use crate::stm32::start;
use embassy_stm32::adc::SampleTime;
use embassy_stm32::{Config, pac, rcc};
use shared_proto::Board;

/// Longer than the converter needs for a source of 10 kΩ (DS11451, table "Maximum ADC RAIN").
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES247_5;

/// 247.5 cycles of sampling and 12.5 of conversion at 80 MHz.
const CONVERSION_NS: u32 = 3_250;

/// 8 µs. The reference needs 4 µs, the thermometer 5 µs (DS11451, tables "Embedded internal voltage
/// reference" and "TS characteristics").
const SLOW_SAMPLE_TIME: SampleTime = SampleTime::CYCLES640_5;

/// Conversions start at a rising edge of TIM6's trigger output: EXTEN in CFGR, and 13 in EXTSEL
/// (RM0394, table "ADC1 external triggers for regular channels").
const TRIGGER: u32 = 1 << 10 | 13 << 6;

fn clocks() -> Config {
    let mut config = start::clocks();
    config.rcc.hsi = true;
    // Off by default: the converter would never become ready.
    config.rcc.mux.adcsel = rcc::mux::Adcsel::SYS;
    config
}

fn set_sample_time(input: u8, time: SampleTime) {
    let position = usize::from(input);
    pac::ADC1.smpr(position / 10).modify(|times| times.set_smp(position % 10, time));
}

start::board! {
    Board::SkinProc,
    freeze: apb1fzr1,
    converter: ADC1 (),
    inputs: PA0 PA1 PA2 PA3 PA4 PA5 PA6 PA7,
    emitters: PB0 PB1 PB3 PB4 PB5 PB6 PB7 PA8,
}
