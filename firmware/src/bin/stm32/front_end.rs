//! Eight emitters, and the inputs of the converter that look at them.

use super::converter::{Converter, light};
use super::factory;
use embassy_stm32::Peri;
use embassy_stm32::adc::AnyAdcChannel;
use embassy_stm32::gpio::{AnyPin, Level, Output, Speed};
use embassy_stm32::peripherals::ADC1;
use firmware::{Clock, Factory, FrontEnd};
use shared_proto::{CHANNELS, Vitals};

/// Conversions of reference and of thermometer, which together take less than [`firmware::VITALS_US`].
const VITAL_CONVERSIONS: u8 = 4;

/// Inputs of the converter, by their numbers.
pub(crate) struct Inputs {
    pub(crate) channels: [u8; CHANNELS],
    pub(crate) reference: u8,
    pub(crate) thermometer: u8,
}

impl Inputs {
    pub(crate) fn new(
        channels: [AnyAdcChannel<'static, ADC1>; CHANNELS],
        reference: AnyAdcChannel<'static, ADC1>,
        thermometer: AnyAdcChannel<'static, ADC1>,
    ) -> Self {
        let number = |input: AnyAdcChannel<'static, ADC1>| input.get_hw_channel();
        Self {
            channels: channels.map(number),
            reference: number(reference),
            thermometer: number(thermometer),
        }
    }
}

/// Photointerrupters on ADC1.
pub(crate) struct Photointerrupters {
    converter: Converter,
    inputs: Inputs,
    factory: Factory,
}

impl Photointerrupters {
    /// With emitters that are off.
    pub(crate) fn new(converter: Converter, inputs: Inputs) -> Self {
        Self { converter, inputs, factory: factory::codes() }
    }

    async fn sum_after(&mut self, settling_us: u16, channel: usize, conversions: u8) -> u32 {
        match self.inputs.channels.get(channel) {
            Some(&input) => self.converter.sum(input, conversions, settling_us).await,
            None => 0,
        }
    }
}

/// Emitters at these pins, which are off.
pub(crate) fn emitters(pins: [Peri<'static, AnyPin>; CHANNELS]) -> [Output<'static>; CHANNELS] {
    pins.map(|pin| Output::new(pin, Level::Low, Speed::Low))
}

impl FrontEnd for Photointerrupters {
    fn light(&mut self, channel: Option<usize>) {
        (0..CHANNELS).for_each(|emitter| light(emitter as u8, channel == Some(emitter)));
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

    async fn expose<C: Clock>(
        &mut self,
        _clock: &C,
        settling_us: u16,
        channel: usize,
        conversions: u8,
    ) -> [u32; 3] {
        let input = self.inputs.channels.get(channel).copied().zip(u8::try_from(channel).ok());
        let Some((input, emitter)) = input else { return [0; 3] };
        self.converter.expose(input, emitter, conversions, settling_us).await
    }

    /// The first conversion comes right after those of a frame, so that none is thrown away.
    async fn vitals(&mut self) -> Vitals {
        let Inputs { reference, thermometer, .. } = self.inputs;
        let reference = self.converter.sum(reference, VITAL_CONVERSIONS, 0).await;
        let thermometer = self.converter.sum(thermometer, VITAL_CONVERSIONS, 0).await;
        self.factory.vitals(reference, thermometer, VITAL_CONVERSIONS)
    }
}
