//! The wire format, pinned by literal bytes.
//!
//! The bytes were made by a program written from the README in another language (bitwise CRC,
//! frames built field by field), not by this crate, and stand in the README as well.

use shared_proto::xbee::{Address, ApiFrame, Mode};
use shared_proto::{
    Answer, Board, BoardId, Boot, Bytes, Challenge, Command, Decoder, Edge, Event, Framing, Health,
    Identity, Key, Packet, Piece, Refusal, ResetCause, Sample, Status, Stream, Timing, Values,
    Vitals,
};

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect()
}

fn readings() -> Packet {
    Packet::Sample(Sample {
        sequence: 258,
        clock_us: 1_000_000,
        values: Values::Readings([31376, 33968, 37664, 40672, 37072, 33312, 33360, 35456]),
        saturated: 0,
        dropped: 0,
    })
}

const READINGS: &str = "04 01 25 03 19 41 43 0e 01 91 7b b1 85 21 92 e1 9f d1 91 21 83 51 83 81 8b 01 01 \
             57 ec 00";

/// For every board.
fn command(command: Command) -> Packet {
    Packet::Command { number: 7, to: None, command }
}

const SERIAL: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// For the board with this serial number, whose CRC-32 is 0x925FC655.
fn addressed(command: Command) -> Packet {
    Packet::Command { number: 7, to: Some(BoardId::of_serial(&SERIAL)), command }
}

/// What the board wants signatures to be made with.
const NONCE: [u8; 8] = *b"nonce no";

fn key() -> Key {
    Key::new(std::array::from_fn(|i| 0x10 + i as u8)).expect("a key")
}

/// Signed with the key, for the board with the serial number.
fn signed(counter: u32, command: Command) -> Packet {
    let to = Some(BoardId::of_serial(&SERIAL));
    let signature = key().sign(&NONCE, counter, 7, to, &command);
    Packet::Signed { number: 7, to, signature, command }
}

fn answer(answer: Answer) -> Packet {
    Packet::Answer { number: 7, answer }
}

fn vectors() -> Vec<(Packet, &'static str)> {
    let awkward = Packet::Sample(Sample {
        sequence: 0x1311,
        clock_us: 0x7E7D_1311,
        values: Values::Readings([0x7D7E, 0x7D7E, 0x7D7E, 0x7D7E, 0, 0, 0xFFFF, 0xFFF0]),
        saturated: 0x81,
        dropped: 255,
    });
    let wrench = Packet::Sample(Sample {
        sequence: 65_535,
        clock_us: u32::MAX,
        values: Values::Wrench([1.0, -0.5, 0.25, 0.001, 0.0, -0.125]),
        saturated: 2,
        dropped: 3,
    });
    let piece: Vec<u8> = (1..=32).collect();
    let whole_piece = Piece::copy_of(&piece).expect("it fits");
    let signed_piece = Piece::copy_of(&piece[..24]).expect("it fits");
    let oops = Piece::copy_of(b"oops").expect("it fits");
    let identity = Identity {
        board: Board::SkinProc,
        firmware: [0, 1, 0],
        serial: SERIAL,
        min_period_us: 1000,
    };
    let status = Status {
        streaming: true,
        calibrated: true,
        zeroed: false,
        stream: Stream::Wrench,
        reset_cause: ResetCause::Watchdog,
        period_us: 10_000,
        conversions: 16,
        settling_us: 50,
        uptime_s: 3600,
        frames: 360_000,
        late: 2,
        overflowed: 1,
        damaged: 5,
        longest_frame_us: 740,
        calibration_crc32: 0x1234_5678,
        foreign: 3,
    };
    let boot = Boot { board: Board::SkinProc, firmware: [0, 1, 0], cause: ResetCause::Panic };
    vec![
        (readings(), READINGS),
        (
            awkward,
            "1d 01 25 10 12 10 12 7c 7f 7f 7c 7f 7c 7f 7c 7f 7c 01 01 01 01 fe fe f1 fe 80 fe \
             7f 36 00",
        ),
        (
            wrench,
            "01 08 25 ff ff ff ff ff ff 01 03 80 3f 01 01 02 bf 01 07 80 3e 6f 12 83 3a 01 01 \
             01 01 01 01 06 be 02 03 99 0d 00",
        ),
        (
            Packet::Health(Health {
                sequence: 258,
                clock_us: 1_000_000,
                timing: Timing { first_us: 278, step_us: 530 },
                vitals: Vitals {
                    temperature_cdeg: Some(3_150),
                    supply_mv: Some(3_300),
                    reference: Some(24_080),
                },
                dark: [800, 816, 832, 848, 864, 880, 896, 912],
            }),
            "01 07 26 02 01 40 42 0f 1d 16 01 12 02 4e 0c e4 0c 10 5e 20 03 30 03 40 03 50 03 60 \
             03 70 03 80 03 90 03 c5 f2 00",
        ),
        (
            Packet::Health(Health {
                sequence: 0,
                clock_us: 12_345,
                timing: Timing { first_us: 226, step_us: 504 },
                vitals: Vitals::default(),
                dark: [0; 8],
            }),
            "01 02 26 01 03 39 30 01 02 e2 03 f8 01 02 80 01 01 01 01 01 01 01 01 01 01 01 01 01 \
             01 01 01 01 01 01 03 32 59 00",
        ),
        (
            Packet::Edge(Edge { number: 3, clock_us: 1_500_000 }),
            "01 03 27 03 04 60 e3 16 03 5b d7 00",
        ),
        (
            Packet::Edge(Edge { number: 65_535, clock_us: 0x7E7D_1311 }),
            "0b 04 23 fb fb 15 17 79 7a 78 75 00",
        ),
        (
            addressed(Command::SetBaud { baud: 115_200 }),
            "0c 01 29 06 01 54 c7 5e 93 10 01 c3 04 01 3b ae 00",
        ),
        (addressed(Command::Bootloader), "01 03 28 07 08 55 c6 5f 92 12 cd c7 00"),
        (answer(Answer::Refused(Refusal::NotOnThisBoard)), "09 01 28 06 01 02 10 38 34 00"),
        (command(Command::Challenge), "01 03 28 07 01 01 01 01 04 0e a9 71 00"),
        (
            addressed(Command::SetKey(Some(key()))),
            "0a 10 38 17 10 45 d6 4f 82 1f 12 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f 55 ed 00",
        ),
        (addressed(Command::SelfTest { emitter: 0 }), "01 03 28 07 06 55 c6 5f 92 10 03 22 b7 00"),
        (
            signed(3, Command::SetPeriod { period_us: 10_000 }),
            "01 03 2b 07 06 55 c6 5f 92 03 01 01 0c dd 49 50 61 e4 a4 ff dd 05 10 27 01 03 6a db 00",
        ),
        (
            signed(4, Command::CalibrationPiece { offset: 24, data: signed_piece }),
            "23 0c 27 0b 0c 59 ca 53 9e 08 0c 0c 0c 06 d4 d1 08 72 f5 9e 23 06 14 0c 0d 0e \
             0f 08 09 0a 0b 04 05 06 07 0f 01 02 03 1c 1d 1e 1f 18 19 1a 1b 14 c8 30 00",
        ),
        (
            answer(Answer::Challenge(Challenge {
                is_keyed: true,
                nonce: NONCE,
                counter: 2,
                refused: 9,
            })),
            "01 03 29 07 0c 05 01 6e 6f 6e 63 65 20 6e 6f 02 01 01 02 09 01 01 03 83 de 00",
        ),
        (
            answer(Answer::SelfTest { emitter: 0, rise: [1_200, -3, 0, 0, 0, 0, 0, 5] }),
            "01 03 29 07 02 06 05 b0 04 fd ff 01 01 01 01 01 01 01 01 01 02 05 03 cd 27 00",
        ),
        (answer(Answer::Refused(Refusal::Unsigned)), "01 03 29 07 05 03 0d 9e 84 00"),
        (command(Command::Identify), "01 03 28 07 01 01 01 01 04 01 d5 dc 00"),
        (addressed(Command::Status), "01 03 28 07 08 55 c6 5f 92 02 49 30 00"),
        (command(Command::Start), "01 03 28 07 01 01 01 01 04 03 bf 6e 00"),
        (command(Command::Stop), "01 03 28 07 01 01 01 01 04 04 01 b8 00"),
        (
            addressed(Command::SetPeriod { period_us: 10_000 }),
            "01 03 28 07 08 55 c6 5f 92 05 10 27 01 03 31 d6 00",
        ),
        (
            addressed(Command::SetOversampling { conversions: 16 }),
            "01 03 28 07 09 55 c6 5f 92 06 10 92 40 00",
        ),
        (
            addressed(Command::SetSettling { settling_us: 50 }),
            "01 03 28 07 07 55 c6 5f 92 07 32 03 2f 3d 00",
        ),
        (
            addressed(Command::SetStream(Stream::Wrench)),
            "01 03 28 07 09 55 c6 5f 92 08 01 aa 84 00",
        ),
        (
            addressed(Command::BeginCalibration { size: 668, crc32: 0x1234_5678 }),
            "01 03 28 07 08 55 c6 5f 92 09 9c 02 01 07 78 56 34 12 2e 04 00",
        ),
        (
            addressed(Command::CalibrationPiece { offset: 32, data: whole_piece }),
            "0a 20 08 27 20 75 e6 7f b2 2a 21 20 21 22 23 24 25 26 27 28 29 2a 2b 2c 2d 2e 2f \
             30 31 32 33 34 35 36 37 38 39 3a 3b 3c 3d 3e 3f 03 69 ac 00",
        ),
        (addressed(Command::CommitCalibration), "01 03 28 07 08 55 c6 5f 92 0b be 12 00"),
        (addressed(Command::Zero { frames: 50 }), "01 03 28 07 07 55 c6 5f 92 0c 32 03 2f 27 00"),
        (
            addressed(Command::LastWords { offset: 32 }),
            "01 03 28 07 07 55 c6 5f 92 0d 20 03 35 68 00",
        ),
        (addressed(Command::Unknown { code: 0x70 }), "01 03 28 07 08 55 c6 5f 92 70 d5 f6 00"),
        (answer(Answer::Done), "01 03 29 07 01 03 b1 66 00"),
        (
            answer(Answer::Identity(identity)),
            "01 03 29 07 03 01 01 02 01 0f 01 02 03 04 05 06 07 08 09 0a 0b 0c e8 03 01 03 4f \
             b2 00",
        ),
        (
            answer(Answer::Status(status)),
            "05 02 2b 05 02 12 09 06 12 25 02 02 12 30 02 12 0c 02 02 42 7c 07 02 0b 02 02 02 \
             03 02 02 02 07 02 e6 09 7a 54 36 10 01 02 78 a6 00",
        ),
        (answer(Answer::Refused(Refusal::WrongSize)), "01 03 29 07 05 03 08 4a e0 00"),
        (
            answer(Answer::Refused(Refusal::LineTooSlow { shortest_us: 5_497 })),
            "01 03 29 07 05 03 0c 79 15 01 03 cd 28 00",
        ),
        (
            answer(Answer::LastWords { len: 4, text: oops }),
            "01 03 29 07 03 04 04 05 6f 6f 70 73 02 7c 00",
        ),
        (Packet::Boot(boot), "01 02 2a 01 02 01 02 01 04 03 c1 3c 00"),
    ]
}

#[test]
fn packets_have_the_bytes_of_the_readme() {
    let readme = include_str!("../../README.md").replace('\n', " ");
    let readme: String = readme.split_whitespace().collect::<Vec<_>>().join(" ");
    for (packet, hex) in vectors() {
        let hex = hex.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(packet.encode(), Bytes::copy_of(&bytes(&hex)).unwrap(), "{packet:?}");
        let (_, frame) = bytes(&hex).split_last().map(|(end, rest)| (*end, rest.to_vec())).unwrap();
        assert_eq!(Packet::decode(&frame), Ok(packet));
        assert!(readme.contains(&hex), "{hex} is not in the README");
    }
}

#[test]
fn api_frames_around_a_packet_have_the_bytes_of_the_manual() {
    let long = 0x0013_A200_400A_0127;
    let zigbee = Address::Zigbee { long, short: 0xFFFE };
    let samples = [
        (Address::Short(0x2052), "7e 00 23 81 20 52 28 00", "6b"),
        (Address::Long(long), "7e 00 29 80 00 13 a2 00 40 0a 01 27 28 00", "b7"),
        (zigbee, "7e 00 2a 90 00 13 a2 00 40 0a 01 27 ff fe 00", "d2"),
    ];
    let payload = readings().encode();
    for (from, head, checksum) in samples {
        let rssi = (from != zigbee).then_some(40);
        let frame = ApiFrame::Receive { from, rssi, payload: &payload };
        let expected = bytes(&format!("{head} {READINGS} {checksum}"));
        assert_eq!(&*frame.encode(Mode::Plain).unwrap(), expected);

        let mut decoded = Vec::new();
        Decoder::new(Framing::Xbee(Mode::Plain)).feed(&expected, |event| decoded.push(event));
        let [Event::Sample { sample, .. }] = decoded[..] else { panic!("{decoded:?}") };
        assert_eq!(Packet::Sample(sample), readings());
    }

    let start = "01 03 28 07 01 01 01 01 04 03 bf 6e 00";
    let commands = [
        (Address::Short(0x2052), Mode::Plain, "7e 00 12 01 01 20 52 00", "20"),
        (Address::Short(0x2013), Mode::Escaped, "7e 00 12 01 01 20 7d 33 00", "5f"),
        (Address::Long(long), Mode::Plain, "7e 00 18 00 01 00 13 a2 00 40 0a 01 27 00", "6c"),
        (zigbee, Mode::Plain, "7e 00 1b 10 01 00 13 a2 00 40 0a 01 27 ff fe 00 00", "5f"),
    ];
    let payload = command(Command::Start).encode();
    for (to, mode, head, checksum) in commands {
        let frame = ApiFrame::Transmit { id: 1, to, payload: &payload };
        let expected = bytes(&format!("{head} {start} {checksum}"));
        assert_eq!(&*frame.encode(mode).unwrap(), expected);
    }
}

#[test]
fn packets_of_other_versions_and_kinds_are_told_from_damage() {
    let mut decoder = Decoder::new(Framing::Cobs);
    let mut events = Vec::new();
    decoder.feed(&bytes("01 03 34 01 08 6c 61 74 65 72 88 20 00"), |event| events.push(event));
    decoder.feed(&bytes("01 03 2f 01 04 78 c6 50 00"), |event| events.push(event));
    assert_eq!(events, [Event::OtherVersion { version: 3, command: false }]);
    let counters = decoder.counters();
    assert_eq!((counters.unknown_version, counters.unknown_kind), (1, 1));
    assert_eq!((counters.packets, counters.bad_crc, counters.malformed), (0, 0, 0));
}

#[test]
fn commands_with_arguments_that_are_not_theirs_are_unknown_commands() {
    // 0x03 (start) with an argument; 0x05 (period) with one byte; made as above.
    for (hex, code) in [
        ("01 03 28 07 09 55 c6 5f 92 03 01 b0 84 00", 3),
        ("01 03 28 07 09 55 c6 5f 92 05 01 52 c8 00", 5),
    ] {
        let frame = bytes(hex);
        let packet = Packet::decode(&frame[..frame.len() - 1]);
        assert_eq!(packet, Ok(addressed(Command::Unknown { code })), "{hex}");
    }
}

#[test]
fn what_a_newer_board_says_is_read_as_far_as_it_goes() {
    let answer_in = |hex| {
        let frame = bytes(hex);
        match Packet::decode(&frame[..frame.len() - 1]) {
            Ok(Packet::Answer { number: 7, answer }) => answer,
            other => panic!("{other:?}"),
        }
    };
    // Made as above: refusal 200 with three bytes more, board 200, answer 200 with three bytes.
    let refusal = answer_in("01 03 29 07 08 03 c8 61 62 63 6f fe 00");
    assert_eq!(refusal, Answer::Refused(Refusal::Other(200)));
    let board = answer_in(
        "01 03 29 07 03 01 c8 02 01 0f 01 02 03 04 05 06 07 08 09 0a 0b 0c e8 03 01 03 3a d2 00",
    );
    let Answer::Identity(identity) = board else { panic!("{board:?}") };
    assert_eq!((identity.board, identity.serial), (Board::Other(200), SERIAL));
    let answer = answer_in("01 03 29 07 07 c8 61 62 63 c1 8d 00");
    assert_eq!(answer, Answer::Other { code: 200 });
}

/// The lengths that the README promises.
#[test]
fn a_sample_of_readings_takes_at_most_forty_bytes_whatever_its_values() {
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as u32
    };
    let awkward = [0x7E7E, 0x7D7D, 0x1111, 0x1313, 0x0000, 0x7D7E, 0x1113, 0x117E, 0x0011];
    for _ in 0..200_000 {
        let mut value = || match random() {
            bits if bits % 3 == 0 => bits as u16,
            bits => awkward[bits as usize % awkward.len()],
        };
        let sample = Sample {
            sequence: value(),
            clock_us: u32::from(value()) << 16 | u32::from(value()),
            values: Values::Readings(std::array::from_fn(|_| value())),
            saturated: value() as u8,
            dropped: value() as u8,
        };
        let frame = Packet::Sample(sample).encode();
        assert_eq!(frame.len(), 30);
        let from = Address::Short(0x2052);
        let received = ApiFrame::Receive { from, rssi: Some(40), payload: &frame };
        let sent = ApiFrame::Transmit { id: 0, to: from, payload: &frame };
        for frame in [received, sent] {
            assert_eq!(frame.encode(Mode::Plain).unwrap().len(), 39);
            assert!(frame.encode(Mode::Escaped).unwrap().len() <= 40);
        }
    }
}
