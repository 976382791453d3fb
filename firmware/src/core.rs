//! The state of the board, apart from everything that waits.

use crate::acquisition::Frame;
use crate::board::{Storage, VITALS_US};
use crate::line::Change;
use crate::outbox::Outbox;
use crate::session::Session;
use crate::settings::Settings;
use crate::setup::BoardSetup;
use crate::upload::Record;
use crate::wrench::Converter;
use shared_proto::{
    Answer, BoardId, Boot, CHANNELS, Command, Frame as WireFrame, Health, Identity, Packet,
    PacketOrigin, Refusal, Sample, Status, Stream, Values, Vitals,
};

/// Time between two words of the board's health, in µs.
const HEALTH_US: u64 = 1_000_000;

/// Session, outbox and counts.
#[derive(Debug)]
pub(crate) struct Core<'a> {
    pub(crate) session: Session<'a>,
    self_test: Option<SelfTest>,
    pub(crate) outbox: Outbox,
    /// The counts since the reset; what else is in it is that of the session.
    pub(crate) counts: Status,
    /// When word of the board's health is due; at once after a change.
    health_at_us: u64,
    /// What the host has been told last of the readings' times.
    described: Option<Settings>,
}

/// A self-test that was asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SelfTest {
    /// Which emitter.
    pub(crate) emitter: u8,
    number: u16,
}

/// The next action on the serial line.
#[derive(Clone, Copy, Debug)]
pub(crate) enum OnLine {
    /// Send this.
    Frame(WireFrame),
    /// Change the line itself.
    Change(Change),
}

impl<'a> Core<'a> {
    /// The state after a reset, with word of it in the outbox. `record` is where uploads are put
    /// together.
    pub(crate) fn new(setup: BoardSetup, record: &'a mut Record) -> Self {
        let BoardSetup { identity, start, reset_cause: cause, .. } = setup;
        let mut outbox = Outbox::new(PacketOrigin { board: identity.id().short(), start });
        let Identity { board, firmware, .. } = identity;
        outbox.push_now(Packet::Boot(Boot { board, firmware, cause }));
        Self {
            session: Session::new(setup, record),
            self_test: None,
            outbox,
            counts: Status { reset_cause: cause, ..Status::default() },
            health_at_us: 0,
            described: None,
        }
    }

    /// When the next frame is due, `None` when not streaming. Slots that cannot be kept any more
    /// are counted as late.
    pub(crate) fn next_slot(&mut self, now_us: u64) -> Option<u64> {
        let (slot_us, skipped) = self.session.schedule.as_mut()?.next(now_us);
        self.counts.late = self.counts.late.wrapping_add(skipped);
        Some(slot_us)
    }

    /// The slot is used: how to take the frame.
    pub(crate) fn begin_frame(&mut self) -> Settings {
        if let Some(schedule) = &mut self.session.schedule {
            schedule.advance();
        }
        self.session.settings
    }

    /// If word of the board's health goes before the sample of the frame that has just ended: whether there is time
    /// to measure it before the next.
    pub(crate) fn health_due(&mut self, now_us: u64) -> Option<bool> {
        let is_described = self.described == Some(self.session.settings);
        if is_described && now_us < self.health_at_us {
            return None;
        }
        let next_us = self.next_slot(now_us).unwrap_or(u64::MAX);
        Some(next_us.saturating_sub(now_us) >= VITALS_US)
    }

    /// A frame was taken from `start_us` to `end_us`: puts a sample of it into the outbox, and before
    /// it the board's health if there is word of it.
    pub(crate) fn finish_frame(
        &mut self,
        frame: &Frame,
        start_us: u64,
        end_us: u64,
        vitals: Option<Vitals>,
    ) {
        // The host unwraps the clock.
        let clock_us = start_us as u32;
        if let Some(vitals) = vitals {
            self.health_at_us = end_us + HEALTH_US;
            self.described = Some(self.session.settings);
            let Frame { timing, dark, .. } = *frame;
            let health = Health { sequence: 0, clock_us, timing, vitals, dark };
            self.outbox.push_in_turn(Packet::Health(health));
        }
        self.counts.frames = self.counts.frames.wrapping_add(1);
        let duration_us = u16::try_from(end_us.saturating_sub(start_us)).unwrap_or(u16::MAX);
        self.counts.longest_frame_us = self.counts.longest_frame_us.max(duration_us);

        let stream = self.session.settings.stream;
        let converter = self.session.converter.as_mut();
        let converter = converter.filter(|it| stream == Stream::Wrench || it.is_taring());
        let wrench = converter.map(|converter| converter.convert(&frame.readings, frame.saturated));
        let values = match (stream, wrench) {
            (Stream::Wrench, Some(wrench)) => Values::Wrench(wrench),
            _ => Values::Readings(frame.readings),
        };
        let (saturated, dropped) = (frame.saturated, self.counts.late as u8);
        let sample = Sample { sequence: 0, clock_us, values, saturated, dropped };
        self.outbox.push_in_turn(Packet::Sample(sample));
    }

    /// Does what a command asks and puts the answer into the outbox. Commands for another board are
    /// counted and left to it.
    pub(crate) fn command<S: Storage>(
        &mut self,
        number: u16,
        to: Option<BoardId>,
        command: &Command,
        now_us: u64,
        storage: &mut S,
    ) {
        let is_ours = to.map_or(command.is_for_all(), |to| to == self.session.setup.identity.id());
        if !is_ours {
            self.counts.foreign = self.counts.foreign.wrapping_add(1);
            return;
        }
        if let Command::Start = command {
            self.described = None; // whoever asks wants to know
        }
        let answer = match *command {
            Command::Identify => Ok(Answer::Identity(self.session.setup.identity)),
            Command::Status => Ok(Answer::Status(self.status(now_us))),
            Command::LastWords { offset } => Ok(self.session.setup.last_words.answer(offset)),
            Command::SelfTest { emitter } if usize::from(emitter) >= CHANNELS => {
                Err(Refusal::OutOfRange)
            }
            Command::SelfTest { .. } if self.session.is_streaming() => Err(Refusal::Streaming),
            Command::SelfTest { emitter } => {
                self.self_test = Some(SelfTest { emitter, number });
                return; // the answer comes when it is done
            }
            _ => self.session.execute(command, now_us, storage).map(|()| Answer::Done),
        };
        self.outbox.answer(number, answer.unwrap_or_else(Answer::Refused));
    }

    /// The self-test that was asked for, unless the board streams by now.
    pub(crate) fn take_self_test(&mut self) -> Option<SelfTest> {
        let test = self.self_test.take()?;
        if self.session.is_streaming() {
            self.outbox.answer(test.number, Answer::Refused(Refusal::Streaming));
            return None;
        }
        Some(test)
    }

    /// A self-test is done: by how much its emitter raises each channel, in steps.
    pub(crate) fn finish_self_test(&mut self, test: &SelfTest, rise: [i16; CHANNELS]) {
        let answer = Answer::SelfTest { emitter: test.emitter, rise };
        self.outbox.answer(test.number, answer);
    }

    /// The next action on the serial line, if there is one.
    pub(crate) fn next_on_line(&mut self) -> Option<OnLine> {
        let answer = self.outbox.pop_answer().map(OnLine::Frame);
        let answer = answer.or_else(|| self.session.line.take().map(OnLine::Change));
        answer.or_else(|| self.outbox.pop().map(OnLine::Frame))
    }

    fn status(&self, now_us: u64) -> Status {
        let session = &self.session;
        let Settings { stream, period_us, conversions, settling_us } = session.settings;
        Status {
            streaming: session.is_streaming(),
            calibrated: session.converter.is_some(),
            zeroed: session.converter.as_ref().is_some_and(Converter::is_zeroed),
            stream,
            period_us,
            conversions,
            settling_us,
            uptime_s: (now_us / 1_000_000) as u32,
            overflowed: self.outbox.overflowed,
            calibration_crc32: session.calibration_crc32,
            ..self.counts
        }
    }
}
