//! The serial line: its data, and disturbances of it.

use shared_proto::{Answer, Command, Refusal, ResetCause, Stream, Timing, Values};
use system_tests::flashed::{Model, SERIAL};

use super::host::{Host, Modelled, Random, boards, played};

#[test]
#[ignore = "needs the flashed image"]
fn the_image_identifies_itself_and_answers_to_its_serial_number() {
    for Modelled { model, board, .. } in &boards() {
        let mut host = Host::new(model);
        assert_eq!(host.boots.len(), 1);
        assert_eq!((host.boots[0].board, host.boots[0].cause), (*board, ResetCause::Power));
        let Some(Answer::Identity(identity)) = host.ask(Command::Identify) else { panic!() };
        assert_eq!((identity.board, identity.serial), (*board, SERIAL));
        let status = host.status();
        assert!(!status.streaming && !status.calibrated);
    }
}

/// Returns the readings that the firmware must measure for a script.
pub fn code(frame: usize, channel: usize) -> (u16, u16) {
    let dark = (frame * 7 + channel * 31) % 300;
    (dark as u16, (dark + 500 + (frame * 13 + channel * 401) % 3_000) as u16)
}

pub fn expected(frame: usize) -> [u16; 8] {
    std::array::from_fn(|channel| {
        let (dark, lit) = code(frame, channel);
        16 * (lit - dark)
    })
}

#[test]
#[ignore = "needs the flashed image"]
fn a_stream_equals_the_converters_values() {
    for Modelled { model, conversion_ns, .. } in &boards() {
        let mut host = Host::start(model, &played(53, code));
        host.order(Command::Start);
        host.run(1.0);
        host.order(Command::Stop);
        assert!(host.samples.len() >= 100);
        let first_us = host.samples[0].clock_us;
        for (i, sample) in host.samples.iter().enumerate() {
            assert_eq!(usize::from(sample.sequence), i);
            // The first conversion after a pause is wrong, as it may be on the chip.
            assert_eq!(sample.values, Values::Readings(expected(i % 53)), "frame {i}");
            assert_eq!((sample.saturated, sample.dropped), (0, 0));
            // A frame that starts more than 0.1 ms after its slot counts as late.
            let due_us = first_us + 10_000 * i as u32;
            assert!(sample.clock_us.abs_diff(due_us) <= 100, "frame {i}");
        }
        let status = host.status();
        assert_eq!((status.late, status.overflowed, status.damaged), (0, 0, 0));
        let [health, ..] = host.healths[..] else { panic!("no word of health") };
        assert_eq!(health.sequence, 0);
        let dark = |channel| 16 * code(0, channel).0;
        assert_eq!(health.dark, std::array::from_fn(dark));
        // A step of the reference is 2.2 mV, of the thermometer 0.32 °C.
        assert!(health.vitals.supply_mv.unwrap().abs_diff(3_300) <= 2);
        assert!(health.vitals.temperature_cdeg.unwrap().abs_diff(3_150) <= 35);
        // Three bursts of 8 conversions, two settlings, and the time for starting them.
        let (burst_us, Timing { first_us, step_us }) = (8 * conversion_ns / 1_000, health.timing);
        let step = 3 * burst_us + 2 * 100;
        assert!((step..step + 40).contains(&u32::from(step_us)), "{:?}", health.timing);
        // The middle of the first lit burst.
        let first = burst_us * 3 / 2 + 100;
        assert!((first..first + 40).contains(&u32::from(first_us)), "{:?}", health.timing);
    }
}

#[test]
#[ignore = "needs the flashed image"]
fn readings_are_exact_after_any_number_of_conversions_and_any_settling() {
    for Modelled { model, conversion_ns, .. } in &boards() {
        let mut host = Host::start(model, &played(53, code));
        host.order(Command::SetPeriod { period_us: 50_000 });
        // One conversion; single bursts of the oversampler, all sizes together, and several of the
        // longest. After 2 ms of settling the converter's first conversion is wrong.
        for (conversions, settling_us) in [(1, 0), (3, 1), (17, 30), (63, 30), (64, 30), (5, 2_000)]
        {
            host.order(Command::SetOversampling { conversions });
            host.order(Command::SetSettling { settling_us });
            host.order(Command::Start);
            host.run(0.5);
            host.order(Command::Stop);
            // The board reports the longest frame so far; each promise exceeds those of the settings before.
            let conversions_us = (u32::from(conversions) * conversion_ns).div_ceil(1_000);
            let promised_us = 8 * (2 * u32::from(settling_us) + 3 * conversions_us + 30);
            let longest_us = u32::from(host.status().longest_frame_us);
            assert!(longest_us <= promised_us, "{conversions}: {longest_us} of {promised_us} µs");
        }
        assert!(host.samples.len() >= 60);
        for (i, sample) in host.samples.iter().enumerate() {
            assert_eq!(sample.values, Values::Readings(expected(i % 53)), "frame {i}");
            assert_eq!(sample.saturated, 0, "frame {i}");
        }
    }
}

#[test]
#[ignore = "needs the flashed image"]
fn a_line_that_is_held_up_costs_the_oldest_samples() {
    let model = &Model::find();
    let mut host = Host::new(model);
    host.order(Command::Start);
    host.board.set_cts("high");
    host.run(2.0);
    let before = host.samples.len();
    host.run(0.1);
    assert_eq!(host.samples.len(), before, "the board sends though it is held up");
    host.board.set_cts("low");
    let released_us = (host.last.time_s * 1e6) as u32;
    host.run(0.5);
    host.order(Command::Stop);
    let sequence: Vec<u16> = host.samples.iter().map(|sample| sample.sequence).collect();
    assert_eq!(sequence, (0..host.samples.len() as u16).collect::<Vec<_>>());
    // The frame in the driver is old. All others are at most 160 ms old, the outbox's capacity.
    let stale = host.samples[before..].iter();
    let stale = stale.filter(|sample| sample.clock_us + 180_000 < released_us).count();
    assert!(stale <= 2, "{stale} samples of before");
    let status = host.status();
    assert_eq!(status.frames, host.samples.len() as u32 + status.overflowed);
    assert!((150..250).contains(&status.overflowed), "{}", status.overflowed);
    assert_eq!(host.samples.last().unwrap().dropped, status.overflowed as u8);
    assert_eq!(host.resets, ["power"], "the watchdog is fed");
}

#[test]
#[ignore = "needs the flashed image"]
fn three_wires_are_enough() {
    let model = &Model::find();
    let mut host = Host::new(model);
    assert_eq!(host.last.pulls, ["up", "down", "up"]);
    host.board.set_cts("open");
    host.order(Command::Start);
    host.run(0.5);
    assert!(host.samples.len() >= 50);
}

#[test]
#[ignore = "needs the flashed image"]
fn sent_received_and_lost_frames_add_up_over_a_bad_line() {
    let model = &Model::find();
    let mut host = Host::new(model);
    host.order(Command::SetSettling { settling_us: 100 });
    host.order(Command::SetOversampling { conversions: 4 });
    host.order(Command::Start);
    let mut random = Random(18);
    while host.last.time_s < 21.0 {
        // One byte in a few hundred is changed, and the line is held up now and then.
        let held_up = random.next().is_multiple_of(40);
        if held_up {
            host.board.set_cts("high");
            host.run(0.3);
            host.board.set_cts("low");
        }
        host.run_behind(0.1, |bytes| {
            for byte in bytes {
                if random.next().is_multiple_of(300) {
                    *byte ^= 1 << (random.next() % 8);
                }
            }
        });
    }
    host.order(Command::Stop);
    host.run(0.2);
    let status = host.status();
    assert!(status.frames >= 2_000, "{}", status.frames);
    let counters = host.decoder.counters;
    assert!(counters.bad_crc > 50 && status.overflowed > 0);
    // Every frame has arrived, or is missing by its number, or was dropped by the board's count.
    let last = u64::from(host.samples.last().unwrap().sequence);
    let numbers: Vec<u16> = host.samples.iter().map(|sample| sample.sequence).collect();
    assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]));
    // No later frame would show damage to the last samples.
    let sent = u64::from(status.frames - status.overflowed);
    assert!(sent - (last + 1) <= 3, "{sent} sent, {last} the last number");
    assert_eq!(status.late, 0);
    assert_eq!(host.resets, ["power"]);
}

#[test]
#[ignore = "needs the flashed image"]
fn five_hundred_random_strings_do_no_harm() {
    let model = &Model::find();
    let mut host = Host::new(model);
    let mut random = Random(81);
    for _ in 0..500 {
        let len = random.next() % 60;
        // One byte in eight is a delimiter, so that many strings end early.
        let bytes = (0..len).map(|_| match random.next() {
            bits if bits.is_multiple_of(8) => 0,
            bits => (bits >> 8) as u8,
        });
        let bytes: Vec<u8> = bytes.collect();
        host.board.send(&bytes);
        host.run(0.012);
    }
    host.board.send(&[0]);
    let status = host.status();
    assert_eq!(host.resets, ["power"]);
    assert!(status.damaged > 500, "{}", status.damaged);
    assert_eq!((status.period_us, status.conversions, status.settling_us), (10_000, 8, 100));
    assert!(!status.streaming);
}

#[test]
#[ignore = "needs the flashed image"]
fn rates_that_the_line_does_not_carry_are_refused() {
    let model = &Model::find();
    let mut host = Host::new(model);
    // Frames of 952 µs.
    host.order(Command::SetSettling { settling_us: 25 });
    host.order(Command::SetOversampling { conversions: 4 });
    let answer = host.ask(Command::SetPeriod { period_us: 1_000 });
    let Some(Answer::Refused(Refusal::LineTooSlow { shortest_us })) = answer else {
        panic!("{answer:?}")
    };
    host.order(Command::SetPeriod { period_us: shortest_us });
    assert_eq!(host.status().stream, Stream::Raw);
    host.order(Command::Start);
    host.run(1.0);
    let status = host.status();
    assert_eq!((status.overflowed, status.late), (0, 0));
    assert!(status.frames > 155, "{}", status.frames);
}
