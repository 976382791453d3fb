use proptest::prelude::*;
use shared_proto::xbee::{Address, ApiFrame};
use shared_proto::{
    Answer, Board, BoardId, Boot, Command, Decoder, Edge, Event, Framing, Health, Identity,
    MAX_PIECE, Packet, Piece, Refusal, ResetCause, Sample, Status, Stream, Timing, Values, Vitals,
};

pub fn on_the_wire(packet: &Packet, framing: Framing) -> Vec<u8> {
    let payload = packet.encode();
    match framing {
        Framing::Cobs => payload.to_vec(),
        Framing::Xbee(mode) => {
            let from = Address::Short(0x2052);
            let frame = ApiFrame::Receive { from, rssi: Some(40), payload: &payload };
            frame.encode(mode).expect("a short payload").to_vec()
        }
    }
}

pub fn decode(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Event> {
    let mut events = Vec::new();
    decoder.feed(bytes, |event| events.push(event));
    events
}

pub fn any_sample() -> impl Strategy<Value = Sample> {
    let values = prop_oneof![
        any::<[u16; 8]>().prop_map(Values::Readings),
        any::<[f32; 6]>().prop_map(Values::Wrench),
    ];
    (any::<(u16, u32, u8, u8)>(), values).prop_map(
        |((sequence, clock_us, saturated, dropped), values)| Sample {
            sequence,
            clock_us,
            values,
            saturated,
            dropped,
        },
    )
}

fn any_command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Identify),
        Just(Command::Status),
        Just(Command::Start),
        Just(Command::Stop),
        Just(Command::CommitCalibration),
        any::<u32>().prop_map(|period_us| Command::SetPeriod { period_us }),
        any::<u8>().prop_map(|conversions| Command::SetOversampling { conversions }),
        any::<u16>().prop_map(|settling_us| Command::SetSettling { settling_us }),
        any_stream().prop_map(Command::SetStream),
        any::<(u32, u32)>().prop_map(|(size, crc32)| Command::BeginCalibration { size, crc32 }),
        (any::<u16>(), prop::collection::vec(any::<u8>(), 0..=MAX_PIECE)).prop_map(
            |(offset, data)| {
                Command::CalibrationPiece { offset, data: Piece::copy_of(&data).expect("it fits") }
            }
        ),
        any::<u16>().prop_map(|frames| Command::Zero { frames }),
        any::<u16>().prop_map(|offset| Command::LastWords { offset }),
        any::<u8>().prop_map(|emitter| Command::SelfTest { emitter }),
        any::<u32>().prop_map(|baud| Command::SetBaud { baud }),
        Just(Command::Bootloader),
        (0x13_u8..).prop_map(Command::Unknown),
    ]
}

fn any_stream() -> impl Strategy<Value = Stream> {
    (0..32_u8).prop_map(|code| Stream::from_code(code).expect("it has no fields"))
}

fn any_answer() -> impl Strategy<Value = Answer> {
    prop_oneof![
        Just(Answer::Done),
        any_refusal().prop_map(Answer::Refused),
        (any_board(), any::<([u8; 3], [u8; 12], u32)>()).prop_map(
            |(board, (firmware, serial, min_period_us))| {
                Answer::Identity(Identity { board, firmware, serial, min_period_us })
            }
        ),
        (any_stream(), any_cause(), any::<([bool; 3], [u32; 5], u8, [u16; 4], u32)>()).prop_map(
            |(stream, reset_cause, (flags, counts, conversions, shorts, crc))| {
                Answer::Status(Status {
                    streaming: flags[0],
                    calibrated: flags[1],
                    zeroed: flags[2],
                    stream,
                    reset_cause,
                    period_us: counts[0],
                    conversions,
                    settling_us: shorts[0],
                    uptime_s: counts[1],
                    frames: counts[2],
                    late: counts[3],
                    overflowed: counts[4],
                    damaged: shorts[1],
                    longest_frame_us: shorts[2],
                    calibration_crc32: crc,
                    foreign: shorts[3],
                })
            }
        ),
        (any::<u16>(), prop::collection::vec(any::<u8>(), 0..=MAX_PIECE)).prop_map(
            |(len, text)| {
                Answer::LastWords { len, text: Piece::copy_of(&text).expect("it fits") }
            }
        ),
        any::<(u8, [i16; 8])>().prop_map(|(emitter, rise)| Answer::SelfTest { emitter, rise }),
        (0x07_u8..).prop_map(Answer::Other),
    ]
}

fn any_board() -> impl Strategy<Value = Board> {
    any::<u8>().prop_map(|code| Board::from_code(code).expect("it has no fields"))
}

fn any_cause() -> impl Strategy<Value = ResetCause> {
    any::<u8>().prop_map(|code| ResetCause::from_code(code).expect("it has no fields"))
}

fn any_refusal() -> impl Strategy<Value = Refusal> {
    let simple = [
        Refusal::UnknownCommand,
        Refusal::OtherVersion,
        Refusal::OutOfRange,
        Refusal::NoCalibration,
        Refusal::NoUpload,
        Refusal::WrongOffset,
        Refusal::WrongSize,
        Refusal::WrongCrc,
        Refusal::BadCalibration,
        Refusal::StorageFailed,
        Refusal::Streaming,
        Refusal::NotOnThisBoard,
    ];
    prop_oneof![
        prop::sample::select(simple.to_vec()),
        any::<u32>().prop_map(|shortest_us| Refusal::PeriodTooShort { shortest_us }),
        any::<u32>().prop_map(|shortest_us| Refusal::LineTooSlow { shortest_us }),
        (18_u8..).prop_map(Refusal::Other),
    ]
}

fn any_to() -> impl Strategy<Value = Option<BoardId>> {
    any::<Option<[u8; 12]>>().prop_map(|serial| serial.map(|serial| BoardId::from_serial(&serial)))
}

fn any_health() -> impl Strategy<Value = Health> {
    let vitals = any::<(Option<i16>, Option<u16>, Option<u16>)>();
    (any::<(u16, u32, u16, u16)>(), vitals, any::<[u16; 8]>()).prop_map(
        |((sequence, clock_us, first_us, step_us), (temperature, supply, reference), dark)| {
            let vitals = Vitals {
                temperature_cdeg: temperature.filter(|&it| it != i16::MIN),
                supply_mv: supply.filter(|&it| it != 0),
                reference: reference.filter(|&it| it != 0),
            };
            Health { sequence, clock_us, timing: Timing { first_us, step_us }, vitals, dark }
        },
    )
}

pub fn any_packet() -> impl Strategy<Value = Packet> {
    prop_oneof![
        4 => any_sample().prop_map(Packet::Sample),
        1 => any_health().prop_map(Packet::Health),
        1 => any::<(u16, u32)>()
            .prop_map(|(number, clock_us)| Packet::Edge(Edge { number, clock_us })),
        2 => (any::<u16>(), any_to(), any_command())
            .prop_map(|(number, to, command)| Packet::Command { number, to, command }),
        2 => (any::<u16>(), any_answer())
            .prop_map(|(number, answer)| Packet::Answer { number, answer }),
        1 => (any_board(), any::<[u8; 3]>(), any_cause())
            .prop_map(|(board, firmware, cause)| Packet::Boot(Boot { board, firmware, cause })),
    ]
}
