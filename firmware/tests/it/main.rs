//! The whole firmware against a world of virtual time, through the bytes on its link.

mod bench;
mod line;

use bench::{Bench, NONCE, SERIAL, readings, wrench};
use firmware::{Converter, Link};
use shared_proto::xbee::{Address, Mode};
use shared_proto::{
    Answer, Board, BoardId, Boot, Calibration, Challenge, Command, Cubic, Event, Identity, Key,
    Packet, Refusal, ResetCause, Stream,
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
    // The first at once.
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
    // Eight channels, twice 200 µs and 16 conversions of 1.5 µs, less the first settling.
    assert_eq!(status.longest_frame_us, 16 * (200 + 24) - 200);
}

#[test]
fn a_frame_that_takes_too_long_costs_the_slots_it_covers_and_says_so() {
    let mut bench = Bench::new();
    let mut samples = bench.done(Command::Start);
    bench.run_for(49_000);
    bench.world.stall_us.set(34_000);
    bench.run_for(102_000);
    samples.extend(bench.samples());
    let clocks: Vec<u32> = samples.iter().map(|sample| sample.clock_us / 1_000).collect();
    assert_eq!(clocks, [0, 10, 20, 30, 40, 50, 90, 100, 110, 120, 130, 140, 150]);
    let dropped: Vec<u8> = samples.iter().map(|sample| sample.dropped).collect();
    assert_eq!(dropped, [0, 0, 0, 0, 0, 0, 3, 3, 3, 3, 3, 3, 3]);
    assert!(samples.iter().enumerate().all(|(i, sample)| usize::from(sample.sequence) == i));
    let status = bench.status();
    assert_eq!((status.frames, status.late), (13, 3));
    assert_eq!(u64::from(status.longest_frame_us), 16 * 224 - 200 + 34_000);
}

#[test]
fn a_link_that_is_held_up_costs_samples_that_are_counted_and_nothing_else() {
    let mut bench = Bench::new();
    bench.done(Command::Start);
    bench.world.held_up.set(true);
    bench.run_for(1_000_000);
    assert!(bench.samples().is_empty());
    bench.world.held_up.set(false);
    bench.run_for(100_000);
    let samples = bench.samples();
    // One on its way and the last 15 waiting, with word of the board's health among them, then those of
    // the 100 ms; the 84 between are counted.
    assert_eq!(samples.len(), 16 + 10);
    let sequence: Vec<u16> = samples.iter().map(|sample| sample.sequence).collect();
    assert_eq!(sequence, (1..27).collect::<Vec<u16>>());
    assert_eq!((samples[0].clock_us, samples[0].dropped), (10_000, 0));
    for (i, sample) in samples.iter().enumerate().skip(1) {
        assert_eq!((sample.clock_us as usize, sample.dropped), (850_000 + 10_000 * i, 84));
    }
    let status = bench.status();
    assert_eq!((status.overflowed, status.late), (84, 0));
    assert_eq!(bench.decoder.counters().missing, 0);
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
    assert!(bench.events().is_empty());
    let samples = bench.done(Command::Start);
    // The sequence goes on.
    assert_eq!(samples[0].sequence, 8);
    assert_eq!(bench.decoder.counters().missing, 0);
}

#[test]
fn wrenches_are_those_of_the_calibration_uploaded_less_the_zero() {
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
    let mut converter = Converter::new(&calibration());
    let expected = |converter: &mut Converter, clock_us: u32| {
        let step = (clock_us / 10_000 % 50) as u16;
        converter.convert(&std::array::from_fn(|c| 16 * (100 + 100 * c as u16 + step)), 0)
    };
    let samples = bench.samples();
    assert!(samples.len() >= 99 && raw.len() >= 4);
    for sample in &samples {
        assert_eq!(wrench(sample), expected(&mut converter, sample.clock_us));
    }
    // 50 frames are one turn of what is played, so their mean is that of any turn.
    bench.done(Command::Zero { frames: 50 });
    bench.run_for(600_000);
    bench.samples();
    assert!(bench.status().zeroed);
    bench.run_for(500_000);
    let turn = bench.samples();
    let turn = &turn[turn.len() - 50..];
    for axis in 0..6 {
        let mean = turn.iter().map(|sample| wrench(sample)[axis]).sum::<f32>() / 50.0;
        // 50 roundings of values of up to some 20 N.
        assert!(mean.abs() < 1e-4, "{mean}");
    }
    // Taking it back.
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

    let mut bench = Bench::with(Link::Transparent, ResetCause::Watchdog, record);
    bench.run_for(1);
    let cause = ResetCause::Watchdog;
    let boot = Boot { board: Board::Simulated, firmware: firmware::VERSION, cause };
    assert_eq!(bench.events(), [Event::Boot(boot)]);
    let status = bench.status();
    assert_eq!((status.calibrated, status.calibration_crc32), (true, crc));
    assert_eq!((status.reset_cause, status.streaming), (ResetCause::Watchdog, false));
}

#[test]
fn the_board_says_what_it_is() {
    let identity = Identity {
        board: Board::Simulated,
        firmware: [0, 1, 0],
        serial: SERIAL,
        min_period_us: 1_000,
    };
    let mut bench = Bench::new();
    assert_eq!(bench.ask(Command::Identify).0, Answer::Identity(identity));
    let unknown = Command::Unknown { code: 99 };
    assert_eq!(bench.ask(unknown).0, Answer::Refused(Refusal::UnknownCommand));
}

#[test]
fn commands_for_another_board_are_counted_and_left_to_it() {
    let mut bench = Bench::new();
    bench.run_for(1);
    bench.events();
    let ours = bench.to;
    for to in [None, Some(BoardId::of_serial(b"another one."))] {
        bench.to = to;
        bench.tell(Command::SetPeriod { period_us: 20_000 });
        bench.tell(Command::BeginCalibration { size: 668, crc32: 1 });
        assert_eq!(bench.events(), []);
    }
    bench.to = Some(BoardId::of_serial(b"another one."));
    bench.tell(Command::Start);
    assert_eq!(bench.events(), []);
    bench.to = None;
    let status = bench.status();
    assert_eq!((status.foreign, status.period_us, status.streaming), (5, 10_000, false));
    bench.to = ours;
    bench.done(Command::SetPeriod { period_us: 20_000 });
}

#[test]
fn the_last_words_of_the_run_before_are_told() {
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
    bench.events();
    let status = bench.status();
    assert!(status.damaged > 10);
    assert_eq!(status.period_us, 10_000);
}

#[test]
fn a_command_of_another_version_is_refused_but_its_samples_are_not_answered() {
    let mut bench = Bench::new();
    bench.run_for(1);
    bench.events();
    // Version 3, made by hand: a command, and a sample.
    bench.send(&[0x01, 0x03, 0x38, 0x04, 0x05, 0x03, 0x04, 0x36, 0xE4, 0x00]);
    bench.send(&[0x01, 0x03, 0x34, 0x04, 0x05, 0x03, 0x04, 0xC1, 0xAD, 0x00]);
    bench.run_for(1_000);
    let answer = Answer::Refused(Refusal::OtherVersion);
    assert_eq!(bench.events(), [Event::Answer { number: 0, answer }]);
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
    // From the end of a frame to the end of the first that ends a second later.
    assert_eq!(clocks, [0, 1_000, 2_000, 3_000, 4_000]);
    for (health, sample) in healths {
        let sample = sample.expect("a sample follows");
        assert_eq!((health.sequence, health.clock_us), (sample.sequence, sample.clock_us));
        // Dark conversions, settling, half of the lit ones; and from channel to channel twice both.
        assert_eq!((health.timing.first_us, health.timing.step_us), (24 + 200 + 12, 448));
        assert_eq!(health.dark, std::array::from_fn(|channel| 160 * channel as u16));
        let degrees = i32::from(health.vitals.temperature_cdeg.unwrap());
        assert!(degrees.abs_diff((health.clock_us / 10_000) as i32) <= 1);
    }
    bench.tell(Command::SetOversampling { conversions: 4 });
    bench.run_for(30_000);
    let [(health, _)] = bench.healths()[..] else { panic!("one word of the change") };
    assert_eq!((health.timing.first_us, health.timing.step_us), (6 + 200 + 3, 412));
    // Whoever starts a stream that runs wants to know.
    bench.tell(Command::Start);
    bench.run_for(10_000);
    assert_eq!(bench.healths().len(), 1);
    assert_eq!(bench.status().late, 0);
}

#[test]
fn where_frames_fill_their_period_health_makes_none_late() {
    let mut bench = Bench::new();
    bench.world.settling_us.set(30);
    bench.done(Command::SetSettling { settling_us: 30 });
    bench.done(Command::SetOversampling { conversions: 16 });
    // 8 · (2 · (30 + 24) + 30) µs are thought of, 834 µs are taken.
    bench.done(Command::SetPeriod { period_us: 1_104 });
    bench.tell(Command::Start);
    bench.run_for(5_000_000);
    let healths = bench.healths();
    assert!(healths.len() >= 5);
    assert!(healths.iter().all(|(health, _)| health.vitals.supply_mv == Some(3_300)));
    assert_eq!(bench.status().late, 0);
}

#[test]
fn a_board_with_a_key_obeys_who_has_it_and_answers_everybody() {
    let [first, second] = [1, 2].map(|byte| Key::new([byte; Key::LEN]).unwrap());
    let mut bench = Bench::new();
    let refused = |refusal| Answer::Refused(refusal);
    bench.done(Command::SetKey(Some(first)));
    let period = |period_us| Command::SetPeriod { period_us };
    assert_eq!(bench.ask(period(20_000)).0, refused(Refusal::Unsigned));
    assert_eq!(bench.ask(Command::SetKey(None)).0, refused(Refusal::Unsigned));
    let challenge = Challenge { is_keyed: true, nonce: NONCE, counter: 0, refused: 2 };
    assert_eq!(bench.ask(Command::Challenge).0, Answer::Challenge(challenge));
    assert_eq!(bench.ask_signed(&second, 1, period(20_000)), refused(Refusal::BadSignature));
    assert_eq!(bench.status().period_us, 10_000);
    assert_eq!(bench.ask_signed(&first, 7, period(20_000)), Answer::Done);
    assert_eq!(bench.ask_signed(&first, 7, period(30_000)), refused(Refusal::Replayed));
    assert_eq!(bench.ask_signed(&first, 6, period(30_000)), refused(Refusal::Replayed));
    assert_eq!(bench.status().period_us, 20_000);
    // Streams can be started together, and anybody may look.
    bench.done(Command::Start);
    bench.done(Command::Stop);
    assert_eq!(bench.ask_signed(&first, 8, Command::SetKey(Some(second))), Answer::Done);
    assert_eq!(bench.ask_signed(&first, 9, period(30_000)), refused(Refusal::BadSignature));

    // After a reset the key is there and the counter begins anew.
    let record = *bench.world.record.borrow();
    let mut bench = Bench::with(Link::Transparent, ResetCause::Pin, record);
    assert_eq!(bench.ask_signed(&first, 1, period(30_000)), refused(Refusal::BadSignature));
    assert_eq!(bench.ask_signed(&second, 1, period(30_000)), Answer::Done);
    assert_eq!(bench.ask_signed(&second, 2, Command::SetKey(None)), Answer::Done);
    bench.done(period(40_000));
}

#[test]
fn a_signed_command_whose_answer_was_lost_is_answered_again_and_done_once() {
    let key = Key::new([3; Key::LEN]).unwrap();
    let mut bench = Bench::new();
    bench.upload(&calibration());
    bench.done(Command::SetKey(Some(key)));
    bench.done(Command::Start);
    bench.run_for(100_000);
    let (number, to, command) = (900, bench.to, Command::Zero { frames: 2 });
    let signature = key.sign(&NONCE, 1, number, to, &command);
    let packet = Packet::Signed { number, to, signature, command };
    bench.set_number(number);
    assert_eq!(bench.ask_packet(&packet), Answer::Done);
    bench.run_for(100_000);
    assert!(bench.status().zeroed);
    // Sent again the zero is not taken anew, which would show for the next two frames.
    bench.set_number(number);
    assert_eq!(bench.ask_packet(&packet), Answer::Done);
    assert!(bench.status().zeroed);
    bench.set_number(number);
    bench.ask_signed(&key, 2, Command::SetPeriod { period_us: 20_000 });
    bench.set_number(number);
    assert_eq!(bench.ask_packet(&packet), Answer::Refused(Refusal::Replayed));
}

#[test]
fn the_self_test_shows_what_each_emitter_raises() {
    let mut bench = Bench::new();
    bench.world.tests_itself.set(true);
    bench.play(|channel, _| (50 + channel as u16, 1_000 + 10 * channel as u16));
    let rises = |bench: &mut Bench| -> Vec<[i16; 8]> {
        let rise = |emitter: u8| {
            bench.tell(Command::SelfTest { emitter });
            bench.run_for(10_000);
            match bench.events().last() {
                Some(Event::Answer { answer: Answer::SelfTest { emitter: of, rise }, .. }) => {
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
fn the_watchdog_is_fed_whatever_the_host_does() {
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

#[test]
fn a_board_behind_an_xbee_in_api_mode_speaks_and_hears_api_frames() {
    for mode in [Mode::Plain, Mode::Escaped] {
        let to = Address::Short(0x0011);
        let mut bench = Bench::with(Link::Api { mode, to }, ResetCause::Pin, None);
        bench.upload(&calibration());
        bench.done(Command::Start);
        bench.run_for(1_000_000);
        let samples = bench.samples();
        assert!(samples.len() >= 99);
        assert_eq!(bench.decoder.counters().missing, 0);
    }
}
