//! Eight emitters, and the inputs of the converter that look at them.

use crate::converter::Converter;
use embassy_stm32::adc::SampleTime;
use embassy_stm32::gpio::Output;
use firmware::{Clock, Factory, FrontEnd};
use shared_proto::{CHANNELS, Vitals};

/// Longer than the converter needs for a source of 10 kΩ (DS11451, table "Maximum ADC RAIN").
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES247_5;

/// The reference takes 4 µs to sample, the thermometer 5 (DS11451, tables "Embedded internal voltage
/// reference" and "TS characteristics"); this is 8 µs.
const SLOW_SAMPLE_TIME: SampleTime = SampleTime::CYCLES640_5;

/// Conversions of each: 33 µs.
const VITAL_CONVERSIONS: u8 = 4;

/// Inputs of the converter.
pub(crate) struct Inputs {
    pub(crate) channels: [u8; CHANNELS],
    pub(crate) reference: u8,
    pub(crate) thermometer: u8,
}

/// Photointerrupters on ADC1.
pub(crate) struct Photointerrupters {
    converter: Converter,
    inputs: Inputs,
    emitters: [Output<'static>; CHANNELS],
    lit: Option<usize>,
    factory: Factory,
}

impl Photointerrupters {
    /// With emitters that are off.
    pub(crate) fn new(
        mut converter: Converter,
        inputs: Inputs,
        emitters: [Output<'static>; CHANNELS],
        factory: Factory,
    ) -> Self {
        inputs.channels.iter().for_each(|&input| converter.set_sample_time(input, SAMPLE_TIME));
        for input in [inputs.reference, inputs.thermometer] {
            converter.set_sample_time(input, SLOW_SAMPLE_TIME);
        }
        Self { converter, inputs, emitters, lit: None, factory }
    }

    async fn sum_after(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        match self.inputs.channels.get(channel) {
            Some(&input) => self.converter.sum(input, conversions, settling_us).await,
            None => 0,
        }
    }
}

impl FrontEnd for Photointerrupters {
    /// 247.5 cycles of sampling and 12.5 of conversion at 80 MHz.
    const CONVERSION_NS: u32 = 3_250;

    fn light(&mut self, channel: Option<usize>) {
        if let Some(emitter) = self.lit.and_then(|lit| self.emitters.get_mut(lit)) {
            emitter.set_low();
        }
        if let Some(emitter) = channel.and_then(|channel| self.emitters.get_mut(channel)) {
            emitter.set_high();
        }
        self.lit = channel;
    }

    async fn sum(&mut self, channel: usize, conversions: u8) -> u32 {
        self.sum_after(0, channel, conversions).await
    }

    async fn settle_and_sum<C: Clock>(
        &mut self,
        _clock: &C,
        settling_us: u16,
        channel: usize,
        conversions: u8,
    ) -> u32 {
        self.sum_after(settling_us, channel, conversions).await
    }

    /// The first conversion comes right after those of a frame, so that none is thrown away.
    async fn vitals(&mut self) -> Vitals {
        let Inputs { reference, thermometer, .. } = self.inputs;
        let reference = self.converter.sum(reference, VITAL_CONVERSIONS, 0).await;
        let thermometer = self.converter.sum(thermometer, VITAL_CONVERSIONS, 0).await;
        self.factory.vitals(reference, thermometer, VITAL_CONVERSIONS)
    }
}
