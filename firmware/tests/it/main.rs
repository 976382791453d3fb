//! The whole firmware in virtual time, tested through the bytes on its link.

mod bench;
mod line;

use bench::{Bench, SERIAL, readings, wrench};
use firmware::Converter;
use shared_proto::{
    Answer, Board, BoardId, Boot, Calibration, Command, Cubic, Identity, Packet, Refusal,
    ResetCause, Stream,
};

fn calibration() -> Calibration {
    let mut coefficients = [[0.0; 6]; 24];
    for (i, value) in coefficients.as_flattened_mut().iter_mut().enumerate() {
        *value = ((i * 7 % 11) as f32 - 5.0) / 8.0;
    }
    let centre = [2e3, 4e3, 6e3, 8e3, 1e4, 1.2e4, 1.4e4, 1.6e4];
    let scale = [1e-3; 8];
    Calibration::Cubic(Cubic { centre, scale, coefficients, intercept: [0.5; 6] })
}

#[test]
fn half_a_minute_at_100_hz_has_every_frame_on_its_slot() {
    let mut bench = Bench::new();
    let played = |channel: usize, us: u64| {
        let frame = (us / 10_000) as u16;
        (50 + channel as u16, 1_000 + frame % 2_000 + channel as u16)
    };
    bench.play(played);
    bench.run_for(20_000);
    let mut samples = bench.done(Command::Start);
    bench.run_for(30_000_000);
    samples.extend(bench.samples());
    assert_eq!(samples.len(), 3_001);
    for (i, sample) in samples.iter().enumerate() {
        assert_eq!(usize::from(sample.sequence), i);
        assert_eq!(sample.clock_us as usize, 20_000 + 10_000 * i);
        assert_eq!((sample.saturated, sample.dropped), (0, 0));
        let expected: [u16; 8] = std::array::from_fn(|channel| {
            let (dark, lit) = played(channel, u64::from(sample.clock_us));
            16 * (lit - dark)
        });
        assert_eq!(readings(sample), expected);
    }
    assert_eq!(*bench.world.faults.borrow(), Vec::<String>::new());
    let status = bench.status();
    assert_eq!((status.frames, status.late, status.overflowed), (3_001, 0, 0));
    assert!(status.streaming);
    // Eight channels, two settlings and three times 8 conversions of 1.5 µs.
    assert_eq!(status.longest_frame_us, 8 * (2 * 100 + 3 * 12));
}

#[test]
fn a_frame_that_takes_too_long_skips_slots_and_counts_them() {
    let mut bench = Bench::new();
    let mut samples = bench.done(Command::Start);
    bench.run_for(45_000);
    bench.world.stall_us.set(34_000);
    bench.run_for(106_000);
    samples.extend(bench.samples());
    let clocks: Vec<u32> = samples.iter().map(|sample| sample.clock_us / 1_000).collect();
    assert_eq!(clocks, [0, 10, 20, 30, 40, 50, 90, 100, 110, 120, 130, 140, 150]);
    let dropped: Vec<u8> = samples.iter().map(|sample| sample.dropped).collect();
    assert_eq!(dropped, [0, 0, 0, 0, 0, 0, 3, 3, 3, 3, 3, 3, 3]);
    assert!(samples.iter().enumerate().all(|(i, sample)| usize::from(sample.sequence) == i));
    let status = bench.status();
    assert_eq!((status.frames, status.late), (13, 3));
    assert_eq!(u64::from(status.longest_frame_us), 8 * 236 + 34_000);
}

#[test]
fn a_blocked_link_drops_samples_and_counts_them() {
    let mut bench = Bench::new();
    bench.done(Command::Start);
    bench.world.held_up.set(true);
    bench.run_for(1_000_000);
    assert!(bench.samples().is_empty());
    bench.world.held_up.set(false);
    bench.run_for(100_000);
    let samples = bench.samples();
    // One sample on its way, the last 15 entries of the queue (one of them a health report), then
    // those of the 100 ms; the 84 between are counted.
    assert_eq!(samples.len(), 16 + 10);
    let sequence: Vec<u16> = samples.iter().map(|sample| sample.sequence).collect();
    assert_eq!(sequence, (1..27).collect::<Vec<u16>>());
    assert_eq!((samples[0].clock_us, samples[0].dropped), (10_000, 0));
    for (i, sample) in samples.iter().enumerate().skip(1) {
        assert_eq!((sample.clock_us as usize, sample.dropped), (850_000 + 10_000 * i, 84));
    }
    let status = bench.status();
    assert_eq!((status.overflowed, status.late), (84, 0));
}

#[test]
fn settings_take_effect_and_are_in_the_status() {
    let mut bench = Bench::new();
    bench.done(Command::SetSettling { settling_us: 20 });
    bench.world.settling_us.set(20);
    bench.done(Command::SetOversampling { conversions: 4 });
    bench.done(Command::SetPeriod { period_us: 1_000 });
    bench.done(Command::Start);
    bench.run_for(1_000_000);
    let samples = bench.samples();
    assert!((999..=1_000).contains(&samples.len()), "{}", samples.len());
    assert!(samples.windows(2).all(|pair| pair[1].clock_us - pair[0].clock_us == 1_000));
    assert_eq!(*bench.world.faults.borrow(), Vec::<String>::new());
    let status = bench.status();
    assert_eq!((status.period_us, status.conversions, status.settling_us), (1_000, 4, 20));
    assert_eq!(status.late, 0);
}

#[test]
fn a_new_period_counts_from_the_command_and_stopping_stops() {
    let mut bench = Bench::new();
    bench.done(Command::Start);
    bench.run_for(44_000);
    bench.samples();
    bench.done(Command::SetPeriod { period_us: 20_000 });
    bench.run_for(60_000);
    let clocks: Vec<u32> = bench.samples().iter().map(|sample| sample.clock_us).collect();
    assert_eq!(clocks, [68_000, 88_000, 108_000]);
    bench.done(Command::Stop);
    bench.run_for(1_000_000);
    assert!(bench.packets().is_empty());
    let samples = bench.done(Command::Start);
    assert_eq!(samples[0].sequence, 8);
}

#[test]
fn wrenches_equal_those_of_the_calibration_uploaded_less_the_zero() {
    let mut bench = Bench::new();
    bench.play(|channel, us| (100, 200 + 100 * channel as u16 + (us / 10_000 % 50) as u16));
    assert_eq!(
        bench.ask(Command::SetStream(Stream::Wrench)).0,
        Answer::Refused(Refusal::NoCalibration)
    );
    bench.upload(&calibration());
    bench.done(Command::Start);
    bench.run_for(50_000);
    let raw = bench.samples();
    bench.done(Command::SetStream(Stream::Wrench));
    bench.run_for(1_000_000);
    let mut converter = Converter::new(calibration());
    let expected = |converter: &mut Converter, clock_us: u32| {
        let step = (clock_us / 10_000 % 50) as u16;
        converter.convert(&std::array::from_fn(|c| 16 * (100 + 100 * c as u16 + step)), 0)
    };
    let samples = bench.samples();
    assert!(samples.len() >= 99 && raw.len() >= 4);
    for sample in &samples {
        assert_eq!(wrench(sample), expected(&mut converter, sample.clock_us));
    }
    // 50 frames are one period of the played signal, so their mean is that of any period.
    bench.done(Command::Zero { frames: 50 });
    bench.run_for(600_000);
    bench.samples();
    assert!(bench.status().zeroed);
    bench.run_for(500_000);
    let turn = bench.samples();
    let turn = &turn[turn.len() - 50..];
    for axis in 0..6 {
        let mean = turn.iter().map(|sample| wrench(sample)[axis]).sum::<f32>() / 50.0;
        // 50 roundings of values of up to about 20 N.
        assert!(mean.abs() < 1e-4, "{mean}");
    }
    bench.done(Command::Zero { frames: 0 });
    bench.run_for(20_000);
    let last = *bench.samples().last().unwrap();
    assert_eq!(wrench(&last), expected(&mut converter, last.clock_us));
}

#[test]
fn a_zero_can_be_taken_while_readings_are_streamed() {
    let mut bench = Bench::new();
    bench.upload(&calibration());
    bench.done(Command::Zero { frames: 3 });
    assert!(!bench.status().zeroed);
    bench.done(Command::Start);
    bench.run_for(40_000);
    assert!(bench.status().zeroed);
    bench.done(Command::SetStream(Stream::Wrench));
    bench.run_for(20_000);
    let last = *bench.samples().last().unwrap();
    assert_eq!(wrench(&last), [0.0; 6]);
}

#[test]
fn the_calibration_survives_a_reset_that_the_board_reports() {
    let mut bench = Bench::new();
    bench.upload(&calibration());
    let record = *bench.world.record.borrow();
    let crc = bench.status().calibration_crc32;
    assert_eq!(crc, shared_proto::crc32(&calibration().to_bytes()));

    let mut bench = Bench::with(ResetCause::Watchdog, record);
    bench.run_for(1);
    let cause = ResetCause::Watchdog;
    let boot = Boot { board: Board::Simulated, firmware: firmware::VERSION, cause };
    assert_eq!(bench.packets(), [Packet::Boot(boot)]);
    let status = bench.status();
    assert_eq!((status.calibrated, status.calibration_crc32), (true, crc));
    assert_eq!((status.reset_cause, status.streaming), (ResetCause::Watchdog, false));
}

#[test]
fn the_board_identifies_itself() {
    let identity = Identity {
        board: Board::Simulated,
        firmware: [0, 2, 0],
        serial: SERIAL,
        min_period_us: 1_000,
    };
    let mut bench = Bench::new();
    assert_eq!(bench.ask(Command::Identify).0, Answer::Identity(identity));
    let unknown = Command::Unknown(99);
    assert_eq!(bench.ask(unknown).0, Answer::Refused(Refusal::UnknownCommand));
}

#[test]
fn commands_for_another_board_are_counted_and_left_to_it() {
    let mut bench = Bench::new();
    bench.run_for(1);
    bench.packets();
    let ours = bench.to;
    for to in [None, Some(BoardId::from_serial(b"another one."))] {
        bench.to = to;
        bench.tell(Command::SetPeriod { period_us: 20_000 });
        bench.tell(Command::BeginCalibration { size: 668, crc32: 1 });
        assert_eq!(bench.packets(), []);
    }
    bench.to = Some(BoardId::from_serial(b"another one."));
    bench.tell(Command::Start);
    assert_eq!(bench.packets(), []);
    bench.to = None;
    let status = bench.status();
    assert_eq!((status.foreign, status.period_us, status.streaming), (5, 10_000, false));
    bench.to = ours;
    bench.done(Command::SetPeriod { period_us: 20_000 });
}

#[test]
fn the_last_words_of_the_previous_run_are_reported() {
    let mut bench = Bench::new();
    let answer = bench.ask(Command::LastWords { offset: 0 }).0;
    let text = shared_proto::Piece::copy_of(&bench::LAST_WORDS[..32]).unwrap();
    let len = bench::LAST_WORDS.len() as u16;
    assert_eq!(answer, Answer::LastWords { len, text });
    let answer = bench.ask(Command::LastWords { offset: 32 }).0;
    let text = shared_proto::Piece::copy_of(&bench::LAST_WORDS[32..]).unwrap();
    assert_eq!(answer, Answer::LastWords { len, text });
}

#[test]
fn channels_at_the_end_of_the_range_are_flagged() {
    let mut bench = Bench::new();
    bench.play(|channel, _| match channel {
        1 => (10, 4_095),
        4 => (0, 0),
        7 => (4_095, 4_095),
        _ => (10, 4_092),
    });
    let samples = bench.done(Command::Start);
    bench.run_for(10_000);
    let sample = samples.first().copied().unwrap_or_else(|| bench.samples()[0]);
    assert_eq!(sample.saturated, 0b1001_0010);
    assert_eq!(readings(&sample)[0], 16 * 4_082);
}

#[test]
fn noise_on_the_line_is_counted_and_does_no_harm() {
    let mut bench = Bench::new();
    bench.run_for(1);
    bench.send(&[0]);
    for i in 0..10_000_u32 {
        bench.send(&[(i.wrapping_mul(2_654_435_761) >> 24) as u8]);
    }
    bench.send(&[0]);
    bench.run_for(1_000);
    bench.packets();
    let status = bench.status();
    assert!(status.damaged > 10);
    assert_eq!(status.period_us, 10_000);
}

#[test]
fn a_command_of_another_version_is_refused_but_its_samples_are_not_answered() {
    let mut bench = Bench::new();
    bench.run_for(1);
    bench.packets();
    // Version 4, made by hand: a command, and a sample.
    bench.send(&[0x01, 0x03, 0x48, 0x05, 0x05, 0x61, 0x62, 0x57, 0x64, 0x00]);
    bench.send(&[0x01, 0x03, 0x44, 0x05, 0x05, 0x61, 0x62, 0xA0, 0x2D, 0x00]);
    bench.run_for(1_000);
    let refused = Packet::Answer { number: 0, answer: Answer::Refused(Refusal::OtherVersion) };
    assert_eq!(bench.packets(), [refused]);
    bench.send(&[0x01, 0x03, 0x28, 0x07, 0x01, 0x01, 0x01, 0x01, 0x04, 0x03, 0xBF, 0x6E, 0x00]);
    bench.run_for(1_000);
    assert_eq!(bench.packets(), [refused]);
}

#[test]
fn health_goes_before_the_first_sample_after_a_change_and_once_a_second() {
    let mut bench = Bench::new();
    bench.play(|channel, _| (10 * channel as u16, 2_000));
    bench.run_for(5_000_000);
    assert!(bench.healths().is_empty(), "nothing is said before the start");
    bench.tell(Command::Start);
    bench.run_for(4_000_000);
    let healths = bench.healths();
    let clocks: Vec<u32> =
        healths.iter().map(|(health, _)| (health.clock_us - 5_000_000) / 1_000).collect();
    // From the end of a frame to the end of the first frame that ends a second later.
    assert_eq!(clocks, [0, 1_000, 2_000, 3_000, 4_000]);
    for (health, sample) in healths {
        let sample = sample.expect("a sample follows");
        assert_eq!((health.sequence, health.clock_us), (sample.sequence, sample.clock_us));
        // To the first reading: dark conversions, settling, half of the lit ones. To the next: a whole channel.
        assert_eq!((health.timing.first_us, health.timing.step_us), (12 + 100 + 6, 236));
        assert_eq!(health.dark, std::array::from_fn(|channel| 160 * channel as u16));
        let degrees = i32::from(health.vitals.temperature_cdeg.unwrap());
        assert!(degrees.abs_diff((health.clock_us / 10_000) as i32) <= 1);
    }
    bench.tell(Command::SetOversampling { conversions: 4 });
    bench.run_for(30_000);
    let [(health, _)] = bench.healths()[..] else { panic!("one word of the change") };
    assert_eq!((health.timing.first_us, health.timing.step_us), (6 + 100 + 3, 218));
    // A repeated start requests a new report.
    bench.tell(Command::Start);
    bench.run_for(10_000);
    assert_eq!(bench.healths().len(), 1);
    assert_eq!(bench.status().late, 0);
}

#[test]
fn health_delays_no_frame_that_fills_its_period() {
    let mut bench = Bench::new();
    bench.world.settling_us.set(30);
    bench.done(Command::SetSettling { settling_us: 30 });
    bench.done(Command::SetOversampling { conversions: 16 });
    // 8 · (2 · 30 + 3 · 24 + 30) µs are planned, 1,056 µs are taken.
    bench.done(Command::SetPeriod { period_us: 1_296 });
    bench.tell(Command::Start);
    bench.run_for(5_000_000);
    let healths = bench.healths();
    assert!(healths.len() >= 5);
    // 240 µs remain, less than a measurement may take.
    assert!(healths.iter().all(|(health, _)| health.vitals.supply_mv.is_none()));
    assert_eq!(bench.status().late, 0);
    bench.done(Command::SetPeriod { period_us: 1_310 });
    bench.run_for(3_000_000);
    let healths = bench.healths();
    assert!(healths.len() >= 2);
    assert!(healths.iter().all(|(health, _)| health.vitals.supply_mv == Some(3_300)));
    assert_eq!(bench.status().late, 0);
}

#[test]
fn the_self_test_reports_the_rise_of_each_emitter() {
    let mut bench = Bench::new();
    bench.world.tests_itself.set(true);
    bench.play(|channel, _| (50 + channel as u16, 1_000 + 10 * channel as u16));
    let rises = |bench: &mut Bench| -> Vec<[i16; 8]> {
        let rise = |emitter: u8| {
            bench.tell(Command::SelfTest { emitter });
            bench.run_for(10_000);
            match bench.packets().last() {
                Some(Packet::Answer { answer: Answer::SelfTest { emitter: of, rise }, .. }) => {
                    assert_eq!(*of, emitter);
                    *rise
                }
                other => panic!("{other:?}"),
            }
        };
        (0..8).map(rise).collect()
    };
    for (emitter, rise) in rises(&mut bench).into_iter().enumerate() {
        for (channel, rise) in rise.into_iter().enumerate() {
            let own = 950 + 9 * channel as i16;
            assert_eq!(rise, if channel == emitter { own } else { 0 });
        }
    }
    bench.world.is_bridged.set(true);
    assert_eq!(rises(&mut bench)[5][6], 950 + 9 * 6);
    assert_eq!(bench.ask(Command::SelfTest { emitter: 8 }).0, Answer::Refused(Refusal::OutOfRange));
    bench.done(Command::Start);
    let refused = bench.ask(Command::SelfTest { emitter: 0 }).0;
    assert_eq!(refused, Answer::Refused(Refusal::Streaming));
}

#[test]
fn the_watchdog_is_fed_under_any_host_traffic() {
    let mut bench = Bench::new();
    bench.run_for(3_000_000);
    bench.done(Command::SetPeriod { period_us: 10_000_000 });
    bench.done(Command::Start);
    bench.run_for(30_000_000);
    bench.world.held_up.set(true);
    bench.run_for(30_000_000);
    assert!(bench.world.longest_unfed_us.get() <= 250_000);
}

#[test]
fn the_watchdog_is_not_fed_while_a_conversion_does_not_end() {
    let mut bench = Bench::new();
    bench.done(Command::Start);
    bench.world.stall_us.set(5_000_000);
    bench.run_for(6_000_000);
    assert!(bench.world.longest_unfed_us.get() >= 5_000_000);
}

// Light of amplitude 300 steps over a reading of 1,600, at the default settings (conversions of
// 1.5 µs, Δ 112 µs): 300 · (1 − cos 2πfΔ) is 1.1 steps at 120.6 Hz; channels are rounded to a 16th.
#[test]
fn of_light_that_flickers_less_than_two_steps_are_left() {
    for mains in [50.0, 60.0, 100.0, 120.0] {
        for off in [0.995, 1.0, 1.003, 1.005] {
            let mut bench = Bench::new();
            let ambient = move |us: u64| {
                400.0 + 300.0 * (std::f64::consts::TAU * mains * off * us as f64 / 1e6).sin()
            };
            bench.play(move |_, us| {
                (ambient(us).round() as u16, (ambient(us) + 1_600.0).round() as u16)
            });
            bench.tell(Command::Start);
            bench.run_for(3_000_000);
            let samples = bench.samples();
            assert!(samples.len() >= 300);
            let steps = samples.iter().flat_map(readings).map(|counts| f64::from(counts) / 16.0);
            // Rounding moves each of three means by up to half a step.
            let worst = steps.map(|step| (step - 1_600.0).abs()).fold(0.0, f64::max);
            assert!(worst <= 2.0 + 0.5, "{worst} at {} Hz", mains * off);
        }
    }
}
