//! The state of the board, apart from everything that waits.

use crate::acquisition::Frame;
use crate::board::Storage;
use crate::last_words::LastWords;
use crate::limits::Limits;
use crate::outbox::Outbox;
use crate::session::Session;
use crate::settings::Settings;
use shared_proto::{
    Answer, BoardId, Boot, Command, Frame as WireFrame, Identity, Refusal, ResetCause, Status,
    Stream, Values,
};

/// Session, outbox and counts.
#[derive(Clone, Debug)]
pub(crate) struct Core {
    identity: Identity,
    reset_cause: ResetCause,
    session: Session,
    outbox: Outbox,
    frames: u32,
    late: u32,
    damaged: u16,
    foreign: u16,
    last_words: LastWords,
    longest_frame_us: u16,
}

impl Core {
    /// The state after a reset, with word of it in the outbox.
    pub(crate) fn new<S: Storage>(
        identity: Identity,
        reset_cause: ResetCause,
        last_words: LastWords,
        limits: Limits,
        storage: &mut S,
    ) -> Self {
        let mut outbox = Outbox::new();
        let Identity { board, firmware, .. } = identity;
        outbox.push_boot(Boot { board, firmware, cause: reset_cause });
        Self {
            identity,
            reset_cause,
            session: Session::new(limits, storage),
            outbox,
            frames: 0,
            late: 0,
            damaged: 0,
            foreign: 0,
            last_words,
            longest_frame_us: 0,
        }
    }

    /// When the next frame is due, `None` when not streaming. Slots that cannot be kept any more
    /// are counted as late.
    pub(crate) fn next_slot(&mut self, now_us: u64) -> Option<u64> {
        let (slot_us, skipped) = self.session.schedule()?.next(now_us);
        self.late = self.late.wrapping_add(skipped);
        Some(slot_us)
    }

    /// The slot is used: how to take the frame.
    pub(crate) fn begin_frame(&mut self) -> Settings {
        if let Some(schedule) = self.session.schedule() {
            schedule.advance();
        }
        *self.session.settings()
    }

    /// A frame was taken from `start_us` to `end_us`: puts a sample of it into the outbox.
    pub(crate) fn finish_frame(&mut self, frame: &Frame, start_us: u64, end_us: u64) {
        self.frames = self.frames.wrapping_add(1);
        let duration_us = u16::try_from(end_us.saturating_sub(start_us)).unwrap_or(u16::MAX);
        self.longest_frame_us = self.longest_frame_us.max(duration_us);

        let stream = self.session.settings().stream;
        let converter = self.session.converter();
        let converter = converter.filter(|it| stream == Stream::Wrench || it.is_taring());
        let wrench = converter.map(|converter| converter.convert(&frame.readings));
        let values = match (stream, wrench) {
            (Stream::Wrench, Some(wrench)) => Values::Wrench(wrench),
            _ => Values::Readings(frame.readings),
        };
        // The host unwraps the clock.
        let clock_us = start_us as u32;
        self.outbox.push_sample(clock_us, values, frame.saturated, self.late);
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
        let is_ours = to.map_or(command.is_for_all(), |to| to == self.identity.id());
        if !is_ours {
            self.foreign = self.foreign.wrapping_add(1);
            return;
        }
        let answer = match self.session.execute(command, now_us, storage) {
            Err(refusal) => Answer::Refused(refusal),
            Ok(()) => match command {
                Command::Identify => Answer::Identity(self.identity),
                Command::Status => Answer::Status(self.status(now_us)),
                Command::LastWords { offset } => self.last_words.answer(*offset),
                _ => Answer::Done,
            },
        };
        self.outbox.push_answer(number, answer);
    }

    /// Answers a command of another version of the protocol, whose number cannot be known.
    pub(crate) fn refuse_other_version(&mut self) {
        self.outbox.push_answer(0, Answer::Refused(Refusal::OtherVersion));
    }

    /// So many frames have arrived damaged since the reset.
    pub(crate) fn set_damaged(&mut self, damaged: u64) {
        self.damaged = damaged as u16;
    }

    /// What goes out next.
    pub(crate) fn pop(&mut self) -> Option<WireFrame> {
        self.outbox.pop()
    }

    fn status(&self, now_us: u64) -> Status {
        let settings = self.session.settings();
        Status {
            streaming: self.session.is_streaming(),
            calibrated: self.session.is_calibrated(),
            zeroed: self.session.is_zeroed(),
            stream: settings.stream,
            reset_cause: self.reset_cause,
            period_us: settings.period_us,
            conversions: settings.conversions,
            settling_us: settings.settling_us,
            uptime_s: (now_us / 1_000_000) as u32,
            frames: self.frames,
            late: self.late,
            overflowed: self.outbox.overflowed(),
            damaged: self.damaged,
            longest_frame_us: self.longest_frame_us,
            calibration_crc32: self.session.calibration_crc32(),
            foreign: self.foreign,
        }
    }
}
