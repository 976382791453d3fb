//! Eight emitters and ADC1 by DMA.

use crate::interrupts::Irqs;
use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, AnyAdcChannel, SampleTime};
use embassy_stm32::gpio::Output;
use embassy_stm32::peripherals::{ADC1, DMA1_CH1};
use embassy_time::{Duration, Instant};
use firmware::{Factory, FrontEnd};
use shared_proto::{CHANNELS, Vitals};

/// Longer than the converter needs for a source of 10 kΩ (DS11451, table "Maximum ADC RAIN").
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES247_5;

/// The reference takes 4 µs to sample, the thermometer 5 (DS11451, tables "Embedded internal voltage
/// reference" and "TS characteristics"); this is 8 µs.
const SLOW_SAMPLE_TIME: SampleTime = SampleTime::CYCLES640_5;

/// Conversions of each: 33 µs.
const VITAL_CONVERSIONS: usize = 4;

/// A conversion later than 1 ms after the one before may be wrong, and is to be thrown away
/// (STM32L432xx/442xx errata, "Wrong ADC result if conversion done late after calibration or previous
/// conversion"). The margin is for starting it.
const LONGEST_PAUSE: Duration = Duration::from_micros(900);

/// Photointerrupters on ADC1.
pub(crate) struct Photointerrupters {
    pub(crate) adc: Adc<'static, ADC1>,
    /// When the last conversion ended, `None` before the first.
    pub(crate) last_conversion: Option<Instant>,
    pub(crate) dma: Peri<'static, DMA1_CH1>,
    pub(crate) channels: [AnyAdcChannel<'static, ADC1>; CHANNELS],
    pub(crate) emitters: [Output<'static>; CHANNELS],
    pub(crate) reference: AnyAdcChannel<'static, ADC1>,
    pub(crate) thermometer: AnyAdcChannel<'static, ADC1>,
    pub(crate) factory: Factory,
}

impl Photointerrupters {
    async fn read(&mut self, channel: usize, codes: &mut [u16]) {
        let Some(channel) = self.channels.get_mut(channel) else { return };
        let sequence = [(channel, SAMPLE_TIME)].into_iter();
        self.adc.read(self.dma.reborrow(), Irqs, sequence, codes).await;
    }
}

impl FrontEnd for Photointerrupters {
    /// 247.5 cycles of sampling and 12.5 of conversion at 80 MHz.
    const CONVERSION_NS: u32 = 3_250;

    fn light(&mut self, channel: Option<usize>) {
        for (i, emitter) in self.emitters.iter_mut().enumerate() {
            emitter.set_level((Some(i) == channel).into());
        }
    }

    async fn convert(&mut self, channel: usize, codes: &mut [u16]) {
        let is_fresh = self.last_conversion.is_some_and(|at| at.elapsed() < LONGEST_PAUSE);
        if !is_fresh {
            self.read(channel, &mut [0]).await;
        }
        self.read(channel, codes).await;
        self.last_conversion = Some(Instant::now());
    }

    /// The first conversion comes right after those of a frame, so that none is thrown away.
    async fn vitals(&mut self) -> Vitals {
        let mut codes = [[0; VITAL_CONVERSIONS]; 2];
        let channels = [&mut self.reference, &mut self.thermometer];
        for (channel, codes) in channels.into_iter().zip(&mut codes) {
            let sequence = [(channel, SLOW_SAMPLE_TIME)].into_iter();
            self.adc.read(self.dma.reborrow(), Irqs, sequence, codes).await;
        }
        self.last_conversion = Some(Instant::now());
        let [reference, thermometer] = &codes;
        self.factory.vitals(reference, thermometer)
    }
}
