//! The wire format, pinned by literal bytes. A program in another language, written from the
//! README, produced them (bitwise CRC, frames built field by field). The README shows them, too.

use shared_proto::xbee::{Address, ApiFrame, Mode};
use shared_proto::{
    Answer, Board, BoardId, Boot, Bytes, Command, DecodeError, Decoder, Edge, Event, Framing,
    Health, Identity, Packet, PacketOrigin, Piece, ReceivedPacket, Refusal, ResetCause, Sample,
    Status, Stream, Timing, Values, Vitals,
};

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect()
}

const ORIGIN: PacketOrigin = PacketOrigin { board: 0xC655, start: 0x2A17 };

fn received(packet: Packet) -> ReceivedPacket {
    let is_command = matches!(packet, Packet::Command { .. });
    ReceivedPacket { origin: (!is_command).then_some(ORIGIN), packet }
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

const READINGS: &str = "04 01 35 03 1d 54 c7 16 2b 41 43 0e 01 91 7b b1 85 21 92 e1 9f d1 91 21 83 51 83 \
             81 8b 01 01 e1 25 00";

fn command(command: Command) -> Packet {
    Packet::Command { number: 7, to: None, command }
}

const SERIAL: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// A command for the board whose serial number has the CRC-32 0x925FC655.
fn addressed(command: Command) -> Packet {
    Packet::Command { number: 7, to: Some(BoardId::from_serial(&SERIAL)), command }
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
            "21 01 35 10 12 54 c7 16 2b 10 12 7c 7f 7f 7c 7f 7c 7f 7c 7f 7c 01 01 01 01 fe fe \
             f1 fe 80 fe ca f1 00",
        ),
        (
            wrench,
            "01 0c 35 ff ff 55 c6 17 2a ff ff ff ff 01 03 80 3f 01 01 02 bf 01 07 80 3e 6f 12 \
             83 3a 01 01 01 01 01 01 06 be 02 03 7a 95 00",
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
            "01 0b 36 02 01 55 c6 17 2a 40 42 0f 1d 16 01 12 02 4e 0c e4 0c 10 5e 20 03 30 03 \
             40 03 50 03 60 03 70 03 80 03 90 03 ac a5 00",
        ),
        (
            Packet::Health(Health {
                sequence: 0,
                clock_us: 12_345,
                timing: Timing { first_us: 226, step_us: 504 },
                vitals: Vitals::default(),
                dark: [0; 8],
            }),
            "01 02 36 01 07 55 c6 17 2a 39 30 01 02 e2 03 f8 01 02 80 01 01 01 01 01 01 01 01 \
             01 01 01 01 01 01 01 01 01 01 01 03 73 e8 00",
        ),
        (
            Packet::Edge(Edge { number: 3, clock_us: 1_500_000 }),
            "01 03 37 03 08 55 c6 17 2a 60 e3 16 03 75 23 00",
        ),
        (
            Packet::Edge(Edge { number: 65_535, clock_us: 0x7E7D_1311 }),
            "0f 01 36 fe fe 54 c7 16 2b 10 12 7c 7f df 93 00",
        ),
        (
            addressed(Command::SetBaud { baud: 115_200 }),
            "0c 01 39 06 01 54 c7 5e 93 10 01 c3 04 01 bd 7c 00",
        ),
        (addressed(Command::Bootloader), "01 03 38 07 08 55 c6 5f 92 12 6b 58 00"),
        (
            answer(Answer::Refused(Refusal::NotOnThisBoard)),
            "0d 01 38 06 01 54 c7 16 2b 02 10 60 24 00",
        ),
        (addressed(Command::SelfTest { emitter: 0 }), "01 03 38 07 06 55 c6 5f 92 10 03 44 21 00"),
        (
            answer(Answer::SelfTest { emitter: 0, rise: [1_200, -3, 0, 0, 0, 0, 0, 5] }),
            "01 03 39 07 06 55 c6 17 2a 06 05 b0 04 fd ff 01 01 01 01 01 01 01 01 01 02 05 03 \
             95 95 00",
        ),
        (command(Command::Identify), "01 03 38 07 01 01 01 01 04 01 73 43 00"),
        (addressed(Command::Status), "01 03 38 07 08 55 c6 5f 92 02 ef af 00"),
        (command(Command::Start), "01 03 38 07 01 01 01 01 04 03 19 f1 00"),
        (command(Command::Stop), "01 03 38 07 01 01 01 01 04 04 a7 27 00"),
        (
            addressed(Command::SetPeriod { period_us: 10_000 }),
            "01 03 38 07 08 55 c6 5f 92 05 10 27 01 03 a6 12 00",
        ),
        (
            addressed(Command::SetOversampling { conversions: 16 }),
            "01 03 38 07 09 55 c6 5f 92 06 10 f4 d6 00",
        ),
        (
            addressed(Command::SetSettling { settling_us: 50 }),
            "01 03 38 07 07 55 c6 5f 92 07 32 03 be 49 00",
        ),
        (
            addressed(Command::SetStream(Stream::Wrench)),
            "01 03 38 07 09 55 c6 5f 92 08 01 cc 12 00",
        ),
        (
            addressed(Command::BeginCalibration { size: 668, crc32: 0x1234_5678 }),
            "01 03 38 07 08 55 c6 5f 92 09 9c 02 01 07 78 56 34 12 61 d6 00",
        ),
        (
            addressed(Command::CalibrationPiece { offset: 32, data: whole_piece }),
            "0a 20 18 27 20 75 e6 7f b2 2a 21 20 21 22 23 24 25 26 27 28 29 2a 2b 2c 2d 2e 2f \
             30 31 32 33 34 35 36 37 38 39 3a 3b 3c 3d 3e 3f 03 1b 8d 00",
        ),
        (addressed(Command::CommitCalibration), "01 03 38 07 08 55 c6 5f 92 0b 18 8d 00"),
        (addressed(Command::Zero { frames: 50 }), "01 03 38 07 07 55 c6 5f 92 0c 32 03 be 53 00"),
        (
            addressed(Command::LastWords { offset: 32 }),
            "01 03 38 07 07 55 c6 5f 92 0d 20 03 a4 1c 00",
        ),
        (addressed(Command::Unknown(0x70)), "01 03 38 07 08 55 c6 5f 92 70 73 69 00"),
        (answer(Answer::Done), "01 03 39 07 05 55 c6 17 2a 03 01 20 00"),
        (
            answer(Answer::Identity(identity)),
            "01 03 39 07 07 55 c6 17 2a 01 01 02 01 0f 01 02 03 04 05 06 07 08 09 0a 0b 0c e8 \
             03 01 03 9d f3 00",
        ),
        (
            answer(Answer::Status(status)),
            "09 02 3b 05 02 57 c4 15 28 12 09 06 12 25 02 02 12 30 02 12 0c 02 02 42 7c 07 02 \
             0b 02 02 02 03 02 02 02 07 02 e6 09 7a 54 36 10 01 02 6c 17 00",
        ),
        (answer(Answer::Refused(Refusal::WrongSize)), "01 03 39 07 09 55 c6 17 2a 03 08 8e ea 00"),
        (
            answer(Answer::Refused(Refusal::LineTooSlow { shortest_us: 5_497 })),
            "01 03 39 07 09 55 c6 17 2a 03 0c 79 15 01 03 bc c8 00",
        ),
        (
            answer(Answer::LastWords { len: 4, text: oops }),
            "01 03 39 07 07 55 c6 17 2a 04 04 07 6f 6f 70 73 ec e4 00",
        ),
        (Packet::Boot(boot), "01 02 3a 01 06 55 c6 17 2a 01 02 01 04 03 b0 f9 00"),
    ]
}

#[test]
fn packets_have_the_bytes_of_the_readme() {
    let readme = include_str!("../../README.md").replace('\n', " ");
    let readme: String = readme.split_whitespace().collect::<Vec<_>>().join(" ");
    for (packet, hex) in vectors() {
        let hex = hex.split_whitespace().collect::<Vec<_>>().join(" ");
        let sent = packet.encode_from(ORIGIN);
        assert_eq!(sent, Bytes::copy_of(&bytes(&hex)).unwrap(), "{packet:?}");
        let (_, frame) = bytes(&hex).split_last().map(|(end, rest)| (*end, rest.to_vec())).unwrap();
        assert_eq!(Packet::decode(&frame), Ok(received(packet)));
        assert!(readme.contains(&hex), "{hex} is not in the README");
    }
}

// The frames below are as version 2 of this crate sent them.
#[test]
fn version_2_is_read_but_its_commands_are_not_done() {
    let all = vectors();
    let packet = |is: fn(&Packet) -> bool| all.iter().map(|(packet, _)| *packet).find(is).unwrap();
    let cases = [
        (
            readings(),
            "04 01 25 03 19 41 43 0e 01 91 7b b1 85 21 92 e1 9f d1 91 21 83 51 83 81 8b 01 01 \
             57 ec 00",
        ),
        (
            packet(|it| matches!(it, Packet::Health(_))),
            "01 07 26 02 01 40 42 0f 1d 16 01 12 02 4e 0c e4 0c 10 5e 20 03 30 03 40 03 50 03 60 \
             03 70 03 80 03 90 03 c5 f2 00",
        ),
        (packet(|it| matches!(it, Packet::Edge(_))), "01 03 27 03 04 60 e3 16 03 5b d7 00"),
        (packet(|it| matches!(it, Packet::Boot(_))), "01 02 2a 01 02 01 02 01 04 03 c1 3c 00"),
    ];
    for (packet, hex) in cases {
        let frame = bytes(hex);
        let read = Packet::decode(&frame[..frame.len() - 1]);
        assert_eq!(read, Ok(ReceivedPacket { origin: None, packet }), "{hex}");
    }
    let start = bytes("01 03 28 07 01 01 01 01 04 03 bf 6e 00");
    let refused = Packet::decode(&start[..start.len() - 1]);
    assert_eq!(refused, Err(DecodeError::UnknownVersion { version: 2, kind: 8 }));
}

#[test]
fn api_frames_around_a_packet_have_the_bytes_of_the_manual() {
    let long = 0x0013_A200_400A_0127;
    let zigbee = Address::Zigbee { long, short: 0xFFFE };
    let samples = [
        (Address::Short(0x2052), "7e 00 27 81 20 52 28 00", "38"),
        (Address::Long(long), "7e 00 2d 80 00 13 a2 00 40 0a 01 27 28 00", "84"),
        (zigbee, "7e 00 2e 90 00 13 a2 00 40 0a 01 27 ff fe 00", "9f"),
    ];
    let payload = readings().encode_from(ORIGIN);
    for (from, head, checksum) in samples {
        let rssi = (from != zigbee).then_some(40);
        let frame = ApiFrame::Receive { from, rssi, payload: &payload };
        let expected = bytes(&format!("{head} {READINGS} {checksum}"));
        assert_eq!(&*frame.encode(Mode::Plain).unwrap(), expected);

        let mut decoded = Vec::new();
        Decoder::new(Framing::Xbee(Mode::Plain)).feed(&expected, |event| decoded.push(event));
        assert_eq!(decoded, [Event::Packet(received(readings()))]);
    }

    let start = "01 03 38 07 01 01 01 01 04 03 19 f1 00";
    let commands = [
        (Address::Short(0x2052), Mode::Plain, "7e 00 12 01 01 20 52 00", "33"),
        (Address::Short(0x2013), Mode::Escaped, "7e 00 12 01 01 20 7d 33 00", "72"),
        (Address::Long(long), Mode::Plain, "7e 00 18 00 01 00 13 a2 00 40 0a 01 27 00", "7f"),
        (zigbee, Mode::Plain, "7e 00 1b 10 01 00 13 a2 00 40 0a 01 27 ff fe 00 00", "72"),
    ];
    let payload = command(Command::Start).encode();
    for (to, mode, head, checksum) in commands {
        let frame = ApiFrame::Transmit { id: 1, to, payload: &payload };
        let expected = bytes(&format!("{head} {start} {checksum}"));
        assert_eq!(&*frame.encode(mode).unwrap(), expected);
    }
}

#[test]
fn packets_of_other_versions_and_kinds_are_distinguished_from_damage() {
    let mut decoder = Decoder::new(Framing::Cobs);
    let mut events = Vec::new();
    decoder.feed(&bytes("01 03 44 02 08 6c 61 74 65 72 fa ff 00"), |event| events.push(event));
    decoder.feed(&bytes("01 03 3f 02 07 55 c6 17 2a f2 19 00"), |event| events.push(event));
    assert_eq!(events, [Event::OtherVersion { version: 4, command: false }]);
    let counters = decoder.counters;
    assert_eq!((counters.unknown_version, counters.unknown_kind), (1, 1));
    assert_eq!((counters.packets, counters.bad_crc, counters.malformed), (0, 0, 0));
}

#[test]
fn commands_with_arguments_that_are_not_theirs_are_unknown_commands() {
    // 0x03 (start) with an argument; 0x05 (period) with one byte; made as above.
    for (hex, code) in [
        ("01 03 38 07 09 55 c6 5f 92 03 01 d6 12 00", 3),
        ("01 03 38 07 09 55 c6 5f 92 05 01 34 5e 00", 5),
    ] {
        let frame = bytes(hex);
        let packet = Packet::decode(&frame[..frame.len() - 1]);
        assert_eq!(packet, Ok(received(addressed(Command::Unknown(code)))), "{hex}");
    }
}

#[test]
fn packets_of_newer_boards_are_read_as_far_as_known() {
    let answer_in = |hex| {
        let frame = bytes(hex);
        match Packet::decode(&frame[..frame.len() - 1]) {
            Ok(ReceivedPacket { packet: Packet::Answer { number: 7, answer }, .. }) => answer,
            other => panic!("{other:?}"),
        }
    };
    // Made as above: refusal 200 with three more bytes, board 200, answer 200 with three bytes.
    let refusal = answer_in("01 03 39 07 0c 55 c6 17 2a 03 c8 61 62 63 f6 15 00");
    assert_eq!(refusal, Answer::Refused(Refusal::Other(200)));
    let board = answer_in(
        "01 03 39 07 07 55 c6 17 2a 01 c8 02 01 0f 01 02 03 04 05 06 07 08 09 0a 0b 0c e8 \
             03 01 03 e8 93 00",
    );
    let Answer::Identity(identity) = board else { panic!("{board:?}") };
    assert_eq!((identity.board, identity.serial), (Board::Other(200), SERIAL));
    let answer = answer_in("01 03 39 07 0b 55 c6 17 2a c8 61 62 63 d7 3a 00");
    assert_eq!(answer, Answer::Other(200));
}

/// Checks the lengths in the README.
#[test]
fn a_sample_of_any_readings_takes_at_most_44_bytes() {
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
        let origin = PacketOrigin { board: value(), start: value() };
        let frame = Packet::Sample(sample).encode_from(origin);
        assert_eq!(frame.len(), 34);
        let from = Address::Short(0x2052);
        let received = ApiFrame::Receive { from, rssi: Some(40), payload: &frame };
        let sent = ApiFrame::Transmit { id: 0, to: from, payload: &frame };
        for frame in [received, sent] {
            assert_eq!(frame.encode(Mode::Plain).unwrap().len(), 43);
            assert!(frame.encode(Mode::Escaped).unwrap().len() <= 44);
        }
    }
}
