//! Commands to the board: (session, command) → (session, answer); and when frames are taken.

use crate::board::Storage;
use crate::line::{Change, LineState};
use crate::settings::Settings;
use crate::setup::BoardSetup;
use crate::upload::{self, Record, Upload};
use crate::wrench::Converter;
use core::num::{NonZeroU32, NonZeroU64};
use shared_proto::{Command, Refusal, Stream};

/// Settings, schedule and calibration. Every command leaves all as it was or does all it asks.
#[derive(Debug)]
pub(crate) struct Session<'a> {
    /// What the board is, with the rate that its line is going to have.
    pub(crate) setup: BoardSetup,
    pub(crate) line: LineState,
    /// How frames are taken.
    pub(crate) settings: Settings,
    /// When frames are to be taken, `None` when not streaming.
    pub(crate) schedule: Option<Schedule>,
    /// What makes wrenches of readings, `None` without a calibration.
    pub(crate) converter: Option<Converter>,
    /// CRC-32 of the calibration in use, 0 without one.
    pub(crate) calibration_crc32: u32,
    upload: Option<Upload>,
    /// What is being uploaded; at the start, what is in storage.
    record: &'a mut Record,
}

impl<'a> Session<'a> {
    /// The session after a reset, without a calibration.
    pub(crate) fn new(setup: BoardSetup, record: &'a mut Record) -> Self {
        Self {
            line: LineState::new(setup.rate),
            setup,
            settings: Settings::DEFAULT,
            schedule: None,
            converter: None,
            calibration_crc32: 0,
            upload: None,
            record,
        }
    }

    /// Uses the calibration that is in storage, if there is one.
    pub(crate) fn load<S: Storage>(&mut self, storage: &mut S) {
        storage.load(self.record);
        if let Some(crc) = upload::kept_crc(self.record) {
            self.use_record(crc);
        }
    }

    /// Whether frames are to be taken.
    pub(crate) fn is_streaming(&self) -> bool {
        self.schedule.is_some()
    }

    /// Does what a command asks that has no answer of its own.
    ///
    /// # Errors
    /// Why it is not done, and then nothing has changed.
    pub(crate) fn execute<S: Storage>(
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
            // The core stands still while pages are erased, and frames would be lost.
            Command::CommitCalibration if self.is_streaming() => Err(Refusal::Streaming),
            Command::CommitCalibration => self.commit(storage),
            Command::Zero { frames } => {
                self.converter.as_mut().ok_or(Refusal::NoCalibration)?.start_zero(frames);
                Ok(())
            }
            _ => Err(Refusal::UnknownCommand),
        }
    }

    /// Whether the rate of before is to be set again, for nothing was heard at the new one.
    pub(crate) fn gives_up_rate(&mut self, now_us: u64) -> bool {
        let old = self.line.give_up(now_us);
        self.setup.rate = old.or(self.setup.rate);
        old.is_some()
    }

    /// Frames have to fit on the line as it will be.
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

    /// The upload is kept, so that a commit whose answer was lost can be sent again.
    fn commit<S: Storage>(&mut self, storage: &mut S) -> Result<(), Refusal> {
        let crc = self.upload.ok_or(Refusal::NoUpload)?.finish(self.record)?;
        let in_use = self.converter.is_some() && self.calibration_crc32 == crc;
        if !in_use {
            storage.store(self.record).map_err(|_| Refusal::StorageFailed)?;
            self.use_record(crc);
        }
        Ok(())
    }

    #[inline(never)] // it takes some KiB of stack, which its callers need not take, too
    fn use_record(&mut self, crc: u32) {
        if let Some(calibration) = upload::open(self.record) {
            self.converter = Some(Converter::new(calibration));
            self.calibration_crc32 = crc;
        }
    }
}

/// How late a frame may start, in µs; a slot that cannot be kept so well is skipped. It is a hundredth of the 10 ms
/// period.
const TOLERANCE_US: u64 = 100;

/// Slots at a fixed distance from the first: the error of one does not carry over to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Schedule {
    next_us: u64,
    period_us: NonZeroU32,
}

impl Schedule {
    /// The first slot is at `first_us`, the others every `period_us`, which is at least 1.
    pub(crate) fn new(first_us: u64, period_us: u32) -> Self {
        let period_us = NonZeroU32::new(period_us).unwrap_or(NonZeroU32::MIN);
        Self { next_us: first_us, period_us }
    }

    /// Time of the next slot that can still be kept, and how many before it cannot.
    pub(crate) fn next(&mut self, now_us: u64) -> (u64, u32) {
        let latest_us = self.next_us.saturating_add(TOLERANCE_US);
        let late_us = now_us.saturating_sub(latest_us);
        if late_us == 0 {
            return (self.next_us, 0); // nearly always, and without a 64-bit division
        }
        let period_us = NonZeroU64::from(self.period_us);
        let skipped = late_us.div_ceil(period_us.get());
        self.next_us = self.next_us.saturating_add(skipped * period_us.get());
        (self.next_us, u32::try_from(skipped).unwrap_or(u32::MAX))
    }

    /// The slot that [`Schedule::next`] gave is used.
    pub(crate) fn advance(&mut self) {
        self.next_us = self.next_us.saturating_add(u64::from(self.period_us.get()));
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
    use proptest::prelude::*;
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
        session: Session<'static>,
        memory: Memory,
    }

    /// The session after a reset.
    fn started<S: Storage>(storage: &mut S) -> Session<'static> {
        let record = std::boxed::Box::leak(std::boxed::Box::new([0; RECORD]));
        let mut session = Session::new(setup(1_000, 1_500), record);
        session.load(storage);
        session
    }

    impl Bench {
        fn new() -> Self {
            let mut memory = erased();
            Self { session: started(&mut memory), memory }
        }

        fn run(&mut self, command: &Command) -> Result<(), Refusal> {
            self.session.execute(command, 0, &mut self.memory)
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
            assert_eq!(bench.session.settings, Settings::DEFAULT);
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
        let schedule = bench.session.schedule.unwrap();
        assert_eq!(bench.session.execute(&Command::Start, 4_000, &mut bench.memory), Ok(()));
        assert_eq!(bench.session.schedule.unwrap(), schedule);
        bench.run_all(&[Command::Stop, Command::Stop]).unwrap();
        assert!(!bench.session.is_streaming());
    }

    #[test]
    fn a_calibration_is_kept_across_a_reset() {
        let mut bench = Bench::new();
        assert!(bench.session.converter.is_none());
        assert_eq!(bench.run_all(&good_upload()), Ok(()));
        let crc = shared_proto::crc32(&calibration().to_bytes());
        assert_eq!(bench.session.calibration_crc32, crc);

        let after = started(&mut bench.memory);
        assert_eq!((after.converter.is_some(), after.calibration_crc32), (true, crc));
    }

    #[test]
    fn a_calibration_replaces_one_of_the_other_kind() {
        let mut bench = Bench::new();
        for calibration in [calibration(), physics(), with_intercept(2.0), physics()] {
            let bytes = calibration.to_bytes();
            let crc = shared_proto::crc32(&bytes);
            assert_eq!(bench.run_all(&upload(&bytes, crc)), Ok(()));
            assert_eq!(bench.session.calibration_crc32, crc);
            assert_eq!(started(&mut bench.memory).calibration_crc32, crc);
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
        assert!(bench.session.converter.is_some());
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
    fn uploads_that_went_wrong_say_how_and_keep_the_old_calibration() {
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

        assert_eq!(bench.session.calibration_crc32, crc);
        assert_eq!(started(&mut bench.memory).calibration_crc32, crc);
    }

    #[test]
    fn a_memory_that_fails_after_erasing_has_the_old_calibration_after_a_reset() {
        let old = calibration();
        let new = with_intercept(9.0);
        let [old_crc, new_crc] = [&old, &new].map(|it| shared_proto::crc32(&it.to_bytes()));
        for outcome in CutOutcome::ALL {
            let mut slots = Slots::new(FakeFlash::new());
            let mut session = started(&mut slots);
            for command in upload(&old.to_bytes(), old_crc) {
                assert_eq!(session.execute(&command, 0, &mut slots), Ok(()));
            }
            // The first two operations erase, the third writes the first double word.
            slots.flash.cut_power(2, outcome);
            let [rest @ .., commit] = &upload(&new.to_bytes(), new_crc)[..] else { panic!() };
            for command in rest {
                assert_eq!(session.execute(command, 0, &mut slots), Ok(()));
            }
            let refused = session.execute(commit, 0, &mut slots);
            assert_eq!(refused, Err(Refusal::StorageFailed));
            assert_eq!(session.calibration_crc32, old_crc);

            slots.flash.restore_power();
            assert_eq!(started(&mut slots).calibration_crc32, old_crc);
            // The upload is still there: the commit can be tried again.
            assert_eq!(session.execute(commit, 0, &mut slots), Ok(()));
            assert_eq!(started(&mut slots).calibration_crc32, new_crc);
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
        assert_eq!(bench.session.settings.stream, Stream::Wrench);
        assert!(bench.session.converter.unwrap().is_taring());
    }

    #[test]
    fn slots_do_not_drift_with_the_time_that_frames_take() {
        let mut schedule = Schedule::new(1_000, 10_000);
        for slot in 0..1_000_000 {
            let at = 1_000 + slot * 10_000;
            assert_eq!(schedule.next(at + slot % 100), (at, 0));
            schedule.advance();
        }
    }

    #[test]
    fn slots_that_have_passed_are_skipped_and_counted() {
        let mut schedule = Schedule::new(0, 10_000);
        schedule.advance();
        assert_eq!(schedule.next(10_100), (10_000, 0));
        assert_eq!(schedule.next(10_101), (20_000, 1));
        assert_eq!(schedule.next(54_321), (60_000, 4));
        schedule.advance();
        assert_eq!(schedule.next(60_500), (70_000, 0));
    }

    proptest! {
        #[test]
        fn every_slot_is_used_or_skipped_once(
            period_us in 1..20_000_u32,
            frames in prop::collection::vec(0..60_000_u64, 1..200),
        ) {
            let mut schedule = Schedule::new(7, period_us);
            let (mut now, mut slots) = (0, 0_u64);
            for frame_us in frames {
                let (at, skipped) = schedule.next(now);
                slots += u64::from(skipped);
                prop_assert_eq!(at, 7 + slots * u64::from(period_us));
                prop_assert!(now <= at + 100);
                slots += 1;
                schedule.advance();
                now = now.max(at) + frame_us;
            }
        }
    }
}
