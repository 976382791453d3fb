//! State of the board, in code that never waits: effects of commands, and samples from frames.

use crate::acquisition::{Frame, Schedule, Settings};
use crate::board::{Storage, VITALS_US};
use crate::line::{Change, LineState};
use crate::outbox::Outbox;
use crate::setup::BoardSetup;
use crate::upload::{self, Record, Upload};
use crate::wrench::Converter;
use shared_proto::{
    Answer, BoardId, Boot, CHANNELS, Command, Frame as WireFrame, Health, Identity, Packet,
    PacketOrigin, Refusal, Sample, Status, Stream, Values, Vitals,
};

const HEALTH_US: u64 = 1_000_000;

/// State of the board. A command takes effect completely or not at all.
#[derive(Debug)]
pub(crate) struct Core<'a> {
    /// Identity and limits, with the rate that the line is about to have.
    setup: BoardSetup,
    pub(crate) line: LineState,
    pub(crate) settings: Settings,
    schedule: Option<Schedule>,
    converter: Option<Converter>,
    upload: Option<Upload>,
    /// The record being uploaded; at first, the one in storage.
    record: &'a mut Record,
    self_test: Option<SelfTest>,
    pub(crate) outbox: Outbox,
    /// Counts since the reset, its cause, and the CRC-32 of the calibration in use.
    pub(crate) counts: Status,
    /// When a health report is due; after a change, immediately.
    health_at_us: u64,
    /// Settings in the last report of the timing to the host.
    described: Option<Settings>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SelfTest {
    pub(crate) emitter: u8,
    number: u16,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum OnLine {
    Frame(WireFrame),
    Change(Change),
}

impl<'a> Core<'a> {
    /// Creates the state after a reset, with its report queued. `record` holds uploads.
    pub(crate) fn new(setup: BoardSetup, record: &'a mut Record) -> Self {
        let BoardSetup { identity, start, reset_cause: cause, .. } = setup;
        let mut outbox = Outbox::new(PacketOrigin { board: identity.id().short(), start });
        let Identity { board, firmware, .. } = identity;
        outbox.push_now(Packet::Boot(Boot { board, firmware, cause }));
        Self {
            line: LineState::new(setup.rate),
            setup,
            settings: Settings::DEFAULT,
            schedule: None,
            converter: None,
            upload: None,
            record,
            self_test: None,
            outbox,
            counts: Status { reset_cause: cause, ..Status::default() },
            health_at_us: 0,
            described: None,
        }
    }

    /// Returns when the next frame is due, if streaming. Slots that cannot be met count as late.
    pub(crate) fn next_slot(&mut self, now_us: u64) -> Option<u64> {
        let (slot_us, skipped) = self.schedule.as_mut()?.next(now_us);
        self.counts.late = self.counts.late.wrapping_add(skipped);
        Some(slot_us)
    }

    /// Uses the slot; returns the settings of the frame and the duration of a conversion, ns.
    pub(crate) fn begin_frame(&mut self) -> (Settings, u32) {
        if let Some(schedule) = &mut self.schedule {
            schedule.advance();
        }
        (self.settings, self.setup.conversion_ns)
    }

    /// Returns `None` if the last frame needs no health report; otherwise true if there is time to
    /// measure before the next frame.
    pub(crate) fn health_due(&mut self, now_us: u64) -> Option<bool> {
        let is_described = self.described == Some(self.settings);
        if is_described && now_us < self.health_at_us {
            return None;
        }
        let next_us = self.next_slot(now_us).unwrap_or(u64::MAX);
        Some(next_us.saturating_sub(now_us) >= VITALS_US)
    }

    /// Puts a sample of the frame into the outbox, after a health report if there are vitals.
    pub(crate) fn finish_frame(
        &mut self,
        frame: &Frame,
        start_us: u64,
        end_us: u64,
        vitals: Option<Vitals>,
    ) {
        // The clock wraps; the host unwraps it.
        let clock_us = start_us as u32;
        if let Some(vitals) = vitals {
            self.health_at_us = end_us + HEALTH_US;
            self.described = Some(self.settings);
            let Frame { timing, dark, .. } = *frame;
            let health = Health { sequence: 0, clock_us, timing, vitals, dark };
            self.outbox.push_in_turn(Packet::Health(health));
        }
        self.counts.frames = self.counts.frames.wrapping_add(1);
        let duration_us = u16::try_from(end_us.saturating_sub(start_us)).unwrap_or(u16::MAX);
        self.counts.longest_frame_us = self.counts.longest_frame_us.max(duration_us);

        let stream = self.settings.stream;
        let converter = self.converter.as_mut();
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

    /// Executes a command and queues its answer; a command for another board is only counted.
    pub(crate) fn command<S: Storage>(
        &mut self,
        number: u16,
        to: Option<BoardId>,
        command: &Command,
        now_us: u64,
        storage: &mut S,
    ) {
        let is_ours = to.map_or(command.is_for_all(), |to| to == self.setup.identity.id());
        if !is_ours {
            self.counts.foreign = self.counts.foreign.wrapping_add(1);
            return;
        }
        if let Command::Start = command {
            self.described = None; // a repeated start requests a new report
        }
        let answer = match *command {
            Command::Identify => Ok(Answer::Identity(self.setup.identity)),
            Command::Status => Ok(Answer::Status(self.status(now_us))),
            Command::LastWords { offset } => Ok(self.setup.last_words.answer(offset)),
            Command::SelfTest { emitter } if usize::from(emitter) >= CHANNELS => {
                Err(Refusal::OutOfRange)
            }
            Command::SelfTest { .. } if self.is_streaming() => Err(Refusal::Streaming),
            Command::SelfTest { emitter } => {
                self.self_test = Some(SelfTest { emitter, number });
                return; // the answer follows after the test
            }
            _ => self.execute(command, now_us, storage).map(|()| Answer::Done),
        };
        self.outbox.answer(number, answer.unwrap_or_else(Answer::Refused));
    }

    pub(crate) fn take_self_test(&mut self) -> Option<SelfTest> {
        let test = self.self_test.take()?;
        if self.is_streaming() {
            self.outbox.answer(test.number, Answer::Refused(Refusal::Streaming));
            return None;
        }
        Some(test)
    }

    pub(crate) fn finish_self_test(&mut self, test: &SelfTest, rise: [i16; CHANNELS]) {
        let answer = Answer::SelfTest { emitter: test.emitter, rise };
        self.outbox.answer(test.number, answer);
    }

    pub(crate) fn next_on_line(&mut self) -> Option<OnLine> {
        let answer = self.outbox.pop_answer().map(OnLine::Frame);
        let answer = answer.or_else(|| self.line.take().map(OnLine::Change));
        answer.or_else(|| self.outbox.pop().map(OnLine::Frame))
    }

    pub(crate) fn load<S: Storage>(&mut self, storage: &mut S) {
        storage.load(self.record);
        if let Some(crc) = upload::kept_crc(self.record) {
            self.use_record(crc);
        }
    }

    fn is_streaming(&self) -> bool {
        self.schedule.is_some()
    }

    /// Executes a command whose answer carries no data; a refusal leaves the state unchanged.
    fn execute<S: Storage>(
        &mut self,
        command: &Command,
        now_us: u64,
        storage: &mut S,
    ) -> Result<(), Refusal> {
        match *command {
            Command::SetBaud { baud } => self.set_baud(baud),
            Command::Bootloader if !self.setup.has_bootloader => Err(Refusal::NotOnThisBoard),
            Command::Bootloader => {
                self.line.want(Change::Bootloader);
                self.schedule = None;
                Ok(())
            }
            Command::Start => {
                self.schedule.get_or_insert(Schedule::new(now_us, self.settings.period_us));
                Ok(())
            }
            Command::Stop => {
                self.schedule = None;
                Ok(())
            }
            Command::SetPeriod { period_us } => {
                self.change(Settings { period_us, ..self.settings }, now_us)
            }
            Command::SetOversampling { conversions } => {
                self.change(Settings { conversions, ..self.settings }, now_us)
            }
            Command::SetSettling { settling_us } => {
                self.change(Settings { settling_us, ..self.settings }, now_us)
            }
            Command::SetStream(Stream::Wrench) if self.converter.is_none() => {
                Err(Refusal::NoCalibration)
            }
            Command::SetStream(stream @ (Stream::Raw | Stream::Wrench)) => {
                self.change(Settings { stream, ..self.settings }, now_us)
            }
            Command::BeginCalibration { size, crc32 } => {
                self.upload = Some(Upload::begin(size, crc32, self.record)?);
                Ok(())
            }
            Command::CalibrationPiece { offset, ref data } => {
                self.upload.as_mut().ok_or(Refusal::NoUpload)?.piece(offset, data, self.record)
            }
            // Erasing pages stops the core, which would lose frames.
            Command::CommitCalibration if self.is_streaming() => Err(Refusal::Streaming),
            Command::CommitCalibration => self.commit(storage),
            Command::Zero { frames } => {
                self.converter.as_mut().ok_or(Refusal::NoCalibration)?.start_zero(frames);
                Ok(())
            }
            _ => Err(Refusal::UnknownCommand),
        }
    }

    /// Returns true to restore the previous rate, as nothing was heard at the new one.
    pub(crate) fn gives_up_rate(&mut self, now_us: u64) -> bool {
        let old = self.line.give_up(now_us);
        self.setup.rate = old.or(self.setup.rate);
        old.is_some()
    }

    fn set_baud(&mut self, name: u32) -> Result<(), Refusal> {
        let rate = self.setup.rates.iter().find(|rate| rate.name == name);
        let rate = *rate.ok_or(match self.setup.rates {
            [] => Refusal::NotOnThisBoard,
            _ => Refusal::OutOfRange,
        })?;
        self.setup.check(&self.settings, Some(rate))?;
        self.setup.rate = Some(rate);
        self.line.want(Change::Rate(rate));
        Ok(())
    }

    fn change(&mut self, settings: Settings, now_us: u64) -> Result<(), Refusal> {
        self.setup.check(&settings, self.setup.rate)?;
        if self.is_streaming() && settings.period_us != self.settings.period_us {
            let first_us = now_us + u64::from(settings.period_us);
            self.schedule = Some(Schedule::new(first_us, settings.period_us));
        }
        self.settings = settings;
        Ok(())
    }

    /// Stores the upload and keeps it, so that a commit whose answer was lost can be repeated.
    fn commit<S: Storage>(&mut self, storage: &mut S) -> Result<(), Refusal> {
        let crc = self.upload.ok_or(Refusal::NoUpload)?.finish(self.record)?;
        let in_use = self.converter.is_some() && self.counts.calibration_crc32 == crc;
        if !in_use {
            storage.store(self.record).map_err(|_| Refusal::StorageFailed)?;
            self.use_record(crc);
        }
        Ok(())
    }

    #[inline(never)] // keeps some KiB of stack out of the callers' frames
    fn use_record(&mut self, crc: u32) {
        if let Some(calibration) = upload::open(self.record) {
            self.converter = Some(Converter::new(calibration));
            self.counts.calibration_crc32 = crc;
        }
    }

    fn status(&self, now_us: u64) -> Status {
        let Settings { stream, period_us, conversions, settling_us } = self.settings;
        Status {
            streaming: self.is_streaming(),
            calibrated: self.converter.is_some(),
            zeroed: self.converter.as_ref().is_some_and(Converter::is_zeroed),
            stream,
            period_us,
            conversions,
            settling_us,
            uptime_s: (now_us / 1_000_000) as u32,
            overflowed: self.outbox.overflowed,
            ..self.counts
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::board::StorageError;
    use crate::setup::tests::setup;
    use crate::slots::Slots;
    use crate::slots::tests::fake_flash::{CutOutcome, FakeFlash};
    use crate::upload::RECORD;
    use shared_proto::{
        AXES, CHANNELS, Calibration, Cubic, FEATURES, MAX_PIECE, Physics, PhysicsSensor, Piece,
    };
    use std::vec::Vec;

    struct Memory {
        record: Record,
        works: bool,
        stored: u32,
    }

    impl Storage for Memory {
        fn load(&mut self, record: &mut Record) {
            *record = self.record;
        }

        fn store(&mut self, record: &Record) -> Result<(), StorageError> {
            if !self.works {
                return Err(StorageError);
            }
            self.record = *record;
            self.stored += 1;
            Ok(())
        }
    }

    fn erased() -> Memory {
        Memory { record: [0xFF; RECORD], works: true, stored: 0 }
    }

    fn with_intercept(intercept: f32) -> Calibration {
        Calibration::Cubic(Cubic {
            centre: [3e4; CHANNELS],
            scale: [1e-4; CHANNELS],
            coefficients: [[0.125; AXES]; FEATURES],
            intercept: [intercept; AXES],
        })
    }

    fn calibration() -> Calibration {
        with_intercept(1.0)
    }

    fn physics() -> Calibration {
        Calibration::Physics(Physics {
            wrench_scale: [1.0; AXES],
            prior: core::array::from_fn(
                |i| if [0, 2, 5, 9, 14, 20].contains(&i) { 1.0 } else { 0.0 },
            ),
            reading_variance: 1e-4,
            displacement_variance: 0.0,
            sensors: [PhysicsSensor::default(); CHANNELS],
        })
    }

    fn upload(bytes: &[u8], crc32: u32) -> Vec<Command> {
        let size = bytes.len() as u32;
        let pieces = bytes.chunks(MAX_PIECE).enumerate().map(|(i, piece)| {
            let data = Piece::copy_of(piece).unwrap();
            Command::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data }
        });
        let begin = Command::BeginCalibration { size, crc32 };
        [begin].into_iter().chain(pieces).chain([Command::CommitCalibration]).collect()
    }

    fn good_upload() -> Vec<Command> {
        let bytes = calibration().to_bytes();
        upload(&bytes, shared_proto::crc32(&bytes))
    }

    struct Bench {
        core: Core<'static>,
        memory: Memory,
    }

    fn started<S: Storage>(storage: &mut S) -> Core<'static> {
        let record = std::boxed::Box::leak(std::boxed::Box::new([0; RECORD]));
        let mut core = Core::new(setup(1_000, 1_500), record);
        core.load(storage);
        core
    }

    impl Bench {
        fn new() -> Self {
            let mut memory = erased();
            Self { core: started(&mut memory), memory }
        }

        fn run(&mut self, command: &Command) -> Result<(), Refusal> {
            self.core.execute(command, 0, &mut self.memory)
        }

        fn run_all(&mut self, commands: &[Command]) -> Result<(), Refusal> {
            commands.iter().try_for_each(|command| self.run(command))
        }
    }

    #[test]
    fn settings_outside_their_range_are_refused_and_nothing_changes() {
        let mut bench = Bench::new();
        // 8 · (2 · settling + 3 · 8 · 1.5 µs + 30 µs)
        let too_short = |shortest_us| Refusal::PeriodTooShort { shortest_us };
        let refused = [
            (Command::SetPeriod { period_us: 0 }, Refusal::OutOfRange),
            (Command::SetPeriod { period_us: 999 }, Refusal::OutOfRange),
            (Command::SetPeriod { period_us: 10_000_001 }, Refusal::OutOfRange),
            (Command::SetPeriod { period_us: 1_000 }, too_short(2_128)),
            (Command::SetOversampling { conversions: 0 }, Refusal::OutOfRange),
            (Command::SetOversampling { conversions: 65 }, Refusal::OutOfRange),
            (Command::SetSettling { settling_us: 10_001 }, Refusal::OutOfRange),
            (Command::SetSettling { settling_us: 1_000 }, too_short(16_528)),
            (Command::SetStream(Stream::Other(7)), Refusal::UnknownCommand),
            (Command::Unknown(77), Refusal::UnknownCommand),
        ];
        for (command, refusal) in refused {
            assert_eq!(bench.run(&command), Err(refusal), "{command:?}");
            assert_eq!(bench.core.settings, Settings::DEFAULT);
        }
    }

    #[test]
    fn a_thousand_hertz_fits_once_settling_and_oversampling_are_lower() {
        let mut bench = Bench::new();
        let commands = [
            Command::SetSettling { settling_us: 25 },
            Command::SetOversampling { conversions: 8 },
            Command::SetPeriod { period_us: 1_000 },
        ];
        assert_eq!(bench.run_all(&commands), Ok(()));
    }

    #[test]
    fn starting_twice_does_not_move_the_slots() {
        let mut bench = Bench::new();
        bench.run(&Command::Start).unwrap();
        let schedule = bench.core.schedule.unwrap();
        assert_eq!(bench.core.execute(&Command::Start, 4_000, &mut bench.memory), Ok(()));
        assert_eq!(bench.core.schedule.unwrap(), schedule);
        bench.run_all(&[Command::Stop, Command::Stop]).unwrap();
        assert!(!bench.core.is_streaming());
    }

    #[test]
    fn a_calibration_is_kept_across_a_reset() {
        let mut bench = Bench::new();
        assert!(bench.core.converter.is_none());
        assert_eq!(bench.run_all(&good_upload()), Ok(()));
        let crc = shared_proto::crc32(&calibration().to_bytes());
        assert_eq!(bench.core.counts.calibration_crc32, crc);

        let after = started(&mut bench.memory);
        assert_eq!((after.converter.is_some(), after.counts.calibration_crc32), (true, crc));
    }

    #[test]
    fn a_calibration_replaces_one_of_the_other_kind() {
        let mut bench = Bench::new();
        for calibration in [calibration(), physics(), with_intercept(2.0), physics()] {
            let bytes = calibration.to_bytes();
            let crc = shared_proto::crc32(&bytes);
            assert_eq!(bench.run_all(&upload(&bytes, crc)), Ok(()));
            assert_eq!(bench.core.counts.calibration_crc32, crc);
            assert_eq!(started(&mut bench.memory).counts.calibration_crc32, crc);
        }
    }

    #[test]
    fn a_commit_while_streaming_is_refused_and_done_after_it() {
        let mut bench = Bench::new();
        let [pieces @ .., commit] = &good_upload()[..] else { panic!() };
        bench.run(&Command::Start).unwrap();
        bench.run_all(pieces).unwrap();
        assert_eq!(bench.run(commit), Err(Refusal::Streaming));
        assert_eq!(bench.memory.stored, 0);
        bench.run_all(&[Command::Stop, *commit]).unwrap();
        assert!(bench.core.converter.is_some());
    }

    #[test]
    fn a_damaged_record_is_no_calibration() {
        let mut bench = Bench::new();
        bench.run_all(&good_upload()).unwrap();
        bench.memory.record[100] ^= 1;
        assert!(started(&mut bench.memory).converter.is_none());
    }

    #[test]
    fn every_command_of_an_upload_can_be_sent_again() {
        let mut bench = Bench::new();
        for command in good_upload() {
            assert_eq!(bench.run(&command), Ok(()));
            assert_eq!(bench.run(&command), Ok(()));
        }
        assert_eq!(bench.memory.stored, 1);
    }

    #[test]
    fn failed_uploads_report_the_reason_and_keep_the_old_calibration() {
        let mut bench = Bench::new();
        let bytes = calibration().to_bytes();
        let crc = shared_proto::crc32(&bytes);
        assert_eq!(bench.run(&Command::CommitCalibration), Err(Refusal::NoUpload));
        assert_eq!(bench.run(&good_upload()[1]), Err(Refusal::NoUpload));
        bench.run_all(&good_upload()).unwrap();

        let other = with_intercept(9.0).to_bytes();
        let other_crc = shared_proto::crc32(&other);
        let begin = |size| Command::BeginCalibration { size, crc32: 1 };
        assert_eq!(bench.run(&begin(667)), Err(Refusal::WrongSize));
        assert_eq!(bench.run(&begin(u32::MAX)), Err(Refusal::WrongSize));

        let commands = upload(&other, other_crc);
        bench.run_all(&commands[..3]).unwrap();
        assert_eq!(bench.run(&commands[4]), Err(Refusal::WrongOffset));
        assert_eq!(bench.run(&Command::CommitCalibration), Err(Refusal::WrongSize));
        let data = Piece::copy_of(&[0; MAX_PIECE]).unwrap();
        bench.run_all(&commands[3..commands.len() - 1]).unwrap();
        let beyond = Command::CalibrationPiece { offset: 640, data };
        assert_eq!(bench.run(&beyond), Err(Refusal::WrongSize));

        assert_eq!(bench.run_all(&upload(&other, other_crc ^ 1)), Err(Refusal::WrongCrc));
        let mut foreign = other.to_vec();
        foreign[0] = 9;
        let foreign_crc = shared_proto::crc32(&foreign);
        assert_eq!(bench.run_all(&upload(&foreign, foreign_crc)), Err(Refusal::BadCalibration));
        bench.memory.works = false;
        assert_eq!(bench.run_all(&upload(&other, other_crc)), Err(Refusal::StorageFailed));

        assert_eq!(bench.core.counts.calibration_crc32, crc);
        assert_eq!(started(&mut bench.memory).counts.calibration_crc32, crc);
    }

    #[test]
    fn a_memory_that_fails_after_erasing_has_the_old_calibration_after_a_reset() {
        let old = calibration();
        let new = with_intercept(9.0);
        let [old_crc, new_crc] = [&old, &new].map(|it| shared_proto::crc32(&it.to_bytes()));
        for outcome in CutOutcome::ALL {
            let mut slots = Slots::new(FakeFlash::new());
            let mut core = started(&mut slots);
            for command in upload(&old.to_bytes(), old_crc) {
                assert_eq!(core.execute(&command, 0, &mut slots), Ok(()));
            }
            // The first two operations erase, the third writes the first double word.
            slots.flash.cut_power(2, outcome);
            let [rest @ .., commit] = &upload(&new.to_bytes(), new_crc)[..] else { panic!() };
            for command in rest {
                assert_eq!(core.execute(command, 0, &mut slots), Ok(()));
            }
            let refused = core.execute(commit, 0, &mut slots);
            assert_eq!(refused, Err(Refusal::StorageFailed));
            assert_eq!(core.counts.calibration_crc32, old_crc);

            slots.flash.restore_power();
            assert_eq!(started(&mut slots).counts.calibration_crc32, old_crc);
            // The upload is still there: the commit can be retried.
            assert_eq!(core.execute(commit, 0, &mut slots), Ok(()));
            assert_eq!(started(&mut slots).counts.calibration_crc32, new_crc);
        }
    }

    #[test]
    fn wrenches_and_zeros_need_a_calibration() {
        let mut bench = Bench::new();
        let commands = [Command::SetStream(Stream::Wrench), Command::Zero { frames: 5 }];
        for command in &commands {
            assert_eq!(bench.run(command), Err(Refusal::NoCalibration));
        }
        bench.run_all(&good_upload()).unwrap();
        assert_eq!(bench.run_all(&commands), Ok(()));
        assert_eq!(bench.core.settings.stream, Stream::Wrench);
        assert!(bench.core.converter.unwrap().is_taring());
    }
}
